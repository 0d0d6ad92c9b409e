// What a spec derives from its tables.
#include "sim/spec.hpp"

#include <algorithm>
#include <cmath>

#include "core/error.hpp"
#include "sim/observations.hpp"
#include "sim/row_layout.hpp"

namespace giga {

void SimSpec::finish() {
  params.n_agents = static_cast<int>(agents.size());
  if (params.n_agents > kMaxGridAgents)
    throw InputError(
        cat("scenario '", name, "' has ", params.n_agents, " agents per world; allowed: up to ", kMaxGridAgents));
  if (params.max_tracking_time < params.min_tracking_time || params.max_tracking_time > 255)
    throw InputError(cat("scenario '", name, "': max_tracking_time is ", params.max_tracking_time,
                         "; allowed: min_tracking_time (", params.min_tracking_time, ") to 255"));
  params.n_team[0] = params.n_team[1] = 0;
  params.has_idle_reward = params.mixed_teams = false;
  for (uint32_t& bits : params.team_bits) bits = 0;
  params.team_after_team = true;
  const AgentSpec* first_of_team[kNTeams] = {};
  for (size_t i = 0; i < agents.size(); ++i) {
    const AgentSpec& agent = agents[i];
    GIGA_CHECK(agent.team == 0 || agent.team == 1, "team ", agent.team);
    if (i > 0 && agent.team < agents[i - 1].team) params.team_after_team = false;
    if (i < kMaxAgents) params.team_bits[i / 32] |= static_cast<uint32_t>(agent.team) << (i % 32);
    ++params.n_team[agent.team];
    params.has_idle_reward = params.has_idle_reward || agent.idle_reward != 0;
    const AgentSpec*& first = first_of_team[agent.team];
    if (!first) first = &agent;
    params.mixed_teams = params.mixed_teams || agent.sprite != first->sprite;
  }
  GIGA_CHECK(params.n_agents <= kMaxAgents || params.team_after_team, "scenario '", name, "': ", params.n_agents,
             " agents that are not sorted by team");
  for (int team = 0; team < kNTeams; ++team)
    if (params.n_team[team] == 0) throw InputError(cat("scenario '", name, "': team ", team, " has no agents"));
  if (maps.empty()) throw InputError(cat("scenario '", name, "' has no map"));
  params.n_maps = static_cast<int>(maps.size());
  params.n_boxes = 0;
  for (const MapSpec& map : maps) params.n_boxes = std::max(params.n_boxes, static_cast<int>(map.boxes.size()));
  params.n_neighbors = std::min(params.n_agents, neighbor_limit);
  params.inv_limit_x = 1.0f / params.limit_x;
  params.inv_limit_y = 1.0f / params.limit_y;
  params.inv_diagonal = 1.0f / std::sqrt(params.limit_x * params.limit_x + params.limit_y * params.limit_y);
}

SimSpec SimSpec::cut_off_after(int steps) const {
  SimSpec cut = *this;
  if (params.max_episode_length > 0 && params.max_episode_length <= steps) return cut;
  cut.params.max_episode_length = steps;
  cut.params.win.at_time_limit = LimitWinner::tie;
  return cut;
}

SimSpec SimSpec::with_time_limit() const {
  return params.max_episode_length > 0 ? *this : cut_off_after(kEpisodeLimit);
}

ObservationSet SimSpec::observations() const {
  ObservationSet set;
  for_each_observation([&](auto kind) {
    if (kind.of == ObservationOf::agent && kind.type == ElementType::f32 && kind.offered(params)) set |= kind.id;
  });
  return set;
}

int SimSpec::observation_size() const { return RowLayout(params, observations()).numbers(); }
int SimSpec::state_size() const { return giga::state_size(params); }

}  // namespace giga
