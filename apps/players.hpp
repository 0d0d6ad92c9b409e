// Who takes part in a round robin: checkpoints of runs, exported policies, and scripts.
#pragma once

#include <string>
#include <vector>

#include "eval/player.hpp"
#include "rating/sheet.hpp"

namespace giga {

struct PlayerRequest {
  std::vector<std::string> runs;  ///< run folders, checkpoint files, exported policies
  std::string scripted;           ///< "all", "none", or names with commas between them
  std::string scenario;           ///< name or path; empty: that of the runs, which must then be the same
  int checkpoints = 0;            ///< at most so many of each run; 0 = all
};

struct RoundRobin {
  Scenario scenario;
  SimSpec spec;
  int n_threads = 0;              ///< of the first run
  std::vector<Player> players;    ///< scripts, then the others as asked for, runs with their checkpoints in order
  std::vector<PlayerInfo> infos;  ///< [players]
};

/// Finds and loads them. All get different names. A damaged checkpoint of a run folder is left out with a warning.
/// Throws InputError for unknown scripts, folders without whole checkpoints, runs given twice, and policies that do not
/// fit the scenario.
RoundRobin find_players(const PlayerRequest& request, const PlayerOptions& options);

/// `count` of n things (0 = all) at equal distances, the last always among them; indices in order.
std::vector<size_t> spread(size_t n, size_t count);

}  // namespace giga
