// Vector observations and the true-state vector: every number, order, ties, limits, communication, dead egos (rules 6,
// 7).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "sim/draws.hpp"
#include "sim/vector_observation.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

constexpr float kObservationTolerance = 1e-6f;

/// Observations of team 0 from the state as it stands, with sight decided anew: [agent][columns].
std::vector<std::vector<float>> observe_team_0(TestWorld& world) {
  const SimParams& p = world.params();
  WorldView& w = world.now();
  const int n = p.n_agents, words = words_for(n);
  for (int i = 0; i < n; ++i) face(w, i);
  for (int a = 0; a < n; ++a) {
    for (int k = 0; k < words; ++k) w.detected[a * words + k] = 0;
    for (int b = 0; b < n; ++b)
      if (p.team_of(a) != p.team_of(b) && w.alive[a] && w.alive[b] &&
          sight(p, w, a, b, [&] { return world.draws.detect(a, b); }).detected)
        w.detected[a * words + b / 32] |= 1u << (b % 32);
  }
  std::vector<float> flat(static_cast<size_t>(p.n_team[0] * world.columns()), NAN);
  StepIo io;
  io.team[0].obs[Observation::vector].rows = flat.data();
  observe_world(SerialLanes{}, p, w, world.draws, io, 0, false);
  std::vector<std::vector<float>> rows;
  for (int i = 0; i < p.n_team[0]; ++i)
    rows.emplace_back(flat.begin() + i * world.columns(), flat.begin() + (i + 1) * world.columns());
  return rows;
}

/// Agent index of each row, by a sprite that is the index + 1; -1 = a row of zeros.
std::vector<int> order_of(const std::vector<float>& obs, int n_rows) {
  std::vector<int> order;
  for (int row = 0; row < n_rows; ++row) order.push_back(static_cast<int>(obs[static_cast<size_t>(row * 9 + 8)]) - 1);
  return order;
}
SimSpec numbered(SimSpec spec) {
  for (size_t i = 0; i < spec.agents.size(); ++i) spec.agents[i].sprite = static_cast<int32_t>(i) + 1;
  return spec;
}

TEST(SimObservation, NineNumbersOfEgoAndOther) {
  SimSpec spec = open_spec(1, 1);
  spec.params.limit_y = 20;
  spec.agents[0].sprite = 3;
  spec.agents[1].sprite = 6;
  spec.agents[1].max_health = 3;
  TestWorld world(spec);
  ASSERT_EQ(world.columns(), 18);
  world.put(0, 2, 5, 0.5f, 1, 1.5f);
  world.put(1, 6, 4, -2.9f, 4, 2.5f);
  world.now().health[0] = 0.25f;
  world.now().health[1] = 2.5f;
  const std::vector<float> obs = observe_team_0(world)[0];
  // Speeds over sqrt(10^2 + 20^2) = 22.3606798: 1.5 -> 0.0670820393, 1 -> 0.0447213595
  // Relative heading -2.9 - 0.5 = -3.4 -> + 2 pi = 2.88318531
  const float expected[18] = {1, 1, 0.2f, 0.25f,  0.1f, 0.5f,        0.0670820393f, 0.25f, 3,
                              1, 0, 0.4f, -0.05f, 0.3f, 2.88318531f, 0.0447213595f, 2.5f,  6};
  for (size_t k = 0; k < 18; ++k) EXPECT_NEAR(obs[k], expected[k], kObservationTolerance) << "column " << k;
}

TEST(SimObservation, AscendingDistanceAndTiesByIndex) {
  TestWorld world(numbered(open_spec(4, 3)));
  world.put(0, 5, 5);
  world.put(1, 5, 8);  // 3
  world.put(2, 7, 5);  // 2
  world.put(3, 5, 3);  // 2: a tie with 2 and 6
  world.put(4, 6, 5);  // 1
  world.put(5, 9, 9);
  world.put(6, 3, 5);  // 2
  const auto rows = observe_team_0(world);
  EXPECT_EQ(order_of(rows[0], 7), (std::vector<int>{0, 4, 2, 3, 6, 1, 5}));
  // From agent 3 at (5, 3): 0 at 2, 4 at 2.236, 2 and 6 at 2.828, 1 at 5, 5 at 7.2
  EXPECT_EQ(order_of(rows[3], 7), (std::vector<int>{3, 0, 4, 2, 6, 1, 5}));
}

TEST(SimObservation, NeighborLimitKeepsTheNearest) {
  for (const int limit : {1, 2, 4, 15}) {
    SimSpec spec = numbered(open_spec(4, 3));
    spec.neighbor_limit = limit;
    TestWorld world(spec);
    const int n_rows = std::min(limit, 7);
    ASSERT_EQ(world.columns(), 9 * n_rows);
    const float xs[] = {1, 7, 2, 6, 3, 5, 4};
    for (int i = 0; i < 7; ++i) world.put(i, xs[i], 5);
    std::vector<int> expected{0, 2, 4, 6, 5, 3, 1};
    expected.resize(static_cast<size_t>(n_rows));
    EXPECT_EQ(order_of(observe_team_0(world)[0], n_rows), expected) << "limit " << limit;
  }
}

TEST(SimObservation, ATieAtTheLimitGoesToTheLowerIndex) {
  SimSpec spec = numbered(open_spec(2, 3));
  spec.neighbor_limit = 3;
  TestWorld world(spec);
  world.put(0, 5, 5);
  world.put(1, 5, 7);  // 2, as agents 2 and 4
  world.put(2, 7, 5);
  world.put(3, 5, 4);  // 1
  world.put(4, 3, 5);
  EXPECT_EQ(order_of(observe_team_0(world)[0], 3), (std::vector<int>{0, 3, 1}));
}

TEST(SimObservation, UnseenRowsAreZerosAtTheEnd) {
  SimSpec spec = numbered(plain_spec(2, 2));  // cones of 3 and 135 degrees
  TestWorld world(spec);
  world.put(0, 5, 5);
  world.put(1, 5, 9);     // team mate, heard anywhere without stochastic communication
  world.put(2, 3.5f, 5);  // behind agent 0, outside agent 1's depth
  world.put(3, 7, 5);     // seen
  const auto rows = observe_team_0(world);
  EXPECT_EQ(order_of(rows[0], 4), (std::vector<int>{0, 3, 1, -1}));
  for (size_t k = 27; k < 36; ++k) EXPECT_EQ(rows[0][k], 0.0f) << "column " << k;
}

TEST(SimObservation, SightIsSharedThroughWhoIsHeard) {
  SimSpec spec = numbered(plain_spec(3, 1));
  spec.params.stochastic_communication = true;
  TestWorld world(spec);
  world.put(0, 1, 1, kPi);
  world.put(1, 7, 7);
  world.put(2, 1, 7, kPi);
  world.put(3, 9, 7);  // only agent 1 detects it
  // Distance 0-1 is sqrt(72) = 8.49 > 8: inaudible even with the largest draw below 1. 0-2 is 6: heard above 0.75.
  world.draws.comm_draw = [](int, int, bool) { return 0.76f; };
  auto rows = observe_team_0(world);
  EXPECT_EQ(order_of(rows[0], 4), (std::vector<int>{0, 2, -1, -1}));
  EXPECT_EQ(order_of(rows[2], 4), (std::vector<int>{2, 0, 1, 3})) << "hears 1, hence sees what 1 detects: 6, 6, 8";
  world.draws.comm_draw = [](int, int, bool) { return 0.74f; };
  rows = observe_team_0(world);
  EXPECT_EQ(order_of(rows[0], 4), (std::vector<int>{0, -1, -1, -1})) << "the ego always hears itself";
  EXPECT_EQ(order_of(rows[1], 4), (std::vector<int>{1, 3, -1, -1}));
}

TEST(SimObservation, CommunicationProbability) {
  // P(heard) = 1 - d / 8; 20,000 draws: 4.5 standard errors = 0.016.
  SimSpec spec = plain_spec(2, 1);
  spec.params.stochastic_communication = true;
  TestWorld world(spec);
  const int n = 20000;
  for (const float d : {0.8f, 4.0f, 7.2f, 8.5f}) {
    world.put(0, 0.5f, 5);
    world.put(1, 0.5f + d, 5);
    int heard = 0, mutual = 0;
    for (int k = 0; k < n; ++k) {
      PhiloxDraws draws(9, static_cast<uint32_t>(k % 65), static_cast<uint32_t>(k / 65));
      listen(world.params(), world.now(), draws, 0, false);
      listen(world.params(), world.now(), draws, 1, false);
      const bool forth = (world.now().hears[0] & 2u) != 0, back = (world.now().hears[1] & 1u) != 0;
      heard += forth;
      mutual += forth && back;
      ASSERT_TRUE(world.now().hears[0] & 1u) << "oneself";
    }
    const double p = std::max(0.0, 1 - static_cast<double>(d) / 8);
    EXPECT_NEAR(heard / static_cast<double>(n), p, 0.016) << "distance " << d;
    EXPECT_NEAR(mutual / static_cast<double>(n), p * p, 0.016) << "each direction is drawn apart, distance " << d;
  }
}

TEST(SimObservation, DeadEgo) {
  for (const bool partial : {false, true}) {
    SimSpec spec = numbered(open_spec(2, 1));
    spec.params.stochastic_communication = partial;
    spec.params.waypoints = true;
    TestWorld world(spec);
    world.put(0, 5, 5);
    world.put(1, 5, 6);
    world.put(2, 7, 5);
    world.kill(0);
    const auto rows = observe_team_0(world);
    const auto order = order_of(rows[0], 3);
    // It never sees itself, but sees the others (the mate at 1, the opponent at 2); with stochastic communication only
    // through mates that it hears: it listens on after its death, as the recordings of the original say.
    EXPECT_EQ(order, (std::vector<int>{-1, 1, 2}));
    world.draws.comm_draw = [](int, int, bool) { return 0.0f; };  // below 1 / 8: nobody is heard
    const auto deaf = order_of(observe_team_0(world)[0], 3);
    EXPECT_EQ(deaf, partial ? (std::vector<int>{-1, -1, -1}) : order);
    EXPECT_NEAR(rows[0][27], -0.5f, kObservationTolerance) << "the tail is not masked: (0 - 5) / 10";
    EXPECT_EQ(order_of(rows[1], 3), (std::vector<int>{1, 2, -1})) << "the dead are neither seen nor heard";
  }
}

TEST(SimObservation, WaypointAndBoxesBehindTheAgents) {
  SimSpec spec = open_spec(1, 1);
  spec.params.limit_y = 20;
  spec.params.waypoints = true;
  spec.maps[0].boxes = {{1, 2, 3, 4, 0, 5}};
  spec.maps.push_back(spec.maps[0]);
  spec.maps[1].boxes = {{5, 6, 7, 8, 1, 2}, {0, 1, 2, 3, 0, 10}};
  TestWorld world(spec);
  ASSERT_EQ(world.columns(), 18 + 5 + 8);
  world.put(0, 2, 5);
  world.put(1, 6, 4);
  const float corners[] = {4, 10, 4.6f, 10.6f};
  for (int k = 0; k < 4; ++k) world.now().waypoint[k] = corners[k];
  *world.now().waypoint_time = 3.5f;
  // (4 - 2)/10, (10 - 5)/20, (4.6 - 2)/10, (10.6 - 5)/20, seconds; the box over (10, 20, 10, 20); padding
  const float expected[] = {0.2f, 0.25f, 0.26f, 0.28f, 3.5f, 0.1f, 0.1f, 0.3f, 0.2f, 0, 0, 0, 0};
  const std::vector<float> obs = observe_team_0(world)[0];
  for (size_t k = 0; k < 13; ++k) EXPECT_NEAR(obs[18 + k], expected[k], kObservationTolerance) << "column " << 18 + k;
  *world.now().map = 1;
  EXPECT_NEAR(observe_team_0(world)[0][18 + 5 + 3], 0.4f, kObservationTolerance)
      << "the boxes are those of the world's map: 8 / 20";
}

TEST(SimObservation, SixNumbersABoxWithHeights) {
  SimSpec spec = open_spec(1, 1);
  spec.params.obstacle_heights = true;
  spec.maps[0].boxes = {{1, 2, 3, 4, 0.5f, 5}};
  TestWorld world(spec);
  ASSERT_EQ(world.columns(), 24);
  world.put(0, 7, 7);
  world.put(1, 8, 8);
  const float expected[] = {0.1f, 0.2f, 0.3f, 0.4f, 0.05f, 0.5f};
  const std::vector<float> obs = observe_team_0(world)[0];
  for (size_t k = 0; k < 6; ++k) EXPECT_NEAR(obs[18 + k], expected[k], kObservationTolerance) << "column " << 18 + k;
}

TEST(SimObservation, BuiltInSizes) {
  // Rules 7.4: agents and box count of the set "all" (4) -> D.
  const struct {
    int n0, n1;
    bool waypoints;
    int size;
  } cases[] = {{1, 1, false, 34},   {2, 2, false, 52}, {5, 1, false, 70}, {5, 5, false, 106},
               {10, 3, false, 133}, {5, 5, true, 111}, {5, 3, true, 93},  {20, 20, false, 151}};
  for (const auto& c : cases) {
    SimSpec spec = plain_spec(c.n0, c.n1);
    spec.params.waypoints = c.waypoints;
    spec.maps[0].boxes.resize(4);
    spec.finish();
    EXPECT_EQ(VectorObservation::shape(spec.params).size(), c.size) << c.n0 << " v " << c.n1;
  }
}

TEST(SimObservation, GlobalState) {
  SimSpec spec = plain_spec(2, 1);
  spec.params.waypoints = true;
  spec.params.max_episode_length = 8;
  spec.params.limit_y = 20;
  spec.agents[2] = {1, 1, 0.8f, 3, 2, 0.5f, 0};
  spec.maps[0].boxes = {{1, 2, 3, 4, 0, 5}};
  TestWorld world(spec);
  ASSERT_EQ(state_size(world.params()), 3 * 12 + 5 + 4);
  world.put(0, 2, 2);
  world.put(1, 2, 8);
  world.put(2, 6, 5, 0.5f, 4, 2);
  world.kill(1);
  world.now().health[2] = 1.5f;
  const float corners[] = {4, 10, 5, 12};
  for (int k = 0; k < 4; ++k) world.now().waypoint[k] = corners[k];
  *world.now().waypoint_time = 2.5f;
  *world.now().episode_length = 2;
  const auto value = [&](int column) { return state_value(world.params(), world.now(), column); };
  for (int k = 0; k < 12; ++k) EXPECT_EQ(value(12 + k), 0.0f) << "the dead are zeros, column " << 12 + k;
  // alive, x, y, z over (10, 20, 10), sine and cosine of 0.5, v / 5, health, health / 3, thrust, range, damage range
  const float entity[] = {1, 0.6f, 0.25f, 0.4f, 0.479425539f, 0.877582562f, 0.4f, 1.5f, 0.5f, 0.8f, 2, 0.5f};
  for (int k = 0; k < 12; ++k) EXPECT_NEAR(value(24 + k), entity[k], kObservationTolerance) << "column " << 24 + k;
  // centre (4.5, 11) over (10, 20), active, 2.5 / 10, 2 / 8 steps, the box
  const float rest[] = {0.45f, 0.55f, 1, 0.25f, 0.25f, 0.1f, 0.1f, 0.3f, 0.2f};
  for (int k = 0; k < 9; ++k) EXPECT_NEAR(value(36 + k), rest[k], kObservationTolerance) << "column " << 36 + k;
  *world.now().waypoint_time = 0;
  for (int k = 0; k < 4; ++k) EXPECT_EQ(value(36 + k), 0.0f) << "no waypoint, column " << 36 + k;
}

}  // namespace
}  // namespace giga::test
