// What `gigastep train` tells about memory before it starts.
#pragma once

#include "core/memory.hpp"
#include "learn/run_config.hpp"

namespace giga {

/// Measures how much of the device's memory the run takes, and prints that and the largest size that fits.
void print_plan(const LoadedRun& run, Device device);

/// Throws InputError where the run certainly needs more memory than the device has free; to be called before anything
/// is created. Of several ranks, where the share of one does.
void check_memory(const LoadedRun& run, Device device, int n_ranks);

}  // namespace giga
