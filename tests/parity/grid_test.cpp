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
#include "cuda/runtime.hpp"
#include "parity/emulated_simulator.hpp"
#include "sim/grid_stages.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

struct Case {
  int n_team_0, n_team_1;
  int n_variants, n_steps;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.n_team_0 << " v " << c.n_team_1; }
const Case kCases[] = {{1, 1, 8, 30}, {2, 9, 12, 30}, {7, 3, 24, 40}, {20, 20, 12, 25}, {60, 50, 6, 15}};

/// Variant 0 has every switch on, 1 none, then each one alone and each one missing; the rest of the scenario is random.
SimSpec variant_of(const Case& c, int variant) {
  SimSpec spec =
      random_spec(static_cast<uint64_t>(7000 * variant + 31 * c.n_team_0 + c.n_team_1), c.n_team_0, c.n_team_1);
  const unsigned all = kNSwitchMasks - 1;
  unsigned mask = variant == 0 ? all : 0;
  if (variant >= 2) mask = 1u << (static_cast<unsigned>(variant - 2) / 2 % kNSwitches);
  if (variant >= 2 && variant % 2) mask = all ^ mask;
  set_switches(spec, mask);
  spec.params.max_episode_length = variant % 5 == 4 ? 0 : 5 + variant % 9;
  spec.finish();
  return spec;
}

SimOptions options_of(int variant) {
  SimOptions options;
  options.n_worlds = 3;
  options.n_threads = 1 + variant % 2;
  options.seed = 0xABCDEFull + static_cast<uint64_t>(variant);
  options.first_world = variant % 3 == 2 ? 100000 : 0;
  options.on_done = variant % 4 == 3 ? (variant % 8 == 3 ? OnDone::freeze : OnDone::keep) : OnDone::reset;
  return options;
}

std::unique_ptr<Simulator> grid(const SimSpec& spec, SimOptions options) {
  options.grid = true;
  return make_grid_simulator(spec, options);
}

/// Without the tables of which a grid keeps nothing. What they led to, the observations, is compared.
Snapshot without_tables(Snapshot shot) {
  std::erase_if(shot.fields, [](const SnapshotField& f) { return f.name == "detected" || f.name == "seen"; });
  return shot;
}

class GridParity : public ::testing::TestWithParam<Case> {};

TEST_P(GridParity, EveryStepIsThatOfTheTables) {
  const Case c = GetParam();
  Activity activity;
  for (int variant = 0; variant < c.n_variants; ++variant) {
    const SimSpec spec = variant_of(c, variant);
    const SimOptions options = options_of(variant);
    SimRunner a(make_cpu_simulator(spec, options)), b(grid(spec, options));
    a.start();
    b.start();
    ASSERT_EQ(difference(without_tables(a.snapshot()), b.snapshot()), "") << "variant " << variant << ", start";
    for (int k = 0; k < c.n_steps; ++k) {
      a.step(static_cast<uint64_t>(k));
      b.step(static_cast<uint64_t>(k));
      const Snapshot now = a.snapshot();
      ASSERT_EQ(difference(without_tables(now), b.snapshot()), "") << "variant " << variant << ", step " << k;
      activity.add(now);
      if (k % 6 != 5) continue;
      a.observe();
      b.observe();
      ASSERT_EQ(difference(observations(a.snapshot()), observations(b.snapshot())), "")
          << "variant " << variant << ", observe after step " << k;
    }
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
        for_near(places.p, places.w, x, y, reach, [&](int, int a, float) { near.insert(a); });
        float asked = 0;
        for_rings(
            places.p, places.w, x, y, e % 3,
            [&](float far) {
              EXPECT_GE(far + 3 * places.p.margin, asked) << "farther and farther";
              asked = far;
              return far > reach;
            },
            [&](int k) { rings.insert(places.w.placed[k].agent); });
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

/// Agents that start at two points, or so near one that keys of distances cannot tell them apart: who has which row is
/// decided by number, or by looking closer.
struct Knot {
  int n_team_0, n_team_1;
  float spread, limit;
  int n_neighbors;
  bool stochastic;
};
const Knot kKnots[] = {
    {6, 7, 0, 20, 15, false},                                   // fewer than rows
    {6, 7, 2e-5f, 20, 15, true},                                // in the wrong order
    {40, 30, 0, 20, 15, true},                                  // more detect one than are kept
    {40, 30, 2e-5f, 20, 15, true},                              // whoever has the last row too
    {40, 30, 2e-5f, 20, 40, false}, {40, 30, 0, 20, 33, true},  // longer rows
    {3, 400, 1, 1000, 15, true},                                // hundreds in a cell
    {60, 50, 8, 30, 15, true},                                  // told by somebody who is not kept
};
SimSpec knot_spec(const Knot& c) {
  SimSpec spec = plain_spec(c.n_team_0, c.n_team_1);
  spec.params.limit_x = spec.params.limit_y = c.limit;
  spec.params.stochastic_detection = spec.params.stochastic_communication = c.stochastic;
  spec.params.collision_range2 = 0;
  spec.params.max_episode_length = 4;
  set_cone(spec.params, 8, kTwoPi);
  set_damage_cone(spec.params, c.n_team_1 > kMostShooters ? 1.0f : 6.0f, 0.2f);
  spec.maps[0].start[0] = {5, 5, 5 + c.spread, 5 + c.spread, 2, 2, 0, 1};
  spec.maps[0].start[1] = {9, 8, 9 + c.spread, 8 + c.spread, 2, 2, 3, 4};
  spec.neighbor_limit = c.n_neighbors;
  spec.finish();
  return spec;
}
/// Plays them by `expected` and `actual`, and compares what holds for both.
void play_knots(const std::function<std::unique_ptr<Simulator>(const SimSpec&, const SimOptions&)>& expected,
                const std::function<std::unique_ptr<Simulator>(const SimSpec&, const SimOptions&)>& actual) {
  for (const Knot& c : kKnots) {
    const SimSpec spec = knot_spec(c);
    SimOptions options;
    options.n_worlds = 2;
    SimRunner a(expected(spec, options)), b(actual(spec, options));
    a.start();
    b.start();
    for (uint64_t k = 0; k < 6; ++k) {
      const Snapshot now = a.snapshot();
      ASSERT_EQ(difference(without_tables(now), without_tables(b.snapshot())), "")
          << c.n_team_0 << " v " << c.n_team_1 << " within " << c.spread << ", " << c.n_neighbors << " rows, step "
          << k;
      a.step(k);
      b.step(k);
    }
  }
}

TEST(Grid, RanksAgentsThatLieTogetherAsTablesDo) { play_knots(make_cpu_simulator, grid); }

/// Who runs the threads of the GPU back end, held against the CPU's grid.
enum class Executor { gpu, emulated };
class GridExecutors : public ::testing::TestWithParam<std::tuple<Executor, Case>> {
 protected:
  void SetUp() override {
    if (executor_ == Executor::gpu && cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  }
  std::unique_ptr<Simulator> other(const SimSpec& spec, SimOptions options, int variant) const {
    options.grid = true;
    if (executor_ == Executor::gpu) return make_cuda_grid_simulator(spec, options, 0);
    // One block to a world, several worlds to a group, several blocks to a world, the last one without agents; parts.
    const int blocks[] = {1, 2, 9, kBlocksInParts};
    return make_emulated_grid_simulator(spec, options, static_cast<ThreadOrder>(variant % 3), blocks[variant % 4]);
  }

  /// Under a sanitizer as few steps as show each stage a few times, over resets.
  static Case cut(Case c, Executor executor) {
    if (executor == Executor::gpu && parity_is_small()) {
      c.n_variants = std::min(c.n_variants, 4);
      c.n_steps = std::min(c.n_steps, 8);
    }
    return c;
  }

  const Executor executor_ = std::get<0>(GetParam());
  const Case case_ = cut(std::get<1>(GetParam()), executor_);
};

TEST_P(GridExecutors, EveryStepIsThatOfTheCpu) {
  int64_t shots = 0, dead = 0, ended = 0;
  for (int variant = 0; variant < case_.n_variants; ++variant) {
    const SimSpec spec = variant_of(case_, variant);
    const SimOptions options = options_of(variant);
    SimRunner a(grid(spec, options)), b(other(spec, options, variant));
    a.start();
    b.start();
    ASSERT_EQ(difference(a.snapshot(), b.snapshot()), "") << "variant " << variant << ", start";
    for (int k = 0; k < case_.n_steps; ++k) {
      a.step(static_cast<uint64_t>(k));
      b.step(static_cast<uint64_t>(k));
      const Snapshot now = a.snapshot();
      ASSERT_EQ(difference(now, b.snapshot()), "") << "variant " << variant << ", step " << k;
      shots += std::ranges::count_if(now.field("tracked").bytes, [](uint8_t t) { return t > 0; });
      dead += std::ranges::count(now.field("alive").bytes, 0);
      ended += std::ranges::count_if(now.field("done").bytes, [](uint8_t d) { return d > 0; });
      if (k % 6 != 5) continue;
      a.observe();
      b.observe();
      ASSERT_EQ(difference(observations(a.snapshot()), observations(b.snapshot())), "")
          << "variant " << variant << ", observe after step " << k;
    }
    const EpisodeStats stats = a.sim().take_stats(), same = b.sim().take_stats();
    for (size_t row = 0; row < stats.rows.size(); ++row)
      EXPECT_NEAR(stats.rows[row], same.rows[row], 1e-9 * (1 + std::abs(stats.rows[row]))) << "row " << row;
  }
  if (case_.n_team_0 < 7 || (executor_ == Executor::gpu && parity_is_small())) return;
  EXPECT_GT(shots, 0);
  EXPECT_GT(dead, 0);
  EXPECT_GT(ended, 0);
}

// Worlds that end one after the other, one or several episodes each, and lists of those that still play.
TEST_P(GridExecutors, WorldsThatFreeze) {
  for (const auto& [variant, episodes] : {std::pair{0, 1}, {4, 1}, {1, 3}, {5, 2}}) {
    SimSpec spec = variant_of(case_, variant);
    spec.params.max_episode_length = std::max(1, case_.n_steps / episodes);
    SimOptions options = options_of(variant);
    options.on_done = OnDone::freeze;
    options.episodes = episodes;
    SimRunner a(grid(spec, options), Outputs::observations), b(other(spec, options, variant), Outputs::observations);
    a.start();
    b.start();
    const int most = case_.n_steps + 4 * kListPeriod;
    for (int k = 0; k < most; ++k) {
      a.step(static_cast<uint64_t>(k));
      b.step(static_cast<uint64_t>(k));
      if (k % 4 == 3) {
        ASSERT_EQ(difference(a.snapshot(), b.snapshot()), "") << "variant " << variant << ", step " << k;
      }
    }
    EXPECT_TRUE(b.sim().over());
    EXPECT_EQ(a.sim().take_stats()[EpisodeStat::episodes], 3 * episodes);
    EXPECT_EQ(b.sim().take_stats()[EpisodeStat::episodes], 3 * episodes);
  }
}

const Case kExecutorCases[] = {{1, 1, 9, 12}, {2, 9, 12, 12}, {7, 3, 18, 20}, {60, 50, 9, 12}, {141, 66, 3, 8}};
const auto kExecutorName = [](const auto& test) {
  const Case& c = std::get<1>(test.param);
  return cat(c.n_team_0, "v", c.n_team_1);
};
INSTANTIATE_TEST_SUITE_P(Gpu, GridExecutors,
                         ::testing::Combine(::testing::Values(Executor::gpu), ::testing::ValuesIn(kExecutorCases)),
                         kExecutorName);
INSTANTIATE_TEST_SUITE_P(Emulated, GridExecutors,
                         ::testing::Combine(::testing::Values(Executor::emulated), ::testing::ValuesIn(kExecutorCases)),
                         kExecutorName);

/// More agents than tables serve: sums of several blocks (rules 17.5), cells of more than one chunk and, beyond 4,096
/// agents, of more than one group.
SimSpec crowd(int n_team_0, int n_team_1, float limit, int episode) {
  SimSpec spec = plain_spec(n_team_0, n_team_1);
  spec.params.limit_x = spec.params.limit_y = limit;
  spec.params.stochastic_detection = spec.params.stochastic_communication = true;
  spec.params.max_episode_length = episode;
  const float far = limit - 2;
  spec.maps[0].start[0] = {2, 2, far, far, 0, 5, 0, 6};
  spec.maps[0].start[1] = {2, 2, far, far, 0, 5, 0, 6};
  spec.finish();
  return spec;
}

struct Crowd {
  int n_team_0, n_team_1;
  float limit;
  int worlds, blocks, steps;
};
void play_crowd(const Crowd& c, const std::function<std::unique_ptr<Simulator>(const SimSpec&, SimOptions)>& other) {
  constexpr int64_t kMostPairs = 1 << 25;
  const SimSpec spec = crowd(c.n_team_0, c.n_team_1, c.limit, 3);
  SimOptions options;
  options.n_worlds = c.worlds;
  options.grid = true;
  SimRunner a(grid(spec, options), Outputs::observations), b(other(spec, options), Outputs::observations);
  a.start();
  b.start();
  for (uint64_t k = 0; k < static_cast<uint64_t>(c.steps); ++k) {
    a.step(k);
    b.step(k);
    ASSERT_TRUE(a.sim().state().save() == b.sim().state().save())
        << c.n_team_0 << " v " << c.n_team_1 << " in " << c.worlds << " worlds, step " << k;
    // What was written too, where the tables of pairs that a snapshot makes are not too large.
    if (int64_t{spec.params.n_agents} * spec.params.n_agents * c.worlds > kMostPairs) continue;
    ASSERT_EQ(difference(a.snapshot(), b.snapshot()), "") << "step " << k;
  }
  const EpisodeStats stats = a.sim().take_stats(), same = b.sim().take_stats();
  for (size_t row = 0; row < stats.rows.size(); ++row)
    EXPECT_NEAR(stats.rows[row], same.rows[row], 1e-9 * (1 + std::abs(stats.rows[row]))) << "row " << row;
}

TEST(GridCrowds, AreThoseOfTheCpu) {
  for (const Crowd& c :
       {Crowd{1100, 903, 40, 2, 5, 5}, Crowd{2600, 2601, 300, 1, 4, 3}, Crowd{1100, 903, 40, 2, kBlocksInParts, 5}})
    play_crowd(c, [&](const SimSpec& spec, const SimOptions& options) {
      return make_emulated_grid_simulator(spec, options, ThreadOrder::shuffled, c.blocks);
    });
}

TEST(GridCrowds, KnotsAreThoseOfTheCpu) {
  for (const int blocks : {1, 2, 9, kBlocksInParts})
    play_knots(grid, [&](const SimSpec& spec, SimOptions options) {
      options.grid = true;
      return make_emulated_grid_simulator(spec, options, ThreadOrder::shuffled, blocks);
    });
}
TEST(GpuGridCrowds, KnotsAreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  play_knots(grid, [](const SimSpec& spec, SimOptions options) {
    options.grid = true;
    return make_cuda_grid_simulator(spec, options, 0);
  });
}

// On an H200, which holds 264 blocks: clusters of 2, 8 and 4 blocks, groups too large for a cluster, one and several at
// once, and groups of a block that go from world to world. Under a sanitizer fewer worlds, and so larger groups.
TEST(GpuGridCrowds, AreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  const auto play = [](const Crowd& c) {
    play_crowd(
        c, [](const SimSpec& spec, const SimOptions& options) { return make_cuda_grid_simulator(spec, options, 0); });
  };
  if (parity_is_small()) {
    for (const Crowd& c : {Crowd{150, 150, 20, 3, 0, 4}, Crowd{1100, 903, 40, 1, 0, 2}, Crowd{2600, 2601, 300, 1, 0, 1},
                           Crowd{10, 10, 12, 300, 0, 2}})
      play(c);
    return;
  }
  for (const Crowd& c : {Crowd{150, 150, 20, 3, 0, 5}, Crowd{1100, 903, 40, 2, 0, 5}, Crowd{1100, 903, 40, 50, 0, 4},
                         Crowd{2600, 2601, 300, 1, 0, 4}, Crowd{2600, 2601, 80, 5, 0, 4}, Crowd{10, 10, 12, 600, 0, 5}})
    play(c);
}

}  // namespace
}  // namespace giga::test
