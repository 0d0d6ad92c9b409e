// One training by several processes: the same result as by one, and an end for all where one is gone.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <fstream>

#include "core/error.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kConfig = R"(scenario: identical_1_vs_1_fobs_vec_void_disc
device: cpu
train: {algorithm: openai_es, total_agent_steps: 8000, n_threads: 1}
population: {population_size: 8, episodes_per_member: 2, max_steps: 60, actor: {hidden: [8]}}
opponents: {pool_size: 2, pool_every_updates: 2, pool_share: 0.5, pool_draw: pfsp}
eval: {episodes: 8, every_updates: 2, record: 0}
checkpoint: {every_updates: 1}
)";

class RankedRun : public ::testing::Test {
 protected:
  RankedRun() { here_.write("es.yaml", kConfig); }
  std::vector<std::string> train(const std::string& run, int ranks, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words = {"train", "es.yaml", "--run-dir", run};
    if (ranks > 1) words.insert(words.end(), {"--ranks", std::to_string(ranks)});
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  /// Processes that were started by this test and are ranks: their ids by rank.
  static std::vector<int> ranks_of(int parent) {
    std::vector<int> pids;
    std::ifstream children(cat("/proc/", parent, "/task/", parent, "/children"));
    for (int pid = 0; children >> pid;) pids.push_back(pid);
    return pids;
  }
  Workplace here_;
};

TEST_F(RankedRun, EqualsTheRunOfOneProcessBitForBit) {
  ASSERT_EQ(here_.run(train("one", 1)).code, 0);
  for (const int ranks : {2, 8}) {
    const std::string run = cat("by_", ranks);
    const Outcome outcome = here_.run(train(run, ranks));
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(contains(outcome.err, {cat("shared by ", ranks, " ranks")}));
    EXPECT_EQ(state_hash(here_, run), state_hash(here_, "one"));
    EXPECT_EQ(metrics_rows(here_, run), metrics_rows(here_, "one"));
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

TEST_F(RankedRun, RefusesWhatCannotBeDivided) {
  const auto refused = [&](const std::vector<std::string>& words, const Environment& environment = {}) {
    const Outcome outcome = here_.run(words, kGigastep, environment);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    return outcome.err;
  };
  EXPECT_TRUE(contains(refused(train("a", 3)), {"8 members cannot be divided among 3 ranks; nearest: 6, 12"}));
  EXPECT_TRUE(contains(refused(train("b", 2, {"--set", "train.algorithm=mappo"})),
                       {"cannot be trained by several ranks yet; openai_es, snes and des can"}));
  EXPECT_TRUE(contains(refused(train("c", 2), {{"RANK", "0"}, {"WORLD_SIZE", "2"}}), {"MASTER_PORT is not set"}));
  EXPECT_FALSE(here_.has("a"));

  // As torchrun starts them, with different configs; rank 0 serves the store.
  const auto rank = [](const char* number) {
    return Environment{{"RANK", number}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "127.0.0.1"}, {"MASTER_PORT", "29517"}};
  };
  const Workplace other;
  other.write("es.yaml", kConfig);
  const auto second = other.start({"train", "es.yaml", "--seed", "2", "--run-dir", "d"}, kGigastep, rank("1"));
  EXPECT_TRUE(contains(refused({"train", "es.yaml", "--run-dir", "d"}, rank("0")),
                       {"rank 1 has another program or config than rank 0", "'seed: 2' instead of 'seed: 1'"}));
  EXPECT_EQ(second->wait().code, 2);
}

}  // namespace
}  // namespace giga::test
