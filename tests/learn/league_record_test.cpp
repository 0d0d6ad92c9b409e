// Mappo with frozen opponents: how games against past policies and scripts count, and what is logged of them.
#include <gtest/gtest.h>

#include <cmath>

#include "league_games.hpp"

namespace giga::test {
namespace {

TEST(LearnLeague, GamesAgainstPastPoliciesCountFromTheirDrawOn) {
  LeagueGames games(with_opponents("pool_size: 2, pool_every_updates: 2, pool_share: 0.4, scripted_share: 0.2"));
  // Worlds: 0 and 1 scripts, 2 to 5 the pool of team 1; 18 to 21 the pool of team 0, 22 and 23 scripts.
  ASSERT_EQ(games.shares.pool(0), (ShardRange{{2, 4}, 24}));
  ASSERT_EQ(games.shares.pool(1), (ShardRange{{18, 4}, 24}));
  Simulator& sim = *games.sim;
  const auto counted = [&] {
    games.league.count(sim);
    sim.take_stats();
    EpisodeStats self_play;
    std::array<LeagueRecord, kNTeams> record;
    games.league.read(self_play, record);
    return std::pair{self_play, record};
  };
  for (int w = 0; w < kSmallRunWorlds; ++w) sim.state().view().episode_length[w] = w == 3 ? 0 : 5;
  sim.take_stats();
  games.league.end(2, sim);  // one policy of each team is kept and drawn
  games.league.begin();
  set_stats(sim, 0, {3, 1, 0, 2});   // scripts of team 0
  set_stats(sim, 2, {1, 1, 0, 0});   // began before its opponent was drawn
  set_stats(sim, 3, {2, 1, 0, 1});   // began with it
  set_stats(sim, 10, {4, 1, 2, 1});  // self-play
  set_stats(sim, 23, {2, 0, 1, 1});  // scripts of team 1
  const auto [self_play, record] = counted();
  EXPECT_EQ(self_play[EpisodeStat::episodes], 4);
  EXPECT_EQ(self_play[EpisodeStat::wins_1], 2);
  EXPECT_EQ(record[0].pool.episodes, 2);
  EXPECT_EQ(record[0].pool.wins, 1);
  EXPECT_EQ(record[0].pool.ties, 1);
  EXPECT_EQ(record[0].scripts.win_rate(), 1 / 3.0);
  EXPECT_EQ(record[1].pool.episodes, 0);
  EXPECT_EQ(record[1].scripts.win_rate(), 1 / 2.0);
  // The next games of worlds 2 and 20 have the same opponent from start to end; that of world 20 is its first to end.
  set_stats(sim, 2, {1, 0, 1, 0});
  set_stats(sim, 20, {1, 0, 1, 0});
  EXPECT_EQ(counted().second[0].pool.episodes, 1);
  set_stats(sim, 20, {1, 0, 1, 0});
  EXPECT_EQ(counted().second[1].pool.wins, 1);
  // Against policy 1 of team 1: 3 games, 1 win, 1 tie; of team 0: one game, won.
  NamedArrays arrays;
  games.league.save("", arrays);
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_1/games")), (std::vector<double>{3, 0}));
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_1/wins")), (std::vector<double>{1.5, 0}));
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_0/games")), (std::vector<double>{1, 0}));
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_0/wins")), (std::vector<double>{1, 0}));
}

// Two shards of 12 worlds: 0 to 2 scripts of team 0, 3 and 4 the pool of team 1, a policy each, 7 and 8 the pool of
// team 0, 9 to 11 scripts of team 1; the second shard likewise from 12 on.
TEST(LearnLeague, GamesOfAllShardsCount) {
  LeagueGames games(with_opponents("pool_size: 2, pool_every_updates: 1, pool_share: 0.4, scripted_share: 0.5"), 2);
  ASSERT_EQ(games.shares.pool(1), (ShardRange{{7, 2}, 12, 2}));
  Simulator& sim = *games.sim;
  std::fill_n(sim.state().view().episode_length, kSmallRunWorlds, 0);  // all games begin with their opponents
  games.league.end(1, sim);
  games.league.begin();
  set_stats(sim, 0, {1, 1, 0, 0});  // scripts of team 0, in both shards
  set_stats(sim, 14, {2, 1, 1, 0});
  set_stats(sim, 3, {1, 0, 1, 0});  // its pool, in both
  set_stats(sim, 16, {3, 2, 0, 1});
  set_stats(sim, 5, {5, 1, 1, 3});  // self-play, in both
  set_stats(sim, 18, {2, 0, 2, 0});
  set_stats(sim, 20, {4, 1, 3, 0});  // the pool of team 1
  set_stats(sim, 23, {2, 0, 2, 0});  // its scripts
  games.league.count(sim);
  EpisodeStats self_play;
  std::array<LeagueRecord, kNTeams> record;
  games.league.read(self_play, record);
  EXPECT_EQ(self_play[EpisodeStat::episodes], 7);
  EXPECT_EQ(record[0].scripts.episodes, 3);
  EXPECT_EQ(record[0].scripts.wins, 2);
  EXPECT_EQ(record[0].pool.episodes, 4);
  EXPECT_EQ(record[0].pool.wins, 2);
  EXPECT_EQ(record[0].pool.ties, 1);
  EXPECT_EQ(record[1].pool.wins, 3);
  EXPECT_EQ(record[1].scripts.episodes, 2);
}

TEST(LearnLeague, OnlyWhatIsStrongerJoinsThePoolWhereEvidenceIsAskedFor) {
  LeagueGames games(with_opponents("pool_size: 4, pool_every_updates: 1, pool_share: 0.4, pool_promotion: evidence"));
  // 12 worlds of a team, 4.8 of them to four policies: worlds 0 to 3 against the pool of team 1, 20 to 23 of team 0.
  ASSERT_EQ(games.shares.pool(0), (ShardRange{{0, 4}, 24}));
  ASSERT_EQ(games.shares.pool(1), (ShardRange{{20, 4}, 24}));
  Simulator& sim = *games.sim;
  std::fill_n(sim.state().view().episode_length, kSmallRunWorlds, 0);  // all games begin with their opponents
  const auto kept = [&] {
    NamedArrays arrays;
    games.league.save("", arrays);
    std::vector<int64_t> count;
    for (const char* team : {"team_0/kept", "team_1/kept"})
      count.push_back(array_values<int64_t>(find_array(arrays, team)).at(0));
    return count;
  };
  const auto play = [&](int64_t update, std::array<float, 4> of_team_0, std::array<float, 4> of_team_1,
                        std::array<bool, kNTeams> fallen = {}) {
    games.league.begin();
    set_stats(sim, 0, of_team_0);
    set_stats(sim, 20, of_team_1);
    games.league.count(sim);
    sim.take_stats();
    EpisodeStats self_play;
    std::array<LeagueRecord, kNTeams> record;
    games.league.read(self_play, record);
    games.league.end(update, sim, fallen);
  };
  play(1, {}, {});
  EXPECT_EQ(kept(), (std::vector<int64_t>{1, 1})) << "the pools were empty";
  // Team 0 wins 7 of 10: 4 more than it loses, and 1.65 sqrt(10) = 5.2 would be evidence. Team 1 wins 9 of 10.
  play(2, {10, 7, 3, 0}, {10, 1, 9, 0});
  EXPECT_EQ(kept(), (std::vector<int64_t>{1, 2}));
  NamedArrays arrays;
  games.league.save("", arrays);
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_0/games")).at(0), 5) << "halved, who joins or not";
  // 14 of 20 together: 8 more, and 1.65 sqrt(20) = 7.4.
  play(3, {10, 7, 3, 0}, {10, 5, 5, 0});
  EXPECT_EQ(kept(), (std::vector<int64_t>{2, 2}));
  // Team 0 has fallen back to what it was at an earlier turn; what it won as it was is forgotten.
  play(4, {10, 9, 1, 0}, {10, 5, 5, 0}, {true, false});
  play(5, {10, 5, 5, 0}, {10, 5, 5, 0});
  EXPECT_EQ(kept(), (std::vector<int64_t>{2, 2}));
}

/// Means of a team's figure over the updates of a run in which it is known.
std::array<double, kNTeams> mean_figures(Learner& learner, const std::string& name, int n_updates) {
  std::array<double, kNTeams> sums{};
  std::array<int, kNTeams> counts{};
  for (int u = 0; u < n_updates; ++u) {
    const Metrics metrics = learner.update();
    for (size_t team = 0; team < kNTeams; ++team) {
      const double value = metric(metrics, cat(name, "_", team));
      if (!std::isfinite(value)) continue;
      sums[team] += value;
      ++counts[team];
    }
  }
  for (size_t team = 0; team < kNTeams; ++team) sums[team] /= counts[team];
  return sums;
}

// Where nobody shoots, whoever flies straight on is the first to leave the map, and who circles never does.
TEST(LearnLeague, WinRatesTellStrongOpponentsFromWeakOnes) {
  const auto win_rates = [](const char* script) {
    SmallRun run = with_opponents(cat("scripted_share: 0.8, scripted: [", script, "]"));
    run.scenario =
        "damage: {damage_cone_depth: 0}\ncollision: {collision_range: 0}\nlimit_x: 10\nlimit_y: 10\n"
        "max_episode_length: 120\n";
    run.n_threads = 1;
    const auto learner = run.learner();
    EXPECT_EQ(learner->headline().back().metric, std::string("scripted_win_rate"));
    return mean_figures(*learner, "scripted_win_rate", 40);
  };
  const std::array<double, kNTeams> weak = win_rates("noop"), strong = win_rates("circle");
  for (size_t team = 0; team < kNTeams; ++team) {
    EXPECT_GT(weak[team], 0.3) << "team " << team;
    EXPECT_LT(strong[team], 0.1) << "team " << team;
  }
}

TEST(LearnLeague, WinRatesAgainstThePoolAreLogged) {
  // Episodes of at most 40 steps, rollouts of 8: those that begin and end between two draws count.
  const auto learner = with_opponents("pool_size: 2, pool_every_updates: 12, pool_share: 0.8").learner();
  EXPECT_TRUE(std::isnan(mean_figures(*learner, "pool_win_rate", 12)[0])) << "nothing counts while the pool is empty";
  for (const double rate : mean_figures(*learner, "pool_win_rate", 24)) {
    EXPECT_GT(rate, 0.05);
    EXPECT_LT(rate, 0.95);
  }
}

// A waypoint covers half of the world: team 0, in the middle, is in nearly every one, team 1, at the border, in one of
// fifty, and nobody dies or gets to another place. In 14 % of the episodes no waypoint appears (0.95^39).
TEST(LearnLeague, WhereWaypointsDecideTheRecordOfThePoolGoesByThem) {
  const auto play = [](const std::string& win) {
    SmallRun run = with_opponents("pool_size: 2, pool_every_updates: 12, pool_share: 0.8, pool_draw: pfsp");
    run.n_threads = 1;
    run.scenario =
        cat("limit_x: 2000\nlimit_y: 1000\nmaps: m\nmap_definitions:\n"
            "  m: {size: [2000, 1000], team_0: {area: [995, 495, 1005, 505]}, team_1: {area: [20, 495, 30, 505]}}\n"
            "team_0: [{type: default, count: 1}]\nteam_1: [{type: default, count: 1}]\n"
            "waypoints: {enable_waypoints: true, waypoint_size: 1000}\nwin: {by: ",
            win, "}\n");
    return run.learner();
  };
  // What a team has won of its games against the other's past policies, ties being half a win; as PFSP looks at it.
  const auto pool_record = [](const Learner& learner, int team) {
    const NamedArrays arrays = saved(learner);
    const auto sum = [&](const char* name) {
      double total = 0;
      for (const double x : array_values<double>(find_array(arrays, cat("league/team_", 1 - team, "/", name))))
        total += x;
      return total;
    };
    EXPECT_GT(sum("games"), 0);
    return sum("wins") / sum("games");
  };
  const auto race = play("waypoints"), survival = play("elimination");
  const std::array<double, kNTeams> rates = mean_figures(*race, "pool_win_rate", 24);
  EXPECT_GT(rates[0], 0.6);
  EXPECT_LT(rates[1], 0.1);
  EXPECT_GT(pool_record(*race, 0), 0.7);
  EXPECT_LT(pool_record(*race, 1), 0.3);
  for (const double rate : mean_figures(*survival, "pool_win_rate", 24)) EXPECT_EQ(rate, 0);
  EXPECT_EQ(pool_record(*survival, 0), 0.5) << "ties";
}

TEST(LearnLeague, ARunGoesOnWithOtherShares) {
  SmallRun run = with_opponents("pool_size: 3, pool_every_updates: 1, pool_share: 0.2");
  const auto learner = run.learner();
  for (int u = 0; u < 3; ++u) learner->update();
  const NamedArrays checkpoint = saved(*learner);
  run.more = "opponents: {pool_size: 3, pool_every_updates: 1, pool_share: 0.8, scripted_share: 0.1}\n";
  const auto other = run.learner();
  other->load(checkpoint);
  expect_finite(other->update(), 0);
  NamedArrays broken = checkpoint;
  for (NamedArray& array : broken)
    if (array.name == "league/team_1/row") array = make_array<int32_t>(array.name, {0, 4, 1});
  EXPECT_THROW(other->load(broken), InputError);  // row 4 of a pool of three
}

}  // namespace
}  // namespace giga::test
