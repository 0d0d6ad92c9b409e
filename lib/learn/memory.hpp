// What memory a training run takes: measured with throwaway learners, and extrapolated along a line.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "io/host_memory.hpp"
#include "learn/learner.hpp"

namespace giga {

struct MemoryPlan {
  struct Trial {
    int64_t size, bytes;
  };
  RunSize size;               ///< what is varied
  std::vector<Trial> trials;  ///< at least two, by size
  double least_per_unit = 0;  ///< bytes; the line through the last two is at least as steep

  bool measured(int64_t size) const;
  /// As measured; else on the line.
  int64_t bytes(int64_t size) const;
  /// The largest allowed size that takes at most so many bytes; 0 where not even the smallest does.
  int64_t largest(int64_t available_bytes) const;
};

/// Makes learners of growing size, one after the other, and has each do short updates, two on the CPU and three on a
/// GPU, be used as `evaluate` says and be saved; after the second trial only while the next would take at most
/// `trial_seconds` and half of `free_bytes`. Bytes are, on a GPU, what its free memory loses (the run's host memory is
/// not counted); on the CPU, how far the peak of the resident memory rises; there the C library keeps freed blocks in
/// its heap, and the same run may take a third more or less (tests/learn/memory_test.cpp). Best called at the start of
/// a process: what has been loaded before is not counted.
MemoryPlan measure_memory(const LoadedRun& run, Device device, int64_t free_bytes,
                          const std::function<void(Learner&)>& evaluate = {}, double trial_seconds = 5);

/// The plan for people: what was measured, whether the run fits, and the largest size that does.
std::string plan_text(const LoadedRun& run, Device device, const MemorySpace& space, const MemoryPlan& plan);

/// Throws InputError where the largest buffers of the run alone are more than is free.
void check_fits(const LoadedRun& run, Device device, const MemorySpace& space);

/// "1.50 GiB".
std::string print_bytes(int64_t bytes);

}  // namespace giga
