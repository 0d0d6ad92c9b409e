// What each script that looks at its observation does in a situation set up by hand, with both kinds of actions.
#include <gtest/gtest.h>

#include <vector>

#include "scripted/actions.hpp"
#include "sim/vector_observation.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

/// What one agent sees: an observation written by hand, in units of the map.
class View {
 public:
  /// On a map of 10 x 10 with weapons that reach 2 units; room for three other agents.
  explicit View(std::vector<Box> boxes = {}, bool waypoints = false) : spec_(plain_spec(2, 2)) {
    set_damage_cone(spec_.params, 2, 0.25f * kPi);
    spec_.params.waypoints = waypoints;
    spec_.maps[0].boxes = boxes;
    spec_.finish();
    row_.assign(static_cast<size_t>(VectorObservation::shape(spec_.params).size()), 0.0f);
    const size_t tail = row_.size() - 4 * boxes.size();
    for (size_t b = 0; b < boxes.size(); ++b) {
      const float corners[] = {boxes[b].x1, boxes[b].y1, boxes[b].x2, boxes[b].y2};
      for (size_t k = 0; k < 4; ++k) row_[tail + 4 * b + k] = 0.1f * corners[k];
    }
  }

  View& at(float x, float y, float heading, float z = 5, float speed = 1.3f) {
    set(0, {1, 1, 0.1f * x, 0.1f * y, 0.1f * z, heading, speed * spec_.params.inv_diagonal, 1, 1});
    return *this;
  }
  View& enemy(float dx, float dy, float dz = 4) { return other(false, dx, dy, dz); }
  View& mate(float dx, float dy, float dz = 4) { return other(true, dx, dy, dz); }
  /// Its centre relative to the agent.
  View& waypoint(float dx, float dy) {
    const size_t first = 4 * kNeighborFeatures;
    const float corners[] = {dx - 0.3f, dy - 0.3f, dx + 0.3f, dy + 0.3f};
    for (size_t k = 0; k < 4; ++k) row_[first + k] = 0.1f * corners[k];
    row_[first + 4] = 5;
    return *this;
  }

  /// Heading, dive and throttle of the discrete action.
  Controls decide(Scripted kind) {
    int32_t action = -1;
    run(kind, ActionKind::discrete, &action);
    return discrete_controls(action);
  }
  Controls decide_continuously(Scripted kind) {
    float action[3] = {7, 7, 7};
    run(kind, ActionKind::continuous, action);
    return {action[0], action[1], action[2]};
  }

 private:
  View& other(bool same_team, float dx, float dy, float dz) {
    set(++n_others_, {1, same_team ? 1.0f : 0.0f, 0.1f * dx, 0.1f * dy, 0.1f * dz, 0, 0, 1, 1});
    return *this;
  }
  void set(size_t row, const std::vector<float>& numbers) {
    std::copy(numbers.begin(), numbers.end(), row_.begin() + static_cast<int64_t>(row) * kNeighborFeatures);
  }
  void run(Scripted kind, ActionKind actions, void* action) const {
    const uint32_t step = 1;
    const int32_t age = 1;
    ScriptedActions{kind,   actions,      {&step, 7, 0, 1, 0}, &age,
                    action, spec_.params, row_.data(),         static_cast<int>(row_.size())}(0);
  }

  SimSpec spec_;
  std::vector<float> row_;
  size_t n_others_ = 0;
};

void expect_controls(Controls got, float heading, float dive, float throttle) {
  EXPECT_EQ(got.heading, heading);
  EXPECT_EQ(got.dive, dive);
  EXPECT_EQ(got.throttle, throttle);
}

TEST(ScriptedTactics, PursuerTurnsToTheEnemyAndTradesHeightForSpeed) {
  // At 3 units, beyond 2 x sqrt(0.8) = 1.79: dives at full throttle; nearer: climbs and slows down.
  expect_controls(View().at(5, 5, 0).enemy(3, 0).decide(Scripted::pursuer), 0, -1, 1);
  expect_controls(View().at(5, 5, 0).enemy(0, 3).decide(Scripted::pursuer), 1, -1, 1);
  expect_controls(View().at(5, 5, 0).enemy(0, -3).decide(Scripted::pursuer), -1, -1, 1);
  expect_controls(View().at(5, 5, 0).enemy(-3, 0.1f).decide(Scripted::pursuer), 1, -1, 1);
  expect_controls(View().at(5, 5, 0).enemy(1.7f, 0).decide(Scripted::pursuer), 0, 1, -1);
  // The nearest enemy, not the nearest agent.
  expect_controls(View().at(5, 5, 0).mate(0, -1.7f).enemy(0, 2.5f).enemy(0, -3).decide(Scripted::pursuer), 1, -1, 1);
}

TEST(ScriptedTactics, TurnsByTheSineOfTheAngle) {
  // An enemy at 3 to 0.3: sine 0.3 / sqrt(9.09) = 0.0995, of 0.4 at full control: 0.249, less than half: straight on.
  EXPECT_NEAR(View().at(5, 5, 0).enemy(3, 0.3f).decide_continuously(Scripted::pursuer).heading, 0.24876f, 1e-4f);
  EXPECT_EQ(View().at(5, 5, 0).enemy(3, 0.3f).decide(Scripted::pursuer).heading, 0);
  // 3 to 0.7: 0.2272 / 0.4 = 0.568, more than half.
  EXPECT_NEAR(View().at(5, 5, 0).enemy(3, 0.7f).decide_continuously(Scripted::pursuer).heading, 0.56807f, 1e-4f);
  EXPECT_EQ(View().at(5, 5, 0).enemy(3, 0.7f).decide(Scripted::pursuer).heading, 1);
}

TEST(ScriptedTactics, PursuerWithoutAnEnemyFliesRoundTheMapAndClimbs) {
  // Right of the middle at 0.5 of the half map, a little inside the ring at 0.55; flying up, which is along it.
  expect_controls(View().at(7.5f, 5, kPi / 2).decide(Scripted::pursuer), 0, 1, 1);
  expect_controls(View().at(7.5f, 5, -kPi / 2).decide(Scripted::pursuer), 0, 1, 1);
  // Flying outwards at 0.7: turns back.
  EXPECT_NE(View().at(8.5f, 5.2f, 0).decide(Scripted::pursuer).heading, 0);
}

TEST(ScriptedTactics, PatrollerDoesNotChase) {
  expect_controls(View().at(7.5f, 5, kPi / 2).decide(Scripted::patroller), 0, 0, 1);
  expect_controls(View().at(7.5f, 5, kPi / 2).enemy(-2, 0).decide(Scripted::patroller), 0, 0, 1);
}

TEST(ScriptedTactics, EvaderFliesAwayFromAllEnemies) {
  expect_controls(View().at(5, 5, 0).enemy(-2, 0).decide(Scripted::evader), 0, -1, 1);
  // Enemies below left and straight below: away is up and a little to the right.
  expect_controls(View().at(5, 5, kPi / 2).enemy(0, -2).enemy(-0.1f, -2.2f).decide(Scripted::evader), 0, -1, 1);
  EXPECT_EQ(View().at(5, 5, 0).enemy(0, -2).decide(Scripted::evader).heading, 1);
  EXPECT_EQ(View().at(5, 5, 0).enemy(0, 2).decide(Scripted::evader).heading, -1);
  // A mate is no enemy; without one it circles to the left, slowly, and climbs.
  expect_controls(View().at(5, 5, 0).mate(0, -2).decide(Scripted::evader), 1, 1, -1);
}

TEST(ScriptedTactics, WaypointRunnerFliesToTheWaypoint) {
  expect_controls(View({}, true).at(5, 5, 0).waypoint(3, 0).decide(Scripted::waypoint_runner), 0, 0, 1);
  expect_controls(View({}, true).at(5, 5, 0).waypoint(0, -3).decide(Scripted::waypoint_runner), -1, 0, 1);
  // The circle of its hardest turn has the radius 0.327 around (0, 0.327): a waypoint at (0.1, 0.3) lies inside and
  // would be circled, so it flies on, slowly.
  expect_controls(View({}, true).at(5, 5, 0).waypoint(0.1f, 0.3f).decide(Scripted::waypoint_runner), 0, 0, -1);
  // Without a waypoint, or in a scenario without any, round the map.
  for (const bool waypoints : {false, true})
    expect_controls(View({}, waypoints).at(7.5f, 5, kPi / 2).decide(Scripted::waypoint_runner), 0, 0, 1);
}

TEST(ScriptedTactics, HiderFliesToTheFarCorner) {
  // The enemy is at (4, 7), the agent at (6, 7). Distance to itself minus that to the enemy: (9, 9) sqrt(13) - sqrt(29)
  // = -1.78; (9, 1) sqrt(45) - sqrt(61) = -1.10; those at the left more than 0.
  const Controls c = View().at(6, 7, 0.588f).enemy(-2, 0).decide(Scripted::hider);  // atan(2 / 3) = 0.588
  expect_controls(c, 0, -1, 1);
  // Alone: to the nearest corner, and there it circles slowly.
  expect_controls(View().at(7, 7, kPi / 4).decide(Scripted::hider), 0, 0, 1);
  EXPECT_EQ(View().at(8.8f, 8.6f, kPi).decide(Scripted::hider).throttle, -1);
}

TEST(ScriptedTactics, HiderFliesBehindAnObstacle) {
  // A box of 1 x 1 around (5, 6) above the agent at (5, 4.2) that faces it; the enemy is below, so the far side is
  // above the box, at (5, 6 + 0.5 + 1). The box is in the way: the first of the directions left and right of it.
  const Controls c = View({{4.5f, 5.5f, 5.5f, 6.5f, 0, 10}}).at(5, 4.2f, kPi / 2).enemy(0, -2).decide(Scripted::hider);
  EXPECT_NE(c.heading, 0);
  EXPECT_EQ(c.throttle, 1);
  // Behind the box already, at (5.6, 7.5), with the enemy at (5, 3): straight to (5, 7.5), which is 0.6 away and 4.5
  // from the enemy; the corner (9, 9) is at 3.72 and 7.21, which is worth less.
  expect_controls(
      View({{4.5f, 5.5f, 5.5f, 6.5f, 0, 10}}).at(5.6f, 7.5f, kPi).enemy(-0.6f, -4.5f).decide(Scripted::hider), 0, -1,
      1);
}

TEST(ScriptedTactics, TurnsAwayFromWallsAndObstacles) {
  // Heading for the wall at x = 10 with an enemy straight ahead. The circle of the hardest turn has the radius 0.327
  // and a margin of 0.25: after one more step of 0.13 straight on it needs 9.23 + 0.13 + 0.58 = 9.94 < 10; from 9.35
  // not.
  EXPECT_EQ(View().at(9.23f, 5, 0).enemy(1.7f, 0).decide(Scripted::pursuer).heading, 0);
  EXPECT_NE(View().at(9.35f, 5, 0).enemy(1.7f, 0).decide(Scripted::pursuer).heading, 0);
  // Likewise an obstacle at x = 6 with walls far away.
  const std::vector<Box> box = {{6, 3, 7, 7, 0, 10}};
  EXPECT_EQ(View(box).at(5.23f, 5, 0).enemy(1.7f, 0).decide(Scripted::pursuer).heading, 0);
  EXPECT_NE(View(box).at(5.35f, 5, 0).enemy(1.7f, 0).decide(Scripted::pursuer).heading, 0);
}

TEST(ScriptedTactics, KeepsApartInAltitude) {
  // An agent at 1 unit in the plane: whoever is higher climbs; 1.3 in altitude are enough.
  EXPECT_EQ(View().at(7.5f, 5, kPi / 2).mate(1, 0, 0.5f).decide(Scripted::patroller).dive, -1);
  EXPECT_EQ(View().at(7.5f, 5, kPi / 2).mate(1, 0, -0.5f).decide(Scripted::patroller).dive, 1);
  EXPECT_EQ(View().at(7.5f, 5, kPi / 2).mate(1, 0, 1.3f).decide(Scripted::patroller).dive, 0);
  EXPECT_EQ(View().at(7.5f, 5, kPi / 2).mate(1.7f, 0, 0).decide(Scripted::patroller).dive, 0);
  // At equal altitude the two decide differently.
  EXPECT_EQ(View().at(7.5f, 5, kPi / 2).mate(1, 0, 0).decide(Scripted::patroller).dive, -1);
  EXPECT_EQ(View().at(8.5f, 5, kPi / 2).mate(-1, 0, 0).decide(Scripted::patroller).dive, 1);
}

TEST(ScriptedTactics, DiscreteActionIsTheInverseOfItsControls) {
  for (int action = 0; action < kNDiscreteActions; ++action)
    EXPECT_EQ(discrete_action(discrete_controls(action)), action);
  EXPECT_EQ(discrete_action({0.6f, -0.4f, -0.51f}), 9 * 0 + 3 * 2 + 1);
}

}  // namespace
}  // namespace giga::test
