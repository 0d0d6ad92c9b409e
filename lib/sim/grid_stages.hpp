// What the stages that look at pairs do in a world of many agents (GridWorld): overloads of the functions of the same
// names, which step.hpp calls. Formulas are those that all executors share; only whom they are asked about differs.
// Some short ones stand here once more, because they lie around the loops over tables: place_agent, propose_place,
// collisions, track and Listener::hears. tests/parity/grid_test.cpp holds both to the same bits.
#pragma once

#include "sim/communication.hpp"
#include "sim/episode.hpp"
#include "sim/grid.hpp"
#include "sim/grid_look.hpp"
#include "sim/grid_sums.hpp"
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

/// The hook of step.hpp: all of an agent is read before anything of it is written, so that a GPU waits once for its
/// memory. Worlds of few agents, which a multiprocessor keeps to itself, are slower so: 20 vs 20 1.85 instead of
/// 1.88 G agent-steps/s (8,192 worlds, one H100).
GIGA_HD void move_agent(const GridParameters auto& p, GridWorld& w, const StepIo& io, int64_t world, int i) {
  const uint8_t lived = w.alive[i];
  const Flight from = flight_of(w, i);
  const Controls controls = read_controls(p, io.of(p.team_of(i)), world, team_row(p, world, i));
  const Flight to = flown(p, from, lived != 0, controls, table_value(p.agents.thrust + i));
  w.was_alive[i] = lived;
  w.flags[i] = 0;
  w.next[i] = from.x;
  w.next[p.n_agents + i] = from.y;
  take_flight(w, to, i);
  if (p.waypoints) touch_waypoint(p, w, i);
  check_bounds(p, w, to, i);
}

/// Rules 4.3.2 and 4.3.3. All that are found lived when they were sorted, which is what the formulas ask; who lives on
/// is written elsewhere, so that no agent waits for the others. `some`: whether the crew has an agent.
template <class Crew>
GIGA_HD void check_collisions(const Crew& crew, const GridParameters auto& p, GridWorld& w, int i, bool some) {
  const float x = w.x[i], y = w.y[i], z = w.z[i];
  bool lives = w.alive[i] != 0, hit = false;
  if (some && lives)
    for_near(crew, p, w, x, y, p.touch_reach, [&](int, int j, float d2) {
      if (!(d2 < p.collision_range2) || j == i) return;
      const float dz = z - w.z[j];
      hit |= (dz < 0 ? -dz : dz) < p.collision_altitude;
    });
  crew.meet();
  hit = crew.ballot(hit) != 0;
  if (!some || !crew.leads()) return;
  if (hit) {
    w.flags[i] |= kHitAgent;
    lives = false;
  }
  if (p.n_boxes > 0 && inside_obstacle(p, w, x, y, z, 0.0f)) {
    w.flags[i] |= kHitObstacle;
    lives = false;
  }
  w.could_see[i] = lives ? 1 : 0;
}
template <class Lanes>
GIGA_HD void check_collisions(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  each_crew_by_place(lanes, p, w, n,
                     [&](const auto& crew, int i, bool some) { check_collisions(crew, p, w, i, some); });
}

/// Rules 4.5, of who has not collided.
GIGA_HD void update_health(const GridParameters auto& p, GridWorld& w, int i) {
  w.alive[i] = w.could_see[i];
  update_health(p, static_cast<WorldView&>(w), i);
}

/// Rules 9.1.
template <class Draws>
GIGA_HD void place_agent(const GridParameters auto& p, GridWorld& w, Draws& draws, int i) {
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
GIGA_HD void propose_place(const GridParameters auto& p, GridWorld& w, Draws& draws, int round, int i) {
  bool crowded = inside_obstacle(p, w, w.x[i], w.y[i], w.z[i], kStartMargin);
  for_near(OneWorker{}, p, w, w.x[i], w.y[i], p.start_reach, [&](int, int j, float d2) {
    if (!(d2 < p.collision_range2 + kStartMargin) || j == i) return;
    const float dz = w.z[i] - w.z[j];
    crowded |= (dz < 0 ? -dz : dz) < p.collision_altitude + kStartMargin;
  });
  w.flags[i] = static_cast<uint8_t>(crowded ? w.flags[i] | kNeedsResample : w.flags[i] & ~kNeedsResample);
  if (crowded) draw_place(p, w, draws, round, i);
}

/// Calls f(place, observer, sighting) for the opponents of target a that detect it; each member of a crew for some.
template <class Crew, class Draws, class F>
GIGA_HD void for_detectors(const Crew& crew, const GridParameters auto& p, const GridWorld& w, Draws& draws, int a,
                           const uint8_t* could_see, F&& f) {
  const int team = 1 - p.team_of(a);
  for_near(crew, p, w, w.x[a], w.y[a], p.sight_reach[team], [&](int k, int b, float) {
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

/// The list of fire as this step leaves it.
class NewFire {
 public:
  GIGA_HD explicit NewFire(int most) : most_(most) {}
  GIGA_HD void add(uint32_t entry) {
    if (size_ == most_) {
      full_ = true;
      return;
    }
    int at = size_++;
    GIGA_ROLLED
    for (; at > 0 && shooter_of(entries_[at - 1]) > shooter_of(entry); --at) entries_[at] = entries_[at - 1];
    entries_[at] = entry;
  }
  /// Adds those of the other members to those of the first.
  template <class Crew>
  GIGA_HD void gather(const Crew& crew) {
    if constexpr (Crew::kWidth > 1) {
      const int own = size_;
      GIGA_ROLLED
      for (int k = 0; crew.any(!crew.leads() && k < own); ++k) {
        const uint32_t mine = k < own ? entries_[k] : 0;
        GIGA_ROLLED
        for (int member = 1; member < Crew::kWidth; ++member) {
          const uint32_t entry = crew.from(mine, member);
          if (crew.leads() && entry != 0) add(entry);
        }
      }
      full_ = crew.ballot(full_) != 0;
    }
  }
  GIGA_HD int size() const { return size_; }
  GIGA_HD uint32_t operator[](int k) const { return entries_[k]; }
  GIGA_HD bool full() const { return full_; }

 private:
  uint32_t entries_[kMostShooters];  // by the number of the shooter
  int most_, size_ = 0;
  bool full_ = false;
};

/// Rules 4.4, and 17.2 for the list of fire. `some`: whether the crew has an agent. Returns the damage units that its
/// agent takes, to all members of a crew.
template <class Crew, class Draws>
GIGA_HD int find_fire(const Crew& crew, const GridParameters auto& p, GridWorld& w, Draws& draws, int a, bool some) {
  uint32_t* list = w.fire + static_cast<int64_t>(a) * p.most_shooters;
  const FireList before(list, p.most_shooters);
  NewFire now(p.most_shooters);
  typename Crew::Counter observers(crew);
  int taken = 0;
  if (some && w.could_see[a]) {
    int32_t* const kept = kept_detectors(w, a);
    for_detectors(crew, p, w, draws, a, w.could_see, [&](int k, int b, const Sighting& s) {
      const int32_t number = observers.take();
      if (number < kKeptDetectors) kept[number] = k;
      add_together(w.detects + b, 1);
      const int count = track(before.count(b), s);
      if (count == 0) return;
      now.add(fire_entry(b, count));
      const int units = damage_units(p, count);
      taken += units;
      if (units > 0) add_together(w.dealt + b, units);
    });
  }
  crew.meet();
  const int32_t n_observers = observers.count();
  now.gather(crew);
  taken = crew.sum(taken);
  if (!some || !crew.leads()) return taken;
  for (int k = 0; k < now.size(); ++k) list[k] = now[k];
  for (int k = now.size(); k < before.size(); ++k) list[k] = 0;
  w.observers[a] = n_observers;
  if (now.full()) add_together(w.full_lists, 1);  // an error: what is counted then does not matter
  w.taken[a] = static_cast<float>(taken);
  return taken;
}
template <class Draws>
GIGA_HD void detect_and_track(const GridParameters auto& p, GridWorld& w, Draws& draws, int a) {
  if (find_fire(OneWorker{}, p, w, draws, a, true) > 0) w.flags[a] |= kTookDamage;
}

/// What the end of a fight asks of an agent: read before the fight writes anything, so that a GPU waits once for its
/// memory.
struct Vitals {
  float health, limit;
  uint8_t flags, lived, lives;  // lived: before the step; lives: it has not collided
};
GIGA_HD Vitals vitals_of(const GridParameters auto& p, const GridWorld& w, int i) {
  return {w.health[i], table_value(p.agents.max_health + i), w.flags[i], w.was_alive[i], w.could_see[i]};
}
/// update_health and note_death by these. Returns whether the agent lives on.
GIGA_HD bool take_damage(const GridParameters auto& p, GridWorld& w, const Vitals& of, int taken, int i) {
  const float health = health_after(p, of.health, static_cast<float>(taken), of.limit, of.flags, of.lives != 0);
  const bool lives = of.lives != 0 && health > 0;
  w.health[i] = health;
  w.alive[i] = lives ? 1 : 0;
  if (taken > 0) w.flags[i] = of.flags | kTookDamage;
  if (of.lived != 0 && !lives) w.death[i] = death_by(of.flags);
  return lives;
}

template <class Draws>
GIGA_HD void detect_only(const GridParameters auto& p, GridWorld& w, Draws& draws, int a) {
  int32_t* kept = kept_detectors(w, a);
  int observers = 0;
  w.could_see[a] = w.alive[a];
  for_detectors(OneWorker{}, p, w, draws, a, w.alive, [&](int k, int, const Sighting&) {
    if (observers < kKeptDetectors) kept[observers] = k;
    ++observers;
  });
  w.observers[a] = observers;
}

GIGA_HD Dealt dealt_by(const GridParameters auto&, const GridWorld& w, int i) { return {w.detects[i], w.dealt[i]}; }
GIGA_HD int observers_of(const GridParameters auto&, const GridWorld& w, int i) { return w.observers[i]; }

/// Rules 5.4. By the table of a map with obstacles the nearest opponent need not be near: all are asked then.
GIGA_HD float way_gained(const GridParameters auto& p, const GridWorld& w, int i) {
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

/// Sorts the agents that live by cell, those of a cell by number.
GIGA_HD void fill_grid(const GridParameters auto& p, GridWorld& w) {
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
GIGA_HD void sort_agents(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  lanes.each_agent(n, [&](int i) {
    w.detects[i] = 0;
    w.dealt[i] = 0;
  });
  lanes.each(n > 0 ? 1 : 0, [&](int) { fill_grid(p, w); });
}

}  // namespace giga
