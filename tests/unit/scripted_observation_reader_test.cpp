// ObservationReader: every number that a script asks for, against a world of the simulator that is set up by hand.
#include "scripted/observation_reader.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

/// The observation of agent e after a step.
std::vector<float> row_of(const TestWorld& world, int e) {
  std::vector<float> row;
  for (int column = 0; column < world.columns(); ++column) row.push_back(world.obs(e, column));
  return row;
}

/// Two a side on a map of 20 x 10 where everybody sees everybody; sides that differ tell x from y.
SimSpec wide_spec() {
  SimSpec spec = plain_spec(2, 2);
  spec.params.limit_x = 20;
  set_cone(spec.params, 30, kPi);
  spec.params.cone_is_full = true;
  set_damage_cone(spec.params, 0, 0.1f);
  return spec;
}

void place(TestWorld& world) {
  world.put(0, 4, 5, 0.5f, 1, 2);
  world.put(1, 16, 2, -1, 3);
  world.put(2, 5, 7, 2, 6, 1.5f);
  world.put(3, 12, 3, 3);
}

TEST(ScriptedObservationReader, OwnStateAndOthersNearestFirst) {
  TestWorld world(wide_spec());
  place(world);
  world.step();
  const std::vector<float> row = row_of(world, 0);
  const ObservationReader reader(world.params(), row.data());
  const WorldView& w = world.now();
  const OwnState own = reader.own();
  EXPECT_NEAR(own.x, w.x[0], 1e-5f);
  EXPECT_NEAR(own.y, w.y[0], 1e-5f);
  EXPECT_NEAR(own.z, w.z[0], 1e-5f);
  EXPECT_NEAR(own.speed, w.v[0], 1e-5f);
  EXPECT_NEAR(own.heading, w.heading[0], 1e-5f);
  EXPECT_NEAR(own.health, w.health[0], 1e-5f);

  // From (4, 5): 2 is at distance sqrt(1 + 4), 3 at sqrt(64 + 4), 1 at sqrt(144 + 9).
  ASSERT_EQ(reader.n_others(), 3);
  const int order[] = {2, 3, 1};
  for (int k = 0; k < 3; ++k) {
    const SeenAgent a = reader.other(k);
    const int i = order[k];
    EXPECT_TRUE(a.seen);
    EXPECT_EQ(a.same_team, i == 1);
    EXPECT_NEAR(a.dx, w.x[i] - w.x[0], 1e-5f) << "agent " << i;
    EXPECT_NEAR(a.dy, w.y[i] - w.y[0], 1e-5f) << "agent " << i;
    EXPECT_NEAR(a.dz, w.z[i] - w.z[0], 1e-5f) << "agent " << i;
    EXPECT_NEAR(a.heading, w.heading[i], 1e-5f) << "agent " << i;
    EXPECT_NEAR(a.speed, w.v[i], 1e-5f) << "agent " << i;
    EXPECT_NEAR(a.health, w.health[i], 1e-5f) << "agent " << i;
  }
  EXPECT_NEAR(reader.nearest_enemy().dx, w.x[2] - w.x[0], 1e-5f);
  world.kill(2);
  world.step();
  const std::vector<float> later = row_of(world, 0);
  const ObservationReader alone(world.params(), later.data());
  EXPECT_NEAR(alone.nearest_enemy().dx, w.x[3] - w.x[0], 1e-5f);
  EXPECT_FALSE(alone.other(2).seen) << "the dead leave their row";
  EXPECT_FALSE(alone.waypoint().active);
}

TEST(ScriptedObservationReader, NobodyInSight) {
  SimSpec spec = wide_spec();
  set_cone(spec.params, 1, kPi);
  spec.params.very_close_depth2 = 0;
  TestWorld world(spec);
  place(world);
  world.step();
  const std::vector<float> row = row_of(world, 0);
  const ObservationReader reader(world.params(), row.data());
  EXPECT_TRUE(reader.other(0).seen && reader.other(0).same_team);
  EXPECT_FALSE(reader.nearest_enemy().seen);
}

TEST(ScriptedObservationReader, WaypointAndBoxesWithAndWithoutHeights) {
  for (const bool heights : {false, true}) {
    SimSpec spec = wide_spec();
    spec.params.waypoints = true;
    spec.params.obstacle_heights = heights;
    MapSpec other = spec.maps[0];
    spec.maps[0].boxes = {{8, 1, 9, 2, 0, 5}};
    other.boxes = {{8, 1, 9, 2, 0, 5}, {2, 8, 3, 9, 0, 5}};
    spec.maps.push_back(other);  // so that map 0 has a box that does not exist
    TestWorld world(spec);
    place(world);
    const float corners[] = {10, 6, 11, 8};
    for (int k = 0; k < 4; ++k) world.now().waypoint[k] = corners[k];
    *world.now().waypoint_time = 4;
    world.step();
    const std::vector<float> row = row_of(world, 0);
    const ObservationReader reader(world.params(), row.data());
    const SeenWaypoint waypoint = reader.waypoint();
    EXPECT_TRUE(waypoint.active);
    EXPECT_NEAR(waypoint.dx, 10.5f - world.now().x[0], 1e-5f);
    EXPECT_NEAR(waypoint.dy, 7.0f - world.now().y[0], 1e-5f);
    EXPECT_NEAR(waypoint.seconds, 3.9f, 1e-5f);
    ASSERT_EQ(reader.n_boxes(), 2);
    const SeenBox box = reader.box(0);
    EXPECT_TRUE(box.exists());
    EXPECT_NEAR(box.x1, 8, 1e-5f);
    EXPECT_NEAR(box.y1, 1, 1e-5f);
    EXPECT_NEAR(box.x2, 9, 1e-5f);
    EXPECT_NEAR(box.y2, 2, 1e-5f);
    EXPECT_FALSE(reader.box(1).exists());
  }
}

}  // namespace
}  // namespace giga::test
