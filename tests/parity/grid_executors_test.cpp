// What the GPU back end does with worlds of many agents, on a GPU and by emulation, against the CPU's grid, bit for
// bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <tuple>
#include <utility>

#include "cuda/runtime.hpp"
#include "parity/emulated_simulator.hpp"
#include "parity/grid_cases.hpp"
#include "sim/grid_memory.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// Who runs the threads of the GPU back end, held against the CPU's grid.
enum class Executor { gpu, emulated };
class GridExecutors : public ::testing::TestWithParam<std::tuple<Executor, Case>> {
 protected:
  void SetUp() override {
    if (executor_ == Executor::gpu && cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  }
  std::unique_ptr<Simulator> other(const SimSpec& spec, SimOptions options, int variant) const {
    options.pairs = Pairs::by_place;
    // A fourth of the variants in launches of many.
    if (executor_ == Executor::gpu && variant % 4 == 3) return make_cuda_grid_simulator(spec, options, 0, nullptr, 1);
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
    const auto note = [&](const Snapshot& now) {
      shots += std::ranges::count_if(now.field("tracked").bytes, [](uint8_t t) { return t > 0; });
      dead += std::ranges::count(now.field("alive").bytes, 0);
      ended += std::ranges::count_if(now.field("done").bytes, [](uint8_t d) { return d > 0; });
    };
    ASSERT_NO_FATAL_FAILURE(expect_same_steps(a, b, case_.n_steps, variant, note));
    expect_same_stats(a.sim().take_stats(), b.sim().take_stats());
  }
  if (case_.n_team_0 < 7 || (executor_ == Executor::gpu && parity_is_small())) return;
  EXPECT_GT(shots, 0);
  EXPECT_GT(dead, 0);
  EXPECT_GT(ended, 0);
}

// Worlds that end one after the other, one or several episodes each, and lists of those that still play.
TEST_P(GridExecutors, WorldsThatFreeze) {
  for (const auto& [variant, episodes] : {std::pair{0, 1}, {4, 1}, {1, 3}, {5, 2}, {3, 2}}) {
    SimSpec spec = variant_of(case_, variant);
    spec.params.max_episode_length = std::max(1, case_.n_steps / episodes);
    SimOptions options = options_of(variant);
    options.on_done = OnDone::freeze;
    options.episodes = episodes;
    const Outputs outputs = variant == 4 ? Outputs::in_mirror : Outputs::observations;
    SimRunner a(grid(spec, options), outputs), b(other(spec, options, variant), outputs);
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
/// agents, of more than one group. Eight rewards are paid, so that a team has ten sums, and 64 threads have room for
/// nine at a time (GridLanes::sum_rows).
SimSpec crowd(int n_team_0, int n_team_1, float limit, int episode) {
  SimSpec spec = plain_spec(n_team_0, n_team_1);
  spec.params.limit_x = spec.params.limit_y = limit;
  spec.params.actions = ActionKind::discrete;
  spec.params.stochastic_detection = spec.params.stochastic_communication = true;
  spec.params.max_episode_length = episode;
  spec.params.min_tracking_time = 0;
  spec.params.damage_per_second = 5;
  for (const RewardTerm term : {RewardTerm::detection, RewardTerm::damage, RewardTerm::collision_agent})
    set_reward(spec, term, 1.5f);
  for (const RewardTerm term : {RewardTerm::defeat_one_opponent, RewardTerm::idle, RewardTerm::agent_disabled,
                                RewardTerm::collision_obstacle, RewardTerm::game_won})
    set_reward(spec, term, 1);
  const float far = limit - 2;
  spec.maps[0].start[0] = {2, 2, far, far, 0, 5, 0, 6};
  spec.maps[0].start[1] = {2, 2, far, far, 0, 5, 0, 6};
  spec.finish();
  return spec;
}

/// What a crowd is like: one whose scenario is mostly constants of the compiler's (PlainCrowd), or one that runs the
/// general code.
enum class CrowdKind {
  plain,
  obstacles,  ///< boxes that hide, altitude that counts, waypoints, the egocentric view, types, continuous actions
  certain     ///< nothing is left to chance: each agent sees all of its team; reward for approach, which looks too
};
SimSpec crowd_of(CrowdKind kind, int n_team_0, int n_team_1, float limit, int episode) {
  SimSpec spec = crowd(n_team_0, n_team_1, limit, episode);
  if (kind == CrowdKind::plain) return spec;
  SimParams& p = spec.params;
  if (kind == CrowdKind::certain) {
    p.stochastic_detection = p.stochastic_communication = false;
    set_reward(spec, RewardTerm::approach, 1);
  } else {
    p.actions = ActionKind::continuous;
    p.obstacle_heights = p.obstacles_block_sight = p.sight_3d = p.egocentric_view = p.waypoints = true;
    p.waypoint_size = limit / 2;  // some agents are in it wherever it appears
    set_reward(spec, RewardTerm::hit_waypoint, 1);
    spec.maps[0].boxes = {{8, 8, 12, 15, 0, 4}, {25, 20, 33, 23, 2, 9}};
    for (size_t i = 0; i < spec.agents.size(); ++i) {
      spec.agents[i].sprite = i % 5 == 0 ? 3 : 1;
      spec.agents[i].range = i % 3 == 0 ? 2.0f : 1.0f;
      spec.agents[i].damage_range = i % 7 == 0 ? 0.0f : 1.0f;
    }
  }
  spec.finish();
  return spec;
}

/// By which a waypoint appears in the first step of world 0: its draw is below 0.05.
constexpr uint64_t kSeedOfWaypoint = 14;

struct Crowd {
  int n_team_0, n_team_1;
  float limit;
  int worlds, blocks, steps;
  OnDone on_done = OnDone::reset;
  int episodes = 1;  // of a world, with OnDone::freeze
  CrowdKind kind = CrowdKind::plain;
};
void play_crowd(const Crowd& c, const std::function<std::unique_ptr<Simulator>(const SimSpec&, SimOptions)>& other) {
  constexpr int64_t kMostPairs = 40'000'000;
  const SimSpec spec = crowd_of(c.kind, c.n_team_0, c.n_team_1, c.limit, 3);
  const float reach[kNTeams] = {1, 1};
  EXPECT_EQ(PlainCrowd::fits(GridParams(spec.params, reach, 1)), c.kind == CrowdKind::plain);
  SimOptions options;
  options.n_worlds = c.worlds;
  options.pairs = Pairs::by_place;
  options.on_done = c.on_done;
  options.episodes = c.episodes;
  options.seed = c.kind == CrowdKind::obstacles ? kSeedOfWaypoint : 0;
  const Outputs outputs = c.on_done == OnDone::freeze ? Outputs::observations : Outputs::all;
  SimRunner a(grid(spec, options), outputs, SimRunner::kZerosBehind);
  SimRunner b(other(spec, options), outputs, SimRunner::kZerosBehind);
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
  const EpisodeStats stats = a.sim().take_stats();
  expect_same_stats(stats, b.sim().take_stats());
  if (c.steps < 3 || c.on_done == OnDone::keep) return;  // no episode ends
  for (const EpisodeStat sum : {EpisodeStat::return_0, EpisodeStat::return_1, EpisodeStat::return_masked_0})
    EXPECT_NE(stats[sum], 0) << "what agents get has to be compared";
  if (c.kind == CrowdKind::plain) return;
  EXPECT_EQ(stats[EpisodeStat::episodes], c.worlds * (c.steps / 3));
  EXPECT_GT(stats[EpisodeStat::deaths_damage_0], 0);
  EXPECT_GT(stats[EpisodeStat::deaths_agent_1], 0);
  if (c.kind == CrowdKind::certain) return;
  EXPECT_GT(stats[EpisodeStat::deaths_obstacle_0], 0);
  EXPECT_GT(stats[EpisodeStat::score_0], 0);
}

TEST(GridCrowds, AreThoseOfTheCpu) {
  for (const Crowd& c :
       {Crowd{1100, 903, 40, 2, 5, 5}, Crowd{2600, 2601, 300, 1, 4, 3}, Crowd{1100, 903, 40, 2, kBlocksInParts, 5},
        // Four lanes for each agent, which are a crew, and two, so that 16 of a warp look for others (spread_over).
        Crowd{40, 30, 20, 1, 9, 5}, Crowd{40, 30, 20, 1, 5, 5}, Crowd{20, 13, 12, 1, kBlocksInParts, 5},
        // Two launches, of one world and of two.
        Crowd{40, 30, 20, 1, kBlocksToSpare, 5}, Crowd{20, 13, 12, 2, kBlocksToSpare, 5},
        // Without room to sort: near each other, with a fight and half a warp that looks, and far apart.
        Crowd{40, 30, 20, 1, kBlocksForMore, 5}, Crowd{40, 30, 90, 1, kBlocksForMore, 5},
        Crowd{20, 13, 12, 2, kBlocksForMore, 5},
        // Sums of several blocks, the last of which adds them up, and crews that see to two agents: 1,200 are more than
        // 128 for each of the blocks.
        Crowd{700, 500, 30, 1, kBlocksForMore, 2}})
    play_crowd(c, [&](const SimSpec& spec, const SimOptions& options) {
      return make_emulated_grid_simulator(spec, options, ThreadOrder::shuffled, c.blocks);
    });
}

// Blocks that sort together, a step in five launches, and blocks that sort for themselves: 1,200 agents of some 33
// bytes find room in 64 KiB, 2,003 do not.
const Crowd kGeneralCrowds[] = {
    {1100, 903, 40, 2, 5, 3, OnDone::reset, 1, CrowdKind::obstacles},
    {1100, 903, 40, 1, kBlocksInParts, 3, OnDone::reset, 1, CrowdKind::obstacles},
    {700, 500, 30, 1, 5, 3, OnDone::reset, 1, CrowdKind::certain},
};
TEST(GridCrowds, GeneralOnesAreThoseOfTheCpu) {
  for (const Crowd& c : kGeneralCrowds)
    play_crowd(c, [&](const SimSpec& spec, const SimOptions& options) {
      return make_emulated_grid_simulator(spec, options, ThreadOrder::shuffled, c.blocks);
    });
}

// By one worker for each agent, and by crews that put their lists together (NewFire::gather); in one launch and in
// several.
TEST(GridCrowds, AListOfFireThatIsTooShortIsAnError) {
  const float reach[kNTeams] = {1, 1};
  EXPECT_TRUE(PlainCrowd::fits(GridParams(two_under_fire().params, reach, 1)));
  for (const int blocks : {1, 2, 9, kBlocksInParts, kBlocksToSpare, kBlocksForMore})
    expect_full_lists_tell([&](const SimSpec& spec, const SimOptions& options) {
      return make_emulated_grid_simulator(spec, options, ThreadOrder::shuffled, blocks);
    });
}
TEST(GpuGridCrowds, AListOfFireThatIsTooShortIsAnError) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  for (const int in_parts : {0, 1, kInParts})
    expect_full_lists_tell([&](const SimSpec& spec, const SimOptions& options) {
      return make_cuda_grid_simulator(spec, options, 0, nullptr, in_parts);
    });
}

// Episodes of three steps: worlds that wait, that play several episodes, that nobody resets.
TEST(GridCrowds, InSeveralLaunchesTheyEndAsThoseOfTheCpu) {
  constexpr std::pair<int, float> kOfLimit[] = {
      {kBlocksInParts, 20}, {kBlocksToSpare, 20}, {kBlocksForMore, 20}, {kBlocksForMore, 90}};
  for (const auto& [blocks, limit] : kOfLimit)
    for (const auto& [on_done, episodes] : {std::pair{OnDone::freeze, 1}, {OnDone::freeze, 2}, {OnDone::keep, 1}})
      play_crowd({40, 30, limit, 1, blocks, 8, on_done, episodes},
                 [blocks = blocks](const SimSpec& spec, const SimOptions& options) {
                   return make_emulated_grid_simulator(spec, options, ThreadOrder::shuffled, blocks);
                 });
}

// Which launches a world has, so that the tests above are of what they say.
TEST(GridCrowds, LaunchesByTheirSize) {
  const auto launches = [](int n_team_0, int n_team_1, int worlds, int blocks) {
    SimOptions options;
    options.n_worlds = worlds;
    options.pairs = Pairs::by_place;
    return emulated_launches(crowd(n_team_0, n_team_1, 20, 3), options, blocks);
  };
  EXPECT_EQ(launches(40, 30, 1, 9), StepLaunches::one) << "from no number on are they several";
  EXPECT_EQ(launches(40, 30, 1, kBlocksInParts), StepLaunches::of_many);
  EXPECT_EQ(launches(40, 30, 2, kBlocksInParts), StepLaunches::of_many);
  EXPECT_EQ(launches(20, 13, 9, kBlocksInParts), StepLaunches::one) << "9 worlds of at least a block each, 8 blocks";
  EXPECT_EQ(launches(40, 30, 1, kBlocksToSpare), StepLaunches::of_few) << "4 x 70 threads are 9 blocks of 32";
  EXPECT_EQ(launches(20, 13, 6, kBlocksToSpare), StepLaunches::of_few) << "6 x 5 of 64 blocks";
  EXPECT_EQ(launches(20, 13, 7, kBlocksToSpare), StepLaunches::one) << "7 x 5 of 64 blocks are more than half";
  EXPECT_EQ(launches(40, 30, 1, kBlocksForMore), StepLaunches::of_more) << "no room to sort";
  EXPECT_EQ(launches(20, 13, 2, kBlocksForMore), StepLaunches::of_more);
  EXPECT_EQ(launches(32768, 9, 1, kBlocksForMore), StepLaunches::of_more) << "512 blocks of 64 are added up at once";
  EXPECT_EQ(launches(32769, 9, 1, kBlocksForMore), StepLaunches::one);
}
// Reaches of 8 to hear and 8 or 3 to see: 70 x 11 x 11 = 8,470 and more are above 4 x 20 x 20 = 1,600, 70 x 16 x 16 =
// 17,920 are below 4 x 90 x 90 = 32,400.
TEST(GridCrowds, AreCrowdedOnSmallMaps) {
  const auto crowded = [](float limit) {
    const float widest[kNTeams] = {1, 1};
    return is_crowded(GridParams(crowd(40, 30, limit, 3).params, widest, 1));
  };
  EXPECT_TRUE(crowded(20));
  EXPECT_FALSE(crowded(90));
}

// On 132 multiprocessors, with room for 8 clusters of 16 blocks of 512 threads.
TEST(GridCrowds, ClustersGiveEachAgentACrewWhereTheyCan) {
  const auto shape = [](int n_agents, int n_worlds) {
    const GridLaunchShape s = grid_launch_shape(n_agents, n_worlds, {512, 132, 16});
    return std::tuple{s.groups, s.blocks, s.clustered, s.lanes_of_agent(n_agents, 512)};
  };
  EXPECT_EQ(shape(1025, 1), (std::tuple{1, 16, true, 4})) << "4 x 1,025 threads are 9 blocks";
  EXPECT_EQ(shape(1025, 8), (std::tuple{8, 16, true, 4}));
  EXPECT_EQ(shape(1025, 9), (std::tuple{9, 8, true, 1})) << "9 clusters of 16 find no room";
  EXPECT_EQ(shape(2048, 1), (std::tuple{1, 16, true, 4}));
  EXPECT_EQ(shape(2049, 1), (std::tuple{1, 17, false, 4})) << "no cluster has as many threads";
  EXPECT_EQ(shape(3000, 4), (std::tuple{4, 24, false, 4})) << "96 of 132 blocks";
  EXPECT_EQ(shape(3000, 8), (std::tuple{8, 16, true, 1})) << "16 blocks for each";
}

TEST(GridCrowds, KnotsAreThoseOfTheCpu) {
  for (const int blocks : {1, 2, 9, kBlocksInParts, kBlocksToSpare, kBlocksForMore}) {
    const auto emulated = [&](const SimSpec& spec, SimOptions options) {
      options.pairs = Pairs::by_place;
      return make_emulated_grid_simulator(spec, options, ThreadOrder::shuffled, blocks);
    };
    const bool crews = blocks == kBlocksToSpare || blocks == kBlocksForMore;
    play_knots(grid, emulated, crews ? 110 : kMostInKnots);  // crews of hundreds are too many fibers
  }
}
TEST(GpuGridCrowds, KnotsAreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  play_knots(grid, [](const SimSpec& spec, SimOptions options) {
    options.pairs = Pairs::by_place;
    return make_cuda_grid_simulator(spec, options, 0);
  });
}

// On an H200, which holds 132 blocks: clusters of 2 and of 16 blocks, groups too large for a cluster, one and several
// at once, and groups of a block that go from world to world. Under a sanitizer fewer worlds, and so larger groups.
TEST(GpuGridCrowds, AreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  const auto play = [](const Crowd& c) {
    play_crowd(
        c, [](const SimSpec& spec, const SimOptions& options) { return make_cuda_grid_simulator(spec, options, 0); });
  };
  if (parity_is_small()) {
    for (const Crowd& c : {Crowd{150, 150, 20, 3, 0, 4}, Crowd{1100, 903, 40, 1, 0, 2}, Crowd{2600, 2601, 300, 1, 0, 1},
                           Crowd{10, 10, 12, 300, 0, 2}, Crowd{4000, 4001, 130, 1, 0, 1}})
      play(c);
    return;
  }
  for (const Crowd& c :
       {Crowd{150, 150, 20, 3, 0, 5}, Crowd{1100, 903, 40, 2, 0, 5}, Crowd{1100, 903, 40, 50, 0, 4},
        Crowd{2600, 2601, 300, 1, 0, 4}, Crowd{2600, 2601, 80, 5, 0, 4}, Crowd{3000, 3101, 80, 1, 0, 3},
        Crowd{3000, 3101, 3000, 1, 0, 3}, Crowd{9000, 9001, 150, 1, 0, 3}, Crowd{9000, 9001, 3000, 1, 0, 2},
        Crowd{10, 10, 12, 600, 0, 5},
        // Beyond 65,536 agents, in five launches.
        Crowd{40000, 40001, 300, 1, 0, 3}})
    play(c);
}

// The general code, in a cluster and in five launches.
TEST(GpuGridCrowds, GeneralOnesAreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  for (const Crowd& c : kGeneralCrowds) {
    Crowd played = c;
    if (parity_is_small()) played.worlds = 1, played.steps = 2;
    play_crowd(played, [&](const SimSpec& spec, const SimOptions& options) {
      return make_cuda_grid_simulator(spec, options, 0, nullptr, c.blocks == kBlocksInParts ? 1 : kInParts);
    });
  }
}

// Small enough for every sanitizer: worlds with crews that leave most of the GPU to the launches that follow, of one
// block and of a cluster.
TEST(GpuGridCrowds, FewAreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  for (const Crowd& c : {Crowd{40, 30, 20, 1, 0, 5}, Crowd{150, 100, 30, 1, 0, 4}})
    play_crowd(
        c, [](const SimSpec& spec, const SimOptions& options) { return make_cuda_grid_simulator(spec, options, 0); });
}

// A step in five launches, as large worlds have it: in one cluster, and in more blocks than fit into one.
TEST(GpuGridCrowds, InPartsAreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  const auto in_parts = [](const SimSpec& spec, SimOptions options) {
    options.pairs = Pairs::by_place;
    return make_cuda_grid_simulator(spec, options, 0, nullptr, 1);
  };
  play_knots(grid, in_parts);
  for (const Crowd& c : {Crowd{1100, 903, 40, 2, 0, 5}, Crowd{2600, 2601, 300, 1, 0, 4}}) {
    if (parity_is_small() && c.n_team_0 > 2000) continue;
    play_crowd(c, in_parts);
  }
}

// In one launch, of a cluster and of more blocks than fit into one, and in five; with worlds that freeze as matches
// have them.
TEST(GpuGridRecorded, StepsAreThoseQueuedOneByOne) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  struct Recorded {
    Crowd crowd;
    int in_parts;
    OnDone on_done;
  };
  for (const Recorded& r :
       {Recorded{{150, 150, 20, 3, 0, 0}, 0, OnDone::reset}, Recorded{{150, 150, 20, 3, 0, 0}, 0, OnDone::freeze},
        Recorded{{2600, 2601, 300, 1, 0, 0}, 0, OnDone::reset}, Recorded{{1100, 903, 40, 1, 0, 0}, 1, OnDone::reset},
        Recorded{{1100, 903, 40, 1, 0, 0}, kInParts, OnDone::reset},
        Recorded{{3000, 3101, 80, 1, 0, 0}, kInParts, OnDone::reset},
        Recorded{{3000, 3101, 3000, 1, 0, 0}, kInParts, OnDone::reset},
        Recorded{{1100, 903, 40, 2, 0, 0}, kInParts, OnDone::freeze}}) {
    const SimSpec spec = crowd(r.crowd.n_team_0, r.crowd.n_team_1, r.crowd.limit, 3);
    SimOptions options;
    options.n_worlds = r.crowd.worlds;
    options.pairs = Pairs::by_place;
    options.on_done = r.on_done;
    const auto runner = [&] {
      return SimRunner(make_cuda_grid_simulator(spec, options, 0, work_stream(0), r.in_parts), Outputs::observations);
    };
    SimRunner queued = runner(), replayed = runner();
    for (SimRunner* all : {&queued, &replayed}) {
      all->start();
      all->step(0);
    }
    const std::unique_ptr<RecordedWork> recorded = replayed.record_step();
    ASSERT_NE(recorded, nullptr);
    for (int k = 0; k < 7; ++k) {
      queued.sim().begin_steps(1);
      queued.queue_step();
      replayed.sim().begin_steps(1);
      recorded->queue();
    }
    queued.sim().synchronize();
    replayed.sim().synchronize();
    EXPECT_TRUE(queued.sim().state().save() == replayed.sim().state().save())
        << r.crowd.n_team_0 << " v " << r.crowd.n_team_1 << ", in parts from " << r.in_parts;
    expect_same_stats(queued.sim().take_stats(), replayed.sim().take_stats());
  }
}

}  // namespace
}  // namespace giga::test
