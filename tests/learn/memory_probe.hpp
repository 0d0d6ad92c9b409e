// What the tests of the memory plan share: their scenario, what a run really takes, and checks of plans of any run.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "learn/learner.hpp"
#include "learn/memory/plan.hpp"

namespace giga::test {

/// A scenario of 5 against 5 and 100 steps, unless `lines` (whole ones) say otherwise.
std::string five_against_five(const std::string& lines);

/// A learner on the CPU after some updates, and the most bytes that LibTorch had allocated meanwhile for this thread,
/// backward passes included.
struct ProbedLearner {
  std::unique_ptr<Learner> learner;
  int64_t peak = 0;
};
ProbedLearner probe_updates(const LoadedRun& run, int n_updates);

/// Bytes of an item; 0 where the plan has none of that name.
int64_t item(const MemoryPlan& plan, const std::string& name);
/// Bytes of the plan without the items that tensors and states do not show: the program and the allocator's slack.
int64_t countable_bytes(const MemoryPlan& plan);

/// Planned over the largest resident memory of this process through two updates on the CPU; nothing where the system
/// does not reset that figure.
std::optional<double> planned_over_resident(const LoadedRun& run);
/// Planned over what the free memory of GPU 0 loses through some updates and an evaluation, LibTorch's cache included;
/// prints both. Run it in a process of its own, as ctest does: what LibTorch and CUDA load once counts in the first
/// call of a process only.
double planned_over_lost(const std::string& name, const LoadedRun& run, int n_updates);

/// Fails unless each item of `large` has bytes_per_unit more for each of so many units than that of `small`.
void expect_growth(const MemoryPlan& small, const MemoryPlan& large, int units);
/// Fails unless the table and the JSON of a plan on the CPU tell all of its items.
void expect_told(const LoadedRun& run, const std::string& table, const std::string& json);

}  // namespace giga::test
