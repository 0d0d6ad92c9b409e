// mappo.one_policy: both teams have what either of them has learned.
#include <gtest/gtest.h>

#include "core/error.hpp"
#include "learn/mappo/ppo_team.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

SmallRun with_one_policy() {
  SmallRun run;
  run.mappo = "one_policy: true";
  run.actor = "hidden: [16]";
  return run;
}

/// Whether the teams have one actor.
bool is_one(const SmallRun& run) {
  const auto learner = run.learner();
  return learner->actor(0) != nullptr && learner->actor(0) == learner->actor(1);
}

TEST(LearnOnePolicy, EitherTeamTeachesBoth) {
  const LoadedRun run = with_one_policy().load();
  const ParallelFor parallel_for(Device{}, 1);
  const auto sim = make_cpu_simulator(run.spec, {run.config.train.n_worlds, 17, 0, OnDone::reset, 1});
  const ShardRange all{{0, sim->n_worlds()}, sim->n_worlds()};
  for (const int learning : {0, 1}) {
    PpoTeam first(run, 0, Device{}, parallel_for, all), second(run, 1, Device{}, parallel_for, all, {}, &first);
    Collector collector(
        *sim, parallel_for, {.horizon = run.config.mappo.horizon, .keep = first.reads()},
        {everywhere(policy_controller(first.actor()), *sim), everywhere(policy_controller(second.actor()), *sim)});
    collector.start();
    collector.collect();
    StepSettings settings = StepSettings::of(run.config.mappo);
    settings.actor_step_size = settings.critic_step_size = 1e-3f;
    const at::Tensor order = at::randperm(first.n_sequences());
    for (PpoTeam* team : {&first, &second}) {
      team->set(settings);
      team->compute_advantages(collector.rollout());
      team->begin_epoch(collector.rollout(), order);
    }
    const at::Tensor before = second.actor().parameters().values().clone();
    (learning == 0 ? first : second).update_minibatch(collector.rollout(), 0, 1);
    EXPECT_FALSE(at::equal(first.actor().parameters().values(), before)) << "team " << learning;
    EXPECT_TRUE(at::equal(first.actor().parameters().values(), second.actor().parameters().values()));
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
