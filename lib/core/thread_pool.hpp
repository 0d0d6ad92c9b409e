// ThreadPool: runs a loop body over index ranges on a fixed set of threads.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace giga {

class ThreadPool {
 public:
  /// `n_threads` workers in all, the caller included; 0 means as many as the machine has cores.
  explicit ThreadPool(int n_threads = 0);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int n_threads() const { return static_cast<int>(threads_.size()) + 1; }

  /// Splits [0, count) into one contiguous range per thread and calls body(begin, end, thread). Returns when all are
  /// done; the first exception of a body is rethrown.
  void for_ranges(int64_t count, const std::function<void(int64_t begin, int64_t end, int thread)>& body);

 private:
  void work(int thread);
  void run_range(int thread) noexcept;

  std::vector<std::thread> threads_;
  std::mutex mutex_;
  std::condition_variable start_, finished_;
  const std::function<void(int64_t, int64_t, int)>* body_ = nullptr;
  int64_t count_ = 0;
  uint64_t round_ = 0;  // number of the loop in flight; a worker that has not seen it starts
  int pending_ = 0;     // workers that have not finished it
  std::exception_ptr error_;
  bool stop_ = false;
};

}  // namespace giga
