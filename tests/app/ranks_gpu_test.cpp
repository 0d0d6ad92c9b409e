// One training by several GPUs, a rank on each; skipped where there are fewer than two.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>

#include "core/error.hpp"
#include "ranked_run.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

// An update: 128 worlds x 8 steps x 4 agents.
constexpr const char* kGpuMappo = R"(scenario: identical_2_vs_2_fobs_vec_void_disc
device: cuda
train: {algorithm: mappo, n_worlds: 128, total_agent_steps: 12288, desynchronize: true}
mappo: {horizon: 8, n_minibatches: 4, n_epochs: 2, shards: 2, actor: {hidden: [32, 32]}, critic: {hidden: [32, 32]}}
eval: {episodes: 8, every_updates: 0, record: 0}
checkpoint: {every_updates: 1}
)";

class RankedRunGpu : public RankedRun {
 protected:
  void SetUp() override {
    here_.write("gpu.yaml", kGpuMappo);
    const Outcome probe = here_.run({"train", "es.yaml", "--device", "cuda", "--gpus", "256"});
    ASSERT_EQ(probe.code, 2) << probe.err;
    if (contains(probe.err, {"0 GPUs found"}) || contains(probe.err, {"1 GPU is found"})) GTEST_SKIP() << probe.err;
    if (contains(probe.err, {"GPUs are found"})) return;
    FAIL() << probe.err;
  }
  std::string run(const std::string& name, int gpus, const std::vector<std::string>& more = {}, int code = 0) {
    std::vector<std::string> words = {"train", "gpu.yaml", "--run-dir", name};
    if (gpus > 1) words.insert(words.end(), {"--gpus", std::to_string(gpus)});
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = here_.run(words);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    err_ = outcome.err;
    return name;
  }
  std::string err_;
};

/// The greatest difference of what the teams have learned, relative to 1 or the number.
double learned_difference(const NamedArrays& a, const NamedArrays& b) {
  const auto learned = [](const NamedArrays& all) {
    NamedArrays teams;
    for (const NamedArray& array : all)
      if (array.name.starts_with("team_")) teams.push_back(array);
    return teams;
  };
  return difference(learned(a), learned(b));
}

TEST_F(RankedRunGpu, OfMappoEqualsThatOfOneGpuToRounding) {
  // By the fused kernels, by LibTorch, and with scripts and a pool. A step is at most 1e-3, and there are 24 of them:
  // halves of a gradient that are not added up would show as 1e-2.
  constexpr double kTolerance = 1e-3;
  const std::vector<std::vector<std::string>> settings = {
      {},
      {"--set", "mappo.fused=false", "--set", "mappo.obs_norm=true", "--set", "mappo.advantage_norm=batch"},
      {"--set", "opponents.pool_size=2", "--set", "opponents.pool_every_updates=1", "--set", "opponents.pool_share=0.5",
       "--set", "opponents.scripted_share=0.25"}};
  for (size_t k = 0; k < (tests_run_in_full() ? settings.size() : 1); ++k) {
    SCOPED_TRACE(k);
    const std::vector<std::string>& set = settings[k];
    const char* const way = k == 1 ? "by LibTorch" : "acts and learns by fused kernels";
    const NamedArrays one = arrays_of(here_, run(cat("one", k), 1, set));
    const std::string two = run(cat("two", k), 2, set);
    EXPECT_TRUE(contains(err_, {"shared by 2 ranks", way}));
    const double apart = learned_difference(one, arrays_of(here_, two));
    std::cout << way << ": two GPUs and one differ by " << apart << std::endl;
    EXPECT_LT(apart, kTolerance);
    // The same ranks give the same bits.
    EXPECT_EQ(state_hash(here_, run(cat("again", k), 2, set)), state_hash(here_, two));
    EXPECT_EQ(timeless_metrics(here_, cat("again", k)), timeless_metrics(here_, two));
    if (k == 1) continue;
    // Begun by two and ended by one, and the other way round.
    for (const auto& [first, second] : {std::pair{2, 1}, std::pair{1, 2}}) {
      if (first == 1 && !tests_run_in_full()) continue;
      std::vector<std::string> begin = set;
      begin.insert(begin.end(), {"--set", "train.stop_at_agent_steps=4096"});
      const std::string begun = run(cat("begun", k, "by", first), first, begin, 124);
      std::vector<std::string> words = {"resume", begun, "--set", "train.stop_at_agent_steps=none"};
      if (second > 1) words.insert(words.end(), {"--gpus", "2"});
      const Outcome resumed = here_.run(words);
      ASSERT_EQ(resumed.code, 0) << resumed.err;
      EXPECT_EQ(metrics_rows(here_, begun), 3u);
      EXPECT_LT(learned_difference(one, arrays_of(here_, begun)), kTolerance);
    }
  }
}

TEST_F(RankedRunGpu, OfEvolutionEqualsThatOfOneGpuBitForBit) {
  for (const int gpus : {1, 2}) {
    std::vector<std::string> words = train(cat("by_", gpus), 1, {"--device", "cuda", "--gpus", std::to_string(gpus)});
    const Outcome outcome = here_.run(words);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
  }
  EXPECT_EQ(state_hash(here_, "by_2"), state_hash(here_, "by_1"));
  EXPECT_EQ(timeless_metrics(here_, "by_2"), timeless_metrics(here_, "by_1"));
}

TEST_F(RankedRunGpu, EndsWhereARankIsKilled) {
  for (size_t victim = tests_run_in_full() ? 0 : 1; victim < 2; ++victim) {
    const std::string name = cat("killed_", victim);
    const auto process = here_.start({"train", "gpu.yaml", "--run-dir", name, "--gpus", "2", "--set",
                                      "train.total_agent_steps=1e12", "--set", "checkpoint.every_updates=0"});
    ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, name) >= 2; }));
    const std::vector<int> pids = ranks_of(process->pid());
    ASSERT_EQ(pids.size(), 2u);
    ::kill(pids[victim], SIGKILL);
    const auto begin = std::chrono::steady_clock::now();
    const Outcome outcome = process->wait();
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    std::cout << "rank " << victim << " killed: all ended after " << seconds << " s\n" << outcome.err << std::endl;
    EXPECT_LT(seconds, 15);
    EXPECT_EQ(outcome.code, 1);
    EXPECT_TRUE(contains(outcome.err, {cat("rank ", 1 - victim, ": rank ", victim, " of 2 was ended by signal 9")}));
  }
}

TEST_F(RankedRunGpu, EndsWhereAGradientIsNotFinite) {
  run("run", 2, {"--set", "mappo.learning_rate=1e38", "--set", "mappo.max_grad_norm=0"}, 3);
  EXPECT_TRUE(contains(err_, {"held a NaN or an infinity at update 1", "rank 0 keeps the batch"}));
}

// As under torchrun, where nobody else tells of the one that is stopped.
TEST_F(RankedRunGpu, EndsWhereARankIsStopped) {
  if (!tests_run_in_full()) GTEST_SKIP() << "takes half a minute";
  const std::vector<std::string> words = {"train",     "gpu.yaml",
                                          "--run-dir", "stopped",
                                          "--set",     "train.total_agent_steps=1e12",
                                          "--set",     "checkpoint.every_updates=0"};
  const auto first = here_.start(words, kGigastep, rank_of_two(0, 29519)),
             second = here_.start(words, kGigastep, rank_of_two(1, 29519));
  ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, "stopped") >= 2; }));
  ::kill(second->pid(), SIGSTOP);
  const auto begin = std::chrono::steady_clock::now();
  const Outcome outcome = first->wait();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  std::cout << "rank 1 stopped: rank 0 ended after " << seconds << " s\n" << outcome.err << std::endl;
  ::kill(second->pid(), SIGKILL);
  EXPECT_EQ(outcome.code, 1);
  EXPECT_LT(seconds, 35);
  EXPECT_TRUE(contains(outcome.err, {"rank 1 of 2 has not been heard of for 20 s: it is dead, stopped or cut off"}));
}

}  // namespace
}  // namespace giga::test
