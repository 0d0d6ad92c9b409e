// Damage and health: tracking counters, the damage sequence, healing, limits, death (rules 4.5).
#include <gtest/gtest.h>

#include <algorithm>

#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

/// Agent 0 (team 0) flies 1.5 behind agent 1 (team 1), both along x with equal speed: 0 fires at 1, 1 does not see 0.
void chase(TestWorld& world) {
  world.put(0, 2, 5);
  world.put(1, 3.5f, 5);
}

TEST(SimDamage, SequenceOverTwelveSteps) {
  SimSpec spec = plain_spec(1, 1);
  spec.agents[1].max_health = 10;
  TestWorld world(spec);
  chase(world);
  // Counter 1, 2, 3, ...; damage = clamp(counter, 3, 10) - 3 = 0 0 0 1 2 3 4 5 6 7 7 7; each unit costs 0.1; healing
  // gives 0.01 a step, cut at 10: 10, 10, 10, 10 - 0.1 + 0.01 = 9.91, - 0.2 + 0.01 = 9.72, ...
  const float health[12] = {10, 10, 10, 9.91f, 9.72f, 9.43f, 9.04f, 8.55f, 7.96f, 7.27f, 6.58f, 5.89f};
  const int taken[12] = {0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 7, 7};
  for (int k = 0; k < 12; ++k) {
    world.step();
    EXPECT_EQ(world.tracked(1, 0), k + 1) << "step " << k;
    EXPECT_EQ(world.tracked(0, 1), 0) << "step " << k;
    EXPECT_EQ(world.now().taken[1], static_cast<float>(taken[k])) << "step " << k;
    EXPECT_NEAR(world.now().health[1], health[k], 1e-5f) << "step " << k;
    EXPECT_EQ((world.now().flags[1] & kTookDamage) != 0, taken[k] > 0) << "step " << k;
    EXPECT_EQ(world.now().health[0], 1.0f) << "step " << k;
  }
}

TEST(SimDamage, DamageUnitsByTable) {
  SimSpec spec = plain_spec(1, 1);
  spec.finish();
  const int expected[] = {0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 7, 7};
  for (int tracked = 0; tracked < 13; ++tracked)
    EXPECT_EQ(damage_units(spec.params, tracked), expected[tracked]) << tracked;
  EXPECT_EQ(damage_units(spec.params, 255), 7);
}

TEST(SimDamage, DeathAtZeroHealth) {
  TestWorld world(plain_spec(1, 1));
  chase(world);
  // From 1: 1 1 1 0.91 0.72 0.43 0.04, then 0.04 - 0.5 + 0.01 < 0.
  world.steps(7);
  EXPECT_NEAR(world.now().health[1], 0.04f, 1e-5f);
  EXPECT_TRUE(world.alive(1));
  world.step();
  EXPECT_EQ(world.now().health[1], 0.0f);
  EXPECT_FALSE(world.alive(1));
  world.step();
  EXPECT_EQ(world.tracked(1, 0), 0) << "nobody fires at the dead";
  EXPECT_EQ(world.now().health[1], 0.0f) << "the dead do not heal";
}

TEST(SimDamage, SeveralShootersAddUp) {
  SimSpec spec = plain_spec(2, 1);
  spec.agents[2].max_health = 10;
  TestWorld world(spec);
  world.put(0, 2, 5);
  world.put(1, 2, 5.5f);
  world.put(2, 3.5f, 5.25f);
  world.steps(5);  // both counters 5: 2 + 2 units; before that 1 + 1
  EXPECT_EQ(world.now().taken[2], 4.0f);
  EXPECT_NEAR(world.now().health[2], 10 - 0.2f + 0.01f - 0.4f + 0.01f, 1e-5f);
}

TEST(SimDamage, OneMissedStepResetsTheCounter) {
  TestWorld world(plain_spec(1, 1));
  chase(world);
  world.steps(3);
  EXPECT_EQ(world.tracked(1, 0), 3);
  world.put(1, world.now().x[0], 9);  // out of sight for one step
  world.step();
  EXPECT_EQ(world.tracked(1, 0), 0);
  chase(world);
  world.step();
  EXPECT_EQ(world.tracked(1, 0), 1);
}

TEST(SimDamage, SightWithoutWeaponRangeDoesNotTrack) {
  TestWorld world(plain_spec(1, 1));
  world.put(0, 2, 5);
  world.put(1, 4.5f, 5);  // 2.5: seen (3), not in reach (2.05)
  world.step();
  EXPECT_TRUE(world.detected(1, 0));
  EXPECT_EQ(world.tracked(1, 0), 0);
}

TEST(SimDamage, CounterStopsAt255) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.max_tracking_time = 255;
  spec.params.damage_per_second = 0;
  TestWorld world(spec);
  for (int k = 0; k < 258; ++k) {
    chase(world);
    world.step();
    ASSERT_EQ(world.tracked(1, 0), std::min(k + 1, 255)) << "step " << k;
  }
  EXPECT_EQ(world.now().taken[1], 252.0f);  // 255 - 3
}

TEST(SimDamage, HealingUpToTheLimit) {
  SimSpec spec = plain_spec(2, 1);
  spec.agents[0].max_health = 3;
  TestWorld world(spec);
  world.put(0, 2, 2);
  world.put(1, 2, 5);
  world.put(2, 7, 8);
  world.now().health[0] = 2.985f;
  world.now().health[1] = 0.5f;
  world.step();
  EXPECT_NEAR(world.now().health[0], 2.995f, 1e-6f);  // + 0.1 * 0.1
  EXPECT_NEAR(world.now().health[1], 0.51f, 1e-6f);
  world.step();
  EXPECT_EQ(world.now().health[0], 3.0f);
}

TEST(SimDamage, HealthAboveTheLimitIsCut) {
  SimSpec spec = plain_spec(1, 1);
  spec.agents[0].max_health = 0.5f;
  TestWorld world(spec);
  world.put(0, 2, 2);
  world.put(1, 7, 8);
  world.now().health[0] = 1;
  world.step();
  EXPECT_EQ(world.now().health[0], 0.5f);
}

TEST(SimDamage, DamagePerSecondAndTrackingTimesScale) {
  SimSpec spec = plain_spec(1, 1);
  spec.agents[1].max_health = 10;
  spec.params.damage_per_second = 10;
  spec.params.healing_per_second = 0;
  spec.params.min_tracking_time = 1;
  spec.params.max_tracking_time = 3;
  TestWorld world(spec);
  chase(world);
  world.steps(4);  // units 0 1 2 2, each costs 10 * 0.1 = 1
  EXPECT_NEAR(world.now().health[1], 5.0f, 1e-5f);
}

}  // namespace
}  // namespace giga::test
