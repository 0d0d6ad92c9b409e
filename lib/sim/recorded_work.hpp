// RecordedWork: work of a device that was queued once and is queued again in one call.
#pragma once

#include <cstddef>
#include <functional>

namespace giga {

class RecordedWork {
 public:
  virtual ~RecordedWork() = default;
  /// Queues all of it once more, with the same buffers and numbers.
  virtual void queue() = 0;
};

/// Where work goes while it is recorded.
class Recording {
 public:
  virtual ~Recording() = default;
  /// Calls queue(k, stream) for k = 0 ... n - 1. What each queues on its stream (a cudaStream_t) follows what was
  /// recorded before and comes before what is recorded later, and may run at the same time as what the others queue.
  virtual void side_by_side(size_t n, const std::function<void(size_t k, void* stream)>& queue) = 0;
};

}  // namespace giga
