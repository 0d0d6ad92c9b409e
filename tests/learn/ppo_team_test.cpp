// PpoTeam on a rollout of eight rows that is worked out by hand: values, advantages, moments over the living, losses.
#include "learn/mappo/ppo_team.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "core/error.hpp"
#include "learn/mappo/sequence_order.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

// Two worlds of two agents, two steps; gamma = lambda = 1/2. Rows are [t][world][agent]:
//
//                     t = 0                             t = 1                                    after
//   world 0, agent 0: V 1, r  1, A 1.5,   R 2.5         V 2, r 2, A 2, R 4                       V 4
//   world 0, agent 1: V 3, r  0, A -2.25, R 0.75        V 1, r 1, A 1, R 2                       V 2
//   world 1, agent 0: V 2, r -1, A -1,    R 1           V 2, r 3, A 4, R 6                       cut off, V 6
//   world 1, agent 1: V 1, r  2, A 1,     R 2           dead since step 0: V 50 and r 100 do not count
//
// for at the end A = r + V' / 2 - V: 2 + 2 - 2 = 2; 1 + 1 - 1 = 1; 3 + 3 - 2 = 4; and before it A = r + V' / 2 - V + A'
// / 4: 1 + 1 - 1 + 1/2 = 1.5; 0 + 0.5 - 3 + 1/4 = -2.25; -1 + 1 - 2 + 1 = -1; who dies has nothing to come: 2 - 1 = 1.
// R = A + V.
const std::vector<float> kValue = {1, 3, 2, 1, 2, 1, 2, 50, 4, 2, 9, 9}, kFinalValue = {70, 70, 6, 70};
const std::vector<float> kReward = {1, 0, -1, 2, 2, 1, 3, 100};
const std::vector<uint8_t> kAlive = {1, 1, 1, 1, 1, 1, 1, 0, 1, 1, 1, 1}, kFinalAlive = {1, 1, 1, 0};
const std::vector<float> kAdvantage = {1.5f, -2.25f, -1, 1, 2, 1, 4, 0}, kReturns = {2.5f, 0.75f, 1, 2, 4, 2, 6, 0};
// How much more probable the uniform policy makes the actions than the one that chose them. The clip is 0.2: of 1.5
// counts 1.2 where the advantage is above the mean, of 0.5 all.
const std::vector<float> kRatio = {1.1f, 0.9f, 1, 1, 1.5f, 1, 0.5f, 3};

constexpr int kLiving = 7;
// Over the living: advantages sum to 6.25, their squares to 30.3125; returns to 18.25 and 67.8125.
const double kAdvantageVariance = 30.3125 / 7 - 6.25 / 7 * 6.25 / 7;                              // 3.533163
const double kReturnMean = 18.25 / 7, kReturnVariance = 67.8125 / 7 - kReturnMean * kReturnMean;  // 2.890306

LoadedRun small_run(const std::string& mappo) {
  SmallRun small;
  small.mappo = mappo;
  small.critic = "kind: independent, hidden: [1], activation: relu";
  LoadedRun run = small.load();
  run.config.train.n_worlds = 2;
  run.config.mappo.horizon = 2;
  run.config.mappo.n_minibatches = 2;
  run.config.mappo.gamma = run.config.mappo.gae_lambda = 0.5f;
  return run;
}

/// Copies, so that the numbers of a test stay.
template <class T>
at::Tensor tensor_of(const std::vector<T>& values, at::ScalarType type, at::IntArrayRef shape) {
  return at::tensor(values).to(type).view(shape).clone();
}

/// The values are the first number of each observation, the rest is 0.
Rollout rollout_by_hand(const SimSpec& spec) {
  const auto observations = [&](const std::vector<float>& values, std::vector<int64_t> shape) {
    shape.push_back(observation_rows(spec).stride());
    at::Tensor obs = at::zeros(shape);
    shape.pop_back();
    obs.select(-1, 0).copy_(tensor_of(values, at::kFloat, shape));
    return obs;
  };
  Rollout rollout;
  TeamRollout& r = rollout.team[0];
  r.obs = observations(kValue, {3, 2, 2});
  r.alive = tensor_of(kAlive, at::kByte, {3, 2, 2});
  r.action = at::full({2, 2, 2}, 5, at::kInt);
  r.log_prob = (-std::log(27.0) - tensor_of(kRatio, at::kFloat, {2, 2, 2}).to(at::kDouble).log()).to(at::kFloat);
  r.reward = tensor_of(kReward, at::kFloat, {2, 2, 2});
  r.final_obs = observations(kFinalValue, {2, 2});
  r.final_alive = tensor_of(kFinalAlive, at::kByte, {2, 2});
  rollout.done = at::zeros({2, 2}, at::kByte);
  rollout.done[1][1] = static_cast<int>(Done::truncated);
  return rollout;
}

/// A team whose policy is uniform and whose critic says the first number of the observation.
class Team {
 public:
  /// `value_std`: of what it has learned from; 0: of nothing yet.
  explicit Team(const std::string& mappo, float value_std = 1)
      : run_(small_run(mappo)),
        team_(run_, 0, Device{}, parallel_for_, {{0, 2}, 2}),
        rollout_(rollout_by_hand(run_.spec)) {
    NamedArrays arrays;
    team_.save("", arrays);
    for (NamedArray& a : arrays) {
      if (a.name == "value_norm/std") std::memcpy(a.bytes.data(), &value_std, sizeof value_std);
      if (!a.name.starts_with("actor/mlp/") && !a.name.starts_with("critic/mlp/")) continue;
      std::fill(a.bytes.begin(), a.bytes.end(), uint8_t{0});
      const float one = 1;
      if (a.name == "critic/mlp/0/weight" || a.name == "critic/mlp/1/weight")
        std::memcpy(a.bytes.data(), &one, sizeof one);
    }
    team_.load("", arrays);
    team_.compute_advantages(rollout_);
  }

  /// Two epochs of two minibatches, with steps of size 0: the networks stay as they are.
  void learn() {
    int minibatch = 0;
    for (int epoch = 0; epoch < 2; ++epoch) {
      team_.begin_epoch(rollout_, at::tensor({3, 0, 2, 1}, at::kLong));
      for (int k = 0; k < 2; ++k) team_.update_minibatch(rollout_, k, ++minibatch);
    }
  }
  double figure(PpoFigure k) const { return team_.figures()[k].item<double>(); }
  std::vector<float> batch(const char* name) const {
    NamedArrays arrays;
    team_.save_batch(rollout_, at::arange(4, at::kLong), arrays);
    return array_values<float>(find_array(arrays, cat("batch/", name)));
  }

 private:
  const ParallelFor parallel_for_{Device{}, 1};
  const LoadedRun run_;
  PpoTeam team_;
  const Rollout rollout_;
};

TEST(LearnPpoTeam, ValuesAdvantagesAndMomentsByHand) {
  const Team team("");
  EXPECT_EQ(team.batch("value"), std::vector<float>(kValue.begin(), kValue.begin() + 8));
  EXPECT_EQ(team.batch("advantage"), kAdvantage);
  EXPECT_EQ(team.batch("returns"), kReturns);
  EXPECT_NEAR(team.figure(kFigLiving), 7 / 8.0, 1e-6);
  // 1 - Var(returns - values) / Var(returns), over the living: 1 - 3.533163 / 2.890306 = -0.222419.
  EXPECT_NEAR(team.figure(kFigExplained), 1 - kAdvantageVariance / kReturnVariance, 1e-5);
  EXPECT_NEAR(team.figure(kFigExplained), -0.222419, 1e-5);
}

TEST(LearnPpoTeam, EachLivingRowCountsOnceAnEpoch) {
  Team team("");
  team.learn();
  EXPECT_EQ(team.figure(kFigRows), 2 * kLiving);
  // Of 1.5 and 0.5 the ratio is beyond 1 +- 0.2; errors are 0.1, 0.1, 0.5 and 0.5.
  EXPECT_EQ(team.figure(kFigClipped), 2 * 2);
  EXPECT_NEAR(team.figure(kFigRatioError), 2 * 1.2, 1e-5);
  EXPECT_NEAR(team.figure(kFigEntropy), 2 * kLiving * std::log(27.0), 1e-4);
}

TEST(LearnPpoTeam, AdvantagesOfTheBatchAreNormalisedOverTheLiving) {
  Team team("advantage_norm: batch");
  team.learn();
  // The mean is 6.25 / 7 = 0.892857, the deviation sqrt(3.533163) = 1.879671. Sum of ratio x (A - mean) with 1.2
  // for 1.5: 1.1 x 0.607143 - 0.9 x 3.142857 - 1.892857 + 0.107143 + 1.2 x 1.107143 + 0.107143 + 0.5 x 3.107143 =
  // -0.957143.
  EXPECT_NEAR(team.figure(kFigPolicyLoss), 2 * 0.957143 / 1.879671, 1e-5);
}

TEST(LearnPpoTeam, AdvantagesOfAMinibatchAreNormalisedOverItsLiving) {
  Team team("advantage_norm: minibatch");
  team.learn();
  // States 3 and 0: 4, 1.5, -2.25, mean 3.25 / 3 = 1.083333, variance 23.3125 / 3 - 1.173611 = 6.597222:
  //   0.5 x 2.916667 + 1.1 x 0.416667 - 0.9 x 3.333333 = -1.083333, over 2.568506.
  // States 2 and 1: 2, 1, -1, 1, mean 3 / 4, variance 7 / 4 - 9 / 16 = 1.1875:
  //   1.2 x 1.25 + 0.25 - 1.75 + 0.25 = 0.25, over 1.089725.
  EXPECT_NEAR(team.figure(kFigPolicyLoss), 2 * (1.083333 / 2.568506 - 0.25 / 1.089725), 1e-5);
}

// However small rewards are, a critic that has learned nothing must not drown them: its values count 0, and returns are
// the rewards of this rollout, A = r + A' / 4: 2, 1 and 3 at the end; before it 1 + 2 / 4, 0 + 1 / 4 and -1 + 3 / 4.
TEST(LearnPpoTeam, BeforeTheFirstRewardsValuesCountNothing) {
  const Team team("value_norm: true", 0);
  const std::vector<float> expected = {1.5f, 0.25f, -0.25f, 2, 2, 1, 3, 0};
  EXPECT_EQ(team.batch("advantage"), expected);
  EXPECT_EQ(team.batch("returns"), expected);
}
TEST(LearnPpoTeam, ANewTeamHasSeenNoRewards) {
  const auto deviation = [](const std::string& mappo) {
    const LoadedRun run = small_run(mappo);
    const ParallelFor parallel_for(Device{}, 1);
    NamedArrays arrays;
    PpoTeam(run, 0, Device{}, parallel_for, {{0, 2}, 2}).save("", arrays);
    return array_values<float>(find_array(arrays, "value_norm/std"));
  };
  EXPECT_EQ(deviation("value_norm: true"), std::vector<float>{0});
  EXPECT_EQ(deviation("value_norm: false"), std::vector<float>{1});
}

TEST(LearnPpoTeam, ValueLossInUnitsOfTheReturnsSoFar) {
  Team team("value_norm: true");
  team.learn();
  // The normaliser has taken in the returns before: their mean 2.607143 and deviation 1.700090. The critic says 1, 3,
  // ...
  double sum = 0;
  for (size_t row = 0; row < 7; ++row) {
    const double target = (static_cast<double>(kReturns[row]) - kReturnMean) / std::sqrt(kReturnVariance);
    sum += 0.5 * std::pow(static_cast<double>(kValue[row]) - target, 2);
  }
  EXPECT_NEAR(sum, 15.81511, 1e-4);
  EXPECT_NEAR(team.figure(kFigValueLoss), 2 * sum, 1e-4);
}

// The normaliser moves from (0, 1) to (2.6, 1.7) before anything is learned. What the critic says has not moved by
// that: with unchanged parameters a clipped loss is the plain one, to the last bit.
TEST(LearnPpoTeam, ANormaliserThatMovesDoesNotClip) {
  Team plain("value_norm: true, value_loss: squared");
  plain.learn();
  for (const char* clip : {"0.001", "0.2"}) {
    Team clipped(cat("value_norm: true, value_loss: clipped, value_clip_coef: ", clip));
    clipped.learn();
    EXPECT_EQ(clipped.figure(kFigValueLoss), plain.figure(kFigValueLoss)) << clip;
    EXPECT_EQ(clipped.figure(kFigCriticNorm), plain.figure(kFigCriticNorm)) << clip;
  }
}

// Worlds 1 and 2 of 4, three steps: states t x 4 + world.
TEST(LearnPpoTeam, MinibatchesHaveEachStateOfTheTeamsWorldsOnce) {
  LoadedRun run = small_run("");
  run.config.train.n_worlds = 4;
  run.config.mappo.horizon = 3;
  const ParallelFor parallel_for(Device{}, 1);
  const PpoTeam team(run, 0, Device{}, parallel_for, {{1, 2}, 4});
  const std::vector<at::Tensor> minibatches = team.minibatches(at::tensor({4, 1, 0, 5, 3, 2}, at::kLong));
  ASSERT_EQ(minibatches.size(), 2u);
  // State k of the team's own is step k / 2, world 1 + k % 2.
  EXPECT_TRUE(at::equal(minibatches[0], at::tensor({9, 2, 1}, at::kLong).view({1, 3})));
  EXPECT_TRUE(at::equal(minibatches[1], at::tensor({10, 6, 5}, at::kLong).view({1, 3})));
}

// Worlds 1 and 2 of each of two shards of 4: 1, 2, 5 and 6 of 8; states t x 8 + world.
TEST(LearnPpoTeam, StatesOfShards) {
  LoadedRun run = small_run("");
  run.config.train.n_worlds = 8;
  run.config.mappo.horizon = 3;
  const ParallelFor parallel_for(Device{}, 1);
  const PpoTeam team(run, 0, Device{}, parallel_for, {{1, 2}, 4, 2});
  EXPECT_EQ(team.n_sequences(), 12);
  EXPECT_TRUE(at::equal(team.states(at::arange(12, at::kLong)),
                        at::tensor({1, 2, 5, 6, 9, 10, 13, 14, 17, 18, 21, 22}, at::kLong)));
}

// Five steps of two worlds, a shard each: sequence k is of world k % 2. Of five, two go into each of two minibatches.
TEST(LearnSequenceOrder, MinibatchesTakeAsManyOfEachShard) {
  const SequenceOrder order{
      .n_sequences = 10, .n_minibatches = 2, .n_worlds = 2, .n_shards = 2, .first_shard = 0, .n_own_shards = 2};
  std::set<int64_t> met;
  for (uint64_t epoch = 0; epoch < 20; ++epoch) {
    const at::Tensor drawn = order.draw(epoch, Device{});
    ASSERT_EQ(drawn.size(0), 8);
    EXPECT_EQ(std::get<0>(at::_unique(drawn)).size(0), 8) << "each once at most";
    EXPECT_EQ(drawn.slice(0, 0, 4).remainder(2).sum().item<int64_t>(), 2);
    EXPECT_EQ(drawn.slice(0, 4, 8).remainder(2).sum().item<int64_t>(), 2);
    for (int64_t k = 0; k < 8; ++k) met.insert(drawn[k].item<int64_t>());
  }
  EXPECT_EQ(met.size(), 10u) << "others are left out in each epoch";
}

/// Two teams with memory, and the worlds in which they play.
struct TeamsWithMemory {
  TeamsWithMemory(const LoadedRun& run, const ParallelFor& parallel_for)
      : team{{run, 0, kCpu, parallel_for, {{0, 24}, 24}}, {run, 1, kCpu, parallel_for, {{0, 24}, 24}}},
        sim(make_cpu_simulator(run.spec, {24, 17, 0, OnDone::reset, 1})),
        collector(*sim, parallel_for, {run.config.mappo.horizon, false, true},
                  {everywhere(policy_controller(team[0].actor()), *sim),
                   everywhere(policy_controller(team[1].actor()), *sim)}) {
    collector.start();
  }
  PpoTeam team[kNTeams];
  std::unique_ptr<Simulator> sim;
  Collector collector;
};

LoadedRun run_with_memory(const char* kind = "gru") {
  SmallRun small;
  small.actor = cat("hidden: [16], output_gain: 1, memory_size: 12, memory: ", kind);
  small.critic = cat("hidden: [16, 16], memory_size: 10, memory: ", kind);
  small.mappo = "value_norm: false";
  LoadedRun run = small.load();  // 24 worlds, 8 steps, episodes of at most 40
  run.config.mappo.n_minibatches = 1;
  return run;
}

// What is remembered at the start of a rollout, and where episodes end in it, is enough to compute the actions'
// probabilities again.
TEST(LearnPpoTeam, AnActorWithMemoryLearnsFromSequences) {
  const ParallelFor parallel_for(kCpu, 1);
  const LoadedRun run = run_with_memory();
  TeamsWithMemory game(run, parallel_for);
  for (int k = 0; k < 6; ++k) game.collector.collect();
  const Rollout& rollout = game.collector.rollout();
  ASSERT_GT((rollout.done.slice(0, 0, 7) != 0).sum().item<int>(), 3) << "no episode ends within the rollout";
  for (int k = 0; k < kNTeams; ++k) {
    PpoTeam& team = game.team[k];
    ASSERT_EQ(team.sequence_length(), 8);
    ASSERT_EQ(team.n_sequences(), 24);
    const at::Tensor order = at::randperm(24, at::detail::createCPUGenerator(3), at::kLong);
    ASSERT_EQ(team.minibatches(order).at(0).sizes(), at::IntArrayRef({8, 24}));
    const auto ratio_error = [&](const Rollout& r) {
      team.compute_advantages(r);
      team.begin_epoch(r, order);
      team.update_minibatch(r, 0, 1);
      return team.figures()[kFigFirstRatioError].item<double>();
    };
    EXPECT_LT(ratio_error(rollout), 1e-6);
    EXPECT_GT(team.figures()[kFigActorNorm].item<double>(), 1e-3);
    Rollout changed = rollout;
    changed.team[k].state = at::zeros_like(rollout.team[k].state);
    EXPECT_GT(ratio_error(changed), 1e-3) << "without the state at the start";
    changed = rollout;
    changed.done = at::zeros_like(rollout.done);
    EXPECT_GT(ratio_error(changed), 1e-3) << "without resets";
  }
}

// One world in each minibatch: its states are every 24th number of the order, not numbers that lie in a row.
TEST(LearnPpoTeam, AMinibatchMayBeOneSequence) {
  const ParallelFor parallel_for(kCpu, 1);
  LoadedRun run = run_with_memory();
  run.config.mappo.n_minibatches = 24;
  TeamsWithMemory game(run, parallel_for);
  for (int k = 0; k < 3; ++k) game.collector.collect();
  const Rollout& rollout = game.collector.rollout();
  PpoTeam& team = game.team[0];
  team.compute_advantages(rollout);
  team.begin_epoch(rollout, at::randperm(24, at::detail::createCPUGenerator(3), at::kLong));
  for (int k = 0; k < 24; ++k) {
    team.update_minibatch(rollout, k, 1);
    EXPECT_LT(team.figures()[kFigFirstRatioError].item<double>(), 1e-6) << "minibatch " << k;
  }
}

// The values of a rollout are those of a critic that goes through the games step by step and forgets where one begins;
// a game that is cut off is worth the value of its last observation, with what was remembered until then.
TEST(LearnPpoTeam, ACriticWithMemoryValuesSequences) {
  const ParallelFor parallel_for(kCpu, 1);
  for (const char* kind : {"gru", "lstm"}) {
    const LoadedRun run = run_with_memory(kind);
    TeamsWithMemory game(run, parallel_for);
    PpoTeam& team = game.team[0];
    NamedArrays arrays;
    team.save_critic("", arrays);
    Critic critic(run.config.mappo.critic, critic_shape(run.config.mappo.critic, team.actor(), run.spec, 0),
                  Precision::fp32, parallel_for, at::kCPU, 0);
    critic.parameters().load("critic/", arrays);
    at::NoGradGuard no_grad;
    NetworkState state;
    int cut_off = 0;
    for (int k = 0; k < 6; ++k) {
      game.collector.collect();
      const Rollout& rollout = game.collector.rollout();
      const TeamRollout& r = rollout.team[0];
      team.compute_advantages(rollout);
      NamedArrays batch;
      team.save_batch(rollout, at::arange(8 * 24), batch);
      const at::Tensor values = at::zeros({8, 24, 2}), advantages = at::zeros({8, 24, 2});
      from_array(find_array(batch, "batch/value"), values.view({8 * 24, 2}));
      from_array(find_array(batch, "batch/advantage"), advantages.view({8 * 24, 2}));
      for (int64_t t = 0; t < 8; ++t) {
        const auto value = [&](const at::Tensor& obs, const at::Tensor& alive, at::Tensor& after) {
          return critic.forward(obs, alive.to(at::kFloat), {}, {.start = state.rows, .states = &after});
        };
        at::Tensor after, unused;
        const at::Tensor expected = value(r.obs[t], r.alive[t], after);
        EXPECT_LT((expected - values[t]).abs().max().item<double>(), 1e-5)
            << kind << ", rollout " << k << ", step " << t;
        state.rows = after[0];
        const at::Tensor last = value(r.final_obs, r.final_alive, unused);
        for (int64_t w = 0; w < 24; ++w) {
          if (rollout.done[t][w].item<int>() != static_cast<int>(Done::truncated) || !r.final_alive[w][0].item<bool>())
            continue;
          ++cut_off;
          // The last reward, and what would have come.
          const double v = last[w][0].item<double>(), reward = r.reward[t][w][0].item<double>();
          EXPECT_NEAR(advantages[t][w][0].item<double>(),
                      reward + static_cast<double>(run.config.mappo.gamma) * v - expected[w][0].item<double>(), 1e-4);
        }
        state.reset((rollout.done[t] != 0).repeat_interleave(2));
      }
    }
    EXPECT_GT(cut_off, 0) << "no game was cut off";
  }
}

TEST(LearnPpoTeam, MemoryIsSavedWithTheWorlds) {
  const ParallelFor parallel_for(kCpu, 1);
  const LoadedRun run = run_with_memory();
  TeamsWithMemory whole(run, parallel_for), resumed(run, parallel_for);
  for (int k = 0; k < 2; ++k) whole.collector.collect();
  NamedArrays arrays;
  whole.sim->state().save("simulator/", arrays);
  whole.collector.save("collector/", arrays);
  resumed.sim->state().load("simulator/", arrays);
  resumed.collector.load("collector/", arrays);
  resumed.collector.resume();
  whole.collector.collect();
  resumed.collector.collect();
  for (int k = 0; k < kNTeams; ++k) {
    EXPECT_TRUE(at::equal(whole.collector.rollout().team[k].state, resumed.collector.rollout().team[k].state));
    EXPECT_TRUE(at::equal(whole.collector.rollout().team[k].log_prob, resumed.collector.rollout().team[k].log_prob));
  }
}

}  // namespace
}  // namespace giga::test
