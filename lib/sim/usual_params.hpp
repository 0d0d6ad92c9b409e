// UsualParams: parameters of which what most scenarios have in common are constants of the compiler.
#pragma once

#include "sim/params.hpp"

namespace giga {

/// SimParams with what decides about loops and branches fixed, for two teams of `kTeamSize` agents.
template <int kTeamSize>
struct UsualParams : SimParams {
  explicit UsualParams(const SimParams& p) : SimParams(p) {}
  static constexpr Rules rules = Rules::corrected;
  static constexpr ActionKind actions = ActionKind::discrete;
  static constexpr int kTeam = kTeamSize, n_agents = 2 * kTeam, n_neighbors = n_agents < 15 ? n_agents : 15;
  static constexpr bool waypoints = false, has_idle_reward = false;
  static constexpr bool stochastic_communication = true, stochastic_detection = true;
  static constexpr bool obstacle_heights = false, obstacles_block_sight = false, sight_3d = false;
  static constexpr bool cone_is_full = false, damage_cone_is_full = false;
  GIGA_HD static constexpr bool original() { return false; }
  GIGA_HD static constexpr int team_of(int i) { return i >= kTeam ? 1 : 0; }
  GIGA_HD static constexpr int first_of(int team) { return team == 0 ? 0 : kTeam; }
  GIGA_HD static constexpr int end_of(int team) { return first_of(team) + kTeam; }
  GIGA_HD static constexpr int size_of(int) { return kTeam; }
  GIGA_HD static constexpr int slot_of(int i) { return i - first_of(team_of(i)); }

  /// Whether a scenario is so.
  static bool fits(const SimParams& p) {
    return p.team_after_team && p.rules == rules && p.actions == actions && p.n_team[0] == kTeam &&
           p.n_team[1] == kTeam && p.n_neighbors == n_neighbors && p.waypoints == waypoints &&
           p.has_idle_reward == has_idle_reward && p.stochastic_communication == stochastic_communication &&
           p.stochastic_detection == stochastic_detection && p.obstacle_heights == obstacle_heights &&
           p.obstacles_block_sight == obstacles_block_sight && p.sight_3d == sight_3d &&
           p.cone_is_full == cone_is_full && p.damage_cone_is_full == damage_cone_is_full;
  }
};

/// Calls f with the parameters: with those of them as constants that a scenario has in common with most, where its
/// teams have one of these sizes.
template <int... kTeamSizes, class F>
void with_usual_teams(const SimParams& p, F&& f) {
  const auto serve = [&]<int kTeamSize>() {
    if (!UsualParams<kTeamSize>::fits(p)) return false;
    f(UsualParams<kTeamSize>(p));
    return true;
  };
  if (!(serve.template operator()<kTeamSizes>() || ...)) f(p);
}

/// The same for all sizes that are served.
template <class F>
void with_usual_params(const SimParams& p, F&& f) {
  with_usual_teams<5, 2, 10, 20>(p, f);
}

}  // namespace giga
