// RowRunner: applies a row operation (math/rows.hpp) to all rows of a device's buffers.
#pragma once

#include <cstdint>
#include <memory>

#include "core/memory.hpp"
#include "core/thread_pool.hpp"

namespace giga {

/// Queues op(0) ... op(n - 1) on a GPU, for the operations listed in row_operations.hpp. Throws in a build without
/// CUDA.
template <class Op>
void launch_rows(const Op& op, int64_t n, int index, void* stream);

/// Where row operations run. On a GPU they are queued on the stream; on the CPU they are done on return.
class RowRunner {
 public:
  /// `n_threads` as in SimOptions; `stream` is a cudaStream_t, null = the default stream.
  explicit RowRunner(Device device, int n_threads = 0, void* stream = nullptr)
      : device_(device), stream_(stream), pool_(device.is_cuda() ? nullptr : new ThreadPool(n_threads)) {}

  Device device() const { return device_; }
  void* stream() const { return stream_; }

  template <class Op>
  void run(const Op& op, int64_t n) const {
    if (n <= 0) return;
    if (device_.is_cuda()) return launch_rows(op, n, device_.index, stream_);
    pool_->for_ranges(n, [&op](int64_t begin, int64_t end, int) {
      for (int64_t row = begin; row < end; ++row) op(row);
    });
  }

 private:
  Device device_;
  void* stream_;
  std::unique_ptr<ThreadPool> pool_;
};

}  // namespace giga
