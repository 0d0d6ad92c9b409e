#include "learn/players/policies.hpp"

#include "learn/team_policy.hpp"
#include "policy/actor.hpp"

namespace giga {

LoadedPolicies::LoadedPolicies() = default;
LoadedPolicies::LoadedPolicies(LoadedPolicies&&) noexcept = default;
LoadedPolicies::~LoadedPolicies() = default;

LoadedPolicies load_policies(const std::string& config_yaml, const std::string& scenario_yaml,
                             const NamedArrays& arrays, Device device) {
  LoadedPolicies loaded;
  loaded.run = load_run_config_text(config_yaml, scenario_yaml);
  for (int team = 0; team < kNTeams; ++team) {
    if (!learns(loaded.run.config.train, team)) continue;
    loaded.actor[team] = std::make_unique<Actor>(make_actor(loaded.run, team, device));
    loaded.actor[team]->load(actor_prefix(team), arrays);
  }
  return loaded;
}

}  // namespace giga
