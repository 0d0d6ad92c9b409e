#include "learn/memory.hpp"

#include <ATen/DeviceAccelerator.h>
#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/checkpoint.hpp"
#include "io/host_info.hpp"
#include "learn/registry.hpp"
#include "learn/team_policy.hpp"

namespace giga {
namespace {

constexpr int64_t kFirstTrial = 32;  // worlds or members, where the run has more

/// Of a GPU, what all its processes hold; of the CPU, the largest resident memory of this process so far.
int64_t memory_taken(Device device) {
  if (device.is_cuda()) {
    const GpuInfo gpu = cuda_device_info(device.index);
    return static_cast<int64_t>(gpu.memory_total - gpu.memory_free);
  }
  std::ifstream in("/proc/self/status");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("VmHWM:")) return std::stoll(line.substr(6)) * 1024;
  throw Error("this system does not tell the memory of a process (VmHWM in /proc/self/status)");
}

/// The peak of this process counts from its present size on, where the system lets it: what was loaded and has been
/// dropped since, as code that is not used, would stand in for the first trials.
void forget_peak() { std::ofstream("/proc/self/clear_refs") << "5"; }

/// What earlier trials have given back goes back to the device.
void release_cached(Device device) {
  if (device.is_cuda() && at::getDeviceAllocator(at::kCUDA)->initialized())
    at::getDeviceAllocator(at::kCUDA)->emptyCache();
  ::malloc_trim(0);
}

/// The run's size halved until it is small, or until twice that size, by its largest buffers, is.
int64_t first_trial(const RunSize& size, double least_per_unit, int64_t free_bytes) {
  int64_t first = size.value;
  for (;;) {
    const int64_t half = first / 2 / size.step * size.step;
    const bool small =
        first < 2 * kFirstTrial && 8 * least_per_unit * static_cast<double>(first) < static_cast<double>(free_bytes);
    if (small || half < size.smallest) return first;
    first = half;
  }
}

/// A run of another size, with short updates.
LoadedRun resized(const LoadedRun& run, int64_t size) {
  LoadedRun trial = run;
  algorithm_of(run.config).set_size(trial.config, size);
  algorithm_of(run.config).shorten(trial.config);
  return trial;
}

std::string number_of(const RunSize& size, int64_t n) { return counted(n, cat(size.unit, 's')); }

}  // namespace

bool MemoryPlan::measured(int64_t n) const {
  return std::any_of(trials.begin(), trials.end(), [n](const Trial& t) { return t.size == n; });
}

int64_t MemoryPlan::bytes(int64_t n) const {
  for (const Trial& t : trials)
    if (t.size == n) return t.bytes;
  const Trial &a = trials.at(trials.size() - 2), &b = trials.back();
  const double slope = static_cast<double>(b.bytes - a.bytes) / static_cast<double>(b.size - a.size);
  return b.bytes + std::llround(std::max(slope, least_per_unit) * static_cast<double>(n - b.size));
}

int64_t MemoryPlan::largest(int64_t available_bytes) const {
  int64_t low = (size.smallest - 1) / size.step, high = size.most / size.step + 1;  // low fits, high does not
  while (high - low > 1) {
    const int64_t middle = low + (high - low) / 2;
    (bytes(middle * size.step) <= available_bytes ? low : high) = middle;
  }
  return low * size.step < size.smallest ? 0 : low * size.step;
}

MemoryPlan measure_memory(const LoadedRun& run, Device device, int64_t free_bytes,
                          const std::function<void(Learner&)>& evaluate, double trial_seconds) {
  const Algorithm& algorithm = algorithm_of(run.config);
  MemoryPlan plan{algorithm.size(run.config), {}, 0};
  plan.least_per_unit = static_cast<double>(algorithm.least_bytes(run)) / static_cast<double>(plan.size.value);
  forget_peak();
  const int64_t before = device.is_cuda() ? memory_taken(device) : resident_bytes();
  int64_t size = first_trial(plan.size, plan.least_per_unit, free_bytes);
  // On a GPU the second update may record minibatches and give back what the first one took (TorchRecorder); the third
  // takes again what it needs beside them.
  const int updates = device.is_cuda() ? 3 : 2;
  for (;;) {
    const auto start = std::chrono::steady_clock::now();
    {
      const auto learner = make_learner(resized(run, size), device);
      for (int update = 0; update < updates; ++update) learner->update();
      if (evaluate) evaluate(*learner);
      Checkpoint saved;
      learner->save(saved.arrays);
      encode_checkpoint(saved);
      plan.trials.push_back({size, memory_taken(device) - before});
    }
    release_cached(device);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const int64_t last = size;
    size = last < plan.size.value ? std::min(2 * last, plan.size.value) : 2 * last;
    if (plan.trials.size() < 2) continue;
    if (size > plan.size.most || 2 * seconds > trial_seconds || plan.bytes(size) > free_bytes / 2) return plan;
  }
}

std::string plan_text(const LoadedRun& run, Device device, const MemorySpace& space, const MemoryPlan& plan) {
  const RunSize& size = plan.size;
  const Precision precision = precision_on(run, device);
  std::string text = cat("measured on ", device.name(), ", networks in ", FieldCodec<Precision>::print(precision),
                         precision == Precision::fp16 ? " by one fused kernel" : "", ":\n");
  for (const MemoryPlan::Trial& t : plan.trials) {
    char line[96];
    std::snprintf(line, sizeof line, "%12lld %-8s %10s\n", static_cast<long long>(t.size), (size.unit + "s").c_str(),
                  print_bytes(t.bytes).c_str());
    text += line;
  }
  const auto how = [&](int64_t n) { return plan.measured(n) ? "measured" : "extrapolated"; };
  const auto redrawn = algorithm_of(run.config).redrawn;
  if (const RedrawnImages of_update = redrawn ? redrawn(run) : RedrawnImages{}; of_update.images > 0)
    text += cat("the images of an update would take ", print_bytes(of_update.images), "; they are drawn again from ",
                print_bytes(of_update.kept), " that are kept in their place\n");
  const int64_t need = plan.bytes(size.value), largest = plan.largest(space.free);
  text += cat(size.key, " ", size.value, " takes ", print_bytes(need), " (", how(size.value), ") and ",
              need <= space.free ? "fits" : "does not fit", ": ", device.name(), " has ", print_bytes(space.free),
              " free of ", print_bytes(space.total), "\n");
  if (largest > 0) return text + cat("the largest ", size.key, " that fits is ", largest, " (", how(largest), ")\n");
  return text + cat("not even ", number_of(size, size.smallest),
                    " would fit: smaller networks and shorter rollouts, or ",
                    "fewer episodes of a member, take less\n");
}

void check_fits(const LoadedRun& run, Device device, const MemorySpace& space) {
  const Algorithm& algorithm = algorithm_of(run.config);
  const int64_t least = algorithm.least_bytes(run);
  const RunSize size = algorithm.size(run.config);
  if (least > space.free)
    throw InputError(cat(size.key, ": ", size.value, " needs more than ", print_bytes(least), " of memory on ",
                         device.name(), ", which has ", print_bytes(space.free), " free of ", print_bytes(space.total),
                         "; `gigastep train CONFIG --plan` measures what fits"));
}

std::string print_bytes(int64_t bytes) {
  static constexpr const char* kUnits[] = {"B", "KiB", "MiB", "GiB", "TiB"};
  double value = static_cast<double>(bytes);
  size_t unit = 0;
  for (; value >= 1023.5 && unit + 1 < std::size(kUnits); ++unit) value /= 1024;
  const int decimals = unit == 0 || value >= 99.95 ? 0 : value >= 9.995 ? 1 : 2;
  char text[32];
  std::snprintf(text, sizeof text, "%.*f %s", decimals, value, kUnits[unit]);
  return text;
}

}  // namespace giga
