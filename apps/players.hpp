// Who takes part in a round robin: checkpoints of runs, exported policies, and scripts.
#pragma once

#include <string>
#include <vector>

#include "eval/played_game.hpp"
#include "rating/sheet.hpp"

namespace giga {

struct PlayerRequest {
  std::vector<std::string> runs;  ///< run folders, checkpoint files, exported policies
  std::string scripted;           ///< "all", "none", or names with commas between them
  GameRequest game;               ///< without a scenario: that of the runs, which must then be the same
  int checkpoints = 0;            ///< at most so many of each run; 0 = all
  bool group = false;  ///< of each run its best checkpoint, or the newest; seeds of one config are one player
};

struct RoundRobin {
  Scenario scenario;
  SimSpec spec;
  int n_threads = 0;               ///< of the first run
  std::vector<Player> players;     ///< scripts, then the others as asked for, runs with their checkpoints in order
  std::vector<PlayerInfo> infos;   ///< [players]
  std::vector<std::string> pools;  ///< [players] as whom their games count; their own names where nothing is pooled
};

/// Finds and loads them. All get different names. A damaged checkpoint of a run folder is left out with a warning.
/// Throws InputError for unknown scripts, folders without whole checkpoints, runs given twice, and policies that do not
/// fit the scenario.
RoundRobin find_players(const PlayerRequest& request, const PlayerOptions& options);

/// `count` of n things (0 = all) at equal distances, the last always among them; indices in order.
std::vector<size_t> spread(size_t n, size_t count);

}  // namespace giga
