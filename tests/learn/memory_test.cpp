// The memory plan: its line, what it measures against what a larger run takes, and what it says.
#include "learn/memory.hpp"

#include <gtest/gtest.h>
#include <malloc.h>

#include <iostream>
#include <limits>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "eval/match.hpp"
#include "io/temporary_folder.hpp"
#include "learn/registry.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"
#include "sim/row_layout.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

constexpr Device kGpu{Device::Kind::cuda, 0};
constexpr int64_t kMiB = 1 << 20;

/// 5 against 5 and discrete actions, unless `scenario` says otherwise.
struct MemorySettings {
  const char* name;
  const char* train;           // keys in flow style
  const char* algorithm = "";  // whole lines
  const char* scenario = "";   // likewise
};
void PrintTo(const MemorySettings& s, std::ostream* out) { *out << s.name; }

LoadedRun load_sized(const MemorySettings& s, int64_t size) {
  const std::string scenario = cat("max_episode_length: 100\n", s.scenario,
                                   "team_0: [{type: default, count: 5}]\nteam_1: [{type: default, count: 5}]\n");
  LoadedRun run = load_run_config_text(
      cat("seed: 1\ntrain: {n_threads: 1, compile_step: never", s.train, "}\neval: {episodes: 8}\n", s.algorithm),
      scenario);
  algorithm_of(run.config).set_size(run.config, size);
  return run;
}

constexpr const char* kPool =
    "opponents: {pool_size: 16, pool_every_updates: 1, pool_share: 0.4, scripted: [circle, pursuer], scripted_share: "
    "0.1}\n";

/// A plan without trials of its own.
MemoryPlan plan_of(const LoadedRun& run, std::vector<MemoryPlan::Trial> trials) {
  return {algorithm_of(run.config).size(run.config), std::move(trials), 0};
}

TEST(LearnMemoryPlan, FollowsTheLineThroughTheLastTwoTrials) {
  MemoryPlan plan = plan_of(load_sized({"", ""}, 64), {{32, 9000}, {64, 10'000}, {128, 11'280}});
  EXPECT_TRUE(plan.measured(64));
  EXPECT_FALSE(plan.measured(256));
  EXPECT_EQ(plan.bytes(32), 9000);  // as measured
  EXPECT_EQ(plan.bytes(64), 10'000);
  EXPECT_EQ(plan.bytes(256), 11'280 + 128 * 20);  // 1,280 bytes for 64 worlds
  EXPECT_EQ(plan.bytes(96), 10'640);
  plan.least_per_unit = 30;  // a run takes at least that
  EXPECT_EQ(plan.bytes(256), 11'280 + 128 * 30);
}

TEST(LearnMemoryPlan, LargestNumberOfWorldsFitsAndOneMoreDoesNot) {
  // 16 steps and 48 minibatches: n_worlds must be a multiple of 48 / gcd(48, 16) = 3.
  const MemoryPlan plan = plan_of(load_sized({"", ", n_worlds: 48", "mappo: {horizon: 16, n_minibatches: 48}\n"}, 48),
                                  {{24, 1240}, {48, 1480}});
  for (const int64_t available : {int64_t{1480}, int64_t{1479}, int64_t{4100}, int64_t{50'000}}) {
    const int64_t n = plan.largest(available);
    EXPECT_EQ(n % 3, 0) << n;
    EXPECT_LE(plan.bytes(n), available);
    EXPECT_GT(plan.bytes(n + 3), available);
  }
  EXPECT_EQ(plan.largest(1480), 48);
  EXPECT_EQ(plan.largest(1479), 45);
  EXPECT_EQ(plan.largest(1029), 0);                       // three worlds take 1,030
  EXPECT_EQ(plan.largest(int64_t{1} << 60), 16'777'215);  // the largest multiple of 3 allowed
}

// Sequences are worlds with memory: 32 minibatches, and of 64 worlds a team learns in 32 at least.
TEST(LearnMemoryPlan, WithMemoryAndOpponentsEachMinibatchHasASequence) {
  const std::string alone = "mappo: {horizon: 16, n_minibatches: 32, actor: {memory: gru, memory_size: 8}}\n",
                    among_others = alone + kPool;
  EXPECT_EQ(plan_of(load_sized({"", "", alone.c_str()}, 128), {}).size.step, 32);
  EXPECT_EQ(plan_of(load_sized({"", "", among_others.c_str()}, 128), {}).size.step, 64);
}

TEST(LearnMemoryPlan, LargestPopulationFitsAndTwoMoreDoNot) {
  LoadedRun run = load_sized({"", ", algorithm: snes", "population: {episodes_per_member: 4}\n"}, 64);
  const std::vector<MemoryPlan::Trial> trials = {{32, 132}, {64, 164}};
  EXPECT_EQ(plan_of(run, trials).largest(2000), 1900);
  EXPECT_EQ(plan_of(run, trials).largest(2001), 1900);  // members come in pairs
  EXPECT_EQ(plan_of(run, trials).largest(101), 0);
  EXPECT_EQ(plan_of(run, trials).largest(int64_t{1} << 60), 1'000'000);  // all that is allowed
  run.config.population.episodes_per_member = 1000;
  EXPECT_EQ(plan_of(run, trials).largest(int64_t{1} << 60), 8388);  // 2 x 8,388 x 1,000 worlds, of 16,777,216
  run.config.population.antithetic = false;
  EXPECT_EQ(plan_of(run, trials).largest(2001), 1901);
  EXPECT_EQ(plan_of(run, trials).largest(101), 0);  // a population of one is not allowed
}

TEST(LearnMemoryPlan, TheLargestBuffersAreALowerBound) {
  // A world of 10 agents: its state, and 16 observations of D floats of those who learn.
  const auto least = [](const MemorySettings& s, int64_t size) {
    const LoadedRun run = load_sized(s, size);
    return algorithm_of(run.config).least_bytes(run);
  };
  const MemorySettings both{"", "", "mappo: {horizon: 16}\n"}, one{"", ", opponent: circle", "mappo: {horizon: 16}\n"};
  const int64_t d = observation_rows(load_sized(both, 64).spec).stride();
  EXPECT_EQ(least(both, 64), static_cast<int64_t>(state_bytes(10, 64)) + 64 * 16 * 10 * 4 * d);
  EXPECT_EQ(least(both, 64) - least(one, 64), 64 * 16 * 5 * 4 * d);
  // Two teams of 64 members, each in 4 worlds.
  const MemorySettings snes{"", ", algorithm: snes", "population: {episodes_per_member: 4}\n"};
  EXPECT_EQ(least(snes, 64), static_cast<int64_t>(state_bytes(10, 512)) + 512 * 10 * 4 * d);
}

TEST(LearnMemoryPlan, WhatCannotFitIsRefusedWithTheNumbers) {
  const LoadedRun run = load_sized({"", ""}, 1024);
  const int64_t least = algorithm_of(run.config).least_bytes(run);
  EXPECT_NO_THROW(check_fits(run, kCpu, {2 * least, least}));
  const std::string message = input_error_of([&] { check_fits(run, kCpu, {2 * least, least - 1}); });
  EXPECT_TRUE(contains(message, {"train.n_worlds: 1024 needs more than ", print_bytes(least).c_str(), "on cpu",
                                 print_bytes(2 * least).c_str(), "--plan"}));
}

TEST(LearnMemoryPlan, SaysWhatWasMeasuredAndWhatFits) {
  const LoadedRun run = load_sized({"", ", precision: tf32"}, 64);
  const MemoryPlan plan = plan_of(run, {{32, 100 * kMiB}, {64, 132 * kMiB}});
  EXPECT_EQ(plan_text(run, kCpu, {1000 * kMiB, 196 * kMiB}, plan),
            "measured on cpu, networks in fp32:\n"
            "          32 worlds      100 MiB\n"
            "          64 worlds      132 MiB\n"
            "train.n_worlds 64 takes 132 MiB (measured) and fits: cpu has 196 MiB free of 1000 MiB\n"
            "the largest train.n_worlds that fits is 128 (extrapolated)\n");
  EXPECT_TRUE(contains(plan_text(run, kCpu, {100, 100}, plan), {"does not fit", "not even 1 world would fit"}));
  // The config alone decides over the arithmetic, not the GPU; the CPU computes in fp32.
  const LoadedRun half = load_sized({"", ", algorithm: snes, precision: fp16"}, 512);
  const MemoryPlan members = plan_of(half, {{32, 100 * kMiB}, {64, 132 * kMiB}});
  EXPECT_TRUE(contains(plan_text(half, {Device::Kind::cuda, 99}, {1000 * kMiB, 196 * kMiB}, members),
                       {"measured on cuda:99, networks in fp16 by one fused kernel:\n", "32 members",
                        "population.population_size 512 takes 580 MiB (extrapolated) and does not fit"}));
  EXPECT_TRUE(contains(plan_text(half, kCpu, {1000 * kMiB, 196 * kMiB}, members), {"networks in fp32:\n"}));
}

TEST(LearnMemoryPlan, BytesForPeople) {
  EXPECT_EQ(print_bytes(0), "0 B");
  EXPECT_EQ(print_bytes(1023), "1023 B");
  EXPECT_EQ(print_bytes(1536), "1.50 KiB");
  EXPECT_EQ(print_bytes(int64_t{3} << 40), "3.00 TiB");
}

void play_a_match(const LoadedRun& run, Device device, Learner& learner) {
  play_match(run.spec, policy_controller(*learner.actor(0)), script_controller(Scripted::circle),
             {run.config.eval.episodes, 1, device, 1});
}

/// The plan, without its last trial, of what that trial took.
double extrapolated_over_measured(const std::string& name, MemoryPlan plan) {
  const MemoryPlan::Trial last = plan.trials.back();
  plan.trials.pop_back();
  if (plan.trials.size() < 2) {
    ADD_FAILURE() << name << ": too few trials";
    return 0;
  }
  const double ratio = static_cast<double>(plan.bytes(last.size)) / static_cast<double>(last.bytes);
  for (const MemoryPlan::Trial& t : plan.trials)
    std::cout << name << ": " << t.size << " take " << print_bytes(t.bytes) << std::endl;
  std::cout << name << ": " << last.size << " take " << print_bytes(last.bytes) << ", extrapolated from "
            << plan.trials.back().size << ": " << ratio << " times that" << std::endl;
  return ratio;
}

const MemorySettings kCpuSettings[] = {
    {"Mappo", "", "mappo: {horizon: 16, n_minibatches: 1}\n"},
    {"StateCriticPool", "",
     "mappo: {horizon: 16, n_minibatches: 2, critic: {kind: state}}\nopponents: {pool_size: 4}\n"},
    {"AgainstAScript", ", opponent: pursuer", "mappo: {horizon: 16}\n", "action: continuous\n"},
    {"OpenAiEs", ", algorithm: openai_es", "population: {episodes_per_member: 4}\n"},
    {"Activations", ", algorithm: snes", "population: {episodes_per_member: 64, actor: {hidden: [32, 24]}}\n"},
};

/// Large blocks get pages of their own and give them back when freed. By default the C library moves that limit up to
/// 32 MiB and keeps freed blocks in its heap, where a small block may keep a large one from fitting: 1,024 worlds of
/// `Mappo` then took 210 or 273 MiB, depending on the length of the program's path. Runs keep the default: pages of
/// their own cost training on the CPU 13 % (`configs/quickstart.yaml`).
class LearnMemory : public testing::TestWithParam<MemorySettings> {
 protected:
  void SetUp() override { ASSERT_EQ(::mallopt(M_MMAP_THRESHOLD, 128 << 10), 1); }
};

TEST_P(LearnMemory, TheLineLeadsToTheNextTrial) {
  const LoadedRun run = load_sized(GetParam(), 64);
  const double however_slow = std::numeric_limits<double>::infinity();
  const MemoryPlan plan = measure_memory(
      run, kCpu, 400 * kMiB, [&](Learner& learner) { play_a_match(run, kCpu, learner); }, however_slow);
  EXPECT_TRUE(plan.measured(64));
  int64_t before = 0;
  for (const auto& [size, bytes] : plan.trials) {
    EXPECT_GE(bytes, algorithm_of(run.config).least_bytes(load_sized(GetParam(), size))) << size;
    EXPECT_GE(bytes, before) << size;
    before = bytes;
  }
  const double ratio = extrapolated_over_measured(GetParam().name, plan);
  // Measured: 0.99 to 1.05.
  EXPECT_GE(ratio, 0.9);
  EXPECT_LE(ratio, 1.15);
}

INSTANTIATE_TEST_SUITE_P(All, LearnMemory, testing::ValuesIn(kCpuSettings),
                         [](const auto& p) { return std::string(p.param.name); });

// Of worlds and of members; the larger sizes are measured also where slow tests are thinned.
constexpr int kSmallWorlds = 4096, kSmallPopulation = 512;

class LearnMemoryGpu : public testing::TestWithParam<std::tuple<MemorySettings, int>> {};

// In a process of its own, as ctest does: what LibTorch and CUDA load once counts in the first call of a process only.
TEST_P(LearnMemoryGpu, PlanIsWhatFreeMemoryLoses) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const auto& [settings, size] = GetParam();
  if ((size == kSmallWorlds || size == kSmallPopulation) && thinned(2) > 1) GTEST_SKIP() << "thinned";
  const std::string name = cat(settings.name, ", ", size);
  const LoadedRun run = load_sized(settings, size);
  const auto free_bytes = [] { return static_cast<int64_t>(cuda_device_info(0).memory_free); };
  const int64_t before = free_bytes();
  const MemoryPlan plan = measure_memory(run, kGpu, before, [&](Learner& l) { play_a_match(run, kGpu, l); });
  EXPECT_LT(before - free_bytes(), 600 * kMiB) << "measuring has left memory behind";

  const auto learner = make_learner(run, kGpu);
  for (int u = 0; u < 3; ++u) learner->update();
  play_a_match(run, kGpu, *learner);
  const double ratio = static_cast<double>(plan.bytes(size)) / static_cast<double>(before - free_bytes());
  std::cout << name << ": planned " << print_bytes(plan.bytes(size)) << ", " << ratio << " times what was lost\n";
  EXPECT_GE(ratio, 0.9);
  EXPECT_LE(ratio, 1.1);
  EXPECT_NEAR(extrapolated_over_measured(name, plan), 1.0, 0.25);
}

const MemorySettings kGpuSettings[] = {
    {"Composed", "", "mappo: {horizon: 16, n_epochs: 2, n_minibatches: 8}\n"},
    {"ComposedBf16", ", precision: bf16", "mappo: {horizon: 16, n_epochs: 2, n_minibatches: 8}\n"},
    {"StateCritic", "", "mappo: {horizon: 16, n_epochs: 2, n_minibatches: 8, critic: {kind: state}}\n",
     "maps: four_rooms\n"},
    {"ContinuousObsNorm", "", "mappo: {horizon: 16, n_epochs: 2, n_minibatches: 8, obs_norm: true}\n",
     "action: continuous\n"},
    {"WideLayerNorm", "",
     "mappo: {horizon: 16, n_epochs: 2, n_minibatches: 4, actor: {hidden: [256, 256], layer_norm: true}, critic: "
     "{hidden: [256, 256], layer_norm: true}}\n"},
};
const MemorySettings kGpuPool{"Pool", "", kPool};
const MemorySettings kGpuPopulations[] = {
    {"Fused", ", algorithm: openai_es, precision: fp16", "population: {episodes_per_member: 16}\n"},
    {"FusedWeightDecayPool", ", algorithm: snes, precision: fp16",
     "population: {episodes_per_member: 16, shaping: {weight_decay: 0.01}}\nopponents: {pool_size: 100, "
     "pool_every_updates: 1, pool_share: 0.5}\n"},
    {"Bf16", ", algorithm: snes, precision: bf16", "population: {episodes_per_member: 16}\n"},
    {"LayerNormContinuous", ", algorithm: des",
     "population: {episodes_per_member: 16, noise: low_rank, actor: {layer_norm: true}}\nopponents: {scripted_share: "
     "0.25}\n",
     "action: continuous\n"},
    {"AgainstAScriptEs", ", algorithm: openai_es, opponent: circle, precision: fp32",
     "population: {episodes_per_member: 16}\n"},
};
const auto kGpuName = [](const auto& p) { return cat(std::get<0>(p.param).name, std::get<1>(p.param)); };
INSTANTIATE_TEST_SUITE_P(All, LearnMemoryGpu,
                         testing::Combine(testing::ValuesIn(kGpuSettings), testing::Values(kSmallWorlds, 65536)),
                         kGpuName);
INSTANTIATE_TEST_SUITE_P(Pool, LearnMemoryGpu,
                         testing::Combine(testing::Values(kGpuPool), testing::Values(kSmallWorlds, 65536)), kGpuName);
INSTANTIATE_TEST_SUITE_P(Populations, LearnMemoryGpu,
                         testing::Combine(testing::ValuesIn(kGpuPopulations), testing::Values(kSmallPopulation, 8192)),
                         kGpuName);

}  // namespace
}  // namespace giga::test
