#include "memory_probe.hpp"

#include <ATen/DeviceAccelerator.h>
#include <c10/core/Allocator.h>
#include <c10/util/ThreadLocalDebugInfo.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iostream>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "eval/match.hpp"
#include "io/host_info.hpp"
#include "learn/memory/report.hpp"
#include "rollout/policy_controllers.hpp"

namespace giga::test {
namespace {

constexpr const char *kProgram = "program", *kSlack = "slack of the allocator";

/// Follows what LibTorch allocates on the CPU for this thread, backward passes included.
class AllocationPeak final : public c10::MemoryReportingInfoBase {
 public:
  void reportMemoryUsage(void*, int64_t bytes, size_t, size_t, c10::Device) override {
    live_ += bytes;
    peak_ = std::max(peak_, live_);
  }
  bool memoryProfilingEnabled() const override { return true; }
  int64_t peak() const { return peak_; }

 private:
  int64_t live_ = 0, peak_ = 0;
};

/// Largest resident memory of this process since it was last reset, bytes.
int64_t peak_resident() {
  std::ifstream in("/proc/self/status");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("VmHWM:")) return std::stoll(line.substr(6)) * 1024;
  return 0;
}

/// False where the system cannot.
bool reset_peak_resident() {
  ::malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << 5;
  return std::abs(peak_resident() - resident_bytes()) <= 32 << 20;
}

int64_t free_gpu_bytes() { return static_cast<int64_t>(cuda_device_info(0).memory_free); }

}  // namespace

std::string five_against_five(const std::string& lines) {
  constexpr const char* kTeams = "team_0: [{type: default, count: 5}]\nteam_1: [{type: default, count: 5}]\n";
  return cat("max_episode_length: 100\n", lines.find("team_0") == std::string::npos ? kTeams : "", lines);
}

ProbedLearner probe_updates(const LoadedRun& run, int n_updates) {
  const auto counter = std::make_shared<AllocationPeak>();
  const c10::DebugInfoGuard guard(c10::DebugInfoKind::PROFILER_STATE, counter);
  ProbedLearner probed{make_learner(run, Device{})};
  for (int u = 0; u < n_updates; ++u) probed.learner->update();
  probed.peak = counter->peak();
  return probed;
}

int64_t item(const MemoryPlan& plan, const std::string& name) {
  for (const MemoryItem& i : plan.items)
    if (i.name == name) return i.bytes;
  return 0;
}

int64_t countable_bytes(const MemoryPlan& plan) { return plan.total() - item(plan, kProgram) - item(plan, kSlack); }

std::optional<double> planned_over_resident(const LoadedRun& run) {
  if (!reset_peak_resident()) return std::nullopt;
  const auto learner = make_learner(run, Device{});
  for (int u = 0; u < 2; ++u) learner->update();
  return static_cast<double>(plan_memory(run, Device{}).total()) / static_cast<double>(peak_resident());
}

double planned_over_lost(const std::string& name, const LoadedRun& run, int n_updates) {
  const Device gpu{Device::Kind::cuda, 0};
  const int64_t before = free_gpu_bytes();
  const auto learner = make_learner(run, gpu);
  for (int u = 0; u < n_updates; ++u) learner->update();
  play_match(run.spec, policy_controller(*learner->actor(0)), script_controller(Scripted::circle),
             {run.config.eval.episodes, 1, gpu, 1});
  const int64_t lost = before - free_gpu_bytes();

  const MemoryPlan plan = plan_memory(run, gpu);
  const double ratio = static_cast<double>(plan.total()) / static_cast<double>(lost);
  const auto stats = at::getDeviceAllocator(at::kCUDA)->getDeviceStats(0);
  std::cout << name << ": predicted " << print_bytes(plan.total()) << ", measured " << print_bytes(lost) << ", ratio "
            << ratio << "; LibTorch at its peak: allocated " << print_bytes(stats.allocated_bytes[0].peak)
            << ", reserved " << print_bytes(stats.reserved_bytes[0].peak) << std::endl;
  for (const MemoryItem& i : plan.items) std::cout << "  " << i.name << ": " << print_bytes(i.bytes) << std::endl;
  return ratio;
}

void expect_growth(const MemoryPlan& small, const MemoryPlan& large, int units) {
  ASSERT_EQ(small.items.size(), large.items.size());
  for (size_t k = 0; k < small.items.size(); ++k) {
    const MemoryItem &a = small.items[k], &b = large.items[k];
    SCOPED_TRACE(a.name);
    ASSERT_EQ(a.name, b.name);
    if (a.name == kSlack) continue;  // a bound, neither proportional nor constant
    // Per field of the state up to 255 bytes of padding.
    EXPECT_NEAR(static_cast<double>(b.bytes - a.bytes), units * static_cast<double>(a.bytes_per_unit), 8192) << a.bytes;
  }
}

void expect_told(const LoadedRun& run, const std::string& table, const std::string& json) {
  const std::string per_unit = "\"bytes_per_" + run_size(run.config).unit + "\": ";
  for (const MemoryItem& i : plan_memory(run, Device{}).items) {
    EXPECT_NE(table.find(i.name), std::string::npos) << i.name;
    EXPECT_NE(json.find(cat("\"bytes\": ", i.bytes)), std::string::npos) << i.name;
    EXPECT_NE(json.find(cat(per_unit, i.bytes_per_unit)), std::string::npos) << i.name;
  }
}

}  // namespace giga::test
