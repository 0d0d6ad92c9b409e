// SimSpec: a compiled scenario, SimParams with its tables, owned. scenario/compile.hpp makes it from a Scenario; a
// simulator copies its tables to its device.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "sim/params.hpp"

namespace giga {

struct AgentSpec {
  int32_t team = 0;
  int32_t sprite = 1;
  float thrust = 1, max_health = 1, range = 1, damage_range = 1, idle_reward = 0;
};

struct MapSpec {
  std::string name;
  std::vector<Box> boxes;
  StartArea start[kNTeams]{};
  std::vector<uint16_t> paths{};  ///< make_path_table; empty where no reward needs it
};

/// A compiled scenario: scalars plus tables. `params.agents` and `params.maps` are empty until a simulator fills them;
/// `finish` derives the counts from the tables.
struct SimSpec {
  std::string name;
  SimParams params;
  std::vector<AgentSpec> agents;  ///< in the order of the original's agent index
  std::vector<MapSpec> maps;
  int neighbor_limit = 15;  ///< max_agent_in_vec_obs

  /// Sets n_agents, n_team, team_bits, team_after_team, n_maps, n_boxes, n_neighbors, has_idle_reward, mixed_teams and
  /// the reciprocals; throws Error where a team is empty or there are more than kMaxGridAgents agents.
  void finish();

  /// The same with episodes of at most `steps`. Such a cut is no time limit of the scenario: surviving to the
  /// cut is not a win, so an undecided episode is a tie. Waypoints count up to the cut.
  SimSpec cut_off_after(int steps) const;
  /// The same with a cut after kEpisodeLimit steps where there is no time limit, so that each episode ends.
  SimSpec with_time_limit() const;

  /// The observations of an agent that the scenario offers and that are numbers: those of a row (sim/row_layout.hpp).
  ObservationSet observations() const;
  /// Numbers of a row that holds them all (sim/row_layout.hpp), without the zeros behind the last.
  int observation_size() const;
  /// Length of one world's true state (critic.kind: state); see state_observation.hpp.
  int state_size() const;
};

}  // namespace giga
