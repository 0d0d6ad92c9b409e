// Movement by hand arithmetic: heading, speed, position, altitude, energy exchange, action decoding (rules 3 and 4.1).
#include <gtest/gtest.h>

#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

constexpr float kMotionTolerance = 2e-6f;  // a few roundings of numbers below 8

// A policy may answer what is no number; places and speeds stay numbers, by which tables are read.
TEST(SimKinematics, ControlsThatAreNoNumbersAreTheLeast) {
  SimSpec spec = plain_spec(1, 1);
  TestWorld broken(spec), least(spec);
  for (TestWorld* world : {&broken, &least}) world->put(0, 5, 5, 0.5f, 3, 2), world->put(1, 1, 1);
  broken.control(0, NAN, NAN, NAN);
  least.control(0, -1, -1, -1);
  broken.step();
  least.step();
  EXPECT_EQ(broken.now().x[0], least.now().x[0]);
  EXPECT_EQ(broken.now().heading[0], least.now().heading[0]);
  EXPECT_EQ(broken.now().v[0], least.now().v[0]);
}

TEST(SimKinematics, AllControlsAtOnce) {
  SimSpec spec = plain_spec(1, 1);
  spec.agents[0].thrust = 2;
  TestWorld world(spec);
  world.put(0, 5, 5, 0.5f, 3, 2);
  world.put(1, 1, 1);
  world.control(0, 1, -1, 1);
  world.step();
  // heading 0.5 + 0.1*1*4 = 0.9; v1 = 2 + 0.1*1*1.5*2 = 2.3; v2 = 2.3 - 0.04*2.3^2 = 2.0884
  // x = 5 + 0.1*2.0884*cos 0.9 = 5.12981703; y = 5 + 0.1*2.0884*sin 0.9 = 5.16358999
  // z = 3 - 0.1*5 = 2.5; v = sqrt(2.0884^2 + 0.5*9.81*0.5) = 2.61034759
  EXPECT_NEAR(world.now().heading[0], 0.9f, kMotionTolerance);
  EXPECT_NEAR(world.now().x[0], 5.12981703f, kMotionTolerance);
  EXPECT_NEAR(world.now().y[0], 5.16358999f, kMotionTolerance);
  EXPECT_NEAR(world.now().z[0], 2.5f, kMotionTolerance);
  EXPECT_NEAR(world.now().v[0], 2.61034759f, kMotionTolerance);
  EXPECT_TRUE(world.neighbors_untouched());
}

TEST(SimKinematics, ClimbingCostsSpeedDownToTheFloor) {
  TestWorld world(plain_spec(2, 1));
  world.put(0, 3, 3, 0, 0, 3);
  world.put(1, 3, 6, 0, 0, 1.5f);
  world.put(2, 8, 8);
  world.control(0, 0, 1, 0);
  world.control(1, 0, 1, 0);
  world.step();
  // v2 = 3 - 0.04*9 = 2.64; v = sqrt(6.9696 - 4.905*0.5) = sqrt(4.5171) = 2.12534703
  EXPECT_NEAR(world.now().z[0], 0.5f, kMotionTolerance);
  EXPECT_NEAR(world.now().v[0], 2.12534703f, kMotionTolerance);
  // v2 = 1.5 - 0.04*2.25 = 1.41; 1.9881 - 2.4525 < 1.69, so the floor
  EXPECT_NEAR(world.now().v[1], 1.3f, kMotionTolerance);
  EXPECT_NEAR(world.now().x[1], 3.141f, kMotionTolerance) << "the position uses the speed before the exchange";
}

TEST(SimKinematics, AltitudeIsClampedAndOnlyTheRealChangeCosts) {
  TestWorld world(plain_spec(2, 1));
  world.put(0, 3, 3, 0, 9.8f, 3);
  world.put(1, 3, 6, 0, 0.2f, 1.3f);
  world.put(2, 8, 8);
  world.control(0, 0, 1, 0);
  world.control(1, 0, -1, 0);
  world.step();
  // 9.8 + 0.5 is cut to 10: v = sqrt(2.64^2 - 4.905*0.2) = sqrt(5.9886) = 2.44716162
  EXPECT_EQ(world.now().z[0], 10.0f);
  EXPECT_NEAR(world.now().v[0], 2.44716162f, kMotionTolerance);
  // 0.2 - 0.5 is cut to 0: v2 = 1.3 - 0.04*1.69 = 1.2324, v = sqrt(1.51880976 + 4.905*0.2) = sqrt(2.49980976)
  EXPECT_EQ(world.now().z[1], 0.0f);
  EXPECT_NEAR(world.now().v[1], 1.58107867f, kMotionTolerance);
}

TEST(SimKinematics, StartSpeedIsOneBelowTheFloorForOneStep) {
  TestWorld world(plain_spec(1, 1));
  EXPECT_EQ(world.now().v[0], 1.0f);
  const float x = world.now().x[0];
  world.control(0, 0, 0, -1);
  world.step();
  // v1 = 1 - 0.15 = 0.85; v2 = 0.85 - 0.04*0.7225 = 0.8211; team 0 starts with heading pi
  EXPECT_NEAR(world.now().x[0], x - 0.08211f, kMotionTolerance);
  EXPECT_NEAR(world.now().v[0], 1.3f, kMotionTolerance);
}

TEST(SimKinematics, ControlsAreClipped) {
  TestWorld world(plain_spec(2, 1));
  world.put(0, 3, 3, 0, 5, 2);
  world.put(1, 3, 6, 0, 5, 2);
  world.put(2, 8, 8);
  world.control(0, 7, -9, 100);
  world.control(1, 1, -1, 1);
  world.step();
  for (int field = 0; field < 4; ++field) {
    const float* values[] = {world.now().x, world.now().z, world.now().v, world.now().heading};
    EXPECT_EQ(values[field][0], values[field][1]) << "field " << field;
  }
}

TEST(SimKinematics, TheDeadStayWhereTheyAre) {
  TestWorld world(plain_spec(2, 1));
  world.put(0, 3, 3, 0.5f, 2, 3);
  world.put(1, 3, 6);
  world.put(2, 8, 8);
  world.kill(0);
  world.control(0, 1, 1, 1);
  world.steps(3);
  EXPECT_EQ(world.now().x[0], 3.0f);
  EXPECT_EQ(world.now().y[0], 3.0f);
  EXPECT_EQ(world.now().z[0], 2.0f);
  EXPECT_NEAR(world.now().heading[0], 0.5f, kMotionTolerance);
  EXPECT_NEAR(world.now().v[0], 3.0f, kMotionTolerance);
  EXPECT_FALSE(world.alive(0));
}

TEST(SimKinematics, DiscreteActionTable) {
  // idx = 9 (throttle + 1) + 3 (heading + 1) + (dive + 1)
  int idx = 0;
  for (int throttle = -1; throttle <= 1; ++throttle)
    for (int heading = -1; heading <= 1; ++heading)
      for (int dive = -1; dive <= 1; ++dive, ++idx) {
        const Controls c = discrete_controls(idx);
        EXPECT_EQ(c.heading, static_cast<float>(heading)) << "action " << idx;
        EXPECT_EQ(c.dive, static_cast<float>(dive)) << "action " << idx;
        EXPECT_EQ(c.throttle, static_cast<float>(throttle)) << "action " << idx;
      }
  EXPECT_EQ(idx, kNDiscreteActions);
}

TEST(SimKinematics, DiscreteActionsMove) {
  SimSpec spec = plain_spec(2, 1);
  spec.params.actions = ActionKind::discrete;
  TestWorld world(spec);
  world.put(0, 3, 3, 0, 5, 2);
  world.put(1, 3, 6, 0, 5, 2);
  world.put(2, 8, 8);
  world.act(0, 16);  // heading +1
  world.act(1, 22);  // throttle +1
  world.step();
  EXPECT_NEAR(world.now().heading[0], 0.4f, kMotionTolerance);
  EXPECT_NEAR(world.now().v[0], 1.84f, kMotionTolerance);  // 2 - 0.04*4
  EXPECT_EQ(world.now().heading[1], 0.0f);
  EXPECT_NEAR(world.now().v[1], 1.9651f, kMotionTolerance);  // 2.15 - 0.04*4.6225
  EXPECT_EQ(world.now().z[0], 5.0f);
}

TEST(SimKinematics, CirclingIsAStableOrbit) {
  // At the floor v 1.3 (1.2324 after drag) and 4 rad/s the radius is about 1.2324/4 = 0.31: nobody leaves a 0.7 square.
  TestWorld world(plain_spec(1, 1));
  world.put(0, 5, 5);
  world.put(1, 1, 1);
  world.control(0, 1, 0, 0);
  world.control(1, -1, 0, 0);
  for (int k = 0; k < 400; ++k) {
    world.step();
    ASSERT_NEAR(world.now().x[0], 5.0f, 0.7f) << "step " << k;
    ASSERT_NEAR(world.now().y[0], 5.0f, 0.7f) << "step " << k;
  }
}

}  // namespace
}  // namespace giga::test
