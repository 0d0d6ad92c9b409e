// gigastep bench es: whole generations of an evolution strategy.
#include <cmath>

#include "apps/benchmark.hpp"
#include "apps/command_line.hpp"
#include "core/error.hpp"
#include "learn/learner.hpp"

namespace giga {
namespace {

LoadedRun load_evolution(const BenchOptions& options, Device device, int worlds, int n_ranks) {
  std::vector<std::string> overrides = options.overrides;
  overrides.push_back("device=" + device.name());
  if (!options.scenario.empty()) overrides.push_back("scenario=" + options.scenario);
  LoadedRun run = load_run_config(find_config(options.config), overrides);
  if (!algorithm_of(run.config).has_populations)
    throw InputError("bench es: " + options.config + " does not evolve; use bench train");
  if (worlds == 0 && n_ranks == 1) return run;
  // Two teams' populations share the worlds; members come in pairs.
  const int per_pair = 4 * run.config.population.n_worlds();
  const int members = worlds > 0 ? std::max(1, worlds / per_pair) * 2 : run.config.population.population_size;
  overrides.push_back(cat("population.population_size=", members * n_ranks));
  return load_run_config(find_config(options.config), overrides);
}

int worlds_of(const RunConfig& c) {
  return populations_at_a_time(c) * c.population.population_size * c.population.n_worlds();
}

/// The closed loop with the same scenario, networks and worlds.
BenchResult closed_loop(const BenchOptions& options, const LoadedRun& run, Device device) {
  BenchOptions measured = options;
  measured.steps = 0;
  LoadedRun loop = run;
  loop.config.train.n_worlds = worlds_of(run.config);
  loop.config.train.precision = options.precision;
  return bench_closed_loop(measured, device, loop);
}

BenchResult measure_evolution(const BenchOptions& options, Device device, const LoadedRun& run, bool with_closed_loop) {
  BenchResult result;
  result.scenario = run.config.scenario;
  result.arithmetic = arithmetic_of(run, device);
  result.worlds = worlds_of(run.config);
  double loop_rate = 0;
  if (with_closed_loop) {
    const BenchResult loop = closed_loop(options, run, device);
    result.closed_loop_arithmetic = loop.arithmetic;
    loop_rate = loop.quantile(0.5);
  }

  const int64_t memory_before = device.is_cuda() ? memory_in_use(device) : 0;
  const auto learner = make_learner(run, device, options.joined);
  double episodes = 0, steps = 0;
  measure(
      options,
      [&](int64_t n) {
        const Updates updates = make_updates(*learner, n);
        episodes += updates.episodes;
        steps += updates.work.agent_steps;
        return updates.work;
      },
      result);
  result.memory_bytes = memory_in_use(device) - memory_before;

  const auto generations = static_cast<double>(learner->updates_done());
  const double per_generation = steps / generations;
  result.checks = {{"generations", generations},
                   {"generations_per_second", result.quantile(0.5) / per_generation},
                   {"episodes_ended", episodes},
                   {"mean_episode_length", steps / episodes / run.spec.params.n_agents}};
  if (with_closed_loop) {
    result.checks.emplace_back("closed_loop_agent_steps_per_second", loop_rate);
    result.checks.emplace_back("share_of_closed_loop", result.quantile(0.5) / loop_rate);
  }
  if (!(episodes > 0) || episodes != generations * result.worlds * run.config.population.n_rounds())
    throw Error("the benchmark is void: not every world has played its episodes");
  return result;
}

}  // namespace

BenchResult bench_es(const BenchOptions& options, Device device, int worlds) {
  const auto with = [&](int n_ranks) {
    return [&options, device, worlds, n_ranks](const BenchOptions& measured) {
      return measure_evolution(measured, device, load_evolution(options, device, worlds, n_ranks), !options.joined);
    };
  };
  return with_one_rank_beside(options, with(1), with(options.joined ? options.joined->size() : 1));
}

}  // namespace giga
