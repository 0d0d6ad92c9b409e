// What every executor of worlds of many agents sets up: the parameters of the grid, the view of one world, its scratch,
// and the error of a list of fire that is too short.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>

#include "core/error.hpp"
#include "sim/grid_stages.hpp"
#include "sim/simulator.hpp"

namespace giga {

inline GridParams grid_params(const SimSpec& spec, const SimTables& tables, int most_shooters) {
  float widest[kNTeams] = {};
  for (const AgentSpec& agent : spec.agents) widest[agent.team] = std::max(widest[agent.team], agent.range);
  return {tables.params(), widest, most_shooters};
}

constexpr const char* kByPlaceWay = "looking for pairs by place";  ///< Simulator::step_way

/// What such worlds do not have.
inline void check_grid(const GridParams& p, const StateShape& shape, const SimOptions& options) {
  GIGA_CHECK(shape.lists(), "a world of ", p.n_agents, " agents with tables of pairs");
  if (p.resolution != 0)
    throw InputError("pairs by_place: agents of this scenario are given images; allowed: auto, tables");
  GIGA_CHECK(options.most_shooters > 0 && options.most_shooters <= kMostShooters, options.most_shooters, " shooters");
}

/// Points the state of `w` to world number `world`; the members for tables of pairs stay null.
GIGA_HD void attach_state(const GridParams& p, GridWorld& w, const StateView& all, const PairLists& lists,
                          int64_t world) {
  for_each_field([&](auto field, auto member) {
    if (all.*member) w.*member = all.*member + world * field.count(p.n_agents);
  });
  const int64_t first = world * p.n_agents;
  w.fire = lists.fire + first * p.most_shooters;
  w.neighbors = reinterpret_cast<AgentNumber*>(lists.neighbors + first * p.n_neighbors);
}

/// Carves arrays out of a 16-byte aligned block; of a null block it counts the bytes alone.
struct Carver {
  char* block;
  size_t at = 0;
  template <class T>
  GIGA_HD void operator()(T*& array, size_t count) {
    if (block) array = reinterpret_cast<T*>(block + at);
    at += (sizeof(T) * count + 15) & ~size_t{15};
  }
};

/// Carves what a block needs to sort the agents of a world for itself, and returns its bytes.
GIGA_HD size_t attach_sorted(int n_agents, GridWorld& w, char* block) {
  const size_t n = static_cast<size_t>(n_agents);
  Carver take{block};
  take(w.placed, n);
  take(w.cell_begin, n + static_cast<size_t>(cells_of_dead(n_agents)) + 1);
  take(w.place, n);
  take(w.work.order, n);
  take(w.work.cell, n);
  take(w.work.bounds, 1);
  return take.at;
}

/// Carves what one step of a world needs besides its state, and returns its bytes. `together`: with what many workers
/// need to add up and, if `sorts`, to sort (SharedWork).
GIGA_HD size_t attach_scratch(const GridParams& p, GridWorld& w, char* block, bool together, bool sorts = true) {
  const size_t n = static_cast<size_t>(p.n_agents);
  Carver take{block};
  take(w.dir_x, n);
  take(w.dir_y, n);
  take(w.taken, n);
  take(w.reward, n);
  take(w.next, 3 * n);
  take(w.was_alive, n);
  take(w.flags, n);
  take(w.features, n);
  take(w.terms, n * kNRewardTerms);
  take(w.counts, kNCounts);
  take(w.nearest_agents, p.egocentric_view ? n * kNearestAgents : 0);
  take(w.detects, n);
  take(w.dealt, n);
  take(w.observers, n);
  take(w.detectors, n * kKeptDetectors);
  take(w.could_see, n);
  if (sorts) {
    take(w.placed, n);
    take(w.cell_begin, n + static_cast<size_t>(cells_of_dead(p.n_agents)) + 1);
    take(w.place, n);
  }
  if (together) {
    if (sorts) {
      take(w.work.cell, n);
      take(w.work.block_sums, n / 8 + 1);  // of blocks of a warp, at most four threads an agent; or of 512, and eight
    }
    take(w.work.sums, static_cast<size_t>(kMostStepItems) *
                          static_cast<size_t>(sums_of_team(p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1])));
  }
  return take.at;
}

/// The error of `full` agents at which more opponents fired than are counted.
inline FullListsError full_lists_error(int full, const GridParams& p, const std::string& scenario) {
  return FullListsError(
      cat(counted(full, "agents"), full == 1 ? " was" : " were", " fired at by more than ", p.most_shooters,
          " opponents at once in scenario '", scenario, "': so many are counted in a world of ", p.n_agents,
          " agents (rules 17.2); with smaller damage.damage_cone_depth or damage_cone_angle", " fewer reach it",
          p.n_agents <= kMaxAgents ? ", and train.pairs: tables counts all, which is slower" : ""));
}

}  // namespace giga
