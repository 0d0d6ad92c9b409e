#include "memory_probe.hpp"

#include <ATen/DeviceAccelerator.h>
#include <malloc.h>

#include <cstdlib>
#include <fstream>
#include <iostream>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/host_info.hpp"
#include "learn/memory/report.hpp"

namespace giga::test {

int64_t item(const MemoryPlan& plan, const std::string& name) {
  for (const MemoryItem& i : plan.items)
    if (i.name == name) return i.bytes;
  return 0;
}

int64_t peak_resident() {
  std::ifstream in("/proc/self/status");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("VmHWM:")) return std::stoll(line.substr(6)) * 1024;
  return 0;
}

bool reset_peak_resident() {
  ::malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << 5;
  return std::abs(peak_resident() - resident_bytes()) <= 32 << 20;
}

int64_t free_gpu_bytes() { return static_cast<int64_t>(cuda_device_info(0).memory_free); }

double print_gpu_plan(const std::string& name, const MemoryPlan& plan, int64_t measured) {
  const double ratio = static_cast<double>(plan.total()) / static_cast<double>(measured);
  const auto stats = at::getDeviceAllocator(at::kCUDA)->getDeviceStats(0);
  std::cout << name << ": predicted " << print_bytes(plan.total()) << ", measured " << print_bytes(measured)
            << ", ratio " << ratio << "; LibTorch at its peak: allocated " << print_bytes(stats.allocated_bytes[0].peak)
            << ", reserved " << print_bytes(stats.reserved_bytes[0].peak) << std::endl;
  for (const MemoryItem& i : plan.items) std::cout << "  " << i.name << ": " << print_bytes(i.bytes) << std::endl;
  return ratio;
}

}  // namespace giga::test
