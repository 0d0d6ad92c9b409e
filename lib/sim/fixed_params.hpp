// FixedParams: parameters of which all that decides about loops and branches in one scenario is a constant of the
// compiler: of that which a GPU compiles for it at run time (cuda/step_compiler.hpp).
#pragma once

#include "sim/team_params.hpp"

namespace giga {

/// What a scenario fixes, as SimParams has it.
struct FixedValues {
  Rules rules;
  ActionKind actions;
  int team_0, team_1, n_neighbors;  // agents of the teams; rows
  bool waypoints, has_idle_reward, has_term_factors, egocentric_view;
  bool cone_is_full, damage_cone_is_full, stochastic_detection, stochastic_communication;
  bool obstacle_heights, obstacles_block_sight, sight_3d;

  bool operator==(const FixedValues&) const = default;
};
constexpr FixedValues fixed_values(const SimParams& p) {
  return {.rules = p.rules,
          .actions = p.actions,
          .team_0 = p.n_team[0],
          .team_1 = p.n_team[1],
          .n_neighbors = p.n_neighbors,
          .waypoints = p.waypoints,
          .has_idle_reward = p.has_idle_reward,
          .has_term_factors = p.has_term_factors,
          .egocentric_view = p.egocentric_view,
          .cone_is_full = p.cone_is_full,
          .damage_cone_is_full = p.damage_cone_is_full,
          .stochastic_detection = p.stochastic_detection,
          .stochastic_communication = p.stochastic_communication,
          .obstacle_heights = p.obstacle_heights,
          .obstacles_block_sight = p.obstacles_block_sight,
          .sight_3d = p.sight_3d};
}

/// The field list: calls f(name, value) for each of them, in their order.
template <class F>
constexpr void for_each_value(const FixedValues& v, F&& f) {
  f("rules", v.rules);
  f("actions", v.actions);
  f("team_0", v.team_0);
  f("team_1", v.team_1);
  f("n_neighbors", v.n_neighbors);
  f("waypoints", v.waypoints);
  f("has_idle_reward", v.has_idle_reward);
  f("has_term_factors", v.has_term_factors);
  f("egocentric_view", v.egocentric_view);
  f("cone_is_full", v.cone_is_full);
  f("damage_cone_is_full", v.damage_cone_is_full);
  f("stochastic_detection", v.stochastic_detection);
  f("stochastic_communication", v.stochastic_communication);
  f("obstacle_heights", v.obstacle_heights);
  f("obstacles_block_sight", v.obstacles_block_sight);
  f("sight_3d", v.sight_3d);
}

/// SimParams with these values fixed.
template <FixedValues kFixed>
struct FixedParams : TeamParams<kFixed.team_0, kFixed.team_1> {
  explicit FixedParams(const SimParams& p) : TeamParams<kFixed.team_0, kFixed.team_1>(p) {}
  static constexpr Rules rules = kFixed.rules;
  static constexpr ActionKind actions = kFixed.actions;
  static constexpr int n_neighbors = kFixed.n_neighbors;
  static constexpr bool waypoints = kFixed.waypoints, has_idle_reward = kFixed.has_idle_reward;
  static constexpr bool has_term_factors = kFixed.has_term_factors;
  static constexpr bool egocentric_view = kFixed.egocentric_view;
  static constexpr bool cone_is_full = kFixed.cone_is_full, damage_cone_is_full = kFixed.damage_cone_is_full;
  static constexpr bool stochastic_detection = kFixed.stochastic_detection;
  static constexpr bool stochastic_communication = kFixed.stochastic_communication;
  static constexpr bool obstacle_heights = kFixed.obstacle_heights;
  static constexpr bool obstacles_block_sight = kFixed.obstacles_block_sight;
  static constexpr bool sight_3d = kFixed.sight_3d;
  GIGA_HD static constexpr bool original() { return rules == Rules::original; }

  /// Whether a scenario is so.
  static bool fits(const SimParams& p) { return p.team_after_team && fixed_values(p) == kFixed; }
};

}  // namespace giga
