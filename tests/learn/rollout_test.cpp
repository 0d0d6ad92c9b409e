// The collector: what is kept of a rollout is what single steps show, and final observations belong to truncations.
#include <gtest/gtest.h>

#include <map>

#include "cuda/runtime.hpp"
#include "learn/team_policy.hpp"
#include "policy/actor.hpp"
#include "rollout/collector.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

constexpr int kWorlds = 128, kHorizon = 8;

/// 1 against 1 in a space so small that many fly out within a few steps, with a time limit as long as a rollout.
LoadedRun cramped() {
  SmallRun run;
  run.scenario = "limit_x: 1.6\nlimit_y: 1.6\nmax_episode_length: 8\n";
  return run.load();
}

/// Plays `run` in rollouts of `horizon` steps.
struct Play {
  Play(const LoadedRun& run, int horizon)
      : parallel_for(Device{}, 2),
        actor{make_actor(run, 0, Device{}), make_actor(run, 1, Device{})},
        sim(make_cpu_simulator(run.spec, {kWorlds, 17, 0, OnDone::reset, 2})),
        collector(*sim, parallel_for, {horizon, true, true},
                  {everywhere(policy_controller(actor[0]), *sim), everywhere(policy_controller(actor[1]), *sim)}) {
    collector.start();
  }
  ParallelFor parallel_for;
  Actor actor[2];
  std::unique_ptr<Simulator> sim;
  Collector collector;
};

TEST(LearnRollout, LongRolloutEqualsSingleSteps) {
  const LoadedRun run = cramped();
  Play whole(run, kHorizon), single(run, 1);
  for (int rollout = 0; rollout < 3; ++rollout) {
    whole.collector.collect();
    const Rollout& r = whole.collector.rollout();
    for (int t = 0; t < kHorizon; ++t) {
      single.collector.collect();
      const Rollout& s = single.collector.rollout();
      ASSERT_TRUE(at::equal(r.done[t], s.done[0])) << "step " << t;
      ASSERT_TRUE(at::equal(r.true_state[t], s.true_state[0])) << "step " << t;
      ASSERT_TRUE(at::equal(r.true_state[t + 1], s.true_state[1])) << "step " << t;
      for (int team = 0; team < 2; ++team) {
        const TeamRollout &a = r.team[team], &b = s.team[team];
        ASSERT_TRUE(at::equal(a.obs[t], b.obs[0])) << "step " << t;
        ASSERT_TRUE(at::equal(a.obs[t + 1], b.obs[1])) << "step " << t;
        ASSERT_TRUE(at::equal(a.alive[t + 1], b.alive[1])) << "step " << t;
        ASSERT_TRUE(at::equal(a.action[t], b.action[0])) << "step " << t;
        ASSERT_TRUE(at::equal(a.log_prob[t], b.log_prob[0])) << "step " << t;
        ASSERT_TRUE(at::equal(a.reward[t], b.reward[0])) << "step " << t;
      }
    }
  }
}

TEST(LearnRollout, AScriptThatLooksSeesEveryStep) {
  // It has the last observations only, in rollouts of any length; what it does depends on all of them.
  const LoadedRun run = cramped();
  const auto make = [&](Simulator& sim, const ParallelFor& parallel_for, const Actor& actor, int horizon) {
    return Collector(
        sim, parallel_for, {horizon, false, true},
        {everywhere(policy_controller(actor), sim), everywhere(script_controller(Scripted::pursuer), sim)});
  };
  const ParallelFor parallel_for(Device{}, 2);
  const Actor actor = make_actor(run, 0, Device{});
  const SimOptions options{kWorlds, 17, 0, OnDone::reset, 2};
  const auto sim_a = make_cpu_simulator(run.spec, options), sim_b = make_cpu_simulator(run.spec, options);
  Collector whole = make(*sim_a, parallel_for, actor, kHorizon), single = make(*sim_b, parallel_for, actor, 1);
  whole.start();
  single.start();
  ASSERT_EQ(whole.rollout().team[1].obs.size(0), 1);
  EXPECT_FALSE(whole.rollout().team[1].reward.defined());
  for (int rollout = 0; rollout < 3; ++rollout) {
    whole.collect();
    const at::Tensor actions = whole.rollout().team[1].action;
    for (int t = 0; t < kHorizon; ++t) {
      single.collect();
      ASSERT_TRUE(at::equal(actions[t], single.rollout().team[1].action[0])) << "step " << t;
    }
    EXPECT_GT(actions.max().item<int>(), actions.min().item<int>()) << "it does the same everywhere";
    EXPECT_TRUE(at::equal(whole.rollout().team[1].obs, single.rollout().team[1].obs));
  }
}

// As the frozen team of `gigastep exploit`: it plays as one that learns would, and nothing else is kept of it.
TEST(LearnRollout, KeepsActionsAloneOfAPolicyThatDoesNotLearn) {
  const LoadedRun run = cramped();
  const ParallelFor rows(Device{}, 2);
  const Actor actor = make_actor(run, 0, Device{});
  at::Tensor actions[2];
  for (const bool learns : {true, false}) {
    const auto sim = make_cpu_simulator(run.spec, {kWorlds, 17, 0, OnDone::reset, 2});
    const Side side = everywhere(policy_controller(actor), *sim);
    Collector collector(*sim, rows, {.horizon = kHorizon, .learns = {true, learns}}, {side, side});
    collector.start();
    for (int rollout = 0; rollout < 2; ++rollout) collector.collect();
    const TeamRollout& team = collector.rollout().team[1];
    actions[learns] = team.action;
    EXPECT_EQ(team.obs.size(0), learns ? kHorizon + 1 : 1);
    for (const at::Tensor& kept : {team.alive, team.log_prob, team.reward, team.final_obs, team.final_alive})
      EXPECT_EQ(kept.defined(), learns);
  }
  EXPECT_TRUE(at::equal(actions[0], actions[1]));
}

TEST(LearnRollout, KeepsTheObservationsThatAreRead) {
  SmallRun small;
  small.scenario = "max_episode_length: 8\nobservation: {egocentric_view: true}\n";
  small.actor = "hidden: [16], inputs: egocentric";
  small.critic = "hidden: [16], inputs: egocentric";
  const LoadedRun run = small.load();
  const ParallelFor rows(Device{}, 2);
  const Actor actor = make_actor(run, 0, Device{});
  for (const ObservationSet keep : {ObservationSet(), ObservationSet(Observation::vector)}) {
    const auto sim = make_cpu_simulator(run.spec, {kWorlds, 17, 0, OnDone::reset, 2});
    const Side side = everywhere(policy_controller(actor), *sim);
    Collector collector(*sim, rows, {.horizon = kHorizon, .keep = keep}, {side, side});
    collector.start();
    collector.collect();
    const at::Tensor obs = collector.rollout().team[1].obs;
    const auto any = [&](Observation kind) {
      const RowLayout::Columns columns = observation_rows(run.spec).columns(kind);
      return obs.narrow(-1, columns.first, columns.count).any().item<bool>();
    };
    EXPECT_TRUE(any(Observation::egocentric));
    EXPECT_EQ(any(Observation::vector), !keep.empty());
  }
}

TEST(LearnRollout, FinalObservationIsThatOfTheTruncation) {
  // A world whose game is cut off early in a rollout may see its next game decided before the rollout ends. The value
  // of the truncation still needs the observation at the truncation.
  const LoadedRun run = cramped();
  Play whole(run, kHorizon), single(run, 1);
  int n_truncated = 0, n_followed = 0;
  std::string wrong;
  for (int rollout = 0; rollout < 4; ++rollout) {
    whole.collector.collect();
    const Rollout& r = whole.collector.rollout();
    const TeamRollout& team = r.team[0];
    std::map<int, at::Tensor> final_obs, final_alive, final_true_state;  // by world: at its truncation
    for (int t = 0; t < kHorizon; ++t) {
      single.collector.collect();
      const Rollout& s = single.collector.rollout();
      for (int w = 0; w < kWorlds; ++w) {
        const auto done = static_cast<Done>(s.done[0][w].item<int>());
        if (done == Done::truncated) {
          ++n_truncated;
          final_obs[w] = s.team[0].final_obs[w].clone();
          final_alive[w] = s.team[0].final_alive[w].clone();
          final_true_state[w] = s.final_true_state[w].clone();
        } else if (done == Done::terminated && final_obs.contains(w)) {
          ++n_followed;
        }
      }
    }
    for (const auto& [w, obs] : final_obs)
      if (!at::equal(team.final_obs[w], obs) || !at::equal(team.final_alive[w], final_alive[w]) ||
          !at::equal(r.final_true_state[w], final_true_state[w]))
        wrong += cat(" ", rollout, ":", w);
  }
  EXPECT_EQ(wrong, "") << "rollout:world of truncations with another final observation";
  EXPECT_GT(n_truncated, 50);
  EXPECT_GT(n_followed, 5);  // the case was met
}

}  // namespace
}  // namespace giga::test
