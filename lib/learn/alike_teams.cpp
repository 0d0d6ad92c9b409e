#include "learn/alike_teams.hpp"

#include <algorithm>
#include <tuple>
#include <vector>

namespace giga {

bool teams_are_alike(const SimSpec& spec) {
  using Agent = std::tuple<int32_t, float, float, float, float, float>;
  std::vector<Agent> team[kNTeams];
  for (const AgentSpec& a : spec.agents)
    team[a.team].emplace_back(a.sprite, a.thrust, a.max_health, a.range, a.damage_range, a.idle_reward);
  for (std::vector<Agent>& agents : team) std::sort(agents.begin(), agents.end());
  return team[0] == team[1] && spec.params.win.at_time_limit == LimitWinner::tie;
}

}  // namespace giga
