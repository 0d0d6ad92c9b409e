// What `gigastep train` tells about memory before it starts.
#pragma once

#include <string>

#include "core/memory.hpp"
#include "learn/run_config.hpp"

namespace giga {

/// Prints what takes how much of the device's memory and the largest size that fits (see RunSize); as JSON to `json`
/// where that is not empty ("-" = standard output).
void print_plan(const LoadedRun& run, Device device, const std::string& json = "");

/// Throws InputError where the run needs more memory than the device has free; to be called before anything is created.
void check_memory(const LoadedRun& run, Device device);

}  // namespace giga
