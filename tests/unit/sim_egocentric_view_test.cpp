// The egocentric view: walls in twelve directions, the nearest opponents and mates along the own heading, the waypoint.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>

#include "sim/observations.hpp"
#include "sim/row_layout.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

constexpr float kViewTolerance = 1e-5f;

SimSpec view_spec(int n_team_0, int n_team_1) {
  SimSpec spec = open_spec(n_team_0, n_team_1);
  spec.params.egocentric_view = true;
  spec.finish();
  return spec;
}

/// Five against five, on each side one agent of each of five kinds, as in special_5_vs_5.
constexpr int kSprites[] = {7, 3, 5, 6, 1};
SimSpec mixed_spec() {
  SimSpec spec = view_spec(5, 5);
  for (size_t i = 0; i < spec.agents.size(); ++i) spec.agents[i].sprite = kSprites[i % 5];
  spec.finish();
  return spec;
}

/// Number `column` of agent e's egocentric view after a step.
float view(const TestWorld& world, int e, int column) { return world.egocentric(e, column); }
float wall(const TestWorld& world, int e, int direction) {
  return view(world, e, view_self_columns(world.params()) + direction);
}
/// Feature of item `item` of the agents (opponents first).
float nearest(const TestWorld& world, int e, int item, int feature) {
  return view(world, e, view_agents_at(world.params()) + item * view_agent_columns(world.params()) + feature);
}

/// Where the view begins in a row, and how many numbers it has.
RowLayout::Columns begin_and_size(const SimSpec& spec) {
  return {observation_rows(spec).columns(Observation::egocentric).first, EgocentricView::shape(spec.params).size()};
}

TEST(SimEgocentricView, SizesFollowTheTeams) {
  // 7 + 12 + min(3, 5) x 8 + min(2, 4) x 8 = 59 behind 10 x 9 numbers, from a multiple of 8 on.
  EXPECT_EQ(begin_and_size(view_spec(5, 5)), (RowLayout::Columns{96, 59}));
  // One against one: an opponent, no mate: 7 + 12 + 8 = 27 behind 2 x 9.
  EXPECT_EQ(begin_and_size(view_spec(1, 1)), (RowLayout::Columns{24, 27}));
  // The larger team decides for both: 1 against 3 has 3 opponents and 2 mates.
  EXPECT_EQ(begin_and_size(view_spec(1, 3)), (RowLayout::Columns{40, 59}));
  SimSpec off = view_spec(5, 5);
  off.params.egocentric_view = false;
  EXPECT_FALSE(off.observations().has(Observation::egocentric));
}

TEST(SimEgocentricView, KindsAreToldWhereATeamMixesThem) {
  // 3 bits more of the agent itself and of each of 3 + 2 others: 59 + 18.
  EXPECT_EQ(begin_and_size(mixed_spec()), (RowLayout::Columns{96, 77}));
  // Teams of one kind each, be they different ones: the team tells the kind, and nothing is added.
  SimSpec spec = view_spec(5, 5);
  for (size_t i = 5; i < 10; ++i) spec.agents[i].sprite = 6;
  spec.finish();
  EXPECT_EQ(begin_and_size(spec).count, 59);
  // One odd agent in either team is enough.
  for (const size_t odd : {4, 5}) {
    SimSpec mixed = spec;
    mixed.agents[odd].sprite = 3;
    mixed.finish();
    EXPECT_EQ(begin_and_size(mixed).count, 77) << odd;
  }
}

/// Agent 0 flies left in the middle; by distance from it stand opponents 8, 6, 9, 5, 7 and mates 2, 4, 1, 3.
void put_ten(TestWorld& world) {
  world.put(0, 5, 5, kPi);
  world.put(8, 5, 4);
  world.put(6, 5, 3);
  world.put(9, 5, 2);
  world.put(5, 9, 1);
  world.put(7, 9, 9);
  world.put(2, 5, 6);
  world.put(4, 5, 7);
  world.put(1, 1, 8);
  world.put(3, 1, 9);
}

TEST(SimEgocentricView, TellsTheKindOfEachAgent) {
  TestWorld world(mixed_spec());
  put_ten(world);
  world.step();
  const auto expect_kind = [](int sprite, auto&& number) {
    for (int bit = 0; bit < kViewKind; ++bit)
      EXPECT_EQ(number(bit), sprite / (1 << bit) % 2) << "sprite " << sprite << ", bit " << bit;
  };
  expect_kind(7, [&](int bit) { return view(world, 0, kViewSelf + bit); });
  expect_kind(6, [&](int bit) { return view(world, 8, kViewSelf + bit); });
  const int sprites[] = {6, 3, 1, 5, 1};  // of opponents 8, 6, 9 and mates 2, 4
  for (int item = 0; item < 5; ++item)
    expect_kind(sprites[item], [&](int bit) { return nearest(world, 0, item, kViewAgent + bit); });
}

TEST(SimEgocentricView, KindsLeaveTheOtherNumbersAlone) {
  SimSpec spec = mixed_spec();
  TestWorld world(spec);
  for (AgentSpec& agent : spec.agents) agent.sprite = 1;
  spec.finish();
  TestWorld alike(spec);
  for (TestWorld* w : {&world, &alike}) {
    put_ten(*w);
    w->step();
  }
  for (int e = 0; e < 10; ++e) {
    for (int k = 0; k < kViewSelf; ++k) EXPECT_EQ(view(world, e, k), view(alike, e, k)) << e << ", " << k;
    for (int k = 0; k < kViewRays; ++k) EXPECT_EQ(wall(world, e, k), wall(alike, e, k)) << e << ", " << k;
    for (int item = 0; item < 5; ++item)
      for (int k = 0; k < kViewAgent; ++k)
        EXPECT_EQ(nearest(world, e, item, k), nearest(alike, e, item, k)) << e << ", " << item << ", " << k;
  }
}

TEST(SimEgocentricView, TheKindOfWhoIsNotSeenIsZero) {
  SimSpec spec = mixed_spec();
  set_cone(spec.params, 0.1f, 0.1f);
  spec.params.very_close_depth2 = 0;
  spec.params.stochastic_communication = true;
  spec.params.communication_range = 0.01f;
  spec.finish();
  TestWorld world(spec);
  for (int i = 0; i < 10; ++i) world.put(i, i < 5 ? 2.0f : 8.0f, 1.0f + 1.5f * static_cast<float>(i % 5));
  world.kill(1);
  world.step();
  for (int item = 0; item < 5; ++item)
    for (int k = 0; k < view_agent_columns(spec.params); ++k) EXPECT_EQ(nearest(world, 0, item, k), 0) << item << k;
  for (int bit = 0; bit < kViewKind; ++bit) EXPECT_EQ(view(world, 0, kViewSelf + bit), 1) << bit;  // its own: 7
  for (int k = 0; k < view_size(spec.params); ++k) EXPECT_EQ(view(world, 1, k), 0) << k;           // of the dead
}

/// Plays with all observations and with some of them side by side; f(all, some) after each step.
void play_beside_whole(Outputs some, const std::function<void(const Snapshot& all, const Snapshot& some)>& f) {
  SimSpec spec = random_spec(7, 3, 2);
  spec.params.egocentric_view = true;
  spec.finish();
  SimOptions options;
  options.n_worlds = 16;
  SimRunner a(make_cpu_simulator(spec, options), Outputs::observations), b(make_cpu_simulator(spec, options), some);
  a.start();
  b.start();
  for (uint64_t step = 0; step < 30; ++step) {
    a.step(step);
    b.step(step);
    f(a.snapshot(), b.snapshot());
  }
}

TEST(SimEgocentricView, AloneItIsTheSame) {
  play_beside_whole(Outputs::egocentric, [](const Snapshot& a, const Snapshot& b) {
    for (const char* team : {"egocentric of team 0", "egocentric of team 1"})
      for (size_t k = 0; k < a.field(team).bytes.size() / 4; ++k)
        ASSERT_EQ(a.float_at(team, k), b.float_at(team, k)) << team << ", " << k;
  });
}

// World w of team t has the observations 5 w + 3 t read, of which bit 0 is the vector and bit 1 the view.
TEST(SimEgocentricView, RowsThatNobodyReadsAreNotTouched) {
  int read = 0, left = 0;
  play_beside_whole(Outputs::by_world, [&](const Snapshot& a, const Snapshot& b) {
    for (size_t t = 0; t < kNTeams; ++t)
      for (size_t kind = 0; kind < 2; ++kind) {
        const std::string name = cat(kind == 0 ? "vector" : "egocentric", " of team ", t);
        const SnapshotField &all = a.field(name), &part = b.field(name);
        const size_t bytes = all.per_world * all.element;
        for (size_t w = 0; w < a.n_worlds; ++w) {
          const bool is_read = (5 * w + 3 * t) >> kind & 1;
          (is_read ? read : left) += 1;
          for (size_t k = w * bytes; k < (w + 1) * bytes; ++k)
            ASSERT_EQ(part.bytes[k], is_read ? all.bytes[k] : SimRunner::kPoison) << name << ", world " << w;
        }
      }
  });
  EXPECT_GT(read, 0);
  EXPECT_EQ(read, left);  // 5 w takes all values of two bits alike in 16 worlds
}

TEST(SimEgocentricView, TellsTheAgentItself) {
  TestWorld world(view_spec(1, 1));
  world.put(0, 2.5f, 7.5f, kPi / 6, 4, 2);
  world.put(1, 9, 9);
  world.now().health[0] = 0.5f;
  world.step();
  const WorldView& w = world.now();
  // 2 x / 10 - 1 and so on of the state after the step; the heading of pi / 6 stays.
  const float expected[kViewSelf] = {w.x[0] / 5 - 1, w.y[0] / 5 - 1, 0.8660254f, 0.5f,
                                     w.z[0] / 10,    w.v[0] / 5,     w.health[0]};
  for (int k = 0; k < kViewSelf; ++k) EXPECT_NEAR(view(world, 0, k), expected[k], kViewTolerance) << k;
  EXPECT_NEAR(view(world, 0, 4), 0.4f, kViewTolerance);
}

TEST(SimEgocentricView, NearnessOfTheBorder) {
  TestWorld world(view_spec(1, 1));
  world.put(0, 6, 3, kPi / 2);  // up
  world.put(1, 1, 1);
  world.step();
  const float x = world.now().x[0], y = world.now().y[0];
  EXPECT_NEAR(wall(world, 0, 0), 1 / (1 + 10 - y), kViewTolerance);  // ahead: the upper border
  EXPECT_NEAR(wall(world, 0, 3), 1 / (1 + x), kViewTolerance);       // a quarter turn to the left: x = 0
  EXPECT_NEAR(wall(world, 0, 6), 1 / (1 + y), kViewTolerance);       // behind: y = 0
  EXPECT_NEAR(wall(world, 0, 9), 1 / (1 + 10 - x), kViewTolerance);  // right: x = 10
  // 30 degrees to the right of up: (1/2, sqrt(3)/2) meets x = 10 after (10 - x) / (1/2), y = 10 after less or more.
  const float way = std::min((10 - x) / 0.5f, (10 - y) / 0.8660254f);
  EXPECT_NEAR(wall(world, 0, 11), 1 / (1 + way), kViewTolerance);
}

TEST(SimEgocentricView, NearnessOfObstacles) {
  SimSpec spec = view_spec(1, 1);
  spec.maps[0].boxes = {{7, 4, 8, 6, 0, 1}, {2, 4.5f, 3, 5.5f, 2, 3}};
  spec.finish();
  TestWorld world(spec);
  world.put(0, 5, 5);  // flies right, between the two
  world.put(1, 1, 1);
  world.step();
  const float x = world.now().x[0];
  EXPECT_NEAR(wall(world, 0, 0), 1 / (1 + 7 - x), kViewTolerance);
  EXPECT_NEAR(wall(world, 0, 6), 1 / (1 + x - 3), kViewTolerance);
  EXPECT_NEAR(wall(world, 0, 3), 1 / (1 + 5.0f), kViewTolerance);  // up: nothing but the border
  // 30 degrees up: (7 - x) tan 30 = 1.08 > 1 at x = 5.13, so it passes above the first box, to x = 10.
  EXPECT_NEAR(wall(world, 0, 1), 1 / (1 + (10 - x) / 0.8660254f), kViewTolerance);

  spec.params.obstacle_heights = true;
  spec.finish();
  TestWorld tall(spec);
  tall.put(0, 5, 5, 0, 2.5f);  // above the first box, level with the second
  tall.put(1, 1, 1);
  tall.step();
  EXPECT_NEAR(wall(tall, 0, 0), 1 / (1 + 10 - tall.now().x[0]), kViewTolerance);
  EXPECT_NEAR(wall(tall, 0, 6), 1 / (1 + tall.now().x[0] - 3), kViewTolerance);
}

TEST(SimEgocentricView, OpponentsAndMatesByDistance) {
  TestWorld world(view_spec(3, 3));
  world.put(0, 5, 5, kPi);  // flies left
  world.put(1, 5, 8, 0);
  world.put(2, 5, 6, 0);
  world.put(3, 5, 2, 0, 5);
  world.put(4, 1, 5, kPi / 2);
  world.put(5, 9, 9, 0);
  world.step();
  const WorldView& w = world.now();
  const auto distance = [&](int a) { return std::hypot(w.x[a] - w.x[0], w.y[a] - w.y[0]); };
  // Opponents 3 (3 below, so to the left of who flies left), 4 (ahead), 5; mates 2, 1.
  const int order[] = {3, 4, 5, 2, 1};
  for (int k = 0; k < 5; ++k)
    EXPECT_NEAR(nearest(world, 0, k, kViewNearness), 1 / (1 + distance(order[k])), kViewTolerance) << k;
  EXPECT_NEAR(nearest(world, 0, 0, kViewAhead), -(w.x[3] - w.x[0]) / distance(3), kViewTolerance);
  EXPECT_NEAR(nearest(world, 0, 0, kViewLeft), -(w.y[3] - w.y[0]) / distance(3), kViewTolerance);
  EXPECT_GT(nearest(world, 0, 0, kViewLeft), 0.9f);
  EXPECT_NEAR(nearest(world, 0, 0, kViewCourseAhead), -1, kViewTolerance);  // it flies the other way
  EXPECT_NEAR(nearest(world, 0, 0, kViewClimb), 0.5f, kViewTolerance);
  EXPECT_NEAR(nearest(world, 0, 1, kViewAhead), 1, 1e-2f);
  EXPECT_NEAR(nearest(world, 0, 1, kViewCourseLeft), -1, kViewTolerance);  // up, seen from who flies left: to the right
  EXPECT_NEAR(nearest(world, 0, 1, kViewCourseAhead), 0, kViewTolerance);
  EXPECT_NEAR(nearest(world, 0, 1, kViewOvertakes), (w.v[4] - w.v[0]) / 5, kViewTolerance);
  EXPECT_NEAR(nearest(world, 0, 3, kViewHealth), w.health[2], kViewTolerance);
}

TEST(SimEgocentricView, NobodySeenAndTheDead) {
  SimSpec spec = view_spec(2, 2);
  set_cone(spec.params, 0.1f, 0.1f);
  spec.params.very_close_depth2 = 0;
  spec.params.stochastic_communication = true;
  spec.finish();
  TestWorld world(spec);
  world.put(0, 2, 2);
  world.put(1, 2, 8);
  world.put(2, 8, 2);
  world.put(3, 8, 8);
  world.kill(1);
  world.step();
  for (int item = 0; item < view_agents(world.params()); ++item)
    for (int k = 0; k < kViewAgent; ++k) EXPECT_EQ(nearest(world, 0, item, k), 0) << item << " " << k;
  EXPECT_NE(wall(world, 0, 0), 0);
  for (int k = 36; k < 40; ++k) EXPECT_TRUE(std::isnan(world.obs(0, k))) << k;  // between the 36 other numbers and it
  for (int k = 0; k < view_size(world.params()); ++k) EXPECT_EQ(view(world, 1, k), 0) << k;
}

TEST(SimEgocentricView, TheWaypointAlongTheHeading) {
  SimSpec spec = view_spec(1, 1);
  spec.params.waypoints = true;
  spec.finish();
  TestWorld world(spec);
  world.put(0, 5, 5, kPi / 2);
  world.put(1, 1, 1);
  WorldView& w = world.now();
  const float place[4] = {1, 5, 2, 6};
  for (int k = 0; k < 4; ++k) w.waypoint[k] = place[k];
  *w.waypoint_time = 5;
  world.step();
  const float dx = 1.5f - w.x[0], dy = 5.5f - w.y[0], distance = std::hypot(dx, dy);
  const int at = kViewSelf + kViewRays;
  EXPECT_NEAR(view(world, 0, at + kViewNearness), 1 / (1 + distance), kViewTolerance);
  EXPECT_NEAR(view(world, 0, at + kViewAhead), dy / distance, kViewTolerance);  // it flies up
  EXPECT_NEAR(view(world, 0, at + kViewLeft), -dx / distance, kViewTolerance);  // and the place lies to its left
  *w.waypoint_time = 0.05f;                                                     // gone after the next step
  world.step();
  for (int k = 0; k < kViewWaypoint; ++k) EXPECT_EQ(view(world, 0, at + k), 0) << k;
}

TEST(SimEgocentricView, TurnsWithTheAgent) {
  // A world turned by a quarter about its centre looks the same from inside.
  SimSpec spec = view_spec(2, 2);
  spec.maps[0].boxes = {{6, 3, 8, 4, 0, 10}};
  spec.finish();
  SimSpec turned_spec = spec;
  turned_spec.maps[0].boxes = {{6, 6, 7, 8, 0, 10}};  // (x, y) -> (10 - y, x)
  turned_spec.finish();
  TestWorld world(spec), turned(turned_spec);
  const float places[4][3] = {{4, 5, 0.3f}, {3, 2, -1}, {7, 6, 2}, {8, 2, 0.5f}};
  for (int i = 0; i < 4; ++i) {
    const auto [x, y, heading] = std::tuple(places[i][0], places[i][1], places[i][2]);
    world.put(i, x, y, heading);
    turned.put(i, 10 - y, x, heading + kPi / 2);
  }
  world.step();
  turned.step();
  for (int e = 0; e < 4; ++e)
    for (int k = kViewSelf; k < view_size(world.params()); ++k)
      EXPECT_NEAR(view(world, e, k), view(turned, e, k), 1e-4f) << e << " " << k;
}

/// Two against two with an obstacle, tracking that takes no time, and a waypoint.
SimSpec mirror_spec(Box box, ActionKind actions) {
  SimSpec spec = view_spec(2, 2);
  spec.maps[0].boxes = {box};
  spec.params.waypoints = true;
  spec.params.actions = actions;
  spec.finish();
  return spec;
}

// The game in the mirror is the game whose y axis points the other way: (x, y) -> (x, 10 - y). Team 0 looks into the
// mirror in one world, in the other all is where the mirror shows it; team 1 plays without one and turns the other way.
void play_in_mirror(ActionKind actions) {
  TestWorld game(mirror_spec({6, 3, 8, 4, 0, 10}, actions)), shown(mirror_spec({6, 6, 8, 7, 0, 10}, actions));
  game.mirror(0, true);
  const float places[4][3] = {{4, 5, 0.3f}, {3, 2, -1}, {7, 6, 2}, {8, 2, 0.5f}};
  // As discrete actions 9 (throttle + 1) + 3 (heading + 1) + (dive + 1), and as controls.
  const float turns[4] = {1, -1, 1, 0};
  const auto turn = [&](TestWorld& world, int i, float heading) {
    if (actions == ActionKind::discrete)
      world.act(i, 9 + 3 * (static_cast<int>(heading) + 1) + 2);
    else
      world.control(i, 0.7f * heading, 0.5f, 0.1f);
  };
  for (int i = 0; i < 4; ++i) {
    game.put(i, places[i][0], places[i][1], places[i][2]);
    shown.put(i, places[i][0], 10 - places[i][1], -places[i][2]);
    turn(game, i, turns[i]);
    turn(shown, i, i < 2 ? turns[i] : -turns[i]);
  }
  for (TestWorld* world : {&game, &shown}) {
    const float place[4] = {1, world == &game ? 5.0f : 4.0f, 2, world == &game ? 6.0f : 5.0f};
    for (int k = 0; k < 4; ++k) world->now().waypoint[k] = place[k];
    *world->now().waypoint_time = 5;
  }
  for (int k = 0; k < 5; ++k) {
    game.step();
    shown.step();
    for (int e = 0; e < 4; ++e) {
      ASSERT_NEAR(game.now().x[e], shown.now().x[e], 1e-4f) << "step " << k << ", agent " << e;
      ASSERT_NEAR(game.now().y[e], 10 - shown.now().y[e], 1e-4f) << "step " << k << ", agent " << e;
      for (int column = 0; e < 2 && column < view_size(game.params()); ++column)
        ASSERT_NEAR(view(game, e, column), view(shown, e, column), 1e-4f) << "step " << k << ", " << e << " " << column;
      // The vector observation is what it was: the own row comes first.
      ASSERT_NEAR(game.obs(e, kY), 1 - shown.obs(e, kY), 1e-4f);
    }
    // Without a mirror y, the sine of the heading, and what lies left have the other sign.
    ASSERT_NEAR(view(game, 2, 1), -view(shown, 2, 1), 1e-4f);
    ASSERT_NEAR(view(game, 2, 3), -view(shown, 2, 3), 1e-4f);
    ASSERT_NEAR(nearest(game, 2, 0, kViewLeft), -nearest(shown, 2, 0, kViewLeft), 1e-4f);
  }
  // It was a test of turns: agent 0 has turned by five steps of one control.
  EXPECT_LT(game.now().heading[0], 0.3f);
  EXPECT_GT(shown.now().heading[0], -0.3f);
}

TEST(SimEgocentricView, InTheMirrorLeftIsRight) { play_in_mirror(ActionKind::discrete); }
TEST(SimEgocentricView, InTheMirrorControlsAreTurned) { play_in_mirror(ActionKind::continuous); }

}  // namespace
}  // namespace giga::test
