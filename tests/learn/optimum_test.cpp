// A problem with a known optimum is solved.
#include <gtest/gtest.h>

#include "eval/match.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

// One agent that learns, and one that circles. Nobody shoots or collides; the only reward is -1 for flying out of the
// 4 x 4 area, which ends the episode. Who turns for ever (radius 1.3 / 4 = 0.33) away from the nearer wall stays
// inside, so that the optimum is a return of 0; flying straight on leaves the area after at most 4 / 0.13 = 31 steps.
constexpr const char* kScenario = R"(
limit_x: 4
limit_y: 4
max_episode_length: 64
maps: empty
team_0: [{type: default, count: 1}]
team_1: [{type: default, count: 1}]
damage: {damage_cone_depth: 0}
collision: {collision_range: 0}
rewards:
  defeat_one_opponent: 0
  detection: 0
  damage: 0
  idle: 0
  collision_agent: 0
  collision_obstacle: 1
  agent_disabled: 0
  game_won: 0
  divide_reward_by_team_size: false
)";
constexpr const char* kConfig = R"(
seed: 2
mappo:
  horizon: 64
  n_minibatches: 2
  actor: {hidden: [32]}
  critic: {hidden: [32], kind: )";

struct Returns {
  double untrained, trained;
};

/// Trains, and plays 256 episodes before and after.
Returns train(const std::string& critic, const std::string& settings, const std::string& action) {
  const LoadedRun run = load_run_config_text(
      kConfig + critic + "}\ntrain: {opponent: circle, " + settings + ", n_threads: 1, precision: fp32}\n",
      kScenario + ("action: " + action + "\n"));
  const auto learner = make_learner(run, Device{});
  const auto play = [&] {
    return play_match(run.spec, policy_controller(*learner->actor(0)), script_controller(Scripted::circle),
                      {256, 9, Device{}, 1})
        .mean_return[0];
  };
  Returns returns{play(), 0};
  for (int64_t u = 0; u < total_updates(run.config, 2); ++u) learner->update();
  returns.trained = play();
  testing::Test::RecordProperty("untrained", std::to_string(returns.untrained));
  testing::Test::RecordProperty("trained", std::to_string(returns.trained));
  return returns;
}

TEST(LearnOptimum, TwoWorldsOfTwoAgents) {
  const Returns returns = train("composed", "n_worlds: 2, total_agent_steps: 200000", "discrete");
  EXPECT_LT(returns.untrained, -0.8);
  EXPECT_GT(returns.trained, -0.2);  // seeds 1 to 8 came to -0.02 ... -0.13
}

TEST(LearnOptimum, ContinuousActionsAndStateCritic) {
  if (!tests_run_in_full()) GTEST_SKIP() << "slow; run with GIGASTEP_TEST_FULL=1";
  const Returns returns = train("state", "n_worlds: 8, total_agent_steps: 400000", "continuous");
  EXPECT_LT(returns.untrained, -0.8);
  EXPECT_GT(returns.trained, -0.2);  // seeds 1 to 8 came to -0.03 ... -0.08
}

}  // namespace
}  // namespace giga::test
