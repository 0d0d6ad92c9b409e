// The items of a memory plan, and those that all algorithms have: simulator, evaluation, checkpoint, fixed parts.
#pragma once

#include <cstdint>
#include <string>

#include "core/memory.hpp"
#include "learn/memory/plan.hpp"

namespace giga {

constexpr int64_t kMiB = 1 << 20;
/// What LibTorch's allocator holds in pieces beyond what is in use at the peak, as a share of what comes and goes.
/// Measured on an H200, with segments that grow (libtorch_settings.cpp): 0.04 to 0.34 (ten runs of mappo, 4,096 and
/// 65,536 worlds).
constexpr double kCudaSlack = 0.36;
/// Where the teams learn in a part of the worlds, and pieces of many sizes are gathered from the rollout, this share of
/// its bytes more: measured 0.04 to 0.06 (4,096 and 65,536 worlds).
constexpr double kCudaSlackOfParts = 0.07;
/// glibc gives blocks from here back to the system and keeps smaller ones in pieces.
constexpr int64_t kHeapBlock = 32 * kMiB;

class PlanItems {
 public:
  PlanItems(const LoadedRun& run, Device device) : run_(run), device_(device), size_(run_size(run.config).value) {}

  enum class Grows : uint8_t { no, yes };  // whether the bytes are proportional to the run's size
  /// Leaves out what has no bytes.
  void add(const std::string& name, int64_t bytes, Grows grows, const std::string& note) {
    if (bytes > 0) plan_.items.push_back({name, bytes, grows == Grows::yes ? bytes / size_ : 0, note});
  }
  /// The simulator that is stepped while learning.
  void add_simulator(int64_t n_worlds);

  /// What decides over the last items.
  struct Rest {
    int64_t work = 0;        ///< bytes that come and go in an update, at the peak
    int64_t acting = 0;      ///< bytes that come and go in an evaluation
    int64_t checkpoint = 0;  ///< bytes of the arrays that are saved
    int64_t slack = 0;       ///< what the allocator keeps
  };
  /// Evaluation, checkpoint, slack, and what the program takes whatever it does.
  void add_rest(const Rest& rest);

  void set_networks(MemberNetworks networks) { plan_.networks = networks; }

  const MemoryPlan& plan() const { return plan_; }

 private:
  const LoadedRun& run_;
  const Device device_;
  const int64_t size_;
  MemoryPlan plan_;
};

/// State of so many worlds.
int64_t simulator_bytes(const LoadedRun& run, int64_t n_worlds);

}  // namespace giga
