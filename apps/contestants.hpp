// Who takes part in a round robin: checkpoints of runs, and scripts.
#pragma once

#include <string>
#include <vector>

#include "eval/policies.hpp"
#include "eval/round_robin.hpp"
#include "rating/sheet.hpp"

namespace giga {

struct ContestantRequest {
  std::vector<std::string> runs;  ///< run folders, or checkpoint files
  std::string scripted;           ///< "all", "none", or names with commas between them
  std::string scenario;           ///< name or path; empty: that of the runs, which must then be the same
  int checkpoints = 0;            ///< at most so many of each run; 0 = all
  bool greedy = false;
};

struct Contestants {
  Scenario scenario;
  SimSpec spec;
  int n_threads = 0;                     ///< of the first run
  std::vector<Entrant> entrants;         ///< scripts, then runs with their checkpoints in order
  std::vector<PlayerInfo> infos;         ///< [entrants]
  std::vector<LoadedPolicies> policies;  ///< owns what the entrants play with
};

/// Finds and loads them. A checkpoint of a run folder that is damaged is left out with a warning. Throws InputError for
/// unknown scripts, folders without whole checkpoints, runs given twice, and policies that do not fit the scenario.
Contestants find_contestants(const ContestantRequest& request, Device device);

/// `count` of n things (0 = all) at equal distances, the last always among them; indices in order.
std::vector<size_t> spread(size_t n, size_t count);

}  // namespace giga
