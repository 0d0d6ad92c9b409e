// What the stages that look at pairs do in a world of many agents (GridWorld): overloads of the functions of the same
// names, which step.hpp calls. Formulas are those that all executors share; only whom they are asked about differs.
// Some short ones stand here once more, because they lie around the loops over tables: place_agent, propose_place,
// collisions, track and hears_mate. tests/parity/grid_test.cpp holds both to the same bits.
#pragma once

#include "sim/communication.hpp"
#include "sim/episode.hpp"
#include "sim/grid.hpp"
#include "sim/observations.hpp"
#include "sim/reset.hpp"
#include "sim/rewards.hpp"
#include "sim/sight.hpp"

namespace giga {

/// Adds to a number that other workers add to as well.
GIGA_HD void add_together(int32_t* sum, int32_t value) {
#if defined(__CUDA_ARCH__)
  atomicAdd(sum, value);
#else
  __atomic_fetch_add(sum, value, __ATOMIC_RELAXED);
#endif
}

/// Rules 4.3.2 and 4.3.3. All that are found lived when they were sorted, which is what the formulas ask; who lives on
/// is written elsewhere, so that no agent waits for the others.
GIGA_HD void check_collisions(const GridParams& p, GridWorld& w, int i) {
  const float x = w.x[i], y = w.y[i], z = w.z[i];
  bool lives = w.alive[i] != 0;
  if (lives) {
    bool hit = false;
    for_near(p, w, x, y, p.touch_reach, [&](int j, float d2) {
      if (!(d2 < p.collision_range2) || j == i) return;
      const float dz = z - w.z[j];
      hit |= (dz < 0 ? -dz : dz) < p.collision_altitude;
    });
    if (hit) {
      w.flags[i] |= kHitAgent;
      lives = false;
    }
  }
  if (p.n_boxes > 0 && inside_obstacle(p, w, x, y, z, 0.0f)) {
    w.flags[i] |= kHitObstacle;
    lives = false;
  }
  w.could_see[i] = lives ? 1 : 0;
}
template <class Lanes>
GIGA_HD void check_collisions(const Lanes& lanes, const GridParams& p, GridWorld& w, int n) {
  each_by_place(lanes, p, w, n, [&](int i) { check_collisions(p, w, i); });
}

/// Rules 4.5, of who has not collided.
GIGA_HD void update_health(const GridParams& p, GridWorld& w, int i) {
  w.alive[i] = w.could_see[i];
  update_health(p, static_cast<WorldView&>(w), i);
}

/// Rules 9.1.
template <class Draws>
GIGA_HD void place_agent(const GridParams& p, GridWorld& w, Draws& draws, int i) {
  const StartArea& area = start_area(p, w, i);
  draw_place(p, w, draws, 0, i);
  take_place(p, w, i);
  w.v[i] = 1.0f;
  w.heading[i] = area.heading_lo + draws.start(i, 0, StartDraw::heading) * (area.heading_hi - area.heading_lo);
  w.health[i] = p.original() ? 1.0f : p.agents.max_health[i];
  w.alive[i] = 1;
  w.death[i] = Death::none;
  w.flags[i] = 0;
  uint32_t* fire = w.fire + static_cast<int64_t>(i) * p.most_shooters;
  for (int k = 0; k < p.most_shooters; ++k) fire[k] = 0;
  w.observers[i] = 0;
  face(w, i);
}

/// Rules 9.2.
template <class Draws>
GIGA_HD void propose_place(const GridParams& p, GridWorld& w, Draws& draws, int round, int i) {
  bool crowded = inside_obstacle(p, w, w.x[i], w.y[i], w.z[i], kStartMargin);
  for_near(p, w, w.x[i], w.y[i], p.start_reach, [&](int j, float d2) {
    if (!(d2 < p.collision_range2 + kStartMargin) || j == i) return;
    const float dz = w.z[i] - w.z[j];
    crowded |= (dz < 0 ? -dz : dz) < p.collision_altitude + kStartMargin;
  });
  w.flags[i] = static_cast<uint8_t>(crowded ? w.flags[i] | kNeedsResample : w.flags[i] & ~kNeedsResample);
  if (crowded) draw_place(p, w, draws, round, i);
}

/// Calls f(observer, sighting) for the opponents of target a that detect it.
template <class Draws, class F>
GIGA_HD void for_detectors(const GridParams& p, const GridWorld& w, Draws& draws, int a, const uint8_t* could_see,
                           F&& f) {
  const int team = 1 - p.team_of(a);
  for_near(p, w, w.x[a], w.y[a], p.sight_reach[team], [&](int b, float) {
    if (p.team_of(b) != team || !could_see[b]) return;
    const Sighting s = sight(p, w, a, b, [&] { return draws.detect(a, b); });
    if (s.detected) f(b, s);
  });
}

/// The counters of those who fire at an agent, by the number of the shooter.
class FireList {
 public:
  GIGA_HD FireList(const uint32_t* entries, int most) : entries_(entries), most_(most) {
    while (size_ < most && entries[size_] != 0) ++size_;
  }
  GIGA_HD int size() const { return size_; }
  GIGA_HD int count(int shooter) const {
    for (int k = 0; k < size_; ++k)
      if (shooter_of(entries_[k]) == shooter) return count_of(entries_[k]);
    return 0;
  }

 private:
  const uint32_t* entries_;
  int most_, size_ = 0;
};

/// The counter of an opponent that fired `before` times in a row, after a sighting.
GIGA_HD int track(int before, const Sighting& s) {
  return s.detected && s.in_weapon_range ? (before < 255 ? before + 1 : 255) : 0;
}

/// Rules 4.4 and 4.5, and 17.2 for the list of fire.
template <class Draws>
GIGA_HD void detect_and_track(const GridParams& p, GridWorld& w, Draws& draws, int a) {
  uint32_t* list = w.fire + static_cast<int64_t>(a) * p.most_shooters;
  int32_t* kept = w.detectors + static_cast<int64_t>(a) * kKeptDetectors;
  const FireList before(list, p.most_shooters);
  uint32_t now[kMostShooters];
  now[0] = 0;
  int n_now = 0, observers = 0, taken = 0;
  bool full = false;
  if (w.could_see[a])
    for_detectors(p, w, draws, a, w.could_see, [&](int b, const Sighting& s) {
      if (observers < kKeptDetectors) kept[observers] = b;
      ++observers;
      add_together(w.detects + b, 1);
      const int count = track(before.count(b), s);
      if (count == 0) return;
      if (n_now == p.most_shooters) {
        full = true;
        return;
      }
      int at = n_now++;
      for (; at > 0 && shooter_of(now[at - 1]) > b; --at) now[at] = now[at - 1];
      now[at] = fire_entry(b, count);
      const int units = damage_units(p, count);
      taken += units;
      if (units > 0) add_together(w.dealt + b, units);
    });
  for (int k = 0; k < n_now; ++k) list[k] = now[k];
  for (int k = n_now; k < before.size(); ++k) list[k] = 0;
  w.observers[a] = observers;
  if (full) add_together(w.full_lists, 1);
  w.taken[a] = static_cast<float>(taken);
  if (taken > 0) w.flags[a] |= kTookDamage;
}

template <class Draws>
GIGA_HD void detect_only(const GridParams& p, GridWorld& w, Draws& draws, int a) {
  int32_t* kept = w.detectors + static_cast<int64_t>(a) * kKeptDetectors;
  int observers = 0;
  w.could_see[a] = w.alive[a];
  for_detectors(p, w, draws, a, w.alive, [&](int b, const Sighting&) {
    if (observers < kKeptDetectors) kept[observers] = b;
    ++observers;
  });
  w.observers[a] = observers;
}

/// Notes with the placed agents what they are asked first. Before `listen` and `look`.
template <class Lanes>
GIGA_HD void mark_placed(const Lanes& lanes, GridWorld& w, int n) {
  lanes.each(n > 0 ? w.cell_begin[w.grid.cells()] : 0, [&](int k) {
    const int i = w.placed[k].agent;
    w.placed[k].marks = (w.alive[i] ? kLives : 0u) | (w.observers[i] > 0 ? kObserved : 0u);
  });
}

template <class Lanes>
GIGA_HD void mark_agents(const Lanes& lanes, const GridParams&, GridWorld& w, int n) {
  mark_placed(lanes, w, n);
}

/// The nearest of the agents that are shown to it, in order, equally near ones by number: selections and nothing but
/// registers, so that the lanes of a warp, each with an agent of its own, keep in step.
class NearestAgents {
 public:
  static constexpr int kMost = 14;  ///< all others of a row of the usual length

  /// Of those behind the last of `before`.
  GIGA_HD NearestAgents(float distance, uint32_t agent) : after_distance_(distance), after_agent_(agent) {
    GIGA_UNROLL
    for (int k = 0; k < kMost; ++k) {
      distance_[k] = INFINITY;
      agent_[k] = kNoAgent;
    }
  }
  GIGA_HD bool wants(float distance, uint32_t agent) const {
    return sooner(after_distance_, after_agent_, distance, agent) &&
           sooner(distance, agent, distance_[kMost - 1], agent_[kMost - 1]);
  }
  /// No step waits for another: those behind the new one move by one, by old values alone.
  GIGA_HD void take(float distance, uint32_t agent) {
    bool first[kMost];
    GIGA_UNROLL
    for (int k = 0; k < kMost; ++k) first[k] = sooner(distance, agent, distance_[k], agent_[k]);
    GIGA_UNROLL
    for (int k = kMost - 1; k > 0; --k) {
      distance_[k] = first[k - 1] ? distance_[k - 1] : first[k] ? distance : distance_[k];
      agent_[k] = first[k - 1] ? agent_[k - 1] : first[k] ? agent : agent_[k];
    }
    distance_[0] = first[0] ? distance : distance_[0];
    agent_[0] = first[0] ? agent : agent_[0];
  }
  GIGA_HD uint32_t agent(int k) const { return agent_[k]; }
  /// Of the last, infinite where there is room.
  GIGA_HD float farthest() const { return distance_[kMost - 1]; }
  GIGA_HD uint32_t last() const { return agent_[kMost - 1]; }

 private:
  GIGA_HD static bool sooner(float d1, uint32_t a1, float d2, uint32_t a2) { return d1 < d2 || (d1 == d2 && a1 < a2); }

  float distance_[kMost], after_distance_;
  uint32_t agent_[kMost], after_agent_;
};

/// The agents of e's rows (rules 7.1), nearest first, equally near ones by number: of those for which seen(placed
/// agent, distance) holds, which are asked only if they would have a row, and of which none lies beyond `reach`. Looks
/// no farther than the last row. Longer rows than the usual are put together of several searches.
template <class Seen>
GIGA_HD void rank_seen(const GridParams& p, GridWorld& w, int e, float reach, bool sees_itself, Seen&& seen) {
  const int limit = p.n_neighbors;
  AgentNumber* rows = w.neighbors + static_cast<int64_t>(e) * limit;
  rows[0] = AgentNumber{static_cast<uint32_t>(e)};
  if (!sees_itself) rows[0] = kNobody;
  const float x = w.x[e], y = w.y[e];
  const int column = w.grid.column(x), row = w.grid.row(y);
  // Where agents are crowded the next cells hold enough of them, and where they are far apart nobody beyond matters.
  int crowd = 0;
  const int left = column > 0 ? column - 1 : 0, right = column + 1 < w.grid.columns ? column + 1 : column;
  for (int at = row > 0 ? row - 1 : 0; at <= row + 1 && at < w.grid.rows; ++at) {
    const CellRange range = w.cells(at, left, right);
    crowd += range.end - range.begin;
  }
  const bool all = min_of(w.grid.size_x, w.grid.size_y) - p.margin > reach;
  const int first = !all && crowd < 2 * NearestAgents::kMost ? 2 : 1;
  float distance = -1;
  uint32_t last = 0;
  GIGA_ROLLED
  for (int done = 1; done < limit; done += NearestAgents::kMost) {
    NearestAgents nearest(distance, last);
    if (distance < INFINITY)
      for_rings(
          p, w, x, y, first, [&](float far) { return far > reach || far * 0.9999f > nearest.farthest(); },
          [&](const PlacedAgent& a) {
            const float away = order_distance(a.x - x, a.y - y);
            const uint32_t agent = static_cast<uint32_t>(a.agent);
            if (a.agent != e && nearest.wants(away, agent) && seen(a, away)) nearest.take(away, agent);
          });
    GIGA_UNROLL
    for (int k = 0; k < NearestAgents::kMost; ++k)
      if (done + k < limit) rows[done + k] = AgentNumber{nearest.agent(k)};
    distance = nearest.farthest();
    last = nearest.last();
  }
}

/// Whether an agent hears another of its team that lives, at some distance; `draw()`, below 1, is asked where chance
/// decides (rules 6).
template <class Draw>
GIGA_HD bool hears_mate(const GridParams& p, float distance, Draw&& draw) {
  const float loss = clamp(divide(distance, p.communication_range), 0.0f, 1.0f);
  return loss < 1 && loss <= draw();
}

/// Rules 6 and 7.1 with stochastic communication: whom e sees decides who hears whom, asked for those agents alone that
/// may have a row.
template <class Draws>
GIGA_HD void listen(const GridParams& p, GridWorld& w, Draws& draws, int e, bool after_reset) {
  const int team = p.team_of(e);
  const auto hears_at = [&](int b, float distance) {
    return hears_mate(p, distance, [&] { return draws.comm(e, b, after_reset); });
  };
  const auto hears = [&](int b) {
    return w.alive[b] && (b == e || hears_at(b, square_root(planar_distance2(w, e, b))));
  };
  const auto told_of = [&](const PlacedAgent& placed) {
    if (!(placed.marks & kObserved)) return false;
    const int a = placed.agent, observers = w.observers[a];
    bool told = false;
    if (observers <= kKeptDetectors) {
      const int32_t* kept = w.detectors + static_cast<int64_t>(a) * kKeptDetectors;
      for (int k = 0; k < observers && !told; ++k) told = hears(kept[k]);
      return told;
    }
    for_near(p, w, w.x[a], w.y[a], p.sight_reach[team], [&](int b, float) {
      if (told || p.team_of(b) != team || !w.could_see[b] || !hears(b)) return;
      told = sight(p, w, a, b, [&] { return draws.detect(a, b); }).detected;
    });
    return told;
  };
  rank_seen(p, w, e, p.hearing_reach + p.sight_reach[team] + p.margin, hears(e),
            [&](const PlacedAgent& a, float distance) {
              if (p.team_of(a.agent) != team) return told_of(a);
              return (a.marks & kLives) && hears_at(a.agent, distance);
            });
}

/// The same without it: all living mates, and whomever anybody detects.
GIGA_HD void look(const GridParams& p, GridWorld& w, int e) {
  if (p.stochastic_communication) return;  // `listen` has seen to it
  const int team = p.team_of(e);
  rank_seen(p, w, e, INFINITY, w.alive[e] || w.observers[e] > 0, [&](const PlacedAgent& a, float) {
    return (p.team_of(a.agent) == team && (a.marks & kLives)) || (a.marks & kObserved);
  });
}

/// The rows are ranked when it is decided whom an agent sees, and kept as state.
GIGA_HD void rank_neighbors(const GridParams&, GridWorld&, int) {}

GIGA_HD Dealt dealt_by(const GridParams&, const GridWorld& w, int i) { return {w.detects[i], w.dealt[i]}; }
GIGA_HD int observers_of(const GridParams&, const GridWorld& w, int i) { return w.observers[i]; }

/// Rules 5.4. By the table of a map with obstacles the nearest opponent need not be near: all are asked then.
GIGA_HD float way_gained(const GridParams& p, const GridWorld& w, int i) {
  if (p.maps.paths) return way_gained(p, static_cast<const WorldView&>(w), i);
  const int team = 1 - p.team_of(i);
  float nearest = -1;
  int target = -1;
  for_rings(
      p, w, w.x[i], w.y[i], 0, [&](float far) { return target >= 0 && far * 0.9999f > nearest; },
      [&](const PlacedAgent& placed) {
        const int a = placed.agent;
        if (p.team_of(a) != team || !w.alive[a]) return;
        const float way = way_to(p, w, w.x[i], w.y[i], a);
        if (target >= 0 && (way > nearest || (way == nearest && a > target))) return;
        nearest = way;
        target = a;
      });
  return target >= 0 ? way_to(p, w, w.next[i], w.next[p.n_agents + i], target) - nearest : 0.0f;
}

/// Blocks of kSumBlock agents of a team, or of so many such sums.
GIGA_HD int sum_blocks(int n) { return (n + kSumBlock - 1) / kSumBlock; }
/// All sums of an item over a team of n agents (SharedWork::sums).
GIGA_HD int sums_of_team(int n) {
  int sums = 0;
  for (int count = sum_blocks(n);; count = sum_blocks(count)) {
    sums += count;
    if (count <= kSumBlock) return sums;
  }
}

/// What an item of accumulate_episode adds up: a team's returns, or one of its terms, by its place in term_returns.
struct StepItem {
  int team, term;

  GIGA_HD StepItem(const GridParams& p, int item) {
    const int k = item - kNTeams;
    team = item < kNTeams ? item : (k >= p.n_active_terms ? 1 : 0);
    term = item < kNTeams ? -1 : active_term(p, k - team * p.n_active_terms);
  }
  /// Of agent i.
  GIGA_HD StepSum of(const GridParams& p, const GridWorld& w, int i) const {
    if (term < 0) return {w.reward[i], masked_reward(w, i)};
    return {term_of_step(p, w, term, i), 0};
  }
  GIGA_HD void add_to_episode(const GridParams& p, GridWorld& w, const StepSum& step) const {
    if (term < 0) {
      w.returns[team] += step.sum;
      w.returns_masked[team] += step.masked;
    } else {
      w.term_returns[team * kNRewardTerms + term] += scale_term(p, w, static_cast<RewardTerm>(term), step.sum);
    }
  }
};

/// Rules 17.5, by one worker.
GIGA_HD void accumulate_episode(const GridParams& p, GridWorld& w, int item) {
  constexpr int kLevels = 4;
  static_assert(kMaxGridAgents <= int64_t{kSumBlock} * kSumBlock * kSumBlock * kSumBlock);
  const StepItem what(p, item);
  StepSum level[kLevels] = {};
  const auto close = [&](int at) {
    level[at + 1] += level[at];
    level[at] = {};
  };
  for_team(p, what.team, [&](int i, int slot) {
    level[0] += what.of(p, w, i);
    for (int at = 0, n = slot + 1; at + 1 < kLevels && n % kSumBlock == 0; ++at, n /= kSumBlock) close(at);
  });
  for (int at = 0; at + 1 < kLevels; ++at) close(at);
  what.add_to_episode(p, w, level[kLevels - 1]);
}

/// How the agents of a team ended is counted in whole numbers: one by one, a float counts to 16,777,216 only.
GIGA_HD void finish_episode(const GridParams& p, GridWorld& w, int item) {
  GridParams nobody = p;
  nobody.team_after_team = true;
  nobody.n_team[0] = nobody.n_team[1] = nobody.n_agents = 0;
  finish_episode(nobody, static_cast<WorldView&>(w), item);
  if (item >= kNTeams) return;
  int ends[kNDeaths + 1] = {};
  for (int i = p.first_of(item); i < p.end_of(item); ++i)
    if (p.team_of(i) == item) ++ends[static_cast<int>(w.death[i])];
  for (int death = 0; death <= kNDeaths; ++death)
    w.stats[static_cast<int>(end_of_agent(static_cast<Death>(death))) + item] += static_cast<float>(ends[death]);
}

/// Sorts the agents that live by cell, those of a cell by number.
GIGA_HD void fill_grid(const GridParams& p, GridWorld& w) {
  int n = 0;
  float x0 = INFINITY, y0 = INFINITY, x1 = -INFINITY, y1 = -INFINITY;
  for (int i = 0; i < p.n_agents; ++i) {
    if (!w.alive[i]) continue;
    ++n;
    x0 = min_of(x0, w.x[i]), x1 = max_of(x1, w.x[i]);
    y0 = min_of(y0, w.y[i]), y1 = max_of(y1, w.y[i]);
  }
  w.grid = grid_shape(n, x0, y0, x1, y1);
  const int cells = w.grid.cells();
  for (int k = 0; k <= cells; ++k) w.cell_begin[k] = 0;
  // Counts one cell further than they belong, so that placing an agent moves the beginning of its own cell.
  for (int i = 0; i < p.n_agents; ++i)
    if (w.alive[i]) ++w.cell_begin[w.grid.cell_of(w.x[i], w.y[i]) + 1];
  for (int k = 0; k < cells; ++k) w.cell_begin[k + 1] += w.cell_begin[k];
  for (int i = p.n_agents - 1; i >= 0; --i)
    if (w.alive[i]) w.placed[--w.cell_begin[w.grid.cell_of(w.x[i], w.y[i]) + 1]] = {w.x[i], w.y[i], i, 0};
  for (int k = 0; k < cells; ++k) w.cell_begin[k] = w.cell_begin[k + 1];
  w.cell_begin[cells] = n;
}

/// The hook of step.hpp where one worker sorts; grid_sort.hpp has that of many.
template <class Lanes>
GIGA_HD void sort_agents(const Lanes& lanes, const GridParams& p, GridWorld& w, int n) {
  lanes.each_agent(n, [&](int i) {
    w.detects[i] = 0;
    w.dealt[i] = 0;
  });
  lanes.each(n > 0 ? 1 : 0, [&](int) { fill_grid(p, w); });
}

}  // namespace giga
