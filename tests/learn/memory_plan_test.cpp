// The memory plan against what LibTorch, our buffers and the process really take.
#include "learn/memory/plan.hpp"

#include <c10/util/ThreadLocalDebugInfo.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "cuda/runtime.hpp"
#include "eval/match.hpp"
#include "learn/memory/report.hpp"
#include "memory_probe.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "runs.hpp"
#include "sim/world.hpp"

namespace giga::test {
namespace {

constexpr Device kCpu{};

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
  constexpr const char* kTeams = "team_0: [{type: default, count: 5}]\nteam_1: [{type: default, count: 5}]\n";
  const bool teams_given = std::string(s.scenario).find("team_0") != std::string::npos;
  return load_run_config_text(cat("seed: 1\ntrain: {n_worlds: ", n_worlds, ", n_threads: 1", s.train,
                                  "}\nmappo: {horizon: 16, ", s.mappo, "}\neval: {episodes: 8}\n", s.more),
                              cat("max_episode_length: 100\n", teams_given ? "" : kTeams, s.scenario));
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
  const auto counter = std::make_shared<AllocationPeak>();
  const c10::DebugInfoGuard guard(c10::DebugInfoKind::PROFILER_STATE, counter);
  const auto learner = make_learner(run, kCpu);
  for (int u = 0; u < 2; ++u) learner->update();

  int64_t state = 0;
  for (const NamedArray& array : saved(*learner))
    if (array.name.starts_with("simulator/")) state += static_cast<int64_t>(array.bytes.size());
  const MemoryPlan plan = plan_memory(run, kCpu);
  const int64_t predicted = plan.total() - item(plan, "program") - item(plan, "slack of the allocator");
  const double ratio = static_cast<double>(predicted) / static_cast<double>(counter->peak() + state);
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
    const LoadedRun run = load({"", mappo}, 512);
    if (!reset_peak_resident()) GTEST_SKIP() << "the system does not reset the peak";
    const auto learner = make_learner(run, kCpu);
    for (int u = 0; u < 2; ++u) learner->update();
    const double ratio = static_cast<double>(plan_memory(run, kCpu).total()) / static_cast<double>(peak_resident());
    EXPECT_GE(ratio, 1.0) << mappo;
    EXPECT_LE(ratio, 1.5) << mappo;
  }
}

TEST(LearnMemoryPlan, CountsAreThoseOfTheNetworks) {
  const LoadedRun run = load({"", "critic: {kind: state, hidden: [24, 16], layer_norm: true}"}, 8);
  const RowRunner rows(kCpu, 1);
  const CriticShape shape = critic_shape(run.spec, 1);
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
  ASSERT_EQ(small.items.size(), large.items.size());
  for (size_t k = 0; k < small.items.size(); ++k) {
    const MemoryItem &a = small.items[k], &b = large.items[k];
    SCOPED_TRACE(a.name);
    ASSERT_EQ(a.name, b.name);
    if (a.name == "slack of the allocator") continue;  // a bound, neither proportional nor constant
    // Per field of the state up to 255 bytes of padding.
    EXPECT_NEAR(static_cast<double>(b.bytes - a.bytes), 64.0 * static_cast<double>(a.bytes_per_unit), 8192) << a.bytes;
  }
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
  try {
    check_fits(run, kCpu, {2 * need, need - 1});
    FAIL() << "not refused";
  } catch (const InputError& e) {
    const std::string message = e.what();
    for (const std::string& part :
         {std::string("train.n_worlds: 1024 needs "), print_bytes(need), std::string("on cpu"), std::string("rollout "),
          cat("largest train.n_worlds that fits is ", largest_size(run, kCpu, need - 1))})
      EXPECT_NE(message.find(part), std::string::npos) << part << " is not in: " << message;
  }
  try {
    check_fits(run, kCpu, {2 * need, 1000});
    FAIL() << "not refused";
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("not even one world fits"), std::string::npos) << e.what();
  }
}

TEST(LearnMemoryPlan, TableAndJsonTellTheSame) {
  const LoadedRun run = load({"", "n_minibatches: 8"}, 1024);
  const MemoryPlan plan = plan_memory(run, kCpu);
  const MemorySpace space{int64_t{64} << 30, int64_t{32} << 30};
  const std::string table = plan_table(run, kCpu, space), json = plan_json(run, kCpu, space).text();
  for (const MemoryItem& i : plan.items) {
    EXPECT_NE(table.find(i.name), std::string::npos) << i.name;
    EXPECT_NE(json.find(cat("\"bytes\": ", i.bytes)), std::string::npos) << i.name;
  }
  const int64_t largest = largest_size(run, kCpu, space.free);
  EXPECT_NE(
      table.find(cat("32.0 GiB free of 64.0 GiB; train.n_worlds 1024 fits\nthe largest train.n_worlds that fits is ",
                     largest)),
      std::string::npos)
      << table;
  EXPECT_NE(json.find(cat("\"largest_n_worlds\": ", largest)), std::string::npos) << json;
  EXPECT_NE(json.find("\"fits\": true"), std::string::npos) << json;
  EXPECT_NE(plan_table(run, kCpu, {100, 100}).find("does not fit"), std::string::npos);
}

TEST(LearnMemoryPlan, BytesForPeople) {
  EXPECT_EQ(print_bytes(0), "0 B");
  EXPECT_EQ(print_bytes(1023), "1023 B");
  EXPECT_EQ(print_bytes(1536), "1.50 KiB");
  EXPECT_EQ(print_bytes(int64_t{3} << 40), "3.00 TiB");
}

class LearnMemoryGpu : public testing::TestWithParam<std::tuple<Settings, int>> {};

// The drop of the GPU's free memory through two updates and an evaluation, LibTorch's cache included. Run it in a
// process of its own, as ctest does: what LibTorch and CUDA load once counts in the first test of a process only.
TEST_P(LearnMemoryGpu, PlanIsWhatFreeMemoryLoses) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const auto& [settings, n_worlds] = GetParam();
  const LoadedRun run = load(settings, n_worlds);
  const int64_t before = free_gpu_bytes();
  const auto learner = make_learner(run, gpu);
  for (int u = 0; u < 2; ++u) learner->update();
  play_match(run.spec, {learner->actor(0)}, {nullptr, Scripted::circle}, {run.config.eval.episodes, 1, gpu, 1});
  const int64_t measured = before - free_gpu_bytes();

  const double ratio = print_gpu_plan(cat(settings.name, ", ", n_worlds, " worlds"), plan_memory(run, gpu), measured);
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
};
INSTANTIATE_TEST_SUITE_P(All, LearnMemoryGpu,
                         testing::Combine(testing::ValuesIn(kGpuSettings), testing::Values(4096, 65536)),
                         [](const auto& p) { return cat(std::get<0>(p.param).name, std::get<1>(p.param)); });

}  // namespace
}  // namespace giga::test
