// Timing of repeats, and the figures drawn from them.
#include "apps/benchmark.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/host_info.hpp"
#include "learn/team_policy.hpp"

namespace giga {
namespace {

constexpr double kRepeatSeconds = 0.5;

struct Timed {
  Work work;
  double seconds;
};
Timed timed(const std::function<Work(int64_t)>& play, int64_t steps) {
  const auto start = std::chrono::steady_clock::now();
  const Work work = play(steps);
  return {work, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count()};
}

void add(Work& sum, const Work& w) {
  sum.agent_steps += w.agent_steps;
  sum.rollout_seconds += w.rollout_seconds;
  sum.learning_seconds += w.learning_seconds;
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

std::string arithmetic_of(const LoadedRun& run, Device device) {
  return FieldCodec<Precision>::print(precision_on(run, device));
}

Updates make_updates(Learner& learner, int64_t n) {
  Updates updates;
  const int64_t before = learner.agent_steps_done();
  for (int64_t k = 0; k < n; ++k) {
    updates.last = learner.update();  // waits: it reads the figures
    const UpdateTimes times = learner.times();
    add(updates.work, {0, times.rollout, times.learning});
    for (const auto& [name, value] : updates.last)
      if (name == "episodes") updates.episodes += value;
  }
  updates.work.agent_steps = static_cast<double>(learner.agent_steps_done() - before);
  return updates;
}

BenchResult with_one_rank_beside(const BenchOptions& options,
                                 const std::function<BenchResult(const BenchOptions&)>& one,
                                 const std::function<BenchResult(const BenchOptions&)>& all) {
  if (!options.joined) return one(options);
  BenchOptions by_itself = options;
  by_itself.joined = nullptr;
  std::shared_ptr<const BenchResult> alone;
  if (options.joined->leads()) alone = std::make_shared<const BenchResult>(one(by_itself));
  options.joined->barrier();
  BenchResult result = all(options);
  result.ranks = options.joined->size();
  result.one_rank = alone;
  return result;
}

void measure(const BenchOptions& options, const std::function<Work(int64_t)>& play, BenchResult& result,
             int64_t piece) {
  // Warm-up: what is done at first use, and a state in which episodes end all the time.
  int64_t steps = std::max<int64_t>(options.steps, 1);
  const auto seconds_of_steps = [&] {
    const double seconds = timed(play, steps).seconds;
    return options.joined ? std::stod(options.joined->broadcast(std::to_string(seconds))) : seconds;
  };
  double seconds = seconds_of_steps();
  if (options.steps == 0) {
    seconds = seconds_of_steps();  // without what is done once
    while (seconds < kRepeatSeconds / 4) {
      steps *= 2;
      seconds = seconds_of_steps();
    }
    steps = std::max<int64_t>(1, std::llround(static_cast<double>(steps) * kRepeatSeconds / seconds));
    if (steps > piece) steps -= steps % piece;
  }
  for (int k = 0; piece > 1 && k < 2; ++k) play(steps % piece == 0 ? piece : steps);
  result.steps = steps;
  for (int k = 0; k < options.repeats; ++k) {
    if (options.joined) options.joined->barrier();
    const Timed repeat = timed(play, steps);
    result.rates.push_back(repeat.work.agent_steps / repeat.seconds);
    add(result.work, repeat.work);
  }
  std::sort(result.rates.begin(), result.rates.end());
}

}  // namespace giga
