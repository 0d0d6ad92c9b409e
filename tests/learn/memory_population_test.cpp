// The memory plan of evolution strategies against what LibTorch and our buffers really take.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/temporary_folder.hpp"
#include "learn/memory/plan.hpp"
#include "learn/memory/report.hpp"
#include "memory_probe.hpp"
#include "policy/actor.hpp"
#include "runs.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

constexpr Device kGpu{Device::Kind::cuda, 0};

/// 5 against 5 and discrete actions, unless `scenario` says otherwise; 4 episodes a member, 3 steps each.
struct PopulationSettings {
  const char* name;
  const char* train;            // keys in flow style
  const char* population = "";  // likewise
  const char* more = "";        // whole lines
  const char* scenario = "";    // likewise
  int episodes = 4;             // of a member
};
void PrintTo(const PopulationSettings& s, std::ostream* out) { *out << s.name; }

LoadedRun load_population(const PopulationSettings& s, int members) {
  return load_run_config_text(
      cat("seed: 1\ntrain: {n_threads: 1, ", s.train, "}\npopulation: {population_size: ", members,
          ", episodes_per_member: ", s.episodes, ", max_steps: 3, ", s.population, "}\neval: {episodes: 8}\n", s.more),
      five_against_five(s.scenario));
}

const PopulationSettings kPopulationSettings[] = {
    {"OpenAiEs", "algorithm: openai_es"},
    {"Snes", "algorithm: snes"},
    {"Des", "algorithm: des"},
    {"OpenAiEsClipUpWinRate", "algorithm: openai_es", "objective: win_rate", "openai_es: {optimizer: clip_up}\n"},
    {"LowRankNoise", "algorithm: snes", "noise: low_rank, noise_rank: 2"},
    {"Pool", "algorithm: openai_es", "", "opponents: {pool_size: 20, pool_every_updates: 1, pool_share: 0.5}\n"},
    {"WeightDecay", "algorithm: des", "shaping: {weight_decay: 0.01}"},
    {"Continuous", "algorithm: snes", "", "", "action: continuous\n"},
    {"AgainstAScript", "algorithm: snes, opponent: pursuer"},
    {"ScriptsAmongOpponents", "algorithm: des", "", "opponents: {scripted: [circle], scripted_share: 0.5}\n"},
    {"Alternating", "algorithm: openai_es", "turns: alternating"},
    // Activations take most.
    {"Activations", "algorithm: snes", "actor: {hidden: [32, 24]}", "", "", 64},
    {"Rounds", "algorithm: des", "parallel_episodes: 2"},
    {"LayerNormGelu", "algorithm: snes", "actor: {hidden: [32, 24], activation: gelu, layer_norm: true}", "", "", 64},
    {"UnequalTeams", "algorithm: snes, opponent: circle", "actor: {hidden: [32]}", "",
     "maps: four_rooms\nteam_0: [{type: default, count: 2}]\nteam_1: [{type: default, count: 7}]\n", 64},
};

// A world takes what it takes, however many episodes it plays.
TEST(LearnMemoryPopulationPlan, EpisodesOneAfterTheOtherShareAWorld) {
  const auto total = [](int episodes, const char* population) {
    return plan_memory(load_population({"", "algorithm: snes", population, "", "", episodes}, 64), kCpu).total();
  };
  EXPECT_EQ(total(64, "parallel_episodes: 4"), total(4, ""));
  EXPECT_LT(total(4, ""), total(64, ""));
}

class LearnMemoryPopulation : public testing::TestWithParam<PopulationSettings> {};

// Measured: 1.000 to 1.003 for these settings; 1.010 with a pool, for the copies of a checkpoint.
TEST_P(LearnMemoryPopulation, PlanIsWhatTensorsAndStateTake) {
  const LoadedRun run = load_population(GetParam(), 64);
  const ProbedLearner probed = probe_updates(run, 3);
  SimOptions sim;
  sim.n_worlds = populations_at_a_time(run.config) * 64 * run.config.population.n_worlds();
  sim.n_threads = 1;
  const auto state = static_cast<int64_t>(make_simulator(run.spec, sim, kCpu)->state().save().size());
  const int64_t predicted = countable_bytes(plan_memory(run, kCpu));
  const double ratio = static_cast<double>(predicted) / static_cast<double>(probed.peak + state);
  RecordProperty("predicted_over_measured", std::to_string(ratio));
  EXPECT_GE(ratio, 1.0) << predicted << " bytes predicted";
  EXPECT_LE(ratio, 1.1) << predicted << " bytes predicted";
}

INSTANTIATE_TEST_SUITE_P(All, LearnMemoryPopulation, testing::ValuesIn(kPopulationSettings),
                         [](const auto& setting) { return std::string(setting.param.name); });

// Measured: 1.37 where members take most, 1.25 where activations do; the difference is the program, which is smaller in
// a test than in training.
TEST(LearnMemoryPopulationPlan, ResidentMemoryOfTheProcess) {
  for (const char* name : {"OpenAiEs", "LayerNormGelu"}) {
    const PopulationSettings& settings =
        *std::find_if(std::begin(kPopulationSettings), std::end(kPopulationSettings),
                      [&](const PopulationSettings& s) { return std::string(s.name) == name; });
    const std::optional<double> ratio = planned_over_resident(load_population(settings, 512));
    if (!ratio) GTEST_SKIP() << "the system does not reset the peak";
    RecordProperty(cat("predicted_over_measured_", name), std::to_string(*ratio));
    EXPECT_GE(*ratio, 1.0) << name;
    EXPECT_LE(*ratio, 1.6) << name;
  }
}

TEST(LearnMemoryPopulationPlan, PartsPerMember) {
  const MemoryPlan small = plan_memory(load_population(kPopulationSettings[0], 64), kCpu),
                   large = plan_memory(load_population(kPopulationSettings[0], 128), kCpu);
  expect_growth(small, large, 64);
  // Two teams of members, each in 4 worlds of 10 agents with D floats and an action.
  const LoadedRun run = load_population(kPopulationSettings[0], 64);
  const int64_t d = run.spec.padded_observation_size();
  EXPECT_EQ(item(small, "observations, actions"), 64 * 2 * 4 * 10 * 4 * (d + 1));
  const int64_t p = Actor::count_parameters(run.config.population.actor, d, ActionKind::discrete);
  EXPECT_EQ(item(small, "members"), 64 * 2 * 4 * p);
}

TEST(LearnMemoryPopulationPlan, LargestPopulationFitsAndTwoMoreDoNot) {
  LoadedRun run = load_population(kPopulationSettings[0], 64);
  const auto total = [&run](int64_t members) {
    run.config.population.population_size = static_cast<int>(members);
    return plan_memory(run, kCpu).total();
  };
  for (const int64_t available : {total(48), total(48) - 1, total(300) + 100, int64_t{8} << 30}) {
    const int64_t n = largest_size(run, kCpu, available);
    EXPECT_EQ(n % 2, 0) << n;
    EXPECT_GT(n, 0);
    EXPECT_LE(total(n), available);
    EXPECT_GT(total(n + 2), available);
  }
  EXPECT_EQ(largest_size(run, kCpu, total(2000)), 2000);
  EXPECT_EQ(largest_size(run, kCpu, total(2000) - 1), 1998);
  EXPECT_EQ(largest_size(run, kCpu, total(2) - 1), 0);
  EXPECT_EQ(largest_size(run, kCpu, int64_t{1} << 60), 1'000'000);  // all that is allowed
  run.config.population.episodes_per_member = 1000;
  EXPECT_EQ(largest_size(run, kCpu, int64_t{1} << 60), 8388);  // 2 x 8,388 x 1,000 worlds, of 16,777,216
  run.config.population.antithetic = false;
  EXPECT_EQ(largest_size(run, kCpu, total(2001)), 2001);
  EXPECT_EQ(largest_size(run, kCpu, total(2) - 1), 0);  // a population of one is not allowed
}

// What bisection needs, across the sizes at which blocks leave the heap and other phases become the largest.
TEST(LearnMemoryPopulationPlan, GrowsWithThePopulation) {
  for (const Device device : {kCpu, kGpu}) {
    for (const PopulationSettings& settings : kPopulationSettings) {
      LoadedRun run = load_population(settings, 2);
      int64_t before = 0;
      for (int members = 2; members < 100'000; members += members / 8 / 2 * 2 + 2) {
        run.config.population.population_size = members;
        const int64_t total = plan_memory(run, device).total();
        EXPECT_GT(total, before) << settings.name << " on " << device.name() << ", " << members << " members";
        before = total;
      }
    }
  }
}

TEST(LearnMemoryPopulationPlan, ForCuda) {
  const MemoryPlan fused = plan_memory(load_population({"", "algorithm: snes, precision: fp16"}, 512), kGpu);
  // Networks 112 -> 64 -> 64 -> 28 in half precision: slabs of 32 inputs x tiles of 8 outputs x 256 numbers, and
  // biases: (4 x 8 x 256 + 64) + (2 x 8 x 256 + 64) + (2 x 4 x 256 + 32), and 8 for log_std.
  ASSERT_EQ(load_population({"", "algorithm: snes"}, 512).spec.padded_observation_size(), 112);
  EXPECT_EQ(item(fused, "members in half precision"), 2 * 512 * 2 * 14'504);
  // Activations only where LibTorch computes.
  EXPECT_EQ(item(fused, "playing: activations"), 0);
  EXPECT_EQ(item(fused, "simulator: list of worlds"), 4 * (2 * 512 * 4 + 1));
  for (const PopulationSettings& s :
       {PopulationSettings{"", "algorithm: snes, precision: bf16", "", "", "", 64},
        PopulationSettings{"", "algorithm: snes", "actor: {layer_norm: true}", "", "", 64},
        PopulationSettings{"", "algorithm: snes", "actor: {hidden: [32, 32]}", "", "", 64}}) {
    const MemoryPlan plan = plan_memory(load_population(s, 512), kGpu);
    EXPECT_EQ(item(plan, "members in half precision"), 0) << s.train << s.population;
    EXPECT_GT(item(plan, "playing: activations"), 0) << s.train << s.population;
  }
}

TEST(LearnMemoryPopulationPlan, TheKernelsLayoutNeedsNoActor) {
  const ActorConfig config = load_population(kPopulationSettings[0], 2).config.population.actor;
  for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous}) {
    const Actor actor(config, 40, actions, false, Precision::fp16, at::kCPU, 1);
    const auto expected = actor.small_mlp(), found = Actor::small_mlp(config, 40, actions, Precision::fp16);
    ASSERT_TRUE(expected && found);
    EXPECT_EQ(found->n_layers, expected->n_layers);
    EXPECT_TRUE(std::equal(std::begin(found->width), std::end(found->width), std::begin(expected->width)));
    EXPECT_TRUE(std::equal(std::begin(found->bias), std::end(found->bias), std::begin(expected->bias)));
    EXPECT_EQ(found->width[0], 40);
    EXPECT_EQ(found->width[found->n_layers], actor.head_size());
    EXPECT_EQ(found->log_std, expected->log_std);
  }
  EXPECT_FALSE(Actor::small_mlp(config, 40, ActionKind::discrete, Precision::tf32));
}

TEST(LearnMemoryPopulationPlan, WhatDoesNotFitIsRefusedWithTheNumbers) {
  const LoadedRun run = load_population(kPopulationSettings[0], 2048);
  const int64_t need = plan_memory(run, kCpu).total();
  EXPECT_NO_THROW(check_fits(run, kCpu, {2 * need, need}));
  const std::string message = input_error_of([&] { check_fits(run, kCpu, {2 * need, need - 1}); });
  EXPECT_TRUE(contains(message, {"population.population_size: 2048 needs ", print_bytes(need).c_str(), "on cpu",
                                 "members ", "largest population.population_size that fits is 2046"}));
  EXPECT_TRUE(contains(input_error_of([&] {
                         check_fits(run, kCpu, {2 * need, 1000});
                       }),
                       {"not even the smallest population fits"}));
}

TEST(LearnMemoryPopulationPlan, TableAndJsonTellTheSame) {
  const LoadedRun run = load_population(kPopulationSettings[0], 512);
  const MemorySpace space{int64_t{64} << 30, int64_t{32} << 30};
  const std::string table = plan_table(run, kCpu, space), json = json_text(plan_json(run, kCpu, space));
  expect_told(run, table, json);
  const std::string largest = std::to_string(largest_size(run, kCpu, space.free));
  EXPECT_TRUE(contains(table, {"per member", "population.population_size 512 fits\n",
                               cat("the largest population.population_size that fits is ", largest).c_str()}));
  EXPECT_TRUE(contains(json, {"\"population_size\": 512", cat("\"largest_population_size\": ", largest).c_str()}));
  EXPECT_EQ(json.find("n_worlds"), std::string::npos) << json;
}

TEST(LearnMemoryPopulationPlan, SaysWhatComputesTheMembersNetworks) {
  constexpr MemorySpace kSpace{int64_t{64} << 30, int64_t{32} << 30};
  constexpr Device kAbsent{Device::Kind::cuda, 99};
  const auto check = [&](const PopulationSettings& s, Device device, MemberNetworks networks, const char* line,
                         const char* json, const char* precision) {
    const LoadedRun run = load_population(s, 512);
    EXPECT_EQ(plan_memory(run, device).networks, networks) << line;
    EXPECT_TRUE(contains(plan_table(run, device, kSpace), {line}));
    EXPECT_TRUE(contains(json_text(plan_json(run, device, kSpace)), {json, precision}));
  };
  // The config alone decides, not the GPU and not the sizes of networks; the CPU computes in fp32.
  const PopulationSettings half{"", "algorithm: snes, precision: fp16"}, plain{"", "algorithm: snes"};
  check(half, kAbsent, MemberNetworks::fused,
        "\n\nmembers' networks: in fp16, by the fused kernel\ncuda:99: ", "\"member_networks\": \"fused\"",
        "\"precision\": \"fp16\"");
  check(half, kCpu, MemberNetworks::libtorch,
        "\n\nmembers' networks: in fp32, through LibTorch\ncpu: ", "\"member_networks\": \"libtorch\"",
        "\"precision\": \"fp32\"");
  check(plain, kAbsent, MemberNetworks::libtorch, "\n\nmembers' networks: in tf32, through LibTorch\n",
        "\"member_networks\": \"libtorch\"", "\"precision\": \"tf32\"");
}

TEST(LearnMemoryPopulationPlan, ShippedConfigsAskForTheFusedKernel) {
  for (const char* name : {"openai_es", "snes", "des"}) {
    const LoadedRun run = load_run_config(source_path(cat("configs/", name, ".yaml")), {});
    EXPECT_EQ(plan_memory(run, {Device::Kind::cuda, 99}).networks, MemberNetworks::fused) << name;
  }
}

class LearnMemoryPopulationGpu : public testing::TestWithParam<std::tuple<PopulationSettings, int>> {};

TEST_P(LearnMemoryPopulationGpu, PlanIsWhatFreeMemoryLoses) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const auto& [settings, members] = GetParam();
  const double ratio =
      planned_over_lost(cat(settings.name, ", ", members, " members"), load_population(settings, members), 3);
  // Measured on an H200, less the 35 MiB by which the plan has shrunk since: 1.20 to 1.27 for 512 members, of 0.3 to
  // 0.4 GiB, and 1.00 to 1.12 for 8,192.
  EXPECT_GE(ratio, 1.0);
  EXPECT_LE(ratio, members <= 512 ? 1.3 : 1.15);
}

const PopulationSettings kGpuPopulationSettings[] = {
    {"Fused", "algorithm: openai_es, precision: fp16", "", "", "", 16},
    {"FusedWeightDecayPool", "algorithm: snes, precision: fp16", "shaping: {weight_decay: 0.01}",
     "opponents: {pool_size: 100, pool_every_updates: 1, pool_share: 0.5}\n", "", 16},
    {"Bf16", "algorithm: snes, precision: bf16", "", "", "", 16},
    {"LayerNormContinuous", "algorithm: des", "noise: low_rank, actor: {layer_norm: true}",
     "opponents: {scripted_share: 0.25}\n", "action: continuous\n", 16},
    {"AgainstAScript", "algorithm: openai_es, opponent: circle, precision: fp32", "", "", "", 16},
};
INSTANTIATE_TEST_SUITE_P(All, LearnMemoryPopulationGpu,
                         testing::Combine(testing::ValuesIn(kGpuPopulationSettings), testing::Values(512, 8192)),
                         [](const auto& p) { return cat(std::get<0>(p.param).name, std::get<1>(p.param)); });

}  // namespace
}  // namespace giga::test
