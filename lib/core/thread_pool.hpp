// ThreadPool: runs a loop body over index ranges on a fixed number of threads.
#pragma once

#include <cstdint>
#include <functional>

namespace giga {

/// A front of OpenMP. LibTorch uses OpenMP too, and two runtimes with threads of their own would take turns spinning on
/// the same cores: seen on two cores, 40 times slower. All pools of a process share OpenMP's threads.
class ThreadPool {
 public:
  /// `n_threads` in all, the caller included; 0 means as many as OpenMP gives, normally one per core.
  explicit ThreadPool(int n_threads = 0);

  int n_threads() const { return n_threads_; }

  /// Splits [0, count) into one contiguous range per thread and calls body(begin, end, thread). Returns when all are
  /// done; the first exception of a body is rethrown.
  void for_ranges(int64_t count, const std::function<void(int64_t begin, int64_t end, int thread)>& body) const;

 private:
  int n_threads_;
};

}  // namespace giga
