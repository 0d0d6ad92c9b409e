// Scenarios of kinds for which the program has no kernels with constants: what a GPU compiles at run time, and tests
// with FixedParams.
#pragma once

#include <cstdint>

#include "sim/fixed_params.hpp"
#include "sim/spec.hpp"

namespace giga::test {

/// Two teams that fight as by default; the rows tell of up to 15 agents.
constexpr FixedValues plain_values(int team_0, int team_1) {
  const int n = team_0 + team_1;
  return {.rules = Rules::corrected,
          .actions = ActionKind::discrete,
          .team_0 = team_0,
          .team_1 = team_1,
          .n_neighbors = n < 15 ? n : 15,
          .waypoints = false,
          .has_idle_reward = false,
          .has_term_factors = false,
          .egocentric_view = false,
          .cone_is_full = false,
          .damage_cone_is_full = false,
          .stochastic_detection = true,
          .stochastic_communication = true,
          .obstacle_heights = false,
          .obstacles_block_sight = false,
          .sight_3d = false};
}
template <class Change>
constexpr FixedValues changed(FixedValues values, Change&& change) {
  change(values);
  return values;
}

/// A scenario and its name.
struct OddScenario {
  const char* name;
  FixedValues values;
};
constexpr OddScenario kOddScenarios[] = {
    {"3v4", plain_values(3, 4)},
    {"7v2", plain_values(7, 2)},
    {"12v12", plain_values(12, 12)},
    // The rows of a stage are those of both teams, and the last ones are fewer.
    {"4v3view", changed(plain_values(4, 3), [](FixedValues& v) { v.egocentric_view = true; })},
    {"4v2factors", changed(plain_values(4, 2), [](FixedValues& v) { v.has_term_factors = v.has_idle_reward = true; })},
    {"4v4waypointsContinuous", changed(plain_values(4, 4),
                                       [](FixedValues& v) {
                                         v.waypoints = true;
                                         v.actions = ActionKind::continuous;
                                       })},
    {"6v3heights", changed(plain_values(6, 3),
                           [](FixedValues& v) { v.obstacle_heights = v.obstacles_block_sight = v.sight_3d = true; })},
    {"5v4original", changed(plain_values(5, 4), [](FixedValues& v) { v.rules = Rules::original; })},
    // Too few agents in a row for the stage of the egocentric view.
    {"5v5fewRows", changed(plain_values(5, 5),
                           [](FixedValues& v) {
                             v.egocentric_view = v.cone_is_full = true;
                             v.n_neighbors = 4;
                             v.stochastic_detection = v.stochastic_communication = false;
                           })},
    // More rows than the sorting network sorts.
    {"12v11manyRows", changed(plain_values(12, 11),
                              [](FixedValues& v) {
                                v.n_neighbors = 20;
                                v.has_idle_reward = v.damage_cone_is_full = true;
                              })},
    {"5v5continuousView", changed(plain_values(5, 5),
                                  [](FixedValues& v) {
                                    v.actions = ActionKind::continuous;
                                    v.egocentric_view = true;
                                  })},
    // A block takes more shared memory than a kernel has unasked.
    {"20v20fadingView",
     changed(plain_values(20, 20), [](FixedValues& v) { v.has_term_factors = v.egocentric_view = true; })},
};

/// A random scenario of that kind, finished, with short episodes.
SimSpec odd_spec(const OddScenario& odd, uint64_t seed);

}  // namespace giga::test
