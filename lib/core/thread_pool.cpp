#include "core/thread_pool.hpp"

#if defined(_OPENMP)
#include <omp.h>

#include <exception>
#include <mutex>
#endif

namespace giga {
namespace {

/// As many as OpenMP gives; without it there is one.
int default_threads() {
#if defined(_OPENMP)
  return omp_get_max_threads();
#else
  return 1;
#endif
}

}  // namespace

ThreadPool::ThreadPool(int n_threads) : n_threads_(n_threads > 0 ? n_threads : default_threads()) {}

void ThreadPool::for_ranges(int64_t count, const std::function<void(int64_t, int64_t, int)>& body) const {
  const int n = n_threads_;
#if defined(_OPENMP)
  std::exception_ptr error;
  std::mutex mutex;
  // A loop over the ranges, not over threads: all are done even where OpenMP gives fewer threads than asked for.
#pragma omp parallel for num_threads(n) schedule(static, 1)
  for (int thread = 0; thread < n; ++thread) {
    const int64_t begin = count * thread / n, end = count * (thread + 1) / n;
    if (begin == end) continue;
    try {
      body(begin, end, thread);
    } catch (...) {
      std::lock_guard lock(mutex);
      if (!error) error = std::current_exception();
    }
  }
  if (error) std::rethrow_exception(error);
#else
  // In a browser's module there are neither threads nor locks, nor anything that catches.
  for (int thread = 0; thread < n; ++thread) {
    const int64_t begin = count * thread / n, end = count * (thread + 1) / n;
    if (begin != end) body(begin, end, thread);
  }
#endif
}

}  // namespace giga
