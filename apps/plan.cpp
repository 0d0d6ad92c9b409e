#include "apps/plan.hpp"

#include <iostream>
#include <memory>

#include "apps/evaluation.hpp"
#include "apps/run_replays.hpp"
#include "cuda/runtime.hpp"
#include "eval/record.hpp"
#include "learn/memory.hpp"

namespace giga {
namespace {

MemorySpace memory_space(Device device) {
  if (!device.is_cuda()) return host_memory_space();
  const GpuInfo gpu = cuda_device_info(device.index);
  return {static_cast<int64_t>(gpu.memory_total), static_cast<int64_t>(gpu.memory_free)};
}

/// An evaluation with the games that it keeps. The memory of a match does not depend on its length; that of what is
/// kept of a game does.
void evaluate_briefly(const LoadedRun& run, Device device, Learner& learner) {
  LoadedRun brief = run;
  brief.spec = run.spec.cut_off_after(2);
  const MatchOptions options = evaluation_options(run, device, learner);
  std::unique_ptr<TeamRecording> games;
  if (run.config.eval.record > 0 && why_games_have_no_room(run).empty())
    games = std::make_unique<TeamRecording>(run, learner, run.config.eval.record, options);
  evaluate(brief, options, learner, games ? &games->games() : nullptr);
  if (!games) return;
  games->fill();
  games->finish();
}

}  // namespace

void print_plan(const LoadedRun& run, Device device) {
  if (!device.is_cuda() && cuda_device_count() == 0) std::cout << "there is no GPU here: planned for the CPU\n";
  const MemorySpace space = memory_space(device);
  const MemoryPlan plan =
      measure_memory(run, device, space.free, [&](Learner& learner) { evaluate_briefly(run, device, learner); });
  std::cout << plan_text(run, device, space, plan);
}

void check_memory(const LoadedRun& run, Device device, int n_ranks) {
  const Algorithm& algorithm = algorithm_of(run.config);
  LoadedRun share = run;
  if (n_ranks > 1) algorithm.set_size(share.config, algorithm.size(run.config).value / n_ranks);
  check_fits(share, device, memory_space(device));
}

}  // namespace giga
