// Stopwatch: seconds since it was made; and how long something takes.
#pragma once

#include <chrono>

namespace giga {

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

/// Runs `f` and gives the seconds that it took.
template <class F>
double timed(F&& f) {
  const Stopwatch watch;
  f();
  return watch.seconds();
}

}  // namespace giga
