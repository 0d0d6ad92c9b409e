// What the CUDA runtime offers to C++ code that is compiled without it. Built without CUDA, or on a machine without a
// GPU, there are zero devices and the factories throw.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "core/memory.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// Whether this build has kernels.
bool built_with_cuda();

/// Number of usable GPUs; 0 without a driver, without a GPU, or in a build without CUDA.
int cuda_device_count();

struct GpuInfo {
  std::string name;
  size_t memory_total = 0, memory_free = 0;  ///< bytes
  int compute_capability = 0;                ///< 90 = 9.0
  int driver_version = 0, runtime_version = 0;
};
GpuInfo cuda_device_info(int index);

/// Bytes per second, read and written counted, of copies within its memory, the best of some.
double cuda_copy_rate(int index);

/// Memory of a GPU, by cudaMalloc.
Memory& cuda_memory(int index);

/// A stream of a GPU (a cudaStream_t) for the work of a run; the same at each call, for as long as the program
/// runs. Unlike the default stream it can be captured. Memory copies and clears on the default stream. A copy waits for
/// the work that was queued here before it, and later work here waits for the copy.
void* work_stream(int index);

/// A simulator on a GPU; work is queued on `stream` (a cudaStream_t; null = the default stream).
std::unique_ptr<Simulator> make_cuda_simulator(SimSpec spec, const SimOptions& options, int index,
                                               void* stream = nullptr);

/// From so many agents on a step of a world is StepLaunches::of_many (cuda/grid_executor.hpp). Tests ask for fewer, or
/// for 0: every step is one launch.
constexpr int kInParts = 1 << 16;

/// The same for worlds of many agents (rules 17), or with Pairs::by_place.
std::unique_ptr<Simulator> make_cuda_grid_simulator(SimSpec spec, const SimOptions& options, int index,
                                                    void* stream = nullptr, int in_parts = kInParts);

/// Parses `auto`, `cpu`, `cuda` or `cuda:1`; auto takes the first GPU where there is one. Throws InputError.
Device parse_device(const std::string& text);

/// The simulator of a device.
std::unique_ptr<Simulator> make_simulator(SimSpec spec, const SimOptions& options, Device device,
                                          void* stream = nullptr);

}  // namespace giga
