#include "apps/plan.hpp"

#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/evaluation.hpp"
#include "cuda/runtime.hpp"
#include "learn/memory.hpp"

namespace giga {
namespace {

MemorySpace memory_space(Device device) {
  if (!device.is_cuda()) return host_memory_space();
  const GpuInfo gpu = cuda_device_info(device.index);
  return {static_cast<int64_t>(gpu.memory_total), static_cast<int64_t>(gpu.memory_free)};
}

}  // namespace

void print_plan(const LoadedRun& run, Device device) {
  if (!device.is_cuda() && cuda_device_count() == 0) std::cout << "there is no GPU here: planned for the CPU\n";
  const MemorySpace space = memory_space(device);
  LoadedRun brief = run;  // the memory of a match does not depend on its length
  brief.spec = run.spec.cut_off_after(2);
  const MemoryPlan plan = measure_memory(run, device, space.free, [&](Learner& learner) {
    evaluate(brief, evaluation_options(brief, device, learner), learner);
  });
  std::cout << plan_text(run, device, space, plan);
}

void check_memory(const LoadedRun& run, Device device, int n_ranks) {
  const Algorithm& algorithm = algorithm_of(run.config);
  LoadedRun share = run;
  if (n_ranks > 1) algorithm.set_size(share.config, algorithm.size(run.config).value / n_ranks);
  check_fits(share, device, memory_space(device));
}

}  // namespace giga
