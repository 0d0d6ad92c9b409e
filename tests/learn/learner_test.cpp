// The learner: rollout and update agree, determinism, save and load, who learns, and every setting for two updates.
#include "learn/learner.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/seeds.hpp"
#include "cuda/runtime.hpp"
#include "game/game.hpp"
#include "io/temporary_folder.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

/// Settings that differ in everything that an update keeps or reads.
struct Variant {
  const char* name;
  SmallRun run;
};
void PrintTo(const Variant& v, std::ostream* out) { *out << v.name; }
SmallRun with_opponents(SmallRun run, const std::string& keys) {
  run.more = "opponents: {" + keys + "}\n";
  return run;
}
/// Networks of images learn on one thread here: those of a convolution's gradient wait for each other in a busy loop,
/// which takes forever where tests share the cores.
SmallRun alone(SmallRun run) {
  run.n_threads = 1;
  return run;
}
constexpr const char* kGru = "hidden: [16], memory: gru, memory_size: 8";
constexpr const char* kEye = "encoder: impala, impala_width: 2, hidden: [8], activation: relu";
constexpr const char *kImages = "observation: {type: rgb, resolution: 12}\n",
                     *kBoth = "observation: {type: rgb_vector, resolution: 9}\n",
                     *kTaught = "observation: {type: rgb_vector, resolution: 9, egocentric_view: true}\n";
const Variant kVariants[] = {
    {"Plain", {}},
    {"ContinuousObsNormStateCritic", {"", "obs_norm: true", "kind: state, hidden: [16, 12]", "action: continuous\n"}},
    {"IndependentHuberBatchNorm",
     {"desynchronize: false", "value_loss: huber, huber_delta: 0.5, advantage_norm: batch",
      "kind: independent, hidden: [16]", ""}},
    {"ClippedCosineLayerNorm",
     {"", "value_loss: clipped, schedule: cosine, advantage_norm: none, value_norm: false",
      "layer_norm: true, activation: gelu, hidden: [16, 16]", ""}},
    {"TargetKl", {"", "target_kl: 1.0e-5, schedule: constant", "hidden: [16]", ""}},
    {"NoClipping", {"", "max_grad_norm: 0", "activation: relu, hidden: [8]", ""}},
    {"WideActor", {"", "", "hidden: [16, 16]", "", 3, "hidden: [129, 8]"}},
    {"WideActorStateCriticOfThree", {"", "", "kind: state, hidden: [8, 8, 8]", "", 3, "hidden: [129, 8]"}},
    {"StateCriticOneLayer", {"", "", "kind: state, hidden: [8], activation: silu", ""}},
    {"ContinuousAgainstCircleRandom",
     {"opponent: circle_random", "obs_norm: true", "hidden: [16]", "action: continuous\n"}},
    {"TeamOneAgainstPursuers", {"opponent: pursuer, learning_team: 1", "", "hidden: [16]", "maps: four_rooms\n"}},
    {"TeamOneAgainstRandom", {"opponent: random, learning_team: 1", "", "kind: state, hidden: [16, 12]", ""}},
    {"ObstaclesWaypointsThreeAgainstOne",
     {"", "", "kind: state, hidden: [16, 12]",
      "maps: four_rooms\nwaypoints: {enable_waypoints: true}\nteam_0: [{type: default, count: 3}]\n"}},
    {"SingleRewardsFadePool",
     with_opponents({"", "shaping_final_factor: 0.5, shaping_final_factors: {damage: 0}, shaping_fade_end: 0.05",
                     "hidden: [16]", "rewards: {game_won: 10, damage: 50, agent_disabled: 10}\n"},
                    "pool_size: 2, pool_every_updates: 1, pool_share: 0.5")},
    {"PoolAndScripts",
     with_opponents({},
                    "pool_size: 3, pool_every_updates: 1, pool_share: 0.5, pool_draw: pfsp, scripted: [circle, "
                    "pursuer], scripted_share: 0.25")},
    {"ContinuousObsNormStateCriticPool",
     with_opponents({"", "obs_norm: true, advantage_norm: batch", "kind: state, hidden: [16, 12]",
                     "action: continuous\nteam_0: [{type: default, count: 3}]\n"},
                    "pool_size: 2, pool_every_updates: 2, pool_share: 0.4, pool_draw: recency")},
    {"MirrorPoolAndScripts",
     alone(with_opponents(
         {"", "mirror: true", "hidden: [16, 12], inputs: egocentric", "observation: {egocentric_view: true}\n", 3,
          "hidden: [16], inputs: egocentric"},
         "pool_size: 2, pool_every_updates: 1, pool_share: 0.5, scripted: [circle], scripted_share: 0.25"))},
    {"OnePolicyPoolAndScripts",
     with_opponents({"", "one_policy: true, obs_norm: true", "hidden: [16, 12]", "", 3, "hidden: [16]"},
                    "pool_size: 2, pool_every_updates: 1, pool_share: 0.5, scripted: [circle], scripted_share: 0.25")},
    {"OnePolicyContinuousStateCriticOfThree",
     {"", "one_policy: true", "kind: state, hidden: [8, 8, 8]", "action: continuous\n", 3, "hidden: [16]"}},
    {"OnePolicyGruTargetKl", {"", "one_policy: true, target_kl: 1.0e-3", kGru, "", 3, kGru}},
    {"OnePolicySharedEncoder", {"", "one_policy: true", "shared_encoder: true, hidden: [12, 8]", ""}},
    {"NoSelfPlay", with_opponents({}, "pool_size: 5, pool_every_updates: 2, pool_share: 1")},
    {"GruObsNorm", {"", "obs_norm: true", kGru, "action: continuous\n", 3, kGru}},
    {"LstmPoolAndScripts",
     with_opponents({"", "", "kind: state, hidden: [8], memory: lstm, memory_size: 6", "", 3,
                     "hidden: [16], memory: lstm, memory_size: 6"},
                    "pool_size: 2, pool_every_updates: 1, pool_share: 0.5, scripted: [circle], scripted_share: 0.25")},
    {"OnlyTheCriticRemembers", {"opponent: circle", "", "kind: independent, hidden: [8], memory: gru", ""}},
    {"ImagesStateCriticPoolAndScripts",
     alone(with_opponents(
         {"", "", "kind: state, hidden: [8]", kImages, 3, kEye},
         "pool_size: 2, pool_every_updates: 1, pool_share: 0.5, scripted: [pursuer], scripted_share: 0.25"))},
    {"ImagesGruCriticOfNumbers",
     alone({"", "", "hidden: [8]", cat(kBoth, "action: continuous\n"), 3, cat(kEye, ", memory: gru, memory_size: 6")})},
    {"ImagesForBoth", alone({"opponent: circle, learning_team: 1", "", kEye, kImages, 3, kEye})},
    {"OnlyTheCriticSeesAndRemembers",
     alone({"", "obs_norm: true", cat(kEye, ", kind: independent, memory: lstm, memory_size: 5"), kBoth})},
    {"SharedEncoderObsNormTargetKl",
     {"", "obs_norm: true, target_kl: 1.0e-3", "shared_encoder: true, hidden: [12, 8]", "action: continuous\n"}},
    {"SharedEncoderBothRememberPoolAndScripts",
     with_opponents(
         {"", "", "shared_encoder: true, kind: independent, hidden: [8], memory: lstm, memory_size: 5", "", 3, kGru},
         "pool_size: 2, pool_every_updates: 1, pool_share: 0.5, scripted: [circle], scripted_share: 0.25")},
    {"SharedEncoderOfImages", alone({"opponent: circle, learning_team: 1", "", "shared_encoder: true, hidden: [8]",
                                     kImages, 3, cat(kEye, ", memory: gru, memory_size: 6")})},
    {"ImagesTaughtTheViewPool", alone(with_opponents({"", "view_coef: 2", "hidden: [8], inputs: egocentric", kTaught, 3,
                                                      cat(kEye, ", memory: gru, memory_size: 6")},
                                                     "pool_size: 2, pool_every_updates: 1, pool_share: 0.5"))},
    {"ImagesTaughtTheViewSharedEncoder", alone({"opponent: circle, learning_team: 1", "view_coef: 2",
                                                "shared_encoder: true, hidden: [8]", kTaught, 3, kEye})},
    {"NatureStateCritic", alone({"opponent: circle", "", "kind: state, hidden: [8]",
                                 "observation: {type: rgb, resolution: 36}\n", 3, "encoder: nature, hidden: [8]"})},
};

/// Whether the policy of the team has played as it is when the team takes its first step; of one policy for both teams
/// that of team 1 comes after team 0's.
bool steps_first(Learner& learner, int team) { return team == 0 || learner.actor(0) != learner.actor(1); }

class LearnVariants : public testing::TestWithParam<Variant> {};

TEST_P(LearnVariants, TwoUpdatesAreFiniteAndStartAtRatioOne) {
  const auto learner = GetParam().run.learner();
  const NamedArrays before = saved(*learner);
  for (int u = 0; u < 2; ++u) {
    const Metrics metrics = learner->update();
    for (int team = 0; team < 2; ++team) {
      if (!learner->actor(team)) continue;
      expect_finite(metrics, team);
      if (steps_first(*learner, team)) {
        EXPECT_LT(metric(metrics, cat("first_ratio_error_", team)), 1e-5) << "update " << u << ", team " << team;
      }
      EXPECT_GT(metric(metrics, cat("living_share_", team)), 0.2);
      EXPECT_GT(metric(metrics, cat("actor_grad_norm_", team)), 1e-6);
    }
  }
  const NamedArrays after = saved(*learner);
  expect_finite(after);
  EXPECT_EQ(learner->updates_done(), 2);
  EXPECT_NE(difference(before, after), "");
}

TEST_P(LearnVariants, SaveLoadAndGoOnEqualsGoingOn) {
  for (const int updates : {0, 3}) {
    SCOPED_TRACE(cat("saved after ", updates));
    const auto learner = GetParam().run.learner();
    for (int u = 0; u < updates; ++u) learner->update();
    const NamedArrays checkpoint = saved(*learner);
    const auto loaded = GetParam().run.learner();
    loaded->update();  // whatever it did before must not matter
    loaded->load(checkpoint);
    EXPECT_EQ(loaded->updates_done(), updates);
    EXPECT_EQ(difference(saved(*loaded), checkpoint), "");
    for (int u = 0; u < (updates > 0 ? 2 : 1); ++u) {
      const Metrics expected = learner->update(), actual = loaded->update();
      EXPECT_EQ(difference(expected, actual), "") << "update " << u << " after loading";
      ASSERT_EQ(difference(saved(*learner), saved(*loaded)), "") << "update " << u << " after loading";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, LearnVariants, testing::ValuesIn(kVariants),
                         [](const auto& variant) { return std::string(variant.param.name); });

// An entropy bonus that outweighs all else, and large steps: without bounds log_std would leave 0.1 at once.
TEST(LearnLearner, DeviationsOfActionsStayWithinTheirBounds) {
  for (const bool fused : {true, false}) {
    SmallRun run;
    run.mappo = cat("learning_rate: 0.1, entropy_coef: 10, fused: ", fused ? "true" : "false");
    run.actor = "hidden: [16, 16], log_std_init: -2, log_std_min: -2.1, log_std_max: -1.9";
    run.scenario = "action: continuous\n";
    const auto learner = run.learner();
    for (int u = 0; u < 3; ++u) learner->update();
    int found = 0;
    for (const NamedArray& array : saved(*learner)) {
      if (!array.name.ends_with("log_std") || array.name.find("adam") != std::string::npos) continue;
      ++found;
      for (const float value : array_values<float>(array))
        EXPECT_FLOAT_EQ(value, -1.9f) << array.name << (fused ? ", fused" : ", by LibTorch");
    }
    EXPECT_EQ(found, 2) << "one a team";
  }
  // Of evolution the mean: it cannot leave a single value, although its members do.
  SmallRun evolution;
  evolution.train = "algorithm: snes";
  evolution.more =
      "population: {population_size: 6, episodes_per_member: 2, actor: {hidden: [8], log_std_min: -0.5, log_std_max: "
      "-0.5}}\n";
  evolution.scenario = "action: continuous\n";
  const auto learner = evolution.learner();
  for (int u = 0; u < 2; ++u) learner->update();
  for (const NamedArray& array : saved(*learner)) {
    if (!array.name.ends_with("actor/log_std")) continue;
    EXPECT_EQ(array_values<float>(array), std::vector<float>(3, -0.5f)) << array.name;
  }
}

TEST(LearnLearner, SameSeedSameArraysAnotherSeedOthers) {
  SmallRun run;
  const auto trained = [&run] {
    const auto learner = run.learner();
    for (int u = 0; u < 3; ++u) learner->update();
    return saved(*learner);
  };
  const NamedArrays first = trained();
  EXPECT_EQ(difference(first, trained()), "");
  run.seed = 4;
  const std::string differing = difference(first, trained());
  for (const char* name : {"simulator/x", "team_0/actor/mlp/0/weight", "team_1/critic/team_mlp/1/team_weight"})
    EXPECT_NE(differing.find(name), std::string::npos) << name << " is the same; differing: " << differing;
}

// Training with a seed does not play the episodes that a match, or another command, plays with that seed.
TEST(LearnLearner, TrainingHasItsOwnStretchOfDraws) {
  SmallRun small;
  small.train = "desynchronize: false";
  const LoadedRun run = small.load();
  const auto starts = [&](uint64_t seed) {
    const auto sim = make_cpu_simulator(run.spec, {run.config.train.n_worlds, seed, 0, OnDone::reset, 1});
    sim->start({});
    NamedArrays state;
    sim->state().save("simulator/", state);
    return find_array(state, "simulator/x").bytes;
  };
  const std::vector<uint8_t> training = find_array(saved(*small.learner()), "simulator/x").bytes;
  EXPECT_EQ(training, starts(seed_of(3, Purpose::training)));
  EXPECT_NE(training, starts(3));
  EXPECT_NE(training, starts(seed_of(3, Purpose::eval)));
  EXPECT_NE(training, starts(seed_of(3, Purpose::evaluation, 0)));
}

TEST(LearnLearner, TeamsStartDifferently) {
  const NamedArrays arrays = saved(*SmallRun{}.learner());
  EXPECT_NE(find_array(arrays, "team_0/actor/mlp/0/weight").bytes,
            find_array(arrays, "team_1/actor/mlp/0/weight").bytes);
}

TEST(LearnLearner, AgainstAScriptOnlyTheLearningTeamLearns) {
  for (const int learning : {0, 1}) {
    SmallRun run;
    run.train = cat("opponent: circle, learning_team: ", learning);
    const auto learner = run.learner();
    EXPECT_NE(learner->actor(learning), nullptr);
    EXPECT_EQ(learner->actor(1 - learning), nullptr);
    const NamedArrays before = saved(*learner);
    const Metrics metrics = learner->update();
    const NamedArrays after = saved(*learner);
    int n_team_arrays = 0;
    for (size_t k = 0; k < after.size(); ++k) {
      EXPECT_FALSE(after[k].name.starts_with(cat("team_", 1 - learning, "/"))) << after[k].name;
      if (!after[k].name.starts_with(cat("team_", learning, "/"))) continue;
      ++n_team_arrays;
      EXPECT_NE(after[k].bytes, before[k].bytes) << after[k].name << " has not changed";
    }
    EXPECT_GT(n_team_arrays, 15);
    expect_finite(metrics, learning);
    EXPECT_TRUE(std::isnan(metric(metrics, cat("policy_loss_", 1 - learning))));
  }
}

// A frozen policy would be another one in the mirror.
TEST(LearnLearner, NobodyHasAMirrorWhereAPolicyIsTheOpponent) {
  SmallRun run;
  run.scenario = "observation: {egocentric_view: true}\n";
  run.actor = run.critic = "hidden: [16], inputs: egocentric";
  const auto changed_by_mirror = [&] {
    const auto after_update = [&](const char* mappo) {
      run.mappo = mappo;
      const auto learner = run.learner();
      learner->update();
      return saved(*learner);
    };
    return !difference(after_update("mirror: true"), after_update("mirror: false")).empty();
  };
  EXPECT_TRUE(changed_by_mirror());
  run.train = "opponent: circle";
  EXPECT_TRUE(changed_by_mirror()) << "the learning team has one";
  const TemporaryFolder folder;
  const std::string frozen = (folder.path() / "frozen.h5").string();
  run.train = "";
  save(run, frozen);
  run.train = cat("opponent: '", frozen, "'");
  EXPECT_FALSE(changed_by_mirror());
}

TEST(LearnLearner, TargetKlSkipsTheRestOfAnUpdate) {
  SmallRun run;
  EXPECT_EQ(metric(run.learner()->update(), "skipped_share_0"), 0);
  // The first minibatch moves the policy by far more than 1e-6, so that at least one and at most seven of the eight
  // minibatches are skipped.
  run.mappo = "target_kl: 1.0e-6";
  const Metrics metrics = run.learner()->update();
  for (const char* name : {"skipped_share_0", "skipped_share_1"}) {
    EXPECT_GE(metric(metrics, name), 1 / 8.0);
    EXPECT_LE(metric(metrics, name), 7 / 8.0);
  }
  // And a target that nothing reaches skips nothing.
  run.mappo = "target_kl: 1000";
  EXPECT_EQ(metric(run.learner()->update(), "skipped_share_0"), 0);
}

TEST(LearnLearner, ScheduleAndCounters) {
  // 24 worlds x 8 steps x 4 agents = 768 agent-steps an update; 100,000 make 131 updates. Linear to zero; update u is
  // made with the factor of u - 1 updates done, the first with 1.
  const auto learner = SmallRun{}.learner();
  EXPECT_EQ(learner->agent_steps_done(), 0);
  for (int u = 1; u <= 3; ++u) {
    const Metrics metrics = learner->update();
    EXPECT_NEAR(metric(metrics, "learning_rate_factor"), 1 - (u - 1) / 131.0, 1e-12);
    EXPECT_EQ(learner->agent_steps_done(), 768 * u);
  }
}

TEST(LearnLearnerGpu, ThreeUpdatesAndGoingOn) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  for (const Variant& variant : kVariants) {
    SCOPED_TRACE(variant.name);
    const auto learner = variant.run.learner(gpu);
    const auto update = [&](Learner& of) {
      const Metrics metrics = of.update();
      for (int team = 0; team < 2; ++team) {
        if (!of.actor(team)) continue;
        expect_finite(metrics, team);
        if (steps_first(of, team)) {
          EXPECT_LT(metric(metrics, cat("first_ratio_error_", team)), 1e-3);
        }
      }
      return metrics;
    };
    for (int u = 0; u < 3; ++u) update(*learner);
    const NamedArrays checkpoint = saved(*learner);
    expect_finite(checkpoint);
    const auto loaded = variant.run.learner(gpu);
    loaded->load(checkpoint);
    const Metrics expected = update(*learner), actual = update(*loaded);
    EXPECT_EQ(difference(expected, actual), "");
    EXPECT_EQ(difference(saved(*learner), saved(*loaded)), "");
  }
}

// A minibatch that is queued as a graph does what its kernels do one by one: also with other step sizes and another
// weight of the entropy, and where minibatches have two sizes, as in those worlds that a pool leaves.
TEST(LearnLearnerGpu, RecordedMinibatchesEqualKernelsOneByOne) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  for (const Variant& variant : kVariants)
    for (const bool fused : {false, true}) {  // where only the actor is, it is part of the graph
      SCOPED_TRACE(cat(variant.name, fused ? ", fused" : ""));
      const auto learner = [&](const char* graphs) {
        SmallRun run = variant.run;
        if (fused) run.precision = "tf32";
        run.mappo +=
            cat(run.mappo.empty() ? "" : ", ", "fused: ", fused ? "true" : "false", ", entropy_target: 2, ", graphs);
        return run.learner({Device::Kind::cuda, 0});
      };
      const auto recorded = learner("graphs: true"), plain = learner("graphs: false");
      for (int u = 0; u < 4; ++u) {
        EXPECT_EQ(difference(plain->update(), recorded->update()), "") << "update " << u;
        ASSERT_EQ(difference(saved(*plain), saved(*recorded)), "") << "update " << u;
      }
    }
}

/// The largest difference of the parameters of a kind of network, actor or critic, and the largest change of one since
/// `before`.
std::pair<double, double> differences_of(const std::string& network, const NamedArrays& a, const NamedArrays& b,
                                         const NamedArrays& before) {
  double apart = 0, change = 0;
  for (const NamedArray& array : before) {
    const std::string& name = array.name;
    if (!name.starts_with(cat("team_0/", network, "/")) && !name.starts_with(cat("team_1/", network, "/"))) continue;
    if (name.find("normalizer") != std::string::npos) continue;
    const auto of = [&name](const NamedArrays& all) { return array_values<float>(find_array(all, name)); };
    const std::vector<float> x = of(a), y = of(b), start = of(before);
    for (size_t k = 0; k < x.size(); ++k) {
      apart = std::max(apart, std::abs(static_cast<double>(x[k]) - static_cast<double>(y[k])));
      change = std::max(change, std::abs(static_cast<double>(x[k]) - static_cast<double>(start[k])));
    }
  }
  return {apart, change};
}

// An actor whose critic the fused kernels do not serve learns by them all the same; a critic of the true state is
// served.
TEST(LearnLearner, FusedNetworksLearnWhatLibTorchsWould) {
  struct Case {
    const char* name;
    const char* ways;
    SmallRun run;
  };
  const char* actor_alone = "the actor learns by fused kernels, the critic by LibTorch";
  const Case cases[] = {
      {"state", "learns by fused kernels", {"", "obs_norm: true", "kind: state, hidden: [16, 12]", ""}},
      {"deep state", actor_alone, {"", "obs_norm: true", "kind: state, hidden: [16, 12, 8]", "action: continuous\n"}},
      {"memory", actor_alone, {"", "advantage_norm: batch", "kind: independent, hidden: [8], memory: gru", ""}},
      {"layer norm", actor_alone, {"", "", "hidden: [16, 16], layer_norm: true", ""}},
      {"one policy", "learns by fused kernels", {"", "one_policy: true", "kind: state, hidden: [16, 12]", ""}},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    const auto learner = [&](bool fused) {
      SmallRun run = c.run;
      run.mappo += cat(run.mappo.empty() ? "" : ", ", "fused: ", fused ? "true" : "false");
      return run.learner();
    };
    const auto fused = learner(true), plain = learner(false);
    EXPECT_TRUE(fused->ways().starts_with(c.ways)) << fused->ways();
    EXPECT_TRUE(plain->ways().starts_with("learns by LibTorch")) << plain->ways();
    const NamedArrays before = saved(*fused);
    fused->update();
    plain->update();
    // Adam's first steps are of one size whatever the gradient's, so a rounding at 0 shows whole: 8 steps of 3e-4 are
    // 2.4e-3. A hundredth of that is left to such numbers.
    for (const char* network : {"actor", "critic"}) {
      const auto [apart, change] = differences_of(network, saved(*fused), saved(*plain), before);
      EXPECT_GT(change, 1e-3) << network;
      EXPECT_LT(apart, 2.4e-5) << network;
    }
  }
}

// Rollouts of networks that fused kernels serve are recorded whole, those that somebody watches are queued step by
// step.
TEST(LearnLearnerGpu, RecordedRolloutsEqualStepsOneByOne) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  for (const Variant& variant : kVariants) {
    SCOPED_TRACE(variant.name);
    SmallRun run = variant.run;
    run.precision = "tf32";
    GameObserver watcher;
    const auto recorded = run.learner({Device::Kind::cuda, 0}), plain = run.learner({Device::Kind::cuda, 0});
    plain->watch(watcher);
    for (int u = 0; u < 4; ++u) {
      EXPECT_EQ(difference(plain->update(), recorded->update()), "") << "update " << u;
      ASSERT_EQ(difference(saved(*plain), saved(*recorded)), "") << "update " << u;
    }
    EXPECT_EQ(recorded->refusal(), "");
  }
}

TEST(LearnLearner, AnObserverOfItsGamesChangesNothing) {
  /// Wants what learners keep for themselves too.
  struct Watcher final : GameObserver {
    void before_step(int64_t, GameStep& step) override {
      want(step.io.done, done.data());
      want(step.io.team[1].reward, reward.data());
      step.rows[0].wanted |= ObservationSet::all();
    }
    void after_step(int64_t, const GameStep& step) override {
      if (step.io.done && step.io.team[1].reward && step.rows[0].obs) ++seen;
    }
    std::vector<uint8_t> done = std::vector<uint8_t>(1000);
    std::vector<float> reward = std::vector<float>(2000);
    int seen = 0;
  };
  SmallRun evolution;
  evolution.train = "algorithm: snes";
  evolution.more = "population: {population_size: 6, episodes_per_member: 2, actor: {hidden: [8]}}\n";
  for (const SmallRun& run : {SmallRun{}, evolution}) {
    Watcher watcher;
    const auto alone = run.learner(), watched = run.learner();
    watched->watch(watcher);
    for (int k = 0; k < 2; ++k) EXPECT_EQ(difference(alone->update(), watched->update()), "");
    EXPECT_EQ(difference(saved(*alone), saved(*watched)), "");
    EXPECT_GE(watcher.seen, 16) << "mappo: two rollouts of 8 steps";
  }
}

}  // namespace
}  // namespace giga::test
