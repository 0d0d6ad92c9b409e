#include "core/thread_pool.hpp"

#include <algorithm>
#include <exception>

namespace giga {

ThreadPool::ThreadPool(int n_threads) {
  if (n_threads <= 0) n_threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  for (int t = 1; t < n_threads; ++t) threads_.emplace_back([this, t] { work(t); });
}

ThreadPool::~ThreadPool() {
  {
    std::lock_guard lock(mutex_);
    stop_ = true;
  }
  start_.notify_all();
  for (auto& thread : threads_) thread.join();
}

void ThreadPool::for_ranges(int64_t count, const std::function<void(int64_t, int64_t, int)>& body) {
  {
    std::lock_guard lock(mutex_);
    body_ = &body;
    count_ = count;
    pending_ = static_cast<int>(threads_.size());
    error_ = nullptr;
    ++round_;
  }
  start_.notify_all();
  run_range(0);
  std::unique_lock lock(mutex_);
  finished_.wait(lock, [this] { return pending_ == 0; });
  if (error_) std::rethrow_exception(error_);
}

void ThreadPool::work(int thread) {
  for (uint64_t seen = 0;;) {
    {
      std::unique_lock lock(mutex_);
      start_.wait(lock, [&] { return stop_ || round_ != seen; });
      if (stop_) return;
      seen = round_;
    }
    run_range(thread);
    std::lock_guard lock(mutex_);
    if (--pending_ == 0) finished_.notify_one();
  }
}

void ThreadPool::run_range(int thread) noexcept {
  const int64_t n = n_threads();
  const int64_t begin = count_ * thread / n, end = count_ * (thread + 1) / n;
  if (begin == end) return;
  try {
    (*body_)(begin, end, thread);
  } catch (...) {
    std::lock_guard lock(mutex_);
    if (!error_) error_ = std::current_exception();
  }
}

}  // namespace giga
