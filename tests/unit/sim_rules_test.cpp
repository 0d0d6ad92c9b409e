// Each line of "what `corrected` changes" (rules 15) that concerns the simulator: the corrected behaviour, and beside
// it the original's, which must differ. Rules that hold under both sets are tested under both.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

SimSpec with_rules(SimSpec spec, Rules rules) {
  spec.params.rules = rules;
  return spec;
}

TEST(SimRules, Q2MapIsUniformOverAllMapsOfTheSet) {
  // 8 maps, 65 worlds x 100 starts = 6,500 draws: chi-square with 7 degrees of freedom, 0.1 % critical value 24.32. The
  // original never draws the last two.
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    SimSpec spec = with_rules(plain_spec(1, 1), rules);
    spec.maps.assign(8, spec.maps[0]);
    spec.finish();
    SimOptions options;
    options.n_worlds = 65;
    options.n_threads = 1;
    SimRunner runner(make_cpu_simulator(spec, options), Outputs::none);
    std::vector<int> counts(8);
    for (int k = 0; k < 100; ++k) {
      runner.start();
      for (int w = 0; w < 65; ++w) {
        const int map = runner.sim().state().view().map[w];
        ASSERT_TRUE(map >= 0 && map < 8) << "world " << w;
        ++counts[static_cast<size_t>(map)];
      }
    }
    double chi2 = 0;
    for (const int count : counts) chi2 += (count - 812.5) * (count - 812.5) / 812.5;
    EXPECT_LT(chi2, 24.32);
  }
}

TEST(SimRules, Q4HeadingsAreWrapped) {
  TestWorld corrected(with_rules(plain_spec(1, 1), Rules::corrected));
  TestWorld original(with_rules(plain_spec(1, 1), Rules::original));
  for (TestWorld* world : {&corrected, &original}) {
    world->put(0, 5, 5, -3.0f);
    world->put(1, 2, 2);
    world->control(0, -1, 0, 0);
    world->step();
  }
  // -3 - 0.4 = -3.4, and -3.4 + 2 pi = 2.88318531
  EXPECT_NEAR(corrected.now().heading[0], 2.88318531f, 1e-6f);
  EXPECT_NEAR(original.now().heading[0], -3.4f, 1e-6f);
  EXPECT_NEAR(corrected.now().x[0], original.now().x[0], 1e-6f) << "the same direction";
  // Beyond +pi both wrap.
  for (TestWorld* world : {&corrected, &original}) {
    world->put(0, 5, 5, 3.0f);
    world->control(0, 1, 0, 0);
    world->step();
    EXPECT_NEAR(world->now().heading[0], -2.88318531f, 1e-6f);
  }
}

TEST(SimRules, Q4RelativeHeadingsAreWrapped) {
  TestWorld corrected(with_rules(plain_spec(1, 1), Rules::corrected));
  TestWorld original(with_rules(plain_spec(1, 1), Rules::original));
  for (TestWorld* world : {&corrected, &original}) {
    world->put(0, 4, 5, 2);  // sees agent 1, 115 degrees off its nose
    world->put(1, 5, 5, -2);
    world->step();
    ASSERT_EQ(world->obs(0, 9), 1.0f);
  }
  EXPECT_NEAR(corrected.obs(0, 9 + 5), -4 + 2 * kPi, 1e-6f);
  EXPECT_NEAR(original.obs(0, 9 + 5), -4.0f, 1e-6f);
}

TEST(SimRules, Q5StartHealthIsTheMaximum) {
  SimSpec spec = plain_spec(2, 1);
  spec.agents[0].max_health = 3;
  spec.agents[1].max_health = 0.5f;
  TestWorld corrected(with_rules(spec, Rules::corrected)), original(with_rules(spec, Rules::original));
  const float expected[] = {3, 0.5f, 1};
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(corrected.now().health[i], expected[i]) << "agent " << i;
    EXPECT_EQ(original.now().health[i], 1.0f) << "agent " << i;
  }
  original.put(0, 2, 2);
  original.put(1, 2, 5);
  original.put(2, 7, 8);
  original.step();
  EXPECT_NEAR(original.now().health[0], 1.01f, 1e-6f) << "below its maximum: heals";
  EXPECT_EQ(original.now().health[1], 0.5f) << "above its maximum: cut";
}

TEST(SimRules, Q7ObstaclePenaltyIsPaid) {
  SimSpec spec = plain_spec(2, 1);
  set_reward(spec, RewardTerm::collision_obstacle, 10);
  spec.maps[0].boxes = {{4, 4, 6, 6, 0, 10}};
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    TestWorld world(with_rules(spec, rules));
    world.put(0, 9.95f, 2);
    world.put(1, 5, 5);
    world.put(2, 2, 8);
    world.step();
    ASSERT_FALSE(world.alive(0) || world.alive(1));
    const float expected = rules == Rules::corrected ? -10.0f : 0.0f;
    EXPECT_EQ(world.reward(0), expected);
    EXPECT_EQ(world.reward(1), expected);
    EXPECT_EQ(world.reward(2), 0.0f);
  }
}

TEST(SimRules, Q10TheDeadCollectNoWaypoints) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.waypoints = true;
  spec.params.episode_ends_one_team_dead = false;
  set_reward(spec, RewardTerm::hit_waypoint, 50);
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    TestWorld world(with_rules(spec, rules));
    world.put(0, 5, 5);
    world.put(1, 2, 8);
    world.kill(0);
    const float corners[] = {4, 4, 6, 6};
    for (int k = 0; k < 4; ++k) world.now().waypoint[k] = corners[k];
    *world.now().waypoint_time = 5;
    world.step();
    EXPECT_NEAR(*world.now().waypoint_time, rules == Rules::corrected ? 4.9f : 0.0f, 1e-6f);
    EXPECT_EQ(world.reward(0), 0.0f) << "unpaid under both rules";
    EXPECT_EQ(world.now().score[0], 0.0f);
    EXPECT_FALSE(world.alive(0)) << "and not revived by the refill";
  }
}

TEST(SimRules, Q18FullyObservableFromTheFirstObservation) {
  SimSpec spec = plain_spec(2, 2);
  set_cone(spec.params, 100, kTwoPi);
  spec.params.collision_range2 = 0;
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    TestWorld world(with_rules(spec, rules));  // starts
    for (int e = 0; e < 4; ++e)
      for (int a = 0; a < 4; ++a) {
        const bool mates = e / 2 == a / 2;
        EXPECT_EQ(world.seen(e, a), mates || rules == Rules::corrected) << "agent " << e << " of agent " << a;
      }
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < 4; ++b) EXPECT_EQ(world.tracked(a, b), 0) << "nobody fires at the start";
    world.step();
    for (int a = 0; a < 4; ++a) EXPECT_TRUE(world.seen(0, a)) << "from the first step on under both, agent " << a;
  }
}

TEST(SimRules, Q18PartlyObservableStartsShowNoOpponentUnderBoth) {
  SimSpec spec = plain_spec(2, 2);
  set_cone(spec.params, 100, kTwoPi);
  spec.params.stochastic_detection = true;
  spec.params.stochastic_communication = true;
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    TestWorld world(with_rules(spec, rules));
    EXPECT_TRUE(world.seen(0, 0));
    EXPECT_FALSE(world.seen(0, 2));
    EXPECT_FALSE(world.seen(0, 3));
  }
}

TEST(SimRules, Q26RewardFactorSurvivesResets) {
  SimSpec spec = plain_spec(1, 1);
  spec.agents[0].idle_reward = 1;
  spec.params.max_episode_length = 1;
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    TestWorld world(with_rules(spec, rules), OnDone::reset);
    EXPECT_EQ(*world.now().reward_factor, 1.0f);
    *world.now().reward_factor = 0.25f;
    for (int episode = 0; episode < 3; ++episode) {
      world.step();
      ASSERT_EQ(world.done(), Done::truncated);
      EXPECT_EQ(world.reward(0), 0.25f) << "episode " << episode;
      EXPECT_EQ(*world.now().reward_factor, 0.25f) << "episode " << episode;
    }
  }
}

TEST(SimRules, Q36EpisodesResetThemselves) {
  SimSpec spec = plain_spec(1, 1);
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    TestWorld world(with_rules(spec, rules), OnDone::reset);
    world.put(0, 5, 5);
    world.put(1, 9.95f, 5);
    world.step();
    ASSERT_EQ(world.done(), Done::terminated);
    EXPECT_EQ(*world.now().episode_length, 0);
    EXPECT_TRUE(world.alive(1));
    world.step();
    EXPECT_EQ(world.done(), Done::running);
    EXPECT_EQ(*world.now().episode_length, 1);
  }
}

TEST(SimRules, KeptQuirksAreTheSameUnderBoth) {
  // Q6 start speed 1, Q9 range on the squared depth, Q12 division by all agents.
  SimSpec spec = plain_spec(2, 1);
  spec.params.divide_reward_by_team_size = true;
  spec.agents[0].idle_reward = 1;
  spec.agents[0].range = 2;
  for (const Rules rules : {Rules::corrected, Rules::original}) {
    TestWorld world(with_rules(spec, rules));
    EXPECT_EQ(world.now().v[0], 1.0f);
    world.put(0, 2, 5);
    world.put(1, 2, 9);
    world.put(2, 6.2f, 5);  // 4.2 < 3 sqrt 2
    world.step();
    EXPECT_TRUE(world.detected(2, 0));
    EXPECT_NEAR(world.reward(0), 1.0f / 3, 1e-6f);
  }
}

}  // namespace
}  // namespace giga::test
