// What the tests of the memory plan measure with.
#pragma once

#include <c10/core/Allocator.h>

#include <algorithm>
#include <cstdint>
#include <string>

#include "learn/memory/plan.hpp"

namespace giga::test {

/// Follows what LibTorch allocates on the CPU for this thread, backward passes included.
class AllocationPeak final : public c10::MemoryReportingInfoBase {
 public:
  void reportMemoryUsage(void*, int64_t bytes, size_t, size_t, c10::Device) override {
    live_ += bytes;
    peak_ = std::max(peak_, live_);
  }
  bool memoryProfilingEnabled() const override { return true; }
  int64_t peak() const { return peak_; }

 private:
  int64_t live_ = 0, peak_ = 0;
};

/// Bytes of an item; 0 where the plan has none of that name.
int64_t item(const MemoryPlan& plan, const std::string& name);

/// Largest resident memory of this process since it was last reset, bytes.
int64_t peak_resident();
/// Resets it; false where the system cannot.
bool reset_peak_resident();

/// Free memory of GPU 0.
int64_t free_gpu_bytes();
/// Prints a plan beside what was measured; returns planned over measured.
double print_gpu_plan(const std::string& name, const MemoryPlan& plan, int64_t measured);

}  // namespace giga::test
