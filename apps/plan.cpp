// Asks the device for its memory and holds the plan against it.
#include "apps/plan.hpp"

#include <iostream>
#include <nlohmann/json.hpp>

#include "cuda/runtime.hpp"
#include "learn/memory/report.hpp"

namespace giga {
namespace {

MemorySpace memory_space(Device device) {
  if (!device.is_cuda()) return host_memory_space();
  const GpuInfo gpu = cuda_device_info(device.index);
  return {static_cast<int64_t>(gpu.memory_total), static_cast<int64_t>(gpu.memory_free)};
}

}  // namespace

void print_plan(const LoadedRun& run, Device device, const std::string& json) {
  const MemorySpace space = memory_space(device);
  if (json != "-") std::cout << plan_table(run, device, space);
  if (!json.empty()) write_json(plan_json(run, device, space), json);
}

void check_memory(const LoadedRun& run, Device device) { check_fits(run, device, memory_space(device)); }

}  // namespace giga
