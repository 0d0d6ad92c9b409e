// What LibTorch is told once per process before a learner is made.
#pragma once

#include "core/memory.hpp"
#include "learn/run_config.hpp"

namespace giga {

/// Threads, TF32 and the allocator as `config` says: settings of the whole process in LibTorch.
void set_up_libtorch(const TrainConfig& config, Device device);

}  // namespace giga
