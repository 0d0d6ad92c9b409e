// ParallelFor: a loop whose rounds are independent, op(0) ... op(n - 1), on the threads of the CPU or on a GPU.
#pragma once

#include <cstdint>
#include <memory>

#include "core/memory.hpp"
#include "core/thread_pool.hpp"

namespace giga {

/// Queues the loop on a GPU, for the operations listed in cuda/elementwise.hpp. Throws in a build without CUDA.
template <class Op>
void launch_elementwise(const Op& op, int64_t n, int index, void* stream);

/// On a GPU the loop is queued on the stream; on the CPU it is done on return.
class ParallelFor {
 public:
  /// `n_threads`: of the CPU, as in SimOptions. `stream`: of the GPU, a cudaStream_t; null = the default stream.
  explicit ParallelFor(Device device, int n_threads = 0, void* stream = nullptr)
      : device_(device), stream_(stream), pool_(device.is_cuda() ? nullptr : new ThreadPool(n_threads)) {}

  Device device() const { return device_; }
  void* stream() const { return stream_; }
  /// Of a CPU.
  const ThreadPool& pool() const { return *pool_; }

  template <class Op>
  void run(const Op& op, int64_t n) const {
    if (n <= 0) return;
    if (device_.is_cuda()) return launch_elementwise(op, n, device_.index, stream_);
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
