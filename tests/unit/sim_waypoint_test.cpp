// Waypoints: appearing, collecting, expiring, payment and score (rules 4.2).
#include <gtest/gtest.h>

#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

SimSpec waypoint_spec(int n_team_0, int n_team_1) {
  SimSpec spec = plain_spec(n_team_0, n_team_1);
  spec.params.waypoints = true;
  set_damage_cone(spec.params, 0, 0.25f * kPi);  // nobody shoots
  set_reward(spec, RewardTerm::hit_waypoint, 50);
  return spec;
}

/// A waypoint over x 4 to 4.6, y 5 to 5.6.
void place_waypoint(TestWorld& world, float seconds) {
  const float corners[] = {4, 5, 4.6f, 5.6f};
  for (int k = 0; k < 4; ++k) world.now().waypoint[k] = corners[k];
  *world.now().waypoint_time = seconds;
}

TEST(SimWaypoint, AppearsWithFivePercent) {
  TestWorld world(waypoint_spec(1, 1));
  world.put(0, 2, 2);
  world.put(1, 8, 8);
  world.draws.appear = 0.05f;
  world.step();
  EXPECT_EQ(*world.now().waypoint_time, 0.0f);
  world.draws.appear = 0.0499f;
  world.draws.location[0] = 0.25f;
  world.draws.location[1] = 0.5f;
  world.draws.time = 0.2f;
  world.step();
  // 0.25 * (10 - 0.6) = 2.35; 0.5 * 9.4 = 4.7; 5 + 5 * 0.2 = 6 seconds
  const float expected[] = {2.35f, 4.7f, 2.95f, 5.3f};
  for (int k = 0; k < 4; ++k) EXPECT_NEAR(world.now().waypoint[k], expected[k], 1e-5f) << "corner " << k;
  EXPECT_NEAR(*world.now().waypoint_time, 6.0f, 1e-5f);
  world.step();
  EXPECT_NEAR(*world.now().waypoint_time, 5.9f, 1e-5f) << "no second one while it lasts";
  EXPECT_NEAR(world.now().waypoint[0], 2.35f, 1e-5f);
}

TEST(SimWaypoint, NoneWithoutTheSwitch) {
  SimSpec spec = waypoint_spec(1, 1);
  spec.params.waypoints = false;
  TestWorld world(spec);
  world.draws.appear = 0;
  world.put(0, 2, 2);
  world.put(1, 8, 8);
  world.step();
  EXPECT_EQ(*world.now().waypoint_time, 0.0f);
}

TEST(SimWaypoint, ExpiresAndTheNextMayComeAtOnce) {
  TestWorld world(waypoint_spec(1, 1));
  world.put(0, 2, 2);
  world.put(1, 8, 8);
  place_waypoint(world, 0.15f);
  world.step();
  EXPECT_NEAR(*world.now().waypoint_time, 0.05f, 1e-6f);
  world.step();
  EXPECT_EQ(*world.now().waypoint_time, 0.0f) << "never below zero";
  EXPECT_EQ(world.now().waypoint[0], 4.0f) << "the stale place stays";
  place_waypoint(world, 0.05f);
  world.draws.appear = 0;
  world.step();
  EXPECT_NEAR(*world.now().waypoint_time, 7.5f, 1e-5f) << "5 + 5 * 0.5 in the step of the expiry";
}

TEST(SimWaypoint, CollectingPaysAllInsideOfBothTeamsAndRefillsThem) {
  SimSpec spec = waypoint_spec(3, 2);
  spec.params.collision_range2 = 0;
  TestWorld world(spec);
  world.put(0, 4.1f, 5.1f, 0, 9);  // altitude does not count
  world.put(1, 4.2f, 5.5f);
  world.put(2, 2, 2);
  world.put(3, 4.05f, 5.3f);
  world.put(4, 4.6f, 5.3f);  // flies out: 4.72
  for (int i = 0; i < 5; ++i) world.now().health[i] = 0.3f;
  place_waypoint(world, 5);
  world.step();
  const bool hit[] = {true, true, false, true, false};
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(world.reward(i), hit[i] ? 50.0f : 0.0f) << "agent " << i;
    EXPECT_EQ(world.term(RewardTerm::hit_waypoint, i), hit[i] ? 50.0f : 0.0f) << "agent " << i;
    // 0.3 + 0.01 + max_health, cut to 1
    EXPECT_NEAR(world.now().health[i], hit[i] ? 1.0f : 0.31f, 1e-6f) << "agent " << i;
  }
  EXPECT_EQ(*world.now().waypoint_time, 0.0f) << "collected";
  EXPECT_EQ(world.now().score[0], 1.0f) << "two of a team count once";
  EXPECT_EQ(world.now().score[1], 1.0f);
  world.step();
  for (int i = 0; i < 5; ++i) EXPECT_EQ(world.reward(i), 0.0f) << "gone, agent " << i;
  EXPECT_EQ(world.now().score[0], 1.0f);
}

TEST(SimWaypoint, EdgesAreInside) {
  TestWorld world(waypoint_spec(1, 1));
  place_waypoint(world, 5);
  const struct {
    float x, y;
    bool inside;
  } cases[] = {{4, 5, true}, {4.6f, 5.6f, true}, {3.9999f, 5.3f, false}, {4.3f, 5.6001f, false}};
  WorldView& w = world.now();
  w.was_alive[0] = 1;
  for (const auto& c : cases) {
    w.flags[0] = 0;
    w.x[0] = c.x;
    w.y[0] = c.y;
    touch_waypoint(world.params(), w, 0);
    EXPECT_EQ((w.flags[0] & kHitWaypoint) != 0, c.inside) << c.x << ", " << c.y;
  }
}

TEST(SimWaypoint, ShownForSomeStepsItStaysAllTheSame) {
  SimSpec spec = waypoint_spec(1, 1);
  spec.params.egocentric_view = true;
  spec.params.waypoint_unseen_time = 9.85f;  // shown for two steps: at 10.0 and at 9.9 seconds
  TestWorld world(spec);
  world.put(0, 2, 2);
  world.put(1, 8, 8);
  world.draws.appear = 0;
  world.draws.location[0] = 0.25f;
  world.draws.location[1] = 0.5f;
  world.draws.time = 0.2f;  // which does not count
  // Two agents of 9 numbers each, then the waypoint's 5; of the view 7 numbers and 12 walls, then its 3.
  const auto shown = [&] {
    int zeros = 0;
    for (int column = 18; column < 23; ++column) zeros += world.obs(0, column) == 0;
    for (int column = 19; column < 22; ++column) zeros += world.egocentric(0, column) == 0;
    EXPECT_TRUE(zeros == 0 || zeros == 8) << zeros << " numbers are 0";
    return zeros == 0;
  };
  world.step();
  world.draws.appear = 1;
  EXPECT_NEAR(*world.now().waypoint_time, 10, 1e-5f);
  EXPECT_NEAR(world.obs(0, 18), (2.35f - world.now().x[0]) / 10, 1e-5f);
  EXPECT_TRUE(shown());
  world.step();
  EXPECT_NEAR(world.obs(0, 22), 9.9f, 1e-5f);
  EXPECT_TRUE(shown());
  world.step();
  EXPECT_NEAR(*world.now().waypoint_time, 9.8f, 1e-5f);
  EXPECT_FALSE(shown());
  world.put(0, 2.5f, 5);
  world.step();
  EXPECT_EQ(world.reward(0), 50.0f) << "who remembers where it is is paid";
  EXPECT_EQ(*world.now().waypoint_time, 0.0f);
}

TEST(SimWaypoint, DyingInItIsStillPaid) {
  SimSpec spec = waypoint_spec(1, 2);
  spec.maps[0].boxes = {{4.3f, 5, 4.5f, 5.6f, 0, 10}};
  TestWorld world(spec);
  world.put(0, 4.3f, 5.3f);
  world.put(1, 8, 8);
  world.put(2, 8, 2);
  place_waypoint(world, 5);
  world.step();
  EXPECT_FALSE(world.alive(0));
  EXPECT_EQ(world.reward(0), 50.0f);
  EXPECT_EQ(*world.now().waypoint_time, 0.0f);
}

}  // namespace
}  // namespace giga::test
