// In which order the trials of a sweep go on, and which of them are tried again.
#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "sweep/progress.hpp"

namespace giga {
namespace {

/// Nine trials, of which a third goes on, for three times the agent-steps each time.
SweepSpec halving_spec() {
  SweepSpec spec;
  spec.seeds = {1, 2};
  spec.halving.first_agent_steps = 100;
  return spec;
}

TEST(SweepHalving, RungsGrowByTheFactor) {
  EXPECT_EQ(rungs_of(halving_spec().halving, 1000), (std::vector<int64_t>{100, 300, 900, 1000}));
  EXPECT_EQ(rungs_of(halving_spec().halving, 900), (std::vector<int64_t>{100, 300, 900}));
  EXPECT_EQ(rungs_of({}, 1000), (std::vector<int64_t>{1000}));
  const int64_t most =
      std::numeric_limits<int64_t>::max();  // 9.2e18: 100 x 3^35 is 5.0e18, and three times that too much
  EXPECT_EQ(rungs_of(halving_spec().halving, most).size(), 37u);
  EXPECT_EQ(rungs_of(halving_spec().halving, most)[35], 5003154509899970700);
}

TEST(SweepHalving, TheBestGoOnAsSoonAsThereAreEnough) {
  SweepProgress progress(halving_spec(), 9, 3);
  const auto run = [&](int trial, int rung, double value) {
    for (const uint64_t seed : {1, 2}) progress.finish({trial, rung, seed}, {value, 0, 1, 100});
  };
  for (int trial = 0; trial < 3; ++trial) {
    const SweepJob job = progress.next().value();
    EXPECT_EQ(std::pair(job.trial, job.rung), std::pair(trial, 0));
    progress.begin(job.trial, job.rung);
  }
  EXPECT_EQ(progress.open().size(), 6u) << "three trials with two seeds";
  EXPECT_EQ(progress.open()[3], (SweepRun{1, 0, 2}));
  run(0, 0, 0.2);
  run(1, 0, 0.5);
  EXPECT_EQ(progress.next()->trial, 3) << "one of two is not a third";
  run(2, 0, 0.4);
  // Of three the best goes on.
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(1, 1));
  progress.begin(1, 1);
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(3, 0));
  for (int trial = 3; trial < 9; ++trial) run(trial, 0, trial == 5 ? 0.9 : 0.1);
  // Of nine three go on: 1, which has, 5 and 2.
  EXPECT_EQ(progress.next()->trial, 5);
  run(5, 1, 0.95);
  EXPECT_EQ(progress.next()->trial, 2);
  run(2, 1, 0.3);
  EXPECT_FALSE(progress.next()) << "trial 1 is not done yet";
  run(1, 1, 0.6);
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(5, 2));
  run(5, 2, 0.99);
  EXPECT_TRUE(progress.complete());
  EXPECT_EQ(progress.ranking()[0], 5);
  EXPECT_EQ(progress.ranking()[1], 1);
  EXPECT_EQ(progress.ranking()[2], 2);
}

// Nine trials, one at a time, the best third goes on: 0, 3 and 6 to rung 1, and only the best of these three to rung 2,
// although 6 comes last.
TEST(SweepHalving, TheLastOfARungIsWaitedFor) {
  SweepSpec spec = halving_spec();
  spec.seeds = {1};
  SweepProgress progress(spec, 9, 3);
  const std::vector<double> first = {0.9, 0.1, 0.1, 0.8, 0.1, 0.1, 0.2, 0.1, 0.1};
  const std::map<int, double> second = {{0, 0.5}, {3, 0.4}, {6, 0.7}};
  std::vector<std::pair<int, int>> further;
  while (const std::optional<SweepJob> job = progress.next()) {
    progress.begin(job->trial, job->rung);
    if (job->rung > 0) further.emplace_back(job->trial, job->rung);
    const double value = job->rung == 0 ? first[static_cast<size_t>(job->trial)] : second.at(job->trial);
    progress.finish({job->trial, job->rung, 1}, {value, 0, 1, 100});
  }
  EXPECT_EQ(further, (std::vector<std::pair<int, int>>{{0, 1}, {3, 1}, {6, 1}, {6, 2}}));
}

TEST(SweepHalving, OfFewTrialsTheBestGoesOnAndOneThatFailedNever) {
  SweepProgress progress(halving_spec(), 2, 2);
  for (const uint64_t seed : {1, 2}) progress.finish({0, 0, seed}, {0.3, 0, 1, 100});
  EXPECT_EQ(progress.next()->trial, 1);
  progress.finish({1, 0, 1}, {0.9, 0, 1, 100});
  progress.finish({1, 0, 2}, {std::nullopt, 3, 1, 50});  // it diverged
  EXPECT_FALSE(progress.value(1, 0));
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(0, 1));
}

// Of three the best goes on and diverges: the next best takes its place, and the one without a value is the last.
TEST(SweepHalving, WhatFailsFurtherOnLeavesItsPlace) {
  SweepSpec spec = halving_spec();
  spec.seeds = {1};
  SweepProgress progress(spec, 3, 2);
  for (const auto& [trial, value] : {std::pair(0, 0.5), {1, 0.9}, {2, 0.7}})
    progress.finish({trial, 0, 1}, {value, 0, 1, 100});
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(1, 1));
  progress.finish({1, 1, 1}, {std::nullopt, 3, 1, 50});
  EXPECT_EQ(progress.ranking(), (std::vector<int>{2, 0, 1}));
  EXPECT_EQ(progress.best(), std::pair(2, 0.7));
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(2, 1));
  progress.finish({2, 1, 1}, {0.6, 0, 1, 100});
  EXPECT_FALSE(progress.next());
  EXPECT_EQ(progress.ranking(), (std::vector<int>{2, 0, 1}));
  EXPECT_EQ(progress.best(), std::pair(2, 0.6));
}

TEST(SweepFailures, AreTriedAgainUnlessTheyDiverged) {
  SweepProgress progress(SweepSpec(), 4, 1);  // with seed 1
  progress.finish({0, 0, 1}, {0.5, 0, 1, 100});
  EXPECT_EQ(progress.failure_code(), 0);
  progress.finish({1, 0, 1}, {std::nullopt, 0, 0, 0});  // somebody else's, told without a value
  EXPECT_EQ(progress.failure_code(), 0);
  progress.finish({2, 0, 1}, {std::nullopt, 3, 1, 50});  // a learning rate too high, for example
  EXPECT_EQ(progress.failure_code(), 0);
  progress.finish({3, 0, 1}, {std::nullopt, 137, 1, 50});  // killed, as where memory is short
  EXPECT_EQ(progress.failure_code(), 1);
  EXPECT_EQ(progress.n_failed(), 2);
  EXPECT_TRUE(progress.complete());
  progress.reopen_failed();
  EXPECT_EQ(progress.open(), (std::vector<SweepRun>{{3, 0, 1}}));
  progress.finish({3, 0, 1}, {0.7, 0, 1, 100});
  EXPECT_EQ(progress.failure_code(), 0);
  SweepProgress all(SweepSpec(), 1, 1);
  all.finish({0, 0, 1}, {std::nullopt, 3, 1, 50});
  EXPECT_EQ(all.failure_code(), 3);
}

}  // namespace
}  // namespace giga
