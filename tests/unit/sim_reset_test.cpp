// The start of an episode: places, resampling, state, maps, the first observation (rules 9).
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <utility>

#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

TEST(SimReset, PlacesAreLinearInTheDraws) {
  SimSpec spec = plain_spec(1, 1);
  spec.maps[0].start[0] = {6, 1, 9, 9, 2, 4, -1, 1};
  spec.maps[0].start[1] = {1, 2, 4, 6, 0, 0, 0.5f, 0.5f};
  TestWorld world(spec);
  world.draws.start_draw = [](int agent, int round, StartDraw what) {
    EXPECT_EQ(round, 0) << "nobody is too close";
    const float u[] = {0.25f, 0.5f, 0.75f, 0.125f};
    return u[static_cast<int>(what)] + (agent == 1 ? 0.125f : 0.0f);
  };
  world.start();
  const WorldView& w = world.now();
  // Agent 0: 6 + 0.25*3, 1 + 0.5*8, 2 + 0.75*2, -1 + 0.125*2; agent 1: 1 + 0.375*3, 2 + 0.625*4, 0, 0.5
  EXPECT_EQ(w.x[0], 6.75f);
  EXPECT_EQ(w.y[0], 5.0f);
  EXPECT_EQ(w.z[0], 3.5f);
  EXPECT_EQ(w.heading[0], -0.75f);
  EXPECT_EQ(w.x[1], 2.125f);
  EXPECT_EQ(w.y[1], 4.5f);
  EXPECT_EQ(w.z[1], 0.0f);
  EXPECT_EQ(w.heading[1], 0.5f);
}

TEST(SimReset, StateIsClean) {
  TestWorld world(plain_spec(2, 1));
  world.put(0, 2, 5);
  world.put(2, 3.5f, 5);
  world.steps(5);
  world.kill(1);
  ASSERT_GT(world.tracked(2, 0), 0);
  *world.now().waypoint_time = 3;
  world.start();
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(world.now().v[i], 1.0f) << "agent " << i;
    EXPECT_EQ(world.now().health[i], 1.0f) << "agent " << i;
    EXPECT_TRUE(world.alive(i)) << "agent " << i;
    for (int b = 0; b < 3; ++b) EXPECT_EQ(world.tracked(i, b), 0) << i << ", " << b;
  }
  EXPECT_EQ(*world.now().waypoint_time, 0.0f);
  EXPECT_EQ(*world.now().episode_length, 0);
  EXPECT_TRUE(world.neighbors_untouched());
}

TEST(SimReset, BothOfAClosePairMoveAndKeepTheirHeading) {
  SimSpec spec = plain_spec(3, 1);
  spec.maps[0].start[0] = {0, 0, 10, 10, 0, 0, 0, 1};
  spec.maps[0].start[1] = {5, 9, 5, 9, 0, 0, 0, 0};  // out of the way
  TestWorld world(spec);
  // Round 0: agents 0 and 1 are 0.5 apart: 0.25 < 0.16 + 0.1, though they do not collide yet; 2 is far away.
  world.draws.start_draw = [](int agent, int round, StartDraw what) {
    if (what == StartDraw::heading) return 0.25f;
    const float x[2][4] = {{0.5f, 0.55f, 0.8f, 0.5f}, {0.1f, 0.3f, 0.0f, 0.0f}};
    EXPECT_LE(round, 1);
    EXPECT_TRUE(round == 0 || agent < 2) << "agent " << agent << " had room";
    return what == StartDraw::x ? x[std::min(round, 1)][agent] : 0.5f;
  };
  world.start();
  EXPECT_EQ(world.now().x[0], 1.0f);
  EXPECT_EQ(world.now().x[1], 3.0f);
  EXPECT_EQ(world.now().x[2], 8.0f);
  EXPECT_EQ(world.now().heading[0], 0.25f);
}

TEST(SimReset, AltitudeGivesRoom) {
  SimSpec spec = plain_spec(2, 1);
  spec.maps[0].start[0] = {5, 5, 5, 5, 0, 1, 0, 0};
  TestWorld world(spec);
  int rounds = 0;
  const auto draws_with = [&](float gap) {
    world.draws.start_draw = [&rounds, gap](int agent, int round, StartDraw what) {
      rounds = std::max(rounds, round);
      return what == StartDraw::z && agent == 1 ? gap : 0.0f;
    };
  };
  draws_with(0.61f);  // 0.5 + 0.1 is enough
  world.start();
  EXPECT_EQ(rounds, 0);
  draws_with(0.59f);
  world.start();
  EXPECT_EQ(rounds, 3) << "three rounds, then it stays as it is";
}

TEST(SimReset, EveryRoundJudgesThePlacesBeforeIt) {
  // Agents 0 and 1 start together; in round 1 agent 0 moves onto agent 2's place: that is found in round 2 only, when
  // 0 and 2 move; round 3 has nothing to do.
  SimSpec spec = plain_spec(3, 1);
  spec.maps[0].start[0] = {0, 5, 10, 5, 0, 0, 0, 0};
  spec.maps[0].start[1] = {5, 9, 5, 9, 0, 0, 0, 0};  // out of the way
  TestWorld world(spec);
  std::set<std::pair<int, int>> asked;
  world.draws.start_draw = [&](int agent, int round, StartDraw what) {
    if (what == StartDraw::x) asked.insert({round, agent});
    const float x[4][4] = {
        {0.2f, 0.2f, 0.8f, 0.5f}, {0.8f, 0.3f, 0.9f, 0}, {0.1f, 0.9f, 0.6f, 0}, {0.9f, 0.9f, 0.9f, 0}};
    return x[round][agent];
  };
  world.start();
  EXPECT_EQ(asked, (std::set<std::pair<int, int>>{{0, 0}, {0, 1}, {0, 2}, {0, 3}, {1, 0}, {1, 1}, {2, 0}, {2, 2}}));
  EXPECT_EQ(world.now().x[0], 1.0f);
  EXPECT_EQ(world.now().x[1], 3.0f);
  EXPECT_EQ(world.now().x[2], 6.0f);
}

TEST(SimReset, BoxesAndTheirPaddingKeepADistance) {
  SimSpec spec = plain_spec(1, 1);
  spec.maps[0].boxes = {{5, 5, 6, 6, 0, 10}};
  spec.maps[0].start[0] = {0, 0, 10, 10, 0, 0, 0, 0};
  spec.maps.push_back(spec.maps[0]);
  spec.maps[1].boxes.clear();  // one box of zeros: a keep-out at the origin (Q24)
  TestWorld world(spec);
  const struct {
    int map;
    float u;
    bool resampled;
  } cases[] = {{0, 0.489f, false}, {0, 0.491f, true}, {0, 0.609f, true}, {0, 0.611f, false},
               {0, 0.005f, false}, {1, 0.5f, false},  {1, 0.005f, true}, {1, 0.011f, false}};
  for (const auto& c : cases) {
    bool resampled = false;
    world.draws.map_index = c.map;
    world.draws.start_draw = [&](int agent, int round, StartDraw) {
      resampled = resampled || round > 0;
      return agent == 0 ? (round == 0 ? c.u : 0.9f) : 0.5f;
    };
    world.start();
    EXPECT_EQ(resampled, c.resampled) << "map " << c.map << ", at " << c.u * 10;
  }
}

TEST(SimReset, MapsAndTheirStartAreas) {
  SimSpec spec = plain_spec(1, 1);
  spec.maps.push_back(spec.maps[0]);
  std::swap(spec.maps[1].start[0], spec.maps[1].start[1]);
  TestWorld world(spec);
  EXPECT_EQ(world.now().x[0], 7.5f);
  world.draws.map_index = 1;
  world.start();
  EXPECT_EQ(world.draws.n_maps_asked, 2);
  EXPECT_EQ(*world.now().map, 1);
  EXPECT_EQ(world.now().x[0], 2.5f);
  EXPECT_EQ(world.now().heading[0], 0.0f);
}

}  // namespace
}  // namespace giga::test
