// UsualParams: parameters of which what most scenarios have in common are constants of the compiler.
#pragma once

#include "sim/team_params.hpp"

namespace giga {

/// What a scenario is about, where that decides about loops and branches.
enum class Play {
  fight,
  hide_and_seek,
  waypoints,
  published  ///< the original's published training run, under either rules: sight all around and without chance
};

/// SimParams with what decides about loops and branches fixed, for teams of `kSize0` and `kSize1` agents.
template <int kSize0, int kSize1 = kSize0, Play kPlay = Play::fight>
struct UsualParams : TeamParams<kSize0, kSize1> {
  using Teams = TeamParams<kSize0, kSize1>;
  explicit UsualParams(const SimParams& p) : Teams(p) {}
  static constexpr ActionKind actions = ActionKind::discrete;
  static constexpr int n_neighbors = Teams::kAgents < 15 ? Teams::kAgents : 15;
  static constexpr bool waypoints = kPlay == Play::waypoints;
  static constexpr bool stochastic_communication = kPlay != Play::published;
  static constexpr bool stochastic_detection = stochastic_communication;
  static constexpr bool obstacle_heights = false, obstacles_block_sight = false, sight_3d = false;
  // Hiders are paid for being there, and seekers catch them in every direction.
  static constexpr bool has_idle_reward = kPlay == Play::hide_and_seek;
  static constexpr bool has_term_factors = false;
  static constexpr bool cone_is_full = kPlay == Play::published, damage_cone_is_full = kPlay == Play::hide_and_seek;
  GIGA_HD bool original() const { return kPlay == Play::published && Teams::rules == Rules::original; }

  /// Whether a scenario is so.
  static bool fits(const SimParams& p) {
    // Beside images the original orders rows by pixels (orders_by_pixel), which these kernels do not.
    const bool rules_fit = p.rules == Rules::corrected || (kPlay == Play::published && p.resolution == 0);
    return p.team_after_team && rules_fit && p.actions == actions && p.n_team[0] == kSize0 && p.n_team[1] == kSize1 &&
           p.n_neighbors == n_neighbors && p.waypoints == waypoints && p.has_idle_reward == has_idle_reward &&
           p.has_term_factors == has_term_factors && p.stochastic_communication == stochastic_communication &&
           p.stochastic_detection == stochastic_detection && p.obstacle_heights == obstacle_heights &&
           p.obstacles_block_sight == obstacles_block_sight && p.sight_3d == sight_3d &&
           p.cone_is_full == cone_is_full && p.damage_cone_is_full == damage_cone_is_full;
  }
};

/// Calls f with the parameters: as the first of these types of which they are, else as they are.
template <class... Usual, class F>
void with_params_as(const SimParams& p, F&& f) {
  const auto serve = [&]<class P>() {
    if (!P::fits(p)) return false;
    f(P(p));
    return true;
  };
  if (!(serve.template operator()<Usual>() || ...)) f(p);
}

/// Calls f with the parameters for a job, a step or another one: with those of them as constants that the scenario has
/// in common with most. Steps are served for more sizes: a kernel takes seconds to compile, and all else is rare.
template <bool kStep, class F>
void with_usual_params(const SimParams& p, F&& f) {
  using enum Play;
  if constexpr (kStep)
    with_params_as<UsualParams<5>, UsualParams<2>, UsualParams<10>, UsualParams<20>, UsualParams<1>, UsualParams<5, 1>,
                   UsualParams<5, 3>, UsualParams<10, 3>, UsualParams<20, 5>, UsualParams<5, 5, hide_and_seek>,
                   UsualParams<5, 10, hide_and_seek>, UsualParams<10, 5, hide_and_seek>, UsualParams<5, 5, waypoints>,
                   UsualParams<5, 3, waypoints>, UsualParams<3, 3, waypoints>, UsualParams<5, 5, published>>(p, f);
  else
    with_params_as<UsualParams<5>, UsualParams<2>, UsualParams<10>, UsualParams<20>>(p, f);
}

}  // namespace giga
