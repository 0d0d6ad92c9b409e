// What a win is: elimination and waypoints, the time limit, cuts, and that nothing but the count depends on it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "core/error.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

constexpr int kLimit = 3;  // steps

/// One a side, at most kLimit steps; nobody shoots or collides.
SimSpec duel(WinRule win, bool ends_one_team_dead = true) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.waypoints = true;
  spec.params.win = win;
  spec.params.episode_ends_one_team_dead = ends_one_team_dead;
  spec.params.max_episode_length = kLimit;
  spec.params.collision_range2 = 0;
  set_damage_cone(spec.params, 0, 1);
  return spec;
}

/// Plays duels in which the test says who dies and who collects in a step.
class Duel {
 public:
  explicit Duel(const SimSpec& spec) : world_(spec, OnDone::freeze) {
    for (int i = 0; i < 2; ++i) world_.put(i, 2, static_cast<float>(3 + 4 * i));  // 3 and 7
  }

  /// A step in which the agents whose bits are set are in a waypoint, and then those of `dying` leave the map.
  Duel& step(int collecting = 0, int dying = 0) {
    WorldView& w = world_.now();
    for (int i = 0; i < 2; ++i)
      if (w.alive[i]) world_.put(i, (dying >> i & 1) ? 9.95f : 2.0f, static_cast<float>(3 + 4 * i));
    // Around both, or one of them, and as wide as the map, so that who leaves it collects first or not at all.
    const float y1 = (collecting & 1) ? 2.0f : 6.0f, y2 = (collecting & 2) ? 8.0f : 4.0f;
    const float corners[] = {0, y1, 9, y2};
    for (int k = 0; k < 4; ++k) w.waypoint[k] = corners[k];
    *w.waypoint_time = collecting ? 5 : 0;
    world_.step();
    return *this;
  }
  Duel& steps(int count) {
    for (int k = 0; k < count; ++k) step();
    return *this;
  }
  Outcome outcome() { return *world_.now().outcome; }
  /// Of the finished episode, by its statistics; open while it runs.
  Outcome counted() {
    if (world_.stat(EpisodeStat::episodes) == 0) return Outcome::open;
    EXPECT_EQ(world_.stat(EpisodeStat::wins_0) + world_.stat(EpisodeStat::wins_1) + world_.stat(EpisodeStat::ties),
              1.0f);
    if (world_.stat(EpisodeStat::ties) > 0) return Outcome::tie;
    return world_.stat(EpisodeStat::wins_0) > 0 ? Outcome::team_0 : Outcome::team_1;
  }
  float score(int team) { return world_.stat(of_team(EpisodeStat::score_0, team)); }

 private:
  TestWorld world_;
};

constexpr int kTeam0 = 1, kTeam1 = 2, kBoth = 3;  // bits of agents
constexpr WinRule kElimination{}, kWaypoints{WinBy::waypoints, LimitWinner::tie};
constexpr WinRule kHiders{WinBy::elimination, LimitWinner::team_1};
constexpr WinRule kWaypointsOrLimit{WinBy::waypoints, LimitWinner::team_1};

TEST(SimWin, ByEliminationTheTimeLimitIsATie) {
  Duel d(duel(kElimination));
  EXPECT_EQ(d.step(kTeam0).step(kTeam0).counted(), Outcome::open);
  EXPECT_EQ(d.outcome(), Outcome::open);
  EXPECT_EQ(d.step().counted(), Outcome::tie) << "whatever was collected";
  EXPECT_EQ(d.outcome(), Outcome::tie);
  EXPECT_EQ(d.score(0), 2.0f);
}

TEST(SimWin, ByEliminationTheFirstWipeOutDecides) {
  Duel d(duel(kElimination, false));
  d.step(0, kTeam1);
  EXPECT_EQ(d.outcome(), Outcome::team_0) << "decided while the episode goes on";
  EXPECT_EQ(d.counted(), Outcome::open);
  EXPECT_EQ(d.step(0, kTeam0).counted(), Outcome::team_0);
  EXPECT_EQ(Duel(duel(kElimination)).step(0, kBoth).counted(), Outcome::tie);
}

// Before there was `at_time_limit` a hider won where the seekers died, and nowhere else.
TEST(SimWin, HidersWinAtTheTimeLimit) {
  EXPECT_EQ(Duel(duel(kHiders)).steps(kLimit).counted(), Outcome::team_1);
  EXPECT_EQ(Duel(duel({WinBy::elimination, LimitWinner::team_0})).steps(kLimit).counted(), Outcome::team_0);
  EXPECT_EQ(Duel(duel(kHiders)).steps(kLimit - 1).outcome(), Outcome::open) << "not before";
}

TEST(SimWin, SeekersWinWhereAllHidersAreCaught) {
  EXPECT_EQ(Duel(duel(kHiders)).step(0, kTeam1).counted(), Outcome::team_0);
  EXPECT_EQ(Duel(duel(kHiders)).steps(kLimit - 1).step(0, kTeam1).counted(), Outcome::team_0) << "in the last step";
  EXPECT_EQ(Duel(duel(kHiders)).step(0, kTeam0).counted(), Outcome::team_1) << "the seekers flew out";
  EXPECT_EQ(Duel(duel(kHiders)).steps(kLimit - 1).step(0, kBoth).counted(), Outcome::tie) << "nobody is left to win";
  // Where the episode goes on until the limit, what was decided stays so.
  EXPECT_EQ(Duel(duel(kHiders, false)).step(0, kTeam1).steps(kLimit - 1).counted(), Outcome::team_0);
}

TEST(SimWin, ByWaypointsMoreAreAWin) {
  EXPECT_EQ(Duel(duel(kWaypoints)).step(kTeam1).steps(kLimit - 1).counted(), Outcome::team_1);
  EXPECT_EQ(Duel(duel(kWaypoints)).step(kTeam1).step(kTeam0).step(kTeam0).counted(), Outcome::team_0)
      << "1 against 2, the last one in the last step";
  EXPECT_EQ(Duel(duel(kWaypoints)).step(kTeam1).step(kTeam0).step().counted(), Outcome::tie) << "1 each";
  EXPECT_EQ(Duel(duel(kWaypoints)).steps(kLimit).counted(), Outcome::tie) << "none";
  EXPECT_EQ(Duel(duel(kWaypoints)).step(kTeam0).outcome(), Outcome::open) << "decided at the end only";
}

TEST(SimWin, AWaypointInWhichBothTeamsAreCountsForBoth) {
  Duel d(duel(kWaypoints));
  d.step(kBoth).step(kTeam0).step(kBoth);
  EXPECT_EQ(d.score(0), 3.0f);
  EXPECT_EQ(d.score(1), 2.0f);
  EXPECT_EQ(d.counted(), Outcome::team_0);
}

TEST(SimWin, ByWaypointsTheDeadMayBeAhead) {
  // Team 0 collects one and dies; the other team, alone, collects none, one, or two.
  EXPECT_EQ(Duel(duel(kWaypoints, false)).step(kTeam0, 0).step(0, kTeam0).step().counted(), Outcome::team_0);
  EXPECT_EQ(Duel(duel(kWaypoints, false)).step(kTeam0, 0).step(0, kTeam0).step(kTeam1).counted(), Outcome::tie);
  SimSpec longer = duel(kWaypoints, false);
  longer.params.max_episode_length = 4;
  EXPECT_EQ(Duel(longer).step(kTeam0, 0).step(0, kTeam0).step(kTeam1).step(kTeam1).counted(), Outcome::team_1);
  // Where a wipe-out ends the episode, waypoints decide it all the same.
  Duel d(duel(kWaypoints));
  EXPECT_EQ(d.step(kTeam0).step(0, kTeam0).counted(), Outcome::team_0);
  EXPECT_EQ(Duel(duel(kWaypoints)).step(0, kTeam0).counted(), Outcome::tie) << "none each";
  EXPECT_EQ(Duel(duel(kWaypoints)).step(kTeam1).step(0, kBoth).counted(), Outcome::team_1);
}

TEST(SimWin, ByWaypointsTheTimeLimitDecidesBetweenEquals) {
  EXPECT_EQ(Duel(duel(kWaypointsOrLimit)).step(kBoth).steps(kLimit - 1).counted(), Outcome::team_1);
  EXPECT_EQ(Duel(duel(kWaypointsOrLimit)).step(kTeam0).steps(kLimit - 1).counted(), Outcome::team_0);
  EXPECT_EQ(Duel(duel(kWaypointsOrLimit)).step(0, kTeam0).counted(), Outcome::tie) << "the limit did not come";
}

TEST(SimWin, ACutIsNoTimeLimit) {
  SimSpec spec = duel(kHiders);
  const auto rule_and_length = [](const SimSpec& s) {
    return std::pair{s.params.win.at_time_limit, s.params.max_episode_length};
  };
  EXPECT_EQ(rule_and_length(spec.cut_off_after(2)), (std::pair{LimitWinner::tie, 2}));
  EXPECT_EQ(rule_and_length(spec.cut_off_after(kLimit)), (std::pair{LimitWinner::team_1, kLimit}));
  EXPECT_EQ(rule_and_length(spec.with_time_limit()), (std::pair{LimitWinner::team_1, kLimit}));
  EXPECT_EQ(Duel(spec.cut_off_after(2)).steps(2).counted(), Outcome::tie);
  EXPECT_EQ(Duel(duel(kWaypointsOrLimit).cut_off_after(2)).step(kTeam0).step().counted(), Outcome::team_0)
      << "the score is the score";
  spec.params.max_episode_length = 0;
  EXPECT_EQ(rule_and_length(spec.with_time_limit()), (std::pair{LimitWinner::tie, kEpisodeLimit}));
}

/// Zeroes what may depend on the rule: the outcome, and wins and ties in the statistics.
Snapshot without_wins(Snapshot snapshot) {
  for (SnapshotField& field : snapshot.fields) {
    if (field.name == "outcome") std::fill(field.bytes.begin(), field.bytes.end(), uint8_t{0});
    if (field.name != "stats") continue;
    for (size_t world = 0; world < snapshot.n_worlds; ++world)
      for (const EpisodeStat s : {EpisodeStat::wins_0, EpisodeStat::wins_1, EpisodeStat::ties})
        std::memset(&field.bytes[(world * kNStatRows + static_cast<size_t>(s)) * sizeof(float)], 0, sizeof(float));
  }
  return snapshot;
}

// All rules, rewards and observations of the random scenarios, `original` and game_won among them.
TEST(SimWin, NothingElseDependsOnIt) {
  int outcomes_differ = 0, originals = 0;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    SimSpec spec = random_spec(seed, 2, 3);
    spec.params.waypoints = true;
    spec.params.reward_weight[static_cast<int>(RewardTerm::game_won)] = 7;
    originals += spec.params.original();
    SimOptions options;
    options.n_worlds = 5;
    options.seed = seed;
    options.n_threads = 1;
    spec.params.win = kElimination;
    SimRunner one(make_cpu_simulator(spec, options));
    spec.params.win = kWaypointsOrLimit;
    SimRunner other(make_cpu_simulator(spec, options));
    one.start();
    other.start();
    for (uint64_t k = 0; k < 40; ++k) {
      one.step(k);
      other.step(k);
      const Snapshot a = one.snapshot(), b = other.snapshot();
      ASSERT_EQ(difference(without_wins(a), without_wins(b)), "") << "seed " << seed << ", step " << k;
      outcomes_differ += !difference(a, b).empty();
    }
  }
  EXPECT_GT(outcomes_differ, 100);
  EXPECT_GT(originals, 5);
}

}  // namespace
}  // namespace giga::test
