// MemoryPlan: what a training run will take of its device's memory, by item, computed before anything is created.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/memory.hpp"
#include "learn/run_config.hpp"

namespace giga {

struct MemoryItem {
  std::string name;
  int64_t bytes = 0;            ///< at the peak of the run
  int64_t bytes_per_world = 0;  ///< the part that grows with train.n_worlds, by world; 0 where it does not
  std::string note;
};

struct MemoryPlan {
  std::vector<MemoryItem> items;
  int64_t total() const;
};

/// On a GPU: what its free memory loses. On the CPU: the resident memory of the process.
MemoryPlan plan_memory(const LoadedRun& run, Device device);

/// The largest train.n_worlds with which the run takes at most `available_bytes` and n_minibatches divides its states;
/// 0 where not even the smallest fits. Everything else stays as `run` says.
int64_t largest_n_worlds(const LoadedRun& run, Device device, int64_t available_bytes);

}  // namespace giga
