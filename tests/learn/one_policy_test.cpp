// mappo.one_policy: both teams have what either of them has learned.
#include <gtest/gtest.h>
#include <torch/cuda.h>

#include <array>
#include <vector>

#include "core/error.hpp"
#include "learn/mappo/ppo_team.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/tensors.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

SmallRun with_one_policy() {
  SmallRun run;
  run.mappo = "one_policy: true";
  run.actor = "hidden: [16]";
  return run;
}

/// Two teams with one policy, and a rollout of theirs.
struct Twins {
  explicit Twins(const LoadedRun& run, Device device = {})
      : parallel_for(device, 1),
        sim(make_simulator(run.spec, {.n_worlds = run.config.train.n_worlds, .seed = 17}, device, nullptr)),
        first(run, 0, device, parallel_for, all()),
        second(run, 1, device, parallel_for, all(), {}, &first),
        collector(
            *sim, parallel_for, {.horizon = run.config.mappo.horizon, .keep = first.reads()},
            {everywhere(policy_controller(first.actor()), *sim), everywhere(policy_controller(second.actor()), *sim)}) {
    collector.start();
    collector.collect();
    StepSettings settings = StepSettings::of(run.config.mappo);
    settings.actor_step_size = settings.critic_step_size = 1e-3f;
    for (PpoTeam* team : {&first, &second}) {
      team->set(settings);
      team->compute_advantages(collector.rollout());
    }
  }
  ShardRange all() const { return {{0, sim->n_worlds()}, sim->n_worlds()}; }
  at::Tensor order() const {
    return at::randperm(first.n_sequences(), at::TensorOptions().device(torch_device(sim->device())));
  }
  void begin_epoch(const at::Tensor& order) {
    for (PpoTeam* team : {&first, &second}) team->begin_epoch(collector.rollout(), order);
  }

  const ParallelFor parallel_for;
  const std::unique_ptr<Simulator> sim;
  PpoTeam first, second;
  Collector collector;
};

/// Whether the teams have one actor.
bool is_one(const SmallRun& run) {
  const auto learner = run.learner();
  return learner->actor(0) != nullptr && learner->actor(0) == learner->actor(1);
}

TEST(LearnOnePolicy, EitherTeamTeachesBoth) {
  const LoadedRun run = with_one_policy().load();
  for (const int learning : {0, 1}) {
    Twins twins(run);
    twins.begin_epoch(twins.order());
    const at::Tensor before = twins.second.actor().parameters().values().clone();
    (learning == 0 ? twins.first : twins.second).update_minibatch(twins.collector.rollout(), 0, 1);
    EXPECT_FALSE(at::equal(twins.first.actor().parameters().values(), before)) << "team " << learning;
    EXPECT_TRUE(at::equal(twins.first.actor().parameters().values(), twins.second.actor().parameters().values()));
  }
}

// On a GPU each team has a stream, on which its critic's gradient is computed while the other steps the actor. What
// comes out is what comes out where the host waits after each piece of work: in so many worlds that a gradient takes
// far longer than to queue it, and two updates in a row.
TEST(LearnOnePolicyGpu, MinibatchesAtOnceHaveTheBitsOfOneByOne) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  SmallRun small = with_one_policy();
  small.actor = small.critic = "hidden: [64, 64]";
  small.precision = "tf32";
  LoadedRun run = small.load();
  run.config.train.n_worlds = 65536;
  Twins at_once(run, {Device::Kind::cuda, 0}), one_by_one(run, {Device::Kind::cuda, 0});
  ASSERT_EQ(at_once.first.plain_because(), "") << "they do not learn by the fused kernels";
  const int n_epochs = run.config.mappo.n_epochs, n_minibatches = run.config.mappo.n_minibatches;
  std::vector<at::Tensor> orders;
  for (int epoch = 0; epoch < 2 * n_epochs; ++epoch) orders.push_back(at_once.order());
  const auto learn = [&](Twins& twins, auto&& piece_ends) {
    const Rollout& rollout = twins.collector.rollout();
    const std::array<PpoTeam*, 2> teams{&twins.first, &twins.second};
    for (int epoch = 0; epoch < 2 * n_epochs; ++epoch) {
      const auto each = [&](auto&& f) {
        for (PpoTeam* team : teams) {
          f(*team);
          piece_ends();
        }
      };
      if (epoch % n_epochs == 0) each([&](PpoTeam& team) { team.compute_advantages(rollout); });
      each([&](PpoTeam& team) { team.begin_epoch(rollout, orders[static_cast<size_t>(epoch)]); });
      for (int k = 0; k < n_minibatches; ++k)
        each([&](PpoTeam& team) { team.update_minibatch(rollout, k, epoch % n_epochs * n_minibatches + k + 1); });
      each([](PpoTeam& team) { team.end_epoch(); });
    }
  };
  torch::cuda::synchronize();
  learn(at_once, [] {});
  learn(one_by_one, [] { torch::cuda::synchronize(); });
  for (const auto team : {&Twins::first, &Twins::second}) {
    NamedArrays expected, actual;
    (one_by_one.*team).save("", expected);
    (at_once.*team).save("", actual);
    EXPECT_EQ(difference(expected, actual), "");
    // The mutual information too, which is that of the policy before the first step of either.
    EXPECT_TRUE(at::equal((one_by_one.*team).figures(), (at_once.*team).figures()));
  }
}

// Where teams differ, or one does not learn, each has its own.
TEST(LearnOnePolicy, IsForTeamsThatAreAlike) {
  SmallRun run = with_one_policy();
  EXPECT_TRUE(is_one(run));
  run.scenario = "team_0: [{type: default, count: 3}]\n";
  EXPECT_FALSE(is_one(run));
  run.scenario = "team_0: [{type: more_health, count: 1}, {type: default, count: 1}]\n";
  EXPECT_FALSE(is_one(run));
  run.scenario += "team_1: [{type: default, count: 1}, {type: more_health, count: 1}]\n";
  EXPECT_TRUE(is_one(run)) << "in another order";
  run.scenario = "win: {at_time_limit: team_1}\n";
  EXPECT_FALSE(is_one(run));
  run.scenario = "";
  run.train = "opponent: circle";
  EXPECT_FALSE(is_one(run));
  run = with_one_policy();
  run.mappo = "one_policy: false";
  EXPECT_FALSE(is_one(run));
}

TEST(LearnOnePolicy, BothTeamsAreSavedAlike) {
  const auto learner = with_one_policy().learner();
  learner->update();
  NamedArrays arrays = saved(*learner);
  int n = 0;
  for (const NamedArray& array : arrays) {
    if (!array.name.starts_with("team_0/actor")) continue;
    ++n;
    EXPECT_EQ(array.bytes, find_array(arrays, "team_1" + array.name.substr(6)).bytes) << array.name;
  }
  EXPECT_GT(n, 6) << "weights, and the optimizer's moments of them";
  EXPECT_NE(find_array(arrays, "team_0/critic/team_mlp/0/weight").bytes,
            find_array(arrays, "team_1/critic/team_mlp/0/weight").bytes);
  // Copies that are not alike cannot both be loaded.
  for (NamedArray& array : arrays)
    if (array.name == "team_1/actor/mlp/0/weight") disturb(array);
  EXPECT_THROW(learner->load(arrays), InputError);
}

}  // namespace
}  // namespace giga::test
