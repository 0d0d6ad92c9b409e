// DeviceClock: how long parts of the work on a device take, without waiting for it.
#pragma once

#include <memory>

#include "core/memory.hpp"

namespace giga {

class DeviceClock {
 public:
  static constexpr int kMarks = 4;
  virtual ~DeviceClock() = default;

  /// Queues the mark `k` < kMarks behind the work that has been queued so far.
  virtual void mark(int k) = 0;
  /// Seconds between two marks; call it when the work up to `to` is known to be done. 0 where they were not set.
  virtual double seconds(int from, int to) const = 0;
};

/// On a GPU by events on `stream` (a cudaStream_t; null = the default stream), on the CPU by the host's clock.
std::unique_ptr<DeviceClock> make_device_clock(Device device, void* stream = nullptr);
std::unique_ptr<DeviceClock> make_cuda_clock(int index, void* stream);

}  // namespace giga
