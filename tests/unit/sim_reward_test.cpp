// Rewards by hand numbers: every term, the factor, the division, the masks (rules 5).
#include <gtest/gtest.h>

#include <cmath>

#include "sim/map_tables.hpp"
#include "sim/paths.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

constexpr float kRewardTolerance = 1e-5f;

SimSpec with_reward(int n_team_0, int n_team_1, RewardTerm term, float weight) {
  SimSpec spec = plain_spec(n_team_0, n_team_1);
  set_reward(spec, term, weight);
  return spec;
}

void expect_rewards(const TestWorld& world, const std::vector<float>& expected) {
  for (size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(world.reward(static_cast<int>(i)), expected[i], kRewardTolerance) << "agent " << i;
}

TEST(SimReward, DefeatOneOpponent) {
  TestWorld world(with_reward(2, 2, RewardTerm::defeat_one_opponent, 6));
  world.put(0, 2, 2);
  world.put(1, 2, 4);
  world.put(2, 2, 8);
  world.put(3, 9.95f, 9);  // leaves: E1 = -1
  world.step();
  // Team 0: 6 (0 + 1) / (2 + 1) = 2; team 1's survivor: 6 (-1 - 0) / (1 + 1) = -3; the dead: 0
  expect_rewards(world, {2, 2, -3, 0});
  world.step();
  expect_rewards(world, {0, 0, 0, 0});
}

TEST(SimReward, Detection) {
  TestWorld world(with_reward(2, 2, RewardTerm::detection, 10));
  world.put(0, 2, 5);
  world.put(2, 4, 5);  // seen by 0, looks away
  world.put(1, 2, 9);
  world.put(3, 4, 7.5f, kPi);  // 2.5 from agent 1, each 37 degrees off the other's nose
  world.step();
  ASSERT_TRUE(world.detected(2, 0) && world.detected(3, 1) && world.detected(1, 3));
  // 10 * 0.1 * (0.5 detected - 0.2 observers)
  expect_rewards(world, {0.5f, 0.3f, -0.2f, 0.3f});
}

TEST(SimReward, Damage) {
  SimSpec spec = with_reward(1, 1, RewardTerm::damage, 10);
  TestWorld world(spec);
  world.put(0, 2, 5);
  world.put(1, 3.5f, 5);
  world.steps(3);
  expect_rewards(world, {0, 0});
  world.step();  // one unit: 10 * 0.1 * 1 and -10 * 0.1 * 0.5
  expect_rewards(world, {1, -0.5f});
  world.step();
  expect_rewards(world, {2, -1});
  world.steps(3);  // units 3, 4, 5: the fifth kills (see SimDamage.DeathAtZeroHealth)
  ASSERT_FALSE(world.alive(1));
  expect_rewards(world, {5, 0});
}

TEST(SimReward, Idle) {
  TestWorld world(with_reward(2, 1, RewardTerm::idle, 1000));
  world.put(0, 2, 2);
  world.put(1, 9.95f, 5);  // dies: alive after the step counts
  world.put(2, 2, 8);
  world.step();
  expect_rewards(world, {-1, 0, -1});
}

TEST(SimReward, CollisionAgent) {
  TestWorld world(with_reward(2, 2, RewardTerm::collision_agent, 4));
  world.put(0, 2, 2);
  world.put(2, 2, 2.2f);
  world.put(1, 2, 8);
  world.put(3, 5, 5);
  world.step();
  expect_rewards(world, {-4, 0, -4, 0});
  world.step();
  expect_rewards(world, {0, 0, 0, 0});
}

TEST(SimReward, CollisionObstacleCountsBothWays) {
  SimSpec spec = with_reward(3, 1, RewardTerm::collision_obstacle, 4);
  spec.maps[0].boxes = {{9, 3, 12, 10, 0, 10}};
  TestWorld world(spec);
  world.put(0, 9.95f, 2);  // out
  world.put(1, 9.2f, 4);   // in the box
  world.put(2, 9.95f, 6);  // out and in the box
  world.put(3, 2, 8);
  world.step();
  expect_rewards(world, {-4, -4, -8, 0});
  world.step();
  expect_rewards(world, {0, 0, 0, 0});
}

TEST(SimReward, AgentDisabledOnce) {
  TestWorld world(with_reward(2, 1, RewardTerm::agent_disabled, 3));
  world.put(0, 2, 2);
  world.put(1, 9.95f, 5);
  world.put(2, 2, 8);
  world.step();
  expect_rewards(world, {0, -3, 0});
  world.step();
  expect_rewards(world, {0, 0, 0});
}

TEST(SimReward, GameWonForSurvivorsInEveryStepFromThen) {
  TestWorld world(with_reward(2, 1, RewardTerm::game_won, 5));
  world.put(0, 2, 2);
  world.put(1, 9.95f, 5);
  world.put(2, 9.95f, 8);
  world.step();
  expect_rewards(world, {5, 0, 0});
  world.step();
  expect_rewards(world, {5, 0, 0});
}

// Two against two without obstacles: the way is straight.
TEST(SimReward, ApproachPaysForTheWayGainedOnTheNearestLivingOpponent) {
  TestWorld world(with_reward(2, 2, RewardTerm::approach, 10));
  world.put(0, 2, 2);
  world.put(1, 2, 5);
  world.put(2, 6, 2);
  world.put(3, 9.95f, 9);  // leaves and counts no more
  world.step();
  const WorldView& w = world.now();
  // All fly east by the same d. Agent 0 gains 10 d on agent 2; agent 1 (2, 5) looks at agent 2 where it is now; agent 2
  // has left agent 0 behind it and loses 10 d.
  const float d = w.x[0] - 2, before = std::hypot(w.x[2] - 2, 3.0f), now = std::hypot(w.x[2] - w.x[1], 3.0f);
  expect_rewards(world, {10 * d, 10 * (before - now), -10 * d, 0});
}

// A wall from the left border with a way round its right end: the way from below to above it leads there and back.
TEST(SimReward, ApproachLeadsRoundObstacles) {
  const std::vector<Box> wall = {{0, 4.8f, 6, 5.2f, 0, 10}};
  const std::vector<uint16_t> table = make_path_table(10, 10, wall);
  const auto way = [&](float x1, float y1, float x2, float y2) {
    const auto cell = [](float x, float y) {
      return PathCell(y, 0.1f).nearest() * kPathCells + PathCell(x, 0.1f).nearest();
    };
    return static_cast<float>(table[static_cast<size_t>(cell(x1, y1) * kPathGrid + cell(x2, y2))]) * path_unit(10, 10);
  };
  // Cells are 0.625 wide. (0.94, 3.44) to (0.94, 6.56): 3.1 straight, at least 2 x 5.3 round the end at (6.25, 5).
  EXPECT_GT(way(0.94f, 3.44f, 0.94f, 6.56f), 2 * 5.3f);
  EXPECT_LT(way(0.94f, 3.44f, 0.94f, 6.56f), 13.0f);
  EXPECT_EQ(way(0.94f, 3.44f, 0.94f, 6.56f), way(0.94f, 6.56f, 0.94f, 3.44f));
  // Beside the wall the way is straight: five cells.
  EXPECT_NEAR(way(8.44f, 3.44f, 8.44f, 6.56f), 3.125f, 0.01f);

  SimSpec spec = with_reward(1, 1, RewardTerm::approach, 1);
  spec.maps[0].boxes = wall;
  spec.maps[0].paths = table;
  TestWorld world(spec);
  world.put(0, 2, 3.5f);       // flies east, to the end of the wall
  world.put(1, 2, 6.5f, kPi);  // flies west, away from it
  world.step();
  EXPECT_GT(world.reward(0), 0.08f);
  EXPECT_LT(world.reward(1), -0.08f);
}

TEST(SimReward, GameWonByNobodyTogether) {
  TestWorld world(with_reward(1, 1, RewardTerm::game_won, 5));
  world.put(0, 2, 2);
  world.put(1, 2, 2.2f);
  world.step();
  expect_rewards(world, {0, 0});
}

TEST(SimReward, IdleRewardOfTheType) {
  SimSpec spec = plain_spec(2, 1);
  spec.agents[0].idle_reward = 1;
  spec.agents[1].idle_reward = 0.25f;
  TestWorld world(spec);
  world.put(0, 2, 2);
  world.put(1, 9.95f, 5);
  world.put(2, 2, 8);
  world.step();  // the step of the death is still paid: no factor `alive` in this term
  expect_rewards(world, {1, 0.25f, 0});
  world.step();
  expect_rewards(world, {1, 0, 0});
}

// Two against one with four rewards, and a step in which the one leaves the map, paid by half.
SimSpec with_four_rewards() {
  SimSpec spec = with_reward(2, 1, RewardTerm::game_won, 6);
  set_reward(spec, RewardTerm::defeat_one_opponent, 9);
  set_reward(spec, RewardTerm::idle, 100);
  spec.agents[0].idle_reward = 2;
  spec.params.divide_reward_by_team_size = true;
  return spec;
}
void step_out_of_bounds(TestWorld& world) {
  *world.now().reward_factor = 0.5f;
  world.put(0, 2, 2);
  world.put(1, 2, 5);
  world.put(2, 9.95f, 8);
  world.step();
}

TEST(SimReward, FactorDivisionAndOrder) {
  SimSpec spec = with_four_rewards();
  TestWorld world(spec);
  step_out_of_bounds(world);
  // Terms of agent 0: type 2, defeat 9 * 1 / 3 = 3, idle -0.1: 0.5 * 4.9 + 6 = 8.45, / 3 agents
  EXPECT_NEAR(world.term(RewardTerm::idle_reward, 0), 2.0f, kRewardTolerance);
  EXPECT_NEAR(world.term(RewardTerm::defeat_one_opponent, 0), 3.0f, kRewardTolerance);
  EXPECT_NEAR(world.term(RewardTerm::idle, 0), -0.1f, kRewardTolerance);
  EXPECT_NEAR(world.term(RewardTerm::game_won, 0), 6.0f, kRewardTolerance);
  EXPECT_EQ(world.term(RewardTerm::damage, 0), 0.0f) << "a term that is off";
  expect_rewards(world, {8.45f / 3, (0.5f * 2.9f + 6) / 3, 0});
}

// The same step with a factor for each term: they act on top of the world's.
TEST(SimReward, TermsHaveFactorsOfTheirOwn) {
  SimSpec spec = with_four_rewards();
  EXPECT_EQ(TestWorld(spec).term_factors(), nullptr);
  spec.params.has_term_factors = true;
  const auto after_step = [&spec](bool whole) {
    TestWorld world(spec);
    for (int t = 0; t < kNRewardTerms; ++t) EXPECT_EQ(world.term_factors()[t], 1) << kRewardTermNames[t];
    const auto set = [&world](RewardTerm term, float factor) { world.term_factors()[static_cast<int>(term)] = factor; };
    if (!whole) {
      set(RewardTerm::defeat_one_opponent, 0.5f);
      set(RewardTerm::idle_reward, 0.25f);
      set(RewardTerm::idle, 0);
    }
    step_out_of_bounds(world);
    return world;
  };
  // At first all are 1: as above, 0.5 * (2 + 3 - 0.1) + 6 and 0.5 * (3 - 0.1) + 6.
  expect_rewards(after_step(true), {8.45f / 3, (0.5f * 2.9f + 6) / 3, 0});
  // Terms of agent 0: type 0.25 * 2 = 0.5, defeat 0.5 * 3 = 1.5, idle 0: 0.5 * 2 + 6 = 7; of agent 1: 0.5 * 1.5 + 6.
  TestWorld world = after_step(false);
  EXPECT_NEAR(world.term(RewardTerm::idle_reward, 0), 0.5f, kRewardTolerance);
  EXPECT_NEAR(world.term(RewardTerm::defeat_one_opponent, 0), 1.5f, kRewardTolerance);
  EXPECT_EQ(world.term(RewardTerm::idle, 0), 0.0f);
  EXPECT_NEAR(world.term(RewardTerm::game_won, 0), 6.0f, kRewardTolerance);
  expect_rewards(world, {7.0f / 3, 6.75f / 3, 0});
  // What the term brought its team in the episode: 0.5 * (1.5 + 1.5) / 3.
  EXPECT_NEAR(world.now().term_returns[static_cast<int>(RewardTerm::defeat_one_opponent)], 0.5f, kRewardTolerance);
}

TEST(SimReward, WeightsOfZeroOrLessSwitchOff) {
  for (const float weight : {0.0f, -4.0f}) {
    TestWorld world(with_reward(1, 1, RewardTerm::collision_agent, weight));
    world.put(0, 2, 2);
    world.put(1, 2, 2.2f);
    world.step();
    ASSERT_FALSE(world.alive(0));
    expect_rewards(world, {0, 0});
    EXPECT_EQ(world.term(RewardTerm::collision_agent, 0), 0.0f);
  }
}

TEST(SimReward, ScaledTermsAddUpToTheReward) {
  int64_t checked = 0, nonzero = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    SimSpec spec = random_spec(seed, 3, 4);
    spec.params.has_term_factors = seed % 2 == 1;
    SimOptions options;
    options.n_worlds = 65;
    options.n_threads = 1;
    options.on_done = OnDone::keep;
    SimRunner runner(make_cpu_simulator(spec, options));
    runner.start();
    const size_t n = 7, w_count = 65;
    const SimParams& p = runner.sim().params();
    for (size_t w = 0; w < w_count; ++w)
      runner.sim().state().view().reward_factor[w] = 0.25f * static_cast<float>(w % 5);
    std::vector<uint8_t> before(runner.sim().state().view().alive, runner.sim().state().view().alive + w_count * n);
    for (uint64_t k = 0; k < 20; ++k) {
      runner.step(k);
      const Snapshot shot = runner.snapshot();
      for (size_t w = 0; w < w_count; ++w)
        for (size_t i = 0; i < n; ++i) {
          double sum = 0;
          for (size_t t = 0; t < kNRewardTerms; ++t) {
            const double value =
                static_cast<double>(shot.float_at("terms [term][agent]", (w * kNRewardTerms + t) * n + i));
            const bool won = t == static_cast<size_t>(RewardTerm::game_won);
            sum += (won ? 1.0 : 0.25 * static_cast<double>(w % 5)) * value;
          }
          if (p.divide_reward_by_team_size) sum /= 7;
          if (!before[w * n + i]) sum = 0;
          const auto team = static_cast<size_t>(p.team_of(i));
          const size_t row = w * static_cast<size_t>(p.n_team[team]) + static_cast<size_t>(p.slot_of(i));
          const float reward = shot.float_at(team ? "reward of team 1" : "reward of team 0", row);
          ASSERT_NEAR(reward, sum, 1e-4) << "scenario " << seed << ", step " << k << ", world " << w << ", agent " << i;
          ++checked;
          nonzero += reward != 0;
          before[w * n + i] = shot.byte_at("alive", w * n + i);
        }
    }
    // The same over the episode: the returns of the terms add up to the return.
    const StateView& s = runner.sim().state().view();
    for (size_t k = 0; k < w_count * kNTeams; ++k) {
      double sum = 0;
      for (size_t t = 0; t < kNRewardTerms; ++t) sum += static_cast<double>(s.term_returns[k * kNRewardTerms + t]);
      ASSERT_NEAR(s.returns[k], sum, 1e-3 * (1 + std::abs(sum))) << "scenario " << seed << ", world " << k / 2;
    }
  }
  EXPECT_GT(nonzero, checked / 20);
}

}  // namespace
}  // namespace giga::test
