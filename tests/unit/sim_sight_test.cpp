// Sight: cones, ranges, the very-close circle, stochastic detection, and the options that change it (rules 4.4).
#include <gtest/gtest.h>

#include <cmath>

#include "sim/draws.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

/// Observer 0 (team 0) at (5,5) looking along `heading`; target 1 (team 1) at the given offset.
Sighting look_at(TestWorld& world, float heading, float dx, float dy, float dz = 0) {
  world.put(0, 5, 5, heading, 5);
  world.put(1, 5 + dx, 5 + dy, 0, 5 + dz);
  face(world.now(), 0);
  face(world.now(), 1);
  return sight(world.params(), world.now(), 1, 0, [&] { return world.draws.detect(1, 0); });
}

Sighting look_polar(TestWorld& world, float heading, float angle, float distance) {
  return look_at(world, heading, distance * std::cos(heading + angle), distance * std::sin(heading + angle));
}

TEST(SimSight, ConeByAngleAndDepth) {
  // Sight: half angle 135 degrees, depth 3, very close 1. Weapon: half angle 45 degrees, depth 2.05.
  TestWorld world(plain_spec(1, 1));
  for (const float heading : {0.0f, 1.0f, 3.0f, -3.1f, -2.0f}) {
    for (const float side : {-1.0f, 1.0f}) {
      EXPECT_TRUE(look_polar(world, heading, side * 2.34f, 2.9f).detected) << heading;   // 134.1 degrees
      EXPECT_FALSE(look_polar(world, heading, side * 2.37f, 2.9f).detected) << heading;  // 135.8 degrees
      EXPECT_TRUE(look_polar(world, heading, side * 0.78f, 2.0f).in_weapon_range) << heading;
      EXPECT_FALSE(look_polar(world, heading, side * 0.79f, 2.0f).in_weapon_range) << heading;  // pi/4 = 0.7854
    }
    EXPECT_TRUE(look_polar(world, heading, 0, 2.99f).detected) << heading;
    EXPECT_FALSE(look_polar(world, heading, 0, 3.01f).detected) << heading;
    EXPECT_TRUE(look_polar(world, heading, 0, 2.04f).in_weapon_range) << heading;
    EXPECT_FALSE(look_polar(world, heading, 0, 2.06f).in_weapon_range) << heading;
  }
}

TEST(SimSight, VeryCloseInAllDirectionsAtAnyAltitude) {
  TestWorld world(plain_spec(1, 1));
  EXPECT_TRUE(look_at(world, 0, -0.99f, 0).detected);
  EXPECT_FALSE(look_at(world, 0, -1.01f, 0).detected) << "behind, beyond 1.0";
  EXPECT_TRUE(look_at(world, 0, -0.99f, 0, 5).detected) << "altitude does not count";
  EXPECT_FALSE(look_at(world, 0, -0.99f, 0).in_weapon_range);
  EXPECT_TRUE(look_at(world, 0, 0, 0).detected) << "the same place";
}

TEST(SimSight, RangeScalesTheSquaredDepth) {
  SimSpec spec = plain_spec(1, 1);
  spec.agents[0].range = 2;         // 3 sqrt 2 = 4.243
  spec.agents[0].damage_range = 2;  // 2.05 sqrt 2 = 2.899
  TestWorld world(spec);
  EXPECT_TRUE(look_at(world, 0, 4.2f, 0).detected);
  EXPECT_FALSE(look_at(world, 0, 4.3f, 0).detected);
  EXPECT_TRUE(look_at(world, 0, 2.89f, 0).in_weapon_range);
  EXPECT_FALSE(look_at(world, 0, 2.91f, 0).in_weapon_range);
}

TEST(SimSight, DamageRangeZeroNeverShoots) {
  SimSpec spec = plain_spec(1, 1);
  spec.agents[0].damage_range = 0;
  TestWorld world(spec);
  EXPECT_FALSE(look_at(world, 0, 0.5f, 0).in_weapon_range);  // x / 0 = inf
  EXPECT_FALSE(look_at(world, 0, 0, 0).in_weapon_range);     // 0 / 0 = NaN
}

TEST(SimSight, FullConesSeeAllAround) {
  SimSpec spec = plain_spec(1, 1);
  set_cone(spec.params, 3, kTwoPi);
  set_damage_cone(spec.params, 1, kPi);
  TestWorld world(spec);
  EXPECT_TRUE(look_at(world, 0, -2.9f, 0).detected);
  EXPECT_TRUE(look_at(world, 0, -0.9f, 0).in_weapon_range);
  EXPECT_FALSE(look_at(world, 0, -1.1f, 0).in_weapon_range);
}

TEST(SimSight, OnlyLivingOpponentsDetect) {
  TestWorld world(plain_spec(2, 2));
  world.put(0, 5, 5);
  world.put(1, 6.5f, 5);  // team mate in the cone
  world.put(2, 5, 6.5f);  // opponent at 90 degrees
  world.put(3, 6.5f, 6.5f);
  world.kill(3);
  world.step();
  EXPECT_TRUE(world.detected(2, 0));
  EXPECT_FALSE(world.detected(1, 0)) << "a team mate";
  EXPECT_FALSE(world.detected(3, 0)) << "a dead opponent";
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(world.detected(i, 3)) << "by the dead: " << i;
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(world.detected(i, i));
}

TEST(SimSight, StochasticThresholds) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.stochastic_detection = true;
  TestWorld world(spec);
  // At 2 ahead but outside the weapon cone (angle 1): score = 4/9 = 0.4444; seen where the draw is above it.
  world.draws.detect_draw = [](int, int) { return 0.44f; };
  EXPECT_FALSE(look_polar(world, 0, 1, 2).detected);
  world.draws.detect_draw = [](int, int) { return 0.45f; };
  EXPECT_TRUE(look_polar(world, 0, 1, 2).detected);
  // Outside the cone or beyond its depth no draw helps; within the weapon cone and the sight depth none is needed.
  world.draws.detect_draw = [](int, int) { return 0.999999f; };
  EXPECT_FALSE(look_polar(world, 0, 2.5f, 2).detected);
  EXPECT_FALSE(look_polar(world, 0, 1, 3.01f).detected);
  world.draws.detect_draw = [](int, int) { return 0.0f; };
  EXPECT_TRUE(look_polar(world, 0, 0.5f, 2.99f).detected);
  EXPECT_FALSE(look_polar(world, 0, 0.5f, 3.01f).detected);
  EXPECT_TRUE(look_polar(world, 0, 3, 0.99f).detected) << "very close";
}

TEST(SimSight, DrawIsAddressedByTargetAndObserver) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.stochastic_detection = true;
  TestWorld world(spec);
  int target = -1, observer = -1;
  world.draws.detect_draw = [&](int a, int b) {
    target = a;
    observer = b;
    return 0.0f;
  };
  look_polar(world, 0, 1, 2);
  EXPECT_EQ(target, 1);
  EXPECT_EQ(observer, 0);
}

TEST(SimSight, StochasticFrequencyIsLinearInSquaredDistance) {
  // P(detect) = 1 - d^2/9. 20,000 draws: standard error at most 0.5 / sqrt(20000) = 0.0035; 4.5 of them = 0.016.
  SimSpec spec = plain_spec(1, 1);
  spec.params.stochastic_detection = true;
  TestWorld world(spec);
  const int n = 20000;
  for (const float d : {1.2f, 1.8f, 2.4f, 2.9f}) {
    look_polar(world, 0, 1, d);
    int hits = 0;
    for (int k = 0; k < n; ++k) {
      PhiloxDraws draws(5, static_cast<uint32_t>(k % 65), static_cast<uint32_t>(k / 65));
      hits += sight(world.params(), world.now(), 1, 0, [&] { return draws.detect(1, 0); }).detected;
    }
    EXPECT_NEAR(hits / static_cast<double>(n), 1 - d * d / 9, 0.016) << "distance " << d;
  }
}

TEST(SimSight, BlockedByObstacles) {
  SimSpec spec = plain_spec(1, 1);
  spec.maps[0].boxes = {{5.8f, 4.5f, 6.2f, 5.5f, 0, 10}};
  TestWorld open(spec);
  EXPECT_TRUE(look_at(open, 0, 2, 0).detected) << "by default obstacles do not block";
  spec.params.obstacles_block_sight = true;
  TestWorld world(spec);
  EXPECT_FALSE(look_at(world, 0, 2, 0).detected) << "through the box";
  EXPECT_TRUE(look_at(world, 0, 0.7f, 0).detected) << "in front of it";
  EXPECT_TRUE(look_at(world, 0, 0, 2).detected) << "beside it";
  EXPECT_FALSE(look_at(world, 0, 1.2f, 0.5f).detected) << "a corner is cut: y 5.33 to 5.5 within x 5.8 to 6.2";
  EXPECT_TRUE(look_at(world, 0, 1.2f, 0.9f).detected) << "passes above the corner: y 5.6 at x 5.8";
  EXPECT_TRUE(look_at(world, kPi, -2, 0).detected) << "away from the box";
  // Altitude does not matter without obstacle_heights, even above the box.
  EXPECT_FALSE(look_at(world, 0, 2, 0, 5).detected);
}

TEST(SimSight, BlockedOnlyBelowTheTopWithHeights) {
  SimSpec spec = plain_spec(1, 1);
  spec.maps[0].boxes = {{5.8f, 4.5f, 6.2f, 5.5f, 0, 4.9f}};  // look_at flies at z = 5
  spec.params.obstacles_block_sight = true;
  spec.params.obstacle_heights = true;
  TestWorld world(spec);
  EXPECT_TRUE(look_at(world, 0, 2, 0).detected) << "above the box";
  // From z 5 at x 5 to z 4 at x 7: 4.6 at x 5.8 and 4.4 at x 6.2, both below 4.9.
  EXPECT_FALSE(look_at(world, 0, 2, 0, -1).detected) << "down through the box";
  // To z 4.85 at x 7: 4.94 and 4.91, above.
  EXPECT_TRUE(look_at(world, 0, 2, 0, -0.15f).detected) << "just above the box";
}

TEST(SimSight, PaddingBlocksNothing) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.obstacles_block_sight = true;
  spec.maps.push_back(spec.maps[0]);
  spec.maps[1].boxes = {{5.8f, 4.5f, 6.2f, 5.5f, 0, 10}};
  TestWorld world(spec);
  EXPECT_TRUE(look_at(world, 0, 2, 0).detected) << "map 0 has no box";
  world.put(0, -0.1f, 0, 0);
  world.put(1, 0.1f, 0, 0);
  EXPECT_FALSE(sight_blocked(world.params(), world.now(), 1, 0)) << "a line through the origin";
}

TEST(SimSight, ThreeDimensional) {
  SimSpec spec = plain_spec(1, 1);
  TestWorld flat(spec);
  EXPECT_TRUE(look_at(flat, 0, 2, 0, 2.5f).detected);
  EXPECT_TRUE(look_at(flat, 0, 2, 0, 2.5f).in_weapon_range);
  spec.params.sight_3d = true;
  TestWorld world(spec);
  EXPECT_FALSE(look_at(world, 0, 2, 0, 2.5f).detected) << "sqrt(4 + 6.25) = 3.2 > 3";
  EXPECT_TRUE(look_at(world, 0, 2, 0, 2.2f).detected) << "sqrt(4 + 4.84) = 2.97";
  EXPECT_FALSE(look_at(world, 0, -0.8f, 0, 0.8f).detected) << "0.8 sqrt 2 = 1.13: not very close, and behind";
  EXPECT_TRUE(look_at(world, 0, 1.0f, 0, 0.9f).in_weapon_range) << "42 degrees up";
  EXPECT_FALSE(look_at(world, 0, 1.0f, 0, 1.1f).in_weapon_range) << "47.7 degrees up";
}

}  // namespace
}  // namespace giga::test
