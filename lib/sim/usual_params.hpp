// UsualParams: parameters of which what most scenarios have in common are constants of the compiler.
#pragma once

#include "sim/params.hpp"

namespace giga {

/// SimParams with what decides about loops and branches fixed, for `kAgents` agents.
template <int kAgents>
struct UsualParams : SimParams {
  explicit UsualParams(const SimParams& p) : SimParams(p) {}
  static constexpr Rules rules = Rules::corrected;
  static constexpr ActionKind actions = ActionKind::discrete;
  static constexpr int n_agents = kAgents, n_neighbors = kAgents < 15 ? kAgents : 15;
  static constexpr bool waypoints = false, mixed_teams = false, has_idle_reward = false;
  static constexpr bool stochastic_communication = true, stochastic_detection = true;
  static constexpr bool obstacle_heights = false, obstacles_block_sight = false, sight_3d = false;
  static constexpr bool cone_is_full = false, damage_cone_is_full = false;
  GIGA_HD static constexpr bool original() { return false; }

  /// Whether a scenario is so.
  static bool fits(const SimParams& p) {
    return p.rules == rules && p.actions == actions && p.n_agents == n_agents && p.n_neighbors == n_neighbors &&
           p.waypoints == waypoints && p.mixed_teams == mixed_teams && p.has_idle_reward == has_idle_reward &&
           p.stochastic_communication == stochastic_communication && p.stochastic_detection == stochastic_detection &&
           p.obstacle_heights == obstacle_heights && p.obstacles_block_sight == obstacles_block_sight &&
           p.sight_3d == sight_3d && p.cone_is_full == cone_is_full && p.damage_cone_is_full == damage_cone_is_full;
  }
};

}  // namespace giga
