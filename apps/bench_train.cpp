// gigastep bench train: whole updates of a learner.
#include <cmath>

#include "apps/benchmark.hpp"
#include "apps/command_line.hpp"
#include "core/error.hpp"
#include "learn/learner.hpp"

namespace giga {

namespace {

LoadedRun load_training(const BenchOptions& options, Device device, int worlds, int n_ranks) {
  std::vector<std::string> overrides = options.overrides;
  overrides.push_back("device=" + device.name());
  if (!options.scenario.empty()) overrides.push_back("scenario=" + options.scenario);
  LoadedRun run = load_run_config(find_config(options.config), overrides);
  if (algorithm_of(run.config).has_populations)
    throw InputError("bench train: " + options.config + " evolves; use bench es");
  if (worlds > 0) {
    overrides.push_back(cat("train.n_worlds=", worlds));
    run = load_run_config(find_config(options.config), overrides);
  }
  if (n_ranks == 1) return run;
  if (worlds == 0) return load_training(options, device, run.config.train.n_worlds, n_ranks);
  overrides.push_back(cat("train.n_worlds=", static_cast<int64_t>(worlds) * n_ranks));
  if (const std::string more = setting_for_ranks(run.config, overrides, n_ranks); !more.empty())
    overrides.push_back(more);
  return load_run_config(find_config(options.config), overrides);
}

BenchResult measure_training(const BenchOptions& options, Device device, const LoadedRun& run) {
  BenchResult result;
  result.scenario = run.config.scenario;
  result.arithmetic = arithmetic_of(run, device);
  result.worlds = run.config.train.n_worlds;
  const int64_t memory_before = device.is_cuda() ? memory_in_use(device) : 0;
  const auto learner = make_learner(run, device, options.joined);
  double episodes = 0;
  Metrics metrics;
  measure(
      options,
      [&](int64_t n) {
        Updates updates = make_updates(*learner, n);
        episodes += updates.episodes;
        metrics = std::move(updates.last);
        return updates.work;
      },
      result);
  result.memory_bytes = memory_in_use(device) - memory_before;

  // The proof: losses and parameters are numbers, and episodes ended.
  NamedArrays arrays;
  learner->save(arrays);
  double squares = 0;
  for (const NamedArray& array : arrays)
    if (array.type == ArrayType::f32 && array.name.rfind("team_", 0) == 0)
      for (const float x : array_values<float>(array)) squares += static_cast<double>(x) * static_cast<double>(x);
  result.checks = {{"episodes_ended", episodes},
                   {"updates", static_cast<double>(learner->updates_done())},
                   {"learned_state_square_sum", squares}};
  for (const auto& [name, value] : metrics)
    if (name.find("_loss_") != std::string::npos) result.checks.emplace_back("last_" + name, value);
  if (!std::isfinite(squares) || !(squares > 0))
    throw Error("the benchmark is void: parameters are not finite, or all zero");
  return result;
}

}  // namespace

BenchResult bench_train(const BenchOptions& options, Device device, int worlds) {
  const auto with = [&](int n_ranks) {
    return [&options, device, worlds, n_ranks](const BenchOptions& measured) {
      return measure_training(measured, device, load_training(options, device, worlds, n_ranks));
    };
  };
  return with_one_rank_beside(options, with(1), with(options.joined ? options.joined->size() : 1));
}

}  // namespace giga
