// The grid, by which worlds of many agents find their pairs (rules 17), against the CPU's tables of pairs, bit for bit,
// at sizes that both can play: every state field, every output, at every step, over resets, deaths and waypoints.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "core/error.hpp"
#include "parity/grid_cases.hpp"
#include "sim/grid_memory.hpp"
#include "sim/grid_stages.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

const Case kCases[] = {{1, 1, 8, 30}, {2, 9, 12, 30}, {7, 3, 24, 40}, {20, 20, 12, 25}, {60, 50, 6, 15}};

class GridParity : public ::testing::TestWithParam<Case> {};

TEST_P(GridParity, EveryStepIsThatOfTheTables) {
  const Case c = GetParam();
  Activity activity;
  for (int variant = 0; variant < c.n_variants; ++variant) {
    const SimSpec spec = variant_of(c, variant);
    const SimOptions options = options_of(variant);
    SimRunner a(make_cpu_simulator(spec, options)), b(grid(spec, options));
    const auto note = [&](const Snapshot& now) { activity.add(now); };
    ASSERT_NO_FATAL_FAILURE(expect_same_steps(a, b, c.n_steps, variant, note));
    const EpisodeStats stats = a.sim().take_stats(), same = b.sim().take_stats();
    EXPECT_EQ(stats.rows, same.rows) << "variant " << variant;
  }
  if (c.n_team_0 < 7) return;
  EXPECT_GT(activity.detections, 0);
  EXPECT_GT(activity.shots, 0);
  EXPECT_GT(activity.dead, 0);
  EXPECT_GT(activity.ended, 0);
  EXPECT_GT(activity.waypoints, 0);
}

INSTANTIATE_TEST_SUITE_P(Sizes, GridParity, ::testing::ValuesIn(kCases),
                         [](const auto& test) { return cat(test.param.n_team_0, "v", test.param.n_team_1); });

TEST(Grid, ASavedStateHoldsAllThatTheNextStepsNeed) {
  const SimSpec spec = variant_of({20, 20, 1, 1}, 3);
  SimRunner a(grid(spec, options_of(0))), b(grid(spec, options_of(0)));
  a.start();
  b.start();
  for (uint64_t k = 0; k < 7; ++k) a.step(k);
  ASSERT_NE(difference(a.snapshot(), b.snapshot()), "");
  NamedArrays saved;
  a.sim().state().save("x/", saved);
  b.sim().state().load("x/", saved);
  for (uint64_t k = 7; k < 15; ++k) {
    a.step(k);
    b.step(k);
  }
  EXPECT_EQ(difference(a.snapshot(), b.snapshot()), "");
}

// Five opponents look at agent 0 from two units away, each inside its weapon cone; lists have room for four.
TEST(Grid, ALongerListOfFireThanThereIsRoomForIsAnError) {
  SimSpec spec = plain_spec(1, 5);
  set_damage_cone(spec.params, 5, kTwoPi);
  set_cone(spec.params, 5, kTwoPi);
  spec.params.collision_range2 = 0;
  spec.maps[0].start[0] = {5, 5, 5, 5, 0, 0, 0, 0};
  spec.maps[0].start[1] = {7, 5, 7, 5, 0, 0, 0, 0};
  spec.finish();
  SimOptions options;
  options.most_shooters = 5;
  SimRunner enough(grid(spec, options));
  enough.start();
  enough.step(1);
  EXPECT_EQ(std::ranges::count(enough.snapshot().field("tracked").bytes, 1), 10) << "five at one, one at five";
  options.most_shooters = 4;
  SimRunner full(grid(spec, options));
  full.start();
  try {
    full.step(1);
    FAIL() << "five shooters in a list of four";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("1 agent was fired at by more than 4 opponents at once"),
              std::string::npos)
        << error.what();
  }
}

// Above 65,535 bit 16 of a row, which tells a reset, belongs to no agent: 65,536 = 0x10000 becomes 0x20000.
TEST(Grid, NoTwoAgentsShareDraws) {
  EXPECT_EQ(draw_slot(65535), 65535u);
  EXPECT_EQ(draw_slot(65536), 131072u);
  std::set<uint32_t> rows;
  for (const uint32_t agent : {0u, 1u, 65535u, 65536u, 65537u, 131071u, 131072u, 4194303u})
    for (const uint32_t reset : {0u, 65536u}) rows.insert(draw_slot(agent) + reset);
  EXPECT_EQ(rows.size(), 16u);
  const PhiloxKeys keys(1);
  GridDraws draws(keys, 2, 3);
  PhiloxDraws few(1, 2, 3);
  EXPECT_EQ(draws.comm(65535, 7, true), few.comm(65535, 7, true));
  EXPECT_NE(draws.comm(65536, 7, false), few.comm(0, 7, true));
}

/// A world of agents at random places, as sort_agents leaves it.
struct Places {
  Places(int n, float limit, uint64_t seed) : x(static_cast<size_t>(n)), y(x.size()), alive(x.size(), 1) {
    std::mt19937_64 dice(seed);
    const auto place = [&] { return limit * static_cast<float>(static_cast<double>(dice() >> 11) * 0x1p-53); };
    for (size_t i = 0; i < x.size(); ++i) {
      x[i] = place();
      y[i] = i % 3 == 0 ? y[i / 2] + 0.25f : place();  // some in crowds
      alive[i] = dice() % 5 != 0;
    }
    placed.resize(x.size());
    begin.resize(x.size() + 1);
    place_of.resize(x.size());
    p.n_agents = n;
    p.margin = 1e-6f * limit;
    w.x = x.data();
    w.y = y.data();
    w.alive = alive.data();
    w.placed = placed.data();
    w.cell_begin = begin.data();
    w.place = place_of.data();
    fill_grid(p, w);
  }
  float distance(int i, float px, float py) const {
    const float dx = x[static_cast<size_t>(i)] - px, dy = y[static_cast<size_t>(i)] - py;
    return square_root(dx * dx + dy * dy);
  }

  std::vector<float> x, y;
  std::vector<uint8_t> alive;
  std::vector<PlacedAgent> placed;
  std::vector<int32_t> begin, place_of;
  GridParams p;
  GridWorld w{};
};

TEST(Grid, FindsAllThatAreNearOnSmallAndLargeMaps) {
  for (const float limit : {1.0f, 40.0f, 32768.0f})
    for (const int n : {2, 50, 700}) {
      const Places places(n, limit, static_cast<uint64_t>(n));
      for (int e = 0; e < n; e += 1 + n / 40) {
        // The dead lie beside the map too.
        const float x = places.x[static_cast<size_t>(e)] - (e % 7 == 0 ? 0.1f * limit : 0.0f);
        const float y = places.y[static_cast<size_t>(e)], reach = limit * static_cast<float>(e % 5) / 8;
        std::multiset<int> near, rings;
        for_near(OneWorker{}, places.p, places.w, x, y, reach, [&](int, int a, float) { near.insert(a); });
        float asked = 0;
        for_rings(
            places.p, places.w, x, y, e % 3,
            [&](float far) {
              EXPECT_GE(far + 3 * places.p.margin, asked) << "farther and farther";
              asked = far;
              return far > reach;
            },
            [&](int k) { rings.insert(places.w.placed[k].agent); });
        std::multiset<int> parts;
        Rings by_parts(places.p, places.w, x, y, e % 3);
        float far = 0;
        while (far < INFINITY && far <= reach) {
          for (int part = 0; part < by_parts.parts(); ++part)
            for (CellRange range = by_parts.part(part); range.begin < range.end; ++range.begin)
              parts.insert(places.w.placed[range.begin].agent);
          far = by_parts.widen();
        }
        EXPECT_EQ(parts, rings) << n << " agents, around agent " << e;
        for (int a = 0; a < n; ++a) {
          const bool expected = places.alive[static_cast<size_t>(a)] && places.distance(a, x, y) <= reach;
          if (expected) {
            EXPECT_EQ(near.count(a), 1u) << n << " agents, agent " << a << " of " << e;
            EXPECT_EQ(rings.count(a), 1u) << n << " agents, agent " << a << " of " << e;
          }
          EXPECT_LE(near.count(a), places.alive[static_cast<size_t>(a)] ? 1u : 0u);
        }
      }
    }
}

// More agents than tables of pairs serve; any number of threads gives the same bits.
TEST(Grid, PlaysMoreAgentsThanTablesDo) {
  SimSpec spec = plain_spec(700, 500);
  spec.params.limit_x = spec.params.limit_y = 30;
  spec.params.stochastic_detection = spec.params.stochastic_communication = true;
  spec.params.max_episode_length = 6;
  spec.maps[0].start[0] = {2, 2, 28, 28, 0, 5, 0, 6};
  spec.maps[0].start[1] = {2, 2, 28, 28, 0, 5, 0, 6};
  spec.finish();
  SimOptions options;
  options.n_worlds = 2;
  options.n_threads = 1;
  SimRunner one(grid(spec, options));
  options.n_threads = 3;
  SimRunner three(make_grid_simulator(spec, options));
  one.start();
  three.start();
  int detects = 0;
  for (uint64_t k = 0; k < 8; ++k) {
    one.step(k);
    three.step(k);
    const Snapshot now = one.snapshot();
    ASSERT_EQ(difference(now, three.snapshot()), "") << "step " << k;
    detects += static_cast<int>(std::ranges::count_if(now.field("tracked").bytes, [](uint8_t t) { return t > 0; }));
  }
  EXPECT_GT(detects, 100);
  EXPECT_EQ(one.sim().take_stats()[EpisodeStat::episodes], 2);
}

TEST(Grid, AListOfFireThatIsTooShortForCrewsIsAnError) { expect_full_lists_tell(grid); }

// As many agents as tables serve (kMaxAgents): tables of a million pairs.
TEST(Grid, AThousandAgentsAreThoseOfTheTables) {
  Activity activity;
  for (const bool plain : {true, false}) {
    SimSpec spec = plain_spec(512, 512);
    ASSERT_EQ(spec.agents.size(), static_cast<size_t>(kMaxAgents));
    SimParams& p = spec.params;
    p.limit_x = p.limit_y = 28;  // 1,024 / 28^2 = 1.3 agents a unit^2
    p.max_episode_length = 4;
    p.min_tracking_time = 0;  // the first step of fire takes 0.5 of 1
    p.damage_per_second = 5;
    p.stochastic_detection = p.stochastic_communication = plain;
    p.actions = plain ? ActionKind::discrete : ActionKind::continuous;
    p.obstacles_block_sight = p.sight_3d = p.egocentric_view = !plain;
    if (!plain) spec.maps[0].boxes = {{6, 6, 9, 11, 0, 5}, {18, 15, 24, 17, 2, 9}};
    for (const RewardTerm term : {RewardTerm::detection, RewardTerm::damage, RewardTerm::collision_agent})
      set_reward(spec, term, 1.5f);
    for (size_t i = 0; i < spec.agents.size(); ++i) spec.agents[i].range = i % 3 == 0 ? 2.0f : 1.0f;
    spec.maps[0].start[0] = {2, 2, 26, 26, 0, 5, 0, 6};
    spec.maps[0].start[1] = {2, 2, 26, 26, 0, 5, 0, 6};
    spec.finish();
    const SimOptions options;
    SimRunner a(make_cpu_simulator(spec, options)), b(grid(spec, options));
    ASSERT_NO_FATAL_FAILURE(expect_same_steps(a, b, 6, plain ? 0 : 1, [&](const Snapshot& now) { activity.add(now); }));
    const EpisodeStats stats = a.sim().take_stats(), same = b.sim().take_stats();
    EXPECT_EQ(stats.rows, same.rows);
    EXPECT_EQ(stats[EpisodeStat::episodes], 1) << "of four steps, in six";
    EXPECT_GT(stats[EpisodeStat::deaths_damage_0], 0);
    EXPECT_GT(stats[EpisodeStat::deaths_agent_1], 0);
  }
  EXPECT_GT(activity.detections, 1000);
  EXPECT_GT(activity.shots, 1000);
}

// What is kept of an agent: its state, and what a step needs, on the CPU and where many workers sort together or for
// themselves. Some things are kept once for a world and sums of blocks of 64 have sums of their own, so it is not quite
// the same; a table of pairs would take 500 times as much for each agent.
TEST(Grid, KeepsNoMoreOfAnAgentWhereThereAreMore) {
  struct Bytes {
    size_t state, alone, by_block, together, sorted;
  };
  const auto bytes_of = [](int n_of_team, bool egocentric) {
    SimSpec spec = plain_spec(n_of_team, n_of_team);
    spec.params.egocentric_view = egocentric;
    spec.finish();
    const float reach[kNTeams] = {1, 1};
    const GridParams p(spec.params, reach, kMostShooters);
    GridWorld w{};
    return Bytes{state_bytes(StateShape(spec), 1), attach_scratch(p, w, nullptr, false),
                 attach_scratch(p, w, nullptr, true, false), attach_scratch(p, w, nullptr, true),
                 attach_sorted(p.n_agents, w, nullptr)};
  };
  for (const bool egocentric : {false, true}) {
    const Bytes few = bytes_of(1000, egocentric), many = bytes_of(500'000, egocentric);
    const auto expect_as_many = [](size_t of_few, size_t of_many, const char* what) {
      const double each_of_few = static_cast<double>(of_few) / 2e3, each_of_many = static_cast<double>(of_many) / 1e6;
      EXPECT_GT(each_of_few, 0) << what;
      EXPECT_NEAR(each_of_many, each_of_few, 0.1 * each_of_few) << what << ", bytes an agent";
    };
    expect_as_many(few.state, many.state, "state");
    expect_as_many(few.alone, many.alone, "scratch of the CPU");
    expect_as_many(few.by_block, many.by_block, "scratch where blocks sort for themselves");
    expect_as_many(few.together, many.together, "scratch where blocks sort together");
    expect_as_many(few.sorted, many.sorted, "what a block needs to sort");
    // Six floats and two bytes, 64 entries of fire and 15 rows of four bytes: 342.
    EXPECT_NEAR(static_cast<double>(many.state) / 1e6, 6 * 4 + 2 + 64 * 4 + 15 * 4, 0.1);
  }
}

TEST(Grid, RanksAgentsThatLieTogetherAsTablesDo) { play_knots(make_cpu_simulator, grid); }

}  // namespace
}  // namespace giga::test
