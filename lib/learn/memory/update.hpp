// What LibTorch allocates and gives back in the course of an update of mappo (mappo.cpp, ppo_team.cpp) and of an
// evaluation.
#pragma once

#include <string>
#include <vector>

#include "core/memory.hpp"
#include "learn/memory/ledger.hpp"
#include "learn/run_config.hpp"

namespace giga {

/// A stretch of work, and what is held on top of the lasting buffers where it holds most.
struct WorkPhase {
  std::string name;
  MemoryByUse peak{};
  bool grows = true;          ///< in proportion to the number of worlds
  int64_t largest_block = 0;  ///< bytes of the widest layer's features
  bool has_gradients = false;
};

/// All phases of a run in their order; the largest decides. Teams take turns, so a phase tells the larger team.
std::vector<WorkPhase> work_phases(const LoadedRun& run, Device device);

}  // namespace giga
