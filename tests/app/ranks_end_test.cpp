// One training by several processes: all end where one is gone, hangs, is told to stop or has a number that is not
// finite.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "core/error.hpp"
#include "io/files.hpp"
#include "ranked_run.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

TEST_F(RankedRun, OfMappoEndsWhereAGradientIsNotFinite) {
  // A first step of 1e38 makes one of the next minibatches' gradients infinite, in both ranks.
  const Outcome outcome = here_.run({"train", "mappo.yaml", "--run-dir", "run", "--ranks", "2", "--set",
                                     "mappo.learning_rate=1e38", "--set", "mappo.max_grad_norm=0"});
  EXPECT_EQ(outcome.code, 3) << outcome.err;
  EXPECT_TRUE(contains(outcome.err, {"the gradient of the actor of team 0 held a NaN or an infinity at update 1, "
                                     "minibatch ",
                                     ", in each of the 2 ranks; the batch of rank 0 is in "}));
  const NamedArrays kept = arrays_of(here_, "run/diverged_update_1_team_0.h5");
  EXPECT_EQ(find_array(kept, "simulator/x").shape, (std::vector<int64_t>{16, 4}));  // the worlds of both
}

// The place of an agent in a world of one rank, in the checkpoint that both go on from.
TEST_F(RankedRun, OfMappoNamesTheRankWhoseNumbersAreNotFinite) {
  ASSERT_EQ(here_.run({"train", "mappo.yaml", "--run-dir", "begun", "--set", "train.stop_at_agent_steps=512"}).code,
            124);
  for (const int rank : {0, 1}) {
    const std::string run = cat("faulty_", rank);
    fs::copy(here_.path() / "begun", here_.path() / run, fs::copy_options::recursive);
    FoundCheckpoint found = find_checkpoint((here_.path() / run).string());
    for (NamedArray& array : found.checkpoint.arrays) {
      if (array.name != "simulator/x") continue;
      std::vector<float> x = array_values<float>(array);  // [16 worlds, 4 agents], 8 worlds of each rank
      x[static_cast<size_t>((8 * rank + 3) * 4)] = NAN;
      std::memcpy(array.bytes.data(), x.data(), array.bytes.size());
    }
    write_checkpoint(found.file, found.checkpoint);
    const Outcome outcome =
        here_.run({"resume", run, "--ranks", "2", "--set", "train.stop_at_agent_steps=none"}, kGigastep);
    EXPECT_EQ(outcome.code, 3) << outcome.err;
    EXPECT_TRUE(contains(outcome.err, {cat("the observations of team 0 held a NaN or an infinity at update 2, in rank ",
                                           rank, " of 2; the batch of rank ", rank, " is in ")}));
    // Which is that of the worlds where it began.
    const NamedArrays kept = arrays_of(here_, run + "/diverged_update_2_team_0.h5");
    const std::vector<float> obs = array_values<float>(find_array(kept, "batch/obs"));
    EXPECT_TRUE(std::any_of(obs.begin(), obs.end(), [](float o) { return !std::isfinite(o); })) << obs.size();
    EXPECT_EQ(find_array(kept, "batch/obs").shape.at(0), find_array(kept, "batch/index").shape.at(0));
  }
}

TEST_F(RankedRun, IsStoppedBySignalAndGoesOnWithAnotherNumberOfRanks) {
  ASSERT_EQ(here_.run(train("whole", 1)).code, 0);
  for (const auto& [first, second] : {std::pair{2, 1}, std::pair{1, 2}}) {
    const std::string run = cat("first_by_", first);
    const Outcome stopped = here_.run(train(run, first, {"--set", "train.stop_at_agent_steps=3000"}));
    ASSERT_EQ(stopped.code, 124) << stopped.err;
    std::vector<std::string> words = {"resume", run, "--set", "train.stop_at_agent_steps=none"};
    if (second > 1) words.insert(words.end(), {"--ranks", std::to_string(second)});
    const Outcome resumed = here_.run(words);
    ASSERT_EQ(resumed.code, 0) << resumed.err;
    EXPECT_EQ(state_hash(here_, run), state_hash(here_, "whole"));
  }
  // A signal to one rank, of which the other learns.
  const auto process = here_.start(train("signal", 2, {"--set", "train.total_agent_steps=1e9"}));
  ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, "signal") >= 2; }));
  const std::vector<int> pids = ranks_of(process->pid());
  ASSERT_EQ(pids.size(), 2u);
  ::kill(pids[1], SIGTERM);
  const Outcome outcome = process->wait();
  EXPECT_EQ(outcome.code, 128 + SIGTERM) << outcome.err;
  EXPECT_TRUE(contains(outcome.err, {"the state is saved"}));
  // One to the process that started them: the ranks tell it by its name.
  const auto interrupted = here_.start(train("interrupted", 2, {"--set", "train.total_agent_steps=1e9"}));
  ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, "interrupted") >= 2; }));
  ::kill(interrupted->pid(), SIGINT);
  const Outcome by_interrupt = interrupted->wait();
  EXPECT_EQ(by_interrupt.code, 128 + SIGINT) << by_interrupt.err;
  EXPECT_TRUE(contains(by_interrupt.err, {"(SIGINT), the state is saved"}));
}

// A signal comes while the ranks are being started: none of them listens yet.
TEST_F(RankedRun, IsStoppedBeforeItsRanksHaveBegun) {
  const Outcome outcome =
      here_.run(train("early", 2), kGigastep,
                {{"LD_PRELOAD", fault_library()}, {"FAULT_EXEC", "500"}, {"FAULT_SIGNAL", std::to_string(SIGTERM)}});
  EXPECT_EQ(outcome.code, 128 + SIGTERM) << outcome.err;
  EXPECT_TRUE(contains(outcome.err, {"stopped (SIGTERM) before all ranks had begun"}));
  EXPECT_EQ(here_.run(train("early", 2)).code, 0);
}

TEST_F(RankedRun, EndsWhereARankIsKilled) {
  for (size_t victim = tests_run_in_full() ? 0 : 1; victim < 2; ++victim) {
    const std::string run = cat("killed_", victim);
    const auto process = here_.start(train(run, 2, {"--set", "train.total_agent_steps=1e9"}));
    ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, run) >= 2; }));
    const std::vector<int> pids = ranks_of(process->pid());
    ASSERT_EQ(pids.size(), 2u);
    ::kill(pids[victim], SIGKILL);
    const auto begin = std::chrono::steady_clock::now();
    const Outcome outcome = process->wait();
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
    EXPECT_EQ(outcome.code, 1);
    EXPECT_TRUE(contains(outcome.err, {cat("rank ", victim, " of 2 was ended by signal 9")}));
    // What was saved is whole.
    const Outcome inspected = here_.run({"inspect", run});
    EXPECT_EQ(inspected.code, 0) << inspected.err;
  }
}

// Rank 0 lives, but does not come back from writing the checkpoint of update 2 (fault/fault.c).
TEST_F(RankedRun, EndsWhereARankHangs) {
  constexpr int kPort = 29521;
  std::vector<std::string> words = train("hung", 1, {"--set", "train.total_agent_steps=1e9"});
  words.insert(words.end(), {"--rank-timeout", "6"});  // longer than another process takes to start
  Environment hangs = rank_of_two(0, kPort);
  hangs.insert(
      hangs.end(),
      {{"LD_PRELOAD", fault_library()}, {"FAULT_PATH", "update_00000002"}, {"FAULT_AT", "1"}, {"FAULT_ERRNO", "-1"}});
  const Workplace other;
  other.write("es.yaml", kRankedEvolution);
  const auto first = here_.start(words, kGigastep, hangs);
  const auto second = other.start(words, kGigastep, rank_of_two(1, kPort));
  const Outcome outcome = second->wait();
  EXPECT_EQ(outcome.code, 1);
  EXPECT_TRUE(contains(outcome.err, {"rank 1: rank 0 of 2 lives, but hangs: no answer within 6 s"}));
  first->send(SIGKILL);
  first->wait();
  // What was saved before is whole.
  EXPECT_EQ(find_checkpoint((here_.path() / "hung").string()).checkpoint.updates, 1);
}

}  // namespace
}  // namespace giga::test
