// The scenarios of odd_scenarios.hpp.
#include "parity/odd_scenarios.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {

SimSpec odd_spec(const OddScenario& odd, uint64_t seed) {
  const FixedValues& v = odd.values;
  SimSpec spec = random_spec(seed, v.team_0, v.team_1);
  SimParams& p = spec.params;
  p.rules = v.rules;
  p.actions = v.actions;
  p.waypoints = v.waypoints;
  p.has_term_factors = v.has_term_factors;
  p.egocentric_view = v.egocentric_view;
  p.cone_is_full = v.cone_is_full;
  p.damage_cone_is_full = v.damage_cone_is_full;
  p.stochastic_detection = v.stochastic_detection;
  p.stochastic_communication = v.stochastic_communication;
  p.obstacle_heights = v.obstacle_heights;
  p.obstacles_block_sight = v.obstacles_block_sight;
  p.sight_3d = v.sight_3d;
  p.resolution = 0;
  p.max_episode_length = 12 + static_cast<int>(seed % 9);
  spec.neighbor_limit = v.n_neighbors;
  std::stable_sort(spec.agents.begin(), spec.agents.end(),
                   [](const AgentSpec& a, const AgentSpec& b) { return a.team < b.team; });
  for (AgentSpec& agent : spec.agents) agent.idle_reward = v.has_idle_reward ? 0.5f : 0.0f;
  spec.finish();
  GIGA_CHECK(p.team_after_team && fixed_values(p) == v, "no scenario of the kind ", odd.name);
  return spec;
}

}  // namespace giga::test
