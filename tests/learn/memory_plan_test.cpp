// The memory plan against what LibTorch, our buffers and the process really take.
#include "learn/memory/plan.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/temporary_folder.hpp"
#include "learn/memory/report.hpp"
#include "memory_probe.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "runs.hpp"
#include "sim/world.hpp"

namespace giga::test {
namespace {

/// 5 against 5 and discrete actions, unless `scenario` says otherwise.
struct Settings {
  const char* name;
  const char* mappo;          // keys in flow style
  const char* scenario = "";  // whole lines
  const char* train = "";     // keys in flow style
  const char* more = "";      // whole lines
};
void PrintTo(const Settings& s, std::ostream* out) { *out << s.name; }

LoadedRun load(const Settings& s, int n_worlds) {
  return load_run_config_text(cat("seed: 1\ntrain: {n_worlds: ", n_worlds, ", n_threads: 1", s.train,
                                  "}\nmappo: {horizon: 16, ", s.mappo, "}\neval: {episodes: 8}\n", s.more),
                              five_against_five(s.scenario));
}

constexpr const char* kPool =
    "opponents: {pool_size: 16, pool_every_updates: 1, pool_share: 0.4, scripted: [circle, pursuer], scripted_share: "
    "0.1}\n";

// With one epoch of one minibatch learning takes most; with eight minibatches, the values of the rollout.
const Settings kSettings[] = {
    {"ComposedCritic", "n_epochs: 1, n_minibatches: 1"},
    {"ValuesOfTheRollout", "n_epochs: 1, n_minibatches: 8"},
    {"LayerNorm", "n_epochs: 1, n_minibatches: 1, actor: {layer_norm: true}, critic: {layer_norm: true}"},
    {"WideSilu",
     "n_epochs: 1, n_minibatches: 1, actor: {hidden: [128, 96]}, critic: {hidden: [160, 128, 64], activation: silu}"},
    {"LayerNormGelu",
     "n_epochs: 1, n_minibatches: 1, actor: {layer_norm: true, activation: gelu}, critic: {layer_norm: true, "
     "activation: gelu}"},
    {"StateCritic", "n_epochs: 1, n_minibatches: 1, critic: {kind: state}", "maps: four_rooms\n"},
    {"StateCriticValues", "n_epochs: 1, n_minibatches: 8, critic: {kind: state}"},
    {"StateCriticSilu", "n_epochs: 1, n_minibatches: 1, critic: {kind: state, hidden: [128, 64], activation: silu}"},
    {"Independent", "n_epochs: 1, n_minibatches: 1, critic: {kind: independent, hidden: [96, 96]}"},
    {"Continuous", "n_epochs: 1, n_minibatches: 1", "action: continuous\n"},
    {"ObsNorm", "n_epochs: 1, n_minibatches: 1, obs_norm: true"},
    {"ObsNormContinuousState", "n_epochs: 1, n_minibatches: 2, obs_norm: true, critic: {kind: state}",
     "action: continuous\n"},
    {"AgainstAScript", "n_epochs: 1, n_minibatches: 1", "", ", opponent: circle"},
    {"AgainstAScriptThatLooks", "n_epochs: 1, n_minibatches: 1", "", ", opponent: pursuer"},
    {"Pool", "n_epochs: 1, n_minibatches: 1", "", "", kPool},
    {"PoolValuesOfTheRollout", "n_epochs: 1, n_minibatches: 8", "", "", kPool},
    {"PoolObsNormContinuousState", "n_epochs: 1, n_minibatches: 2, obs_norm: true, critic: {kind: state}",
     "action: continuous\n", "", kPool},
};

class LearnMemory : public testing::TestWithParam<Settings> {};

// Measured: 1.000 to 1.005 for these settings. What is over are numbers per row that the plan gives back late.
TEST_P(LearnMemory, PlanIsWhatTensorsAndStateTake) {
  const LoadedRun run = load(GetParam(), 96);
  const ProbedLearner probed = probe_updates(run, 2);
  int64_t state = 0;
  for (const NamedArray& array : saved(*probed.learner))
    if (array.name.starts_with("simulator/")) state += static_cast<int64_t>(array.bytes.size());
  const int64_t predicted = countable_bytes(plan_memory(run, kCpu));
  const double ratio = static_cast<double>(predicted) / static_cast<double>(probed.peak + state);
  RecordProperty("predicted_over_measured", std::to_string(ratio));
  EXPECT_GE(ratio, 1.0) << predicted << " bytes predicted";
  EXPECT_LE(ratio, 1.02) << predicted << " bytes predicted";
}

INSTANTIATE_TEST_SUITE_P(All, LearnMemory, testing::ValuesIn(kSettings),
                         [](const auto& setting) { return std::string(setting.param.name); });

// Measured: 1.27 with one and with eight minibatches. Both have blocks below 32 MiB, of which the C library keeps an
// amount that the plan can only bound; the share shrinks as runs grow.
TEST(LearnMemoryPlan, ResidentMemoryOfTheProcess) {
  for (const char* mappo : {"n_epochs: 2, n_minibatches: 8", "n_epochs: 2, n_minibatches: 1"}) {
    const std::optional<double> ratio = planned_over_resident(load({"", mappo}, 512));
    if (!ratio) GTEST_SKIP() << "the system does not reset the peak";
    EXPECT_GE(*ratio, 1.0) << mappo;
    EXPECT_LE(*ratio, 1.5) << mappo;
  }
}

TEST(LearnMemoryPlan, CountsAreThoseOfTheNetworks) {
  const LoadedRun run = load({"", "critic: {kind: state, hidden: [24, 16], layer_norm: true}"}, 8);
  const ParallelFor rows(kCpu, 1);
  const CriticShape shape = critic_shape(run.config.mappo.critic, run.spec, 1);
  const Critic critic(run.config.mappo.critic, shape, Precision::fp32, rows, at::kCPU, 1);
  EXPECT_EQ(Critic::count_parameters(run.config.mappo.critic, shape), critic.parameters().values().numel());
  const int64_t obs_size = run.spec.padded_observation_size();
  for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous}) {
    const Actor actor(run.config.mappo.actor, obs_size, actions, false, Precision::fp32, at::kCPU, 1);
    EXPECT_EQ(Actor::count_parameters(run.config.mappo.actor, obs_size, actions), actor.parameters().values().numel());
  }
}

TEST(LearnMemoryPlan, PartsPerWorld) {
  const MemoryPlan small = plan_memory(load(kSettings[0], 64), kCpu),
                   large = plan_memory(load(kSettings[0], 128), kCpu);
  expect_growth(small, large, 64);
  // A world of 10 agents: 17 slots of D floats and a byte, 16 of action, log-probability and reward; 16 times done.
  const int64_t d = load(kSettings[0], 1).spec.padded_observation_size();
  const auto rollout =
      std::find_if(large.items.begin(), large.items.end(), [](const auto& i) { return i.name == "rollout"; });
  ASSERT_NE(rollout, large.items.end());
  EXPECT_EQ(rollout->bytes_per_unit, 17 * 10 * (4 * d + 1) + 16 * 10 * 12 + 16);
}

TEST(LearnMemoryPlan, LargestNumberOfWorldsFitsAndOneMoreDoesNot) {
  // 16 steps and 48 minibatches: n_worlds must be a multiple of 48 / gcd(48, 16) = 3.
  LoadedRun run = load({"", "n_minibatches: 48"}, 48);
  const auto total = [&run](int64_t n_worlds) {
    run.config.train.n_worlds = static_cast<int>(n_worlds);
    return plan_memory(run, kCpu).total();
  };
  for (const int64_t available : {total(48), total(48) - 1, total(300) + 100, int64_t{50} << 30}) {
    const int64_t n = largest_size(run, kCpu, available);
    EXPECT_EQ(n % 3, 0) << n;
    EXPECT_GT(n, 0);
    EXPECT_LE(total(n), available);
    EXPECT_GT(total(n + 3), available);
  }
  EXPECT_EQ(largest_size(run, kCpu, total(48)), 48);
  EXPECT_EQ(largest_size(run, kCpu, total(48) - 1), 45);
  EXPECT_EQ(largest_size(run, kCpu, total(3) - 1), 0);
  EXPECT_EQ(largest_size(run, kCpu, int64_t{1} << 60), 16'777'215);  // the largest multiple of 3 allowed
}

// What bisection needs, across the sizes at which chunks fill up and blocks leave the heap.
TEST(LearnMemoryPlan, GrowsWithTheNumberOfWorlds) {
  for (const Device device : {kCpu, Device{Device::Kind::cuda, 0}}) {
    for (const Settings& settings : kSettings) {
      LoadedRun run = load(settings, 64);
      int64_t before = 0;
      for (int n_worlds = 8; n_worlds < 200'000; n_worlds += n_worlds / 8 / 8 * 8 + 8) {
        run.config.train.n_worlds = n_worlds;
        const int64_t total = plan_memory(run, device).total();
        EXPECT_GT(total, before) << settings.name << " on " << device.name() << ", " << n_worlds << " worlds";
        before = total;
      }
    }
  }
}

TEST(LearnMemoryPlan, ForCuda) {
  const Device gpu{Device::Kind::cuda, 0};
  const Settings bf16{"", "n_minibatches: 1", "", ", precision: bf16"}, fp32{"", "n_minibatches: 1"};
  const MemoryPlan half = plan_memory(load(bf16, 4096), gpu), full = plan_memory(load(fp32, 4096), gpu);
  EXPECT_EQ(item(half, "rollout"), item(full, "rollout"));
  EXPECT_LT(item(half, "learning: actor activations"), item(full, "learning: actor activations"));
  EXPECT_EQ(item(full, "CUDA"), item(plan_memory(load(fp32, 8192), gpu), "CUDA"));
  // The CPU computes in fp32 whatever the precision.
  EXPECT_EQ(plan_memory(load(bf16, 4096), kCpu).total(), plan_memory(load(fp32, 4096), kCpu).total());
  // A world of 5 against 5 has its scratch in shared memory, one of 100 against 100 has not.
  EXPECT_EQ(item(full, "simulator: scratch"), 0);
  const Settings large{"", "n_minibatches: 1",
                       "team_0: [{type: default, count: 100}]\nteam_1: [{type: default, count: 100}]\n"};
  const LoadedRun run = load(large, 64);
  EXPECT_EQ(item(plan_memory(run, gpu), "simulator: scratch"),
            static_cast<int64_t>(64 * ScratchLayout(run.spec.params).size));
}

TEST(LearnMemoryPlan, AScriptedOpponentThatLooksNeedsObservations) {
  const Device gpu{Device::Kind::cuda, 0};
  LoadedRun run = load({"", "n_minibatches: 1"}, 64);
  run.config.eval.opponents = {Scripted::circle};
  const int64_t blind = item(plan_memory(run, gpu), "evaluation");
  run.config.eval.opponents = {Scripted::circle, Scripted::pursuer};
  // 8 episodes of 5 agents, floats.
  EXPECT_EQ(item(plan_memory(run, gpu), "evaluation") - blind, 4 * 8 * 5 * run.spec.padded_observation_size());
}

TEST(LearnMemoryPlan, WhatDoesNotFitIsRefusedWithTheNumbers) {
  const LoadedRun run = load({"", "n_minibatches: 8"}, 1024);
  const int64_t need = plan_memory(run, kCpu).total();
  EXPECT_NO_THROW(check_fits(run, kCpu, {2 * need, need}));
  const std::string message = input_error_of([&] { check_fits(run, kCpu, {2 * need, need - 1}); });
  EXPECT_TRUE(contains(message, {"train.n_worlds: 1024 needs ", print_bytes(need).c_str(), "on cpu", "rollout "}));
  const std::string largest = cat("largest train.n_worlds that fits is ", largest_size(run, kCpu, need - 1));
  EXPECT_TRUE(contains(message, {largest.c_str()}));
  EXPECT_TRUE(contains(input_error_of([&] { check_fits(run, kCpu, {2 * need, 1000}); }), {"not even one world fits"}));
}

TEST(LearnMemoryPlan, TableAndJsonTellTheSame) {
  const LoadedRun run = load({"", "n_minibatches: 8"}, 1024);
  const MemorySpace space{int64_t{64} << 30, int64_t{32} << 30};
  const std::string table = plan_table(run, kCpu, space), json = plan_json(run, kCpu, space).text();
  expect_told(run, table, json);
  const std::string largest = std::to_string(largest_size(run, kCpu, space.free));
  EXPECT_TRUE(contains(table, {"\n\ncpu: 32.0 GiB free of 64.0 GiB; train.n_worlds 1024 fits\n",
                               cat("the largest train.n_worlds that fits is ", largest).c_str()}));
  EXPECT_TRUE(contains(json, {cat("\"largest_n_worlds\": ", largest).c_str(), "\"fits\": true"}));
  EXPECT_TRUE(contains(plan_table(run, kCpu, {100, 100}), {"does not fit"}));
}

TEST(LearnMemoryPlan, BytesForPeople) {
  EXPECT_EQ(print_bytes(0), "0 B");
  EXPECT_EQ(print_bytes(1023), "1023 B");
  EXPECT_EQ(print_bytes(1536), "1.50 KiB");
  EXPECT_EQ(print_bytes(int64_t{3} << 40), "3.00 TiB");
}

class LearnMemoryGpu : public testing::TestWithParam<std::tuple<Settings, int>> {};

TEST_P(LearnMemoryGpu, PlanIsWhatFreeMemoryLoses) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const auto& [settings, n_worlds] = GetParam();
  const double ratio = planned_over_lost(cat(settings.name, ", ", n_worlds, " worlds"), load(settings, n_worlds), 2);
  // Measured on an H200: 1.01 to 1.13.
  EXPECT_GE(ratio, 1.0);
  EXPECT_LE(ratio, 1.15);
}

const Settings kGpuSettings[] = {
    {"Composed", "n_epochs: 2, n_minibatches: 8"},
    {"ComposedBf16", "n_epochs: 2, n_minibatches: 8", "", ", precision: bf16"},
    {"StateCritic", "n_epochs: 2, n_minibatches: 8, critic: {kind: state}", "maps: four_rooms\n"},
    {"ContinuousObsNorm", "n_epochs: 2, n_minibatches: 8, obs_norm: true", "action: continuous\n"},
    {"WideLayerNorm",
     "n_epochs: 2, n_minibatches: 4, actor: {hidden: [256, 256], layer_norm: true}, critic: {hidden: [256, 256], "
     "layer_norm: true}"},
    {"Pool", "n_epochs: 2, n_minibatches: 8", "", "", kPool},
};
INSTANTIATE_TEST_SUITE_P(All, LearnMemoryGpu,
                         testing::Combine(testing::ValuesIn(kGpuSettings), testing::Values(4096, 65536)),
                         [](const auto& p) { return cat(std::get<0>(p.param).name, std::get<1>(p.param)); });

}  // namespace
}  // namespace giga::test
