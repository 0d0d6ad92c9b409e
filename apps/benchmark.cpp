// Timing of repeats, and the figures drawn from them.
#include "apps/benchmark.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/host_info.hpp"

namespace giga {
namespace {

constexpr double kRepeatSeconds = 0.5;

struct Timed {
  double agent_steps, seconds;
};
Timed timed(const std::function<double(int64_t)>& play, int64_t steps) {
  const auto start = std::chrono::steady_clock::now();
  const double agent_steps = play(steps);
  return {agent_steps, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count()};
}

}  // namespace

double BenchResult::quantile(double share) const {
  GIGA_CHECK(!rates.empty(), "no repeats");
  const double at = share * static_cast<double>(rates.size() - 1);
  const auto low = static_cast<size_t>(at), high = std::min(low + 1, rates.size() - 1);
  return rates[low] + (rates[high] - rates[low]) * (at - static_cast<double>(low));
}

int64_t memory_in_use(Device device) {
  if (!device.is_cuda()) return resident_bytes();
  const GpuInfo info = cuda_device_info(device.index);
  return static_cast<int64_t>(info.memory_total - info.memory_free);
}

void measure(const BenchOptions& options, const std::function<double(int64_t)>& play, BenchResult& result) {
  // Warm-up: what is done at first use, and a state in which episodes end all the time.
  int64_t steps = std::max<int64_t>(options.steps, 1);
  double seconds = timed(play, steps).seconds;
  if (options.steps == 0) {
    seconds = timed(play, steps).seconds;  // without what is done once
    while (seconds < kRepeatSeconds / 4) {
      steps *= 2;
      seconds = timed(play, steps).seconds;
    }
    steps = std::max<int64_t>(1, std::llround(static_cast<double>(steps) * kRepeatSeconds / seconds));
  }
  result.steps = steps;
  for (int k = 0; k < options.repeats; ++k) {
    const Timed repeat = timed(play, steps);
    result.rates.push_back(repeat.agent_steps / repeat.seconds);
  }
  std::sort(result.rates.begin(), result.rates.end());
}

}  // namespace giga
