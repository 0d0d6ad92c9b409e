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
    for_near(p, w, x, y, p.touch_reach, [&](int, int j, float d2) {
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
  for_near(p, w, w.x[i], w.y[i], p.start_reach, [&](int, int j, float d2) {
    if (!(d2 < p.collision_range2 + kStartMargin) || j == i) return;
    const float dz = w.z[i] - w.z[j];
    crowded |= (dz < 0 ? -dz : dz) < p.collision_altitude + kStartMargin;
  });
  w.flags[i] = static_cast<uint8_t>(crowded ? w.flags[i] | kNeedsResample : w.flags[i] & ~kNeedsResample);
  if (crowded) draw_place(p, w, draws, round, i);
}

/// Calls f(place, observer, sighting) for the opponents of target a that detect it.
template <class Draws, class F>
GIGA_HD void for_detectors(const GridParams& p, const GridWorld& w, Draws& draws, int a, const uint8_t* could_see,
                           F&& f) {
  const int team = 1 - p.team_of(a);
  for_near(p, w, w.x[a], w.y[a], p.sight_reach[team], [&](int k, int b, float) {
    if (p.team_of(b) != team || !could_see[b]) return;
    const Sighting s = sight(p, w, a, b, [&] { return draws.detect(a, b); });
    if (s.detected) f(k, b, s);
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

/// The list of those that detect an agent; it has one if it was placed, and else it is not asked for.
GIGA_HD int32_t* kept_detectors(const GridWorld& w, int a) {
  return w.detectors + static_cast<int64_t>(w.place[a]) * kKeptDetectors;
}

/// Rules 4.4 and 4.5, and 17.2 for the list of fire.
template <class Draws>
GIGA_HD void detect_and_track(const GridParams& p, GridWorld& w, Draws& draws, int a) {
  uint32_t* list = w.fire + static_cast<int64_t>(a) * p.most_shooters;
  int32_t* kept = kept_detectors(w, a);
  const FireList before(list, p.most_shooters);
  uint32_t now[kMostShooters];
  now[0] = 0;
  int n_now = 0, observers = 0, taken = 0;
  bool full = false;
  if (w.could_see[a])
    for_detectors(p, w, draws, a, w.could_see, [&](int k, int b, const Sighting& s) {
      if (observers < kKeptDetectors) kept[observers] = k;
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
  int32_t* kept = kept_detectors(w, a);
  int observers = 0;
  w.could_see[a] = w.alive[a];
  for_detectors(p, w, draws, a, w.alive, [&](int k, int, const Sighting&) {
    if (observers < kKeptDetectors) kept[observers] = k;
    ++observers;
  });
  w.observers[a] = observers;
}

/// Notes with the placed agents what they are asked first. Before `listen` and `look`.
template <class Lanes>
GIGA_HD void mark_placed(const Lanes& lanes, const GridParams& p, GridWorld& w, int n) {
  lanes.each(n > 0 ? w.cell_begin[w.grid.cells()] : 0, [&](int k) {
    const int i = w.placed[k].agent, observers = w.observers[i];
    const int told = observers <= kKeptDetectors ? observers : kKeptDetectors + 1;
    w.placed[k].marks = (w.alive[i] ? kLives : 0u) | (observers > 0 ? kObserved : 0u) |
                        (p.team_of(i) == 1 ? kOfTeam1 : 0u) | static_cast<uint32_t>(told) << kObserversShift;
  });
}

template <class Lanes>
GIGA_HD void mark_agents(const Lanes& lanes, const GridParams& p, GridWorld& w, int n) {
  mark_placed(lanes, p, w, n);
}

GIGA_HD int team_of(const PlacedAgent& a) { return (a.marks & kOfTeam1) ? 1 : 0; }

/// The nearest of the agents that are shown to it, for the rows of an observation. An agent is a key: its squared
/// distance, whose lowest bits give way to the number of the slot in which its place is kept. Keys in registers and no
/// branches, so that the lanes of a warp, each with an agent of its own, keep in step; a new one takes two instructions
/// a row. Where keys lie so near each other that they leave open who comes first, whoever reads them looks closer:
/// squares whose roots are equal lie within four of the smallest steps.
class NearestAgents {
 public:
  static constexpr int kMost = 14;  ///< all others of a row of the usual length
  /// Of all keys, and one that is free. An array apart from the keys: where one is addressed by numbers that are not
  /// constants, it lies in memory as a whole.
  static constexpr int kSlots = 16;
  using Slots = int[kSlots];

  GIGA_HD NearestAgents() {
    // Keys of nobody lie behind all others, and far from each other.
    GIGA_UNROLL
    for (uint32_t k = 0; k <= kMost; ++k) key_[k] = kNobodyKey + k * 2 * kUnclear + k;
  }
  /// Whether an agent at that squared distance may be one of them.
  GIGA_HD bool wants(float d2) const { return float_bits(d2) < key_[kMost - 1] + kUnclear; }
  GIGA_HD void take(float d2, int place, Slots& slots) {
    slots[free_] = place;
    const uint32_t key = (float_bits(d2) & ~kSlotBits) | free_;
    free_ = max_of(key_[kMost], key) & kSlotBits;  // of the one that is left out
    // No step waits for another: by old values alone.
    GIGA_UNROLL
    for (int k = kMost; k > 0; --k) key_[k] = max_of(key_[k - 1], min_of(key_[k], key));
    key_[0] = min_of(key_[0], key);
  }
  /// Whether agents that lie that far off, or farther, are not among them.
  GIGA_HD bool all_nearer_than(float distance) const {
    const float d = distance * 0.9999f;
    return distance > 0 && key_[kMost - 1] < kNobodyKey && float_bits(d * d) > (key_[kMost - 1] | kSlotBits);
  }
  /// The place of number k; -1 = there is none.
  GIGA_HD int place(int k, const Slots& slots) const { return key_[k] < kNobodyKey ? slots[key_[k] & kSlotBits] : -1; }
  /// Bit k: whether number k + 1 might come before number k. One that is left out might, in the place of the last.
  GIGA_HD uint32_t unclear() const {
    uint32_t bits = 0;
    GIGA_UNROLL
    for (int k = 0; k < kMost; ++k) bits |= key_[k + 1] - key_[k] < kUnclear ? 1u << k : 0u;
    return bits;
  }

 private:
  static constexpr uint32_t kSlotBits = kSlots - 1, kUnclear = 2 * kSlots, kNobodyKey = 0x80000000u;
  static_assert(kSlots >= kMost + 2);
  GIGA_HD static uint32_t min_of(uint32_t a, uint32_t b) { return b < a ? b : a; }
  GIGA_HD static uint32_t max_of(uint32_t a, uint32_t b) { return b > a ? b : a; }

  uint32_t key_[kMost + 1];  // the last only to be compared with the one before
  uint32_t free_ = kMost + 1;
};

/// How rows are ordered: by distance from a place, equally near ones by number.
struct RowOrder {
  float x, y;
  struct Rank {
    float distance;
    uint32_t agent;
    GIGA_HD bool before(const Rank& other) const {
      return distance < other.distance || (distance == other.distance && agent < other.agent);
    }
  };
  GIGA_HD Rank rank(const PlacedAgent& a) const {
    return {order_distance(a.x - x, a.y - y), static_cast<uint32_t>(a.agent)};
  }
  GIGA_HD Rank rank(const GridWorld& w, AgentNumber a) const {
    return {order_distance(w.x[a] - x, w.y[a] - y), a.value};
  }
  /// Moves the agent of row k forward to where it belongs among those before it.
  GIGA_HD void sink(const GridWorld& w, AgentNumber* rows, int k) const {
    GIGA_ROLLED
    for (; k > 0 && rank(w, rows[k]).before(rank(w, rows[k - 1])); --k) {
      const AgentNumber other = rows[k - 1];
      rows[k - 1] = rows[k];
      rows[k] = other;
    }
  }
};

/// What is said about an agent that may have a row.
enum class Answer { no, yes, ask_again };

/// The same as rank_seen does, one by one and with nothing but distances and numbers: where keys leave open who has the
/// last row. `rows`: [most], of agents behind `after`.
template <class Seen>
GIGA_HD void rank_exactly(const GridParams& p, const GridWorld& w, int e, float reach, const RowOrder& order,
                          RowOrder::Rank after, const Seen& seen, AgentNumber* rows, int most) {
  int n = 0;
  const auto last = [&] { return order.rank(w, rows[n - 1]); };
  for_rings(
      p, w, order.x, order.y, 1,
      [&](float far) { return far > reach || (n == most && far * 0.9999f > last().distance); },
      [&](int k) {
        const PlacedAgent a = w.placed[k];
        const RowOrder::Rank rank = order.rank(a);
        if (a.agent == e || !after.before(rank) || (n == most && !rank.before(last()))) return;
        if (!seen.worth_asking(a, planar_distance2(w, e, a.agent))) return;
        Answer answer = Answer::ask_again;
        GIGA_ROLLED
        for (int turn = 0; answer == Answer::ask_again; ++turn) answer = seen.ask(a, k, turn);
        if (answer == Answer::no) return;
        if (n < most) ++n;
        rows[n - 1] = AgentNumber{rank.agent};
        order.sink(w, rows, n - 1);
      });
  for (; n < most; ++n) rows[n] = kNobody;
}

/// The agents of e's rows (rules 7.1), nearest first, equally near ones by number: of those that `seen` says yes to,
/// which are asked only if they would have a row, and of which none lies beyond `reach`. Looks no farther than the last
/// row. Longer rows than the usual are put together of several searches. By turns agents are listed and those listed
/// are asked: each is a short loop, so that workers with agents of their own are in the same one.
///   seen.worth_asking(placed agent, squared distance)   what can be told at once
///   seen.ask(placed agent, its place, turn)             turn 0, 1, ... while it says ask_again
template <class Seen>
GIGA_HD void rank_seen(const GridParams& p, GridWorld& w, int e, float reach, bool sees_itself, const Seen& seen) {
  constexpr int kListed = 32, kMost = NearestAgents::kMost;
  const int limit = p.n_neighbors;
  AgentNumber* rows = w.neighbors + static_cast<int64_t>(e) * limit;
  rows[0] = AgentNumber{static_cast<uint32_t>(e)};
  if (!sees_itself) rows[0] = kNobody;
  const RowOrder order{w.x[e], w.y[e]};
  const int column = w.grid.column(order.x), row = w.grid.row(order.y);
  // Where agents are crowded the next cells hold enough of them, and where they are far apart nobody beyond matters.
  int crowd = 0;
  const int left = column > 0 ? column - 1 : 0, right = column + 1 < w.grid.columns ? column + 1 : column;
  for (int at = row > 0 ? row - 1 : 0; at <= row + 1 && at < w.grid.rows; ++at) {
    const CellRange range = w.cells(at, left, right);
    crowd += range.end - range.begin;
  }
  const bool all = min_of(w.grid.size_x, w.grid.size_y) - p.margin > reach;
  const int first = !all && crowd < 2 * kMost ? 2 : 1;
  RowOrder::Rank after{-1, 0};
  GIGA_ROLLED
  for (int done = 1; done < limit; done += kMost) {
    const int most = limit - done < kMost ? limit - done : kMost;
    NearestAgents nearest;
    NearestAgents::Slots slots;
    Rings rings(p, w, order.x, order.y, first);
    int list[kListed];
    bool more = true;
    GIGA_ROLLED
    while (more) {
      int n = 0;
      GIGA_ROLLED
      while (n < kListed) {
        const int k = rings.next();
        if (k < 0) {
          if (n > 0) break;  // who has been listed decides whether any beyond matter
          const float far = rings.widen();
          more = far < INFINITY && far <= reach && !nearest.all_nearer_than(far);
          if (!more) break;
        } else {
          const PlacedAgent a = w.placed[k];
          const float dx = a.x - order.x, dy = a.y - order.y, d2 = dx * dx + dy * dy;
          list[n] = k;
          bool wanted = nearest.wants(d2) && a.agent != e && seen.worth_asking(a, d2);
          if (done > 1) wanted = wanted && after.before(order.rank(a));
          n += wanted ? 1 : 0;
        }
      }
      int at = 0, turn = 0;
      GIGA_ROLLED
      while (at < n) {
        const int k = list[at];
        const PlacedAgent a = w.placed[k];
        const Answer answer = seen.ask(a, k, turn);
        const float dx = a.x - order.x, dy = a.y - order.y;
        if (answer == Answer::yes) nearest.take(dx * dx + dy * dy, k, slots);
        turn = answer == Answer::ask_again ? turn + 1 : 0;
        at += answer == Answer::ask_again ? 0 : 1;
      }
    }
    AgentNumber* to = rows + done;
    GIGA_UNROLL
    for (int k = 0; k < kMost; ++k) {
      const int place = nearest.place(k, slots);
      if (k < most) to[k] = AgentNumber{place < 0 ? kNoAgent : static_cast<uint32_t>(w.placed[place].agent)};
    }
    uint32_t unclear = nearest.unclear();
    if (unclear != 0) {  // hardly ever
      unclear &= (1u << most) - 1u;
      if (unclear >> (most - 1) != 0)
        rank_exactly(p, w, e, reach, order, after, seen, to, most);
      else
        for (; unclear != 0; unclear &= unclear - 1) order.sink(w, to, lowest_bit(unclear) + 1);
    }
    if (done + kMost >= limit) return;
    if (to[kMost - 1] == kNobody) {
      for (int k = done + kMost; k < limit; ++k) rows[k] = kNobody;
      return;
    }
    after = order.rank(w, to[kMost - 1]);
  }
}

/// Whom an agent hears, and is told of by whom it hears.
template <class Draws>
struct Listener {
  const GridParams& p;
  const GridWorld& w;
  Draws& draws;
  int e, team;
  float x, y;  // of e
  bool after_reset;

  GIGA_HD bool in_earshot(float d2) const { return d2 <= p.hearing_reach * p.hearing_reach; }
  GIGA_HD bool worth_asking(const PlacedAgent& a, float d2) const {
    return team_of(a) == team ? (a.marks & kLives) && in_earshot(d2) : (a.marks & kObserved) != 0;
  }
  /// Whether it hears one of its team; itself if it lives.
  GIGA_HD bool hears(const PlacedAgent& b) const {
    const float dx = b.x - x, dy = b.y - y, d2 = dx * dx + dy * dy;
    if (!(b.marks & kLives) || !in_earshot(d2)) return false;
    const float draw = draws.comm(e, b.agent, after_reset);
    const Hearing rough = roughly_hears_at(p, d2, draw);
    return b.agent == e || (rough.clear ? rough.heard : hears_at(p, d2, draw));
  }
  /// About a mate: whether it is heard. About an opponent: whether one that detects it is, turn by turn. One place in
  /// the code where they are, so that workers that ask about both need not wait for each other.
  GIGA_HD Answer ask(const PlacedAgent& a, int k, int turn) const {
    const bool mate = team_of(a) == team;
    if (!mate && turn == kKeptDetectors) return told_by_any(a) ? Answer::yes : Answer::no;
    const int sender = mate ? k : w.detectors[static_cast<int64_t>(k) * kKeptDetectors + turn];
    if (hears(w.placed[sender])) return Answer::yes;
    return mate || turn + 1 == static_cast<int>(a.marks >> kObserversShift) ? Answer::no : Answer::ask_again;
  }
  /// Of all that detect it, where they are more than are kept.
  GIGA_HD bool told_by_any(const PlacedAgent& a) const {
    bool told = false;
    for_near(p, w, a.x, a.y, p.sight_reach[team], [&](int k, int b, float) {
      if (told || p.team_of(b) != team || !w.could_see[b] || !hears(w.placed[k])) return;
      told = sight(p, w, a.agent, b, [&] { return draws.detect(a.agent, b); }).detected;
    });
    return told;
  }
};

/// Rules 6 and 7.1 with stochastic communication: whom e sees decides who hears whom, asked for those agents alone that
/// may have a row.
template <class Draws>
GIGA_HD void listen(const GridParams& p, GridWorld& w, Draws& draws, int e, bool after_reset) {
  const int team = p.team_of(e);
  rank_seen(p, w, e, p.hearing_reach + p.sight_reach[team] + p.margin, w.alive[e] != 0,
            Listener<Draws>{p, w, draws, e, team, w.x[e], w.y[e], after_reset});
}

/// Whom an agent sees where all mates are heard.
struct Onlooker {
  int team;
  GIGA_HD bool worth_asking(const PlacedAgent& a, float) const {
    return (team_of(a) == team && (a.marks & kLives)) || (a.marks & kObserved);
  }
  GIGA_HD Answer ask(const PlacedAgent&, int, int) const { return Answer::yes; }
};

/// The same without it: all living mates, and whomever anybody detects.
GIGA_HD void look(const GridParams& p, GridWorld& w, int e) {
  if (p.stochastic_communication) return;  // `listen` has seen to it
  rank_seen(p, w, e, INFINITY, w.alive[e] || w.observers[e] > 0, Onlooker{p.team_of(e)});
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
      [&](int k) {
        const int a = w.placed[k].agent;
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
  for (int i = p.n_agents - 1; i >= 0; --i) {
    w.place[i] = w.alive[i] ? --w.cell_begin[w.grid.cell_of(w.x[i], w.y[i]) + 1] : kNotPlaced;
    if (w.alive[i]) w.placed[w.place[i]] = {w.x[i], w.y[i], i, 0};
  }
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
