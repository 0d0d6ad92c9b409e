// Deaths by movement: bounds, agents, obstacles, and their order (rules 4.3).
#include <gtest/gtest.h>

#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

/// One step from these places; everybody moves 0.1*(1.3 - 0.04*1.69) = 0.12324 along the heading, here 0 (x) for all.
constexpr float kStride = 0.12324f;

SimSpec with_box(SimSpec spec, Box box) {
  spec.maps[0].boxes = {box};
  return spec;
}

TEST(SimCollision, BoundsAreInside) {
  // Heading pi/2 or so is not exact, so the limit itself is reached by the dead-straight x direction: the agent that
  // starts at 10 - stride ends within rounding of 10; the exact limit is tested with an agent that does not move.
  TestWorld world(plain_spec(4, 1));
  world.put(0, 10 - kStride - 0.001f, 2);
  world.put(1, 10 - kStride + 0.001f, 4);
  world.put(2, kStride + 0.001f, 6, kPi);
  world.put(3, kStride - 0.001f, 8, kPi);
  world.put(4, 5, 5);
  world.step();
  EXPECT_TRUE(world.alive(0)) << world.now().x[0];
  EXPECT_FALSE(world.alive(1)) << world.now().x[1];
  EXPECT_TRUE(world.alive(2)) << world.now().x[2];
  EXPECT_FALSE(world.alive(3)) << world.now().x[3];
  EXPECT_TRUE(world.alive(4));
  EXPECT_EQ(world.now().health[1], 0.0f);
}

TEST(SimCollision, TheLimitItselfIsInside) {
  TestWorld world(plain_spec(1, 1));
  WorldView& w = world.now();
  const struct {
    float x, y;
    bool inside;
  } cases[] = {{0, 5, true},       {10, 5, true},         {5, 0, true},          {5, 10, true}, {-1e-6f, 5, false},
               {5, -1e-6f, false}, {10.00001f, 5, false}, {5, 10.00001f, false}, {10, 10, true}};
  for (const auto& c : cases) {
    w.x[0] = c.x;
    w.y[0] = c.y;
    w.alive[0] = 1;
    w.flags[0] = 0;
    check_bounds(world.params(), w, flight_of(w, 0), 0);
    EXPECT_EQ(world.alive(0), c.inside) << c.x << ", " << c.y;
    EXPECT_EQ((w.flags[0] & kOutOfBounds) == 0, c.inside) << c.x << ", " << c.y;
  }
}

TEST(SimCollision, UpperLimitInY) {
  SimSpec spec = plain_spec(2, 1);
  spec.params.limit_y = 12;
  TestWorld world(spec);
  world.put(0, 5, 11.8f, kPi / 2);  // y 11.92
  world.put(1, 3, 11.9f, kPi / 2);  // y 12.02
  world.put(2, 1, 1);
  world.step();
  EXPECT_TRUE(world.alive(0));
  EXPECT_FALSE(world.alive(1));
}

TEST(SimCollision, AgentsOfAnyTeamDieTogether) {
  // All move alike, so distances stay. Range 0.4: 0.39 collides, 0.41 does not; three in a row all die.
  TestWorld world(plain_spec(4, 4));
  world.put(0, 2, 2);
  world.put(4, 2, 2.39f);  // opponents, too close
  world.put(1, 4, 2);
  world.put(5, 4, 2.41f);  // far enough
  world.put(2, 6, 2);
  world.put(3, 6, 2.3f);  // team mates
  world.put(6, 6, 2.6f);  // touches 3 only
  world.put(7, 2, 7);
  world.step();
  const bool expected[] = {false, true, false, false, false, true, false, true};
  for (int i = 0; i < 8; ++i) EXPECT_EQ(world.alive(i), expected[i]) << "agent " << i;
}

TEST(SimCollision, AltitudeSeparates) {
  TestWorld world(plain_spec(2, 2));
  world.put(0, 2, 2, 0, 1);
  world.put(2, 2, 2, 0, 1.49f);
  world.put(1, 5, 5, 0, 1);
  world.put(3, 5, 5, 0, 1.51f);
  world.step();
  EXPECT_FALSE(world.alive(0));
  EXPECT_FALSE(world.alive(2));
  EXPECT_TRUE(world.alive(1));
  EXPECT_TRUE(world.alive(3));
}

TEST(SimCollision, RangeZeroSwitchesCollisionsOff) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.collision_range2 = 0;
  TestWorld world(spec);
  world.put(0, 5, 5);
  world.put(1, 5, 5);
  world.step();
  EXPECT_TRUE(world.alive(0));
  EXPECT_TRUE(world.alive(1));
}

TEST(SimCollision, TheDeadDoNotCollide) {
  TestWorld world(plain_spec(2, 1));
  world.put(0, 5, 5);
  world.put(1, 5 + kStride, 5);
  world.put(2, 1, 1);
  world.kill(1);
  world.step();  // agent 0 flies onto the wreck
  EXPECT_TRUE(world.alive(0));
}

TEST(SimCollision, InsideABoxStrictly) {
  TestWorld world(with_box(plain_spec(4, 1), {4, 4, 6, 6, 0, 10}));
  world.put(0, 4 - kStride + 0.01f, 5);     // ends inside
  world.put(1, 4 - kStride - 0.01f, 4.5f);  // ends in front
  world.put(2, 5, 5.5f, 0, 9);              // infinite height without obstacle_heights
  world.put(3, 5, 3.9f);                    // beside
  world.put(4, 1, 1);
  world.step();
  EXPECT_FALSE(world.alive(0));
  EXPECT_TRUE(world.alive(1));
  EXPECT_FALSE(world.alive(2));
  EXPECT_TRUE(world.alive(3));
  const WorldView& w = world.now();
  EXPECT_FALSE(inside_obstacle(world.params(), w, 4, 5, 0, 0)) << "the edge is outside";
  EXPECT_FALSE(inside_obstacle(world.params(), w, 5, 6, 0, 0)) << "the edge is outside";
  EXPECT_TRUE(inside_obstacle(world.params(), w, 4.0001f, 5.9999f, 0, 0));
}

TEST(SimCollision, PaddingNeverHits) {
  SimSpec spec = with_box(plain_spec(1, 1), {4, 4, 6, 6, 0, 10});
  spec.maps.push_back(plain_spec(1, 1).maps[0]);  // no box: one of zeros
  TestWorld world(spec);
  world.draws.map_index = 1;
  world.start();
  ASSERT_EQ(*world.now().map, 1);
  world.put(0, 5, 5);
  world.put(1, 0.001f, 0.001f);
  world.step();
  EXPECT_TRUE(world.alive(0)) << "the box belongs to the other map";
  EXPECT_TRUE(world.alive(1));
  EXPECT_FALSE(inside_obstacle(world.params(), world.now(), 0, 0, 0, 0));
}

TEST(SimCollision, OrderBoundsThenAgentsThenObstacles) {
  TestWorld world(with_box(plain_spec(2, 2), {4, 4, 6, 6, 0, 10}));
  world.put(0, 9.95f, 2);                // leaves the arena, so it no longer collides
  world.put(2, 9.8f, 2, 0.0f, 0, 1.0f);  // 9.8 + 0.1*(1 - 0.04) = 9.896, 0.2 away from agent 0: survives
  world.put(1, 5, 5.95f);                // inside the box, still kills its neighbour
  world.put(3, 5, 6.2f);
  world.step();
  EXPECT_FALSE(world.alive(0));
  EXPECT_TRUE(world.alive(2));
  EXPECT_FALSE(world.alive(1));
  EXPECT_FALSE(world.alive(3));
}

TEST(SimCollision, ObstacleHeightsOption) {
  SimSpec spec = with_box(plain_spec(3, 1), {4, 4, 6, 6, 2, 4});
  spec.params.obstacle_heights = true;
  TestWorld world(spec);
  world.put(0, 5, 4.5f, 0, 1.9f);  // below
  world.put(1, 5, 5.0f, 0, 3);     // in
  world.put(2, 5, 5.5f, 0, 4.1f);  // above
  world.put(3, 1, 1);
  world.step();
  EXPECT_TRUE(world.alive(0));
  EXPECT_FALSE(world.alive(1));
  EXPECT_TRUE(world.alive(2));
  EXPECT_TRUE(inside_obstacle(world.params(), world.now(), 5, 5, 2, 0)) << "z1 itself is solid";
  EXPECT_TRUE(inside_obstacle(world.params(), world.now(), 5, 5, 4, 0)) << "z2 itself is solid";
}

}  // namespace
}  // namespace giga::test
