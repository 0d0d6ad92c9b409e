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
  int64_t bytes = 0;           ///< at the peak of the run
  int64_t bytes_per_unit = 0;  ///< the part that grows with the run's size, by unit of it; 0 where it does not
  std::string note;
};

/// What computes the networks of a population's members, which decides over their memory.
enum class MemberNetworks : uint8_t {
  none,      ///< there are no members: mappo
  libtorch,  ///< LibTorch, with the activations of a whole population
  fused,     ///< the fused kernel (cuda/population_policy.hpp), which keeps none: precision fp16 on a GPU
};

struct MemoryPlan {
  std::vector<MemoryItem> items;
  MemberNetworks networks = MemberNetworks::none;
  int64_t total() const;
};

/// On a GPU: what its free memory loses. On the CPU: the resident memory of the process.
MemoryPlan plan_memory(const LoadedRun& run, Device device);

/// The setting that makes a run larger or smaller: worlds of mappo, members of an evolution strategy.
struct RunSize {
  std::string group, name;  ///< "train", "n_worlds"
  std::string unit;         ///< "world"
  int value = 0;            ///< in the run's configuration
  std::string key() const { return group + "." + name; }
};
RunSize run_size(const RunConfig& config);

/// The largest size with which the run takes at most `available_bytes` and its configuration is valid: n_minibatches
/// divides mappo's states, and antithetic members come in pairs. 0 where not even the smallest fits. Everything else
/// stays as `run` says.
int64_t largest_size(const LoadedRun& run, Device device, int64_t available_bytes);

}  // namespace giga
