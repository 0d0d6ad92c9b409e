// Frozen opponents: shares of the worlds, whom a pool keeps and how often it is drawn, and the records of games.
#include <gtest/gtest.h>

#include <cmath>

#include "learn/opponents/pool.hpp"
#include "learn/opponents/record.hpp"
#include "learn/opponents/world_shares.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

OpponentsConfig opponents(int pool_size, float pool_share, float scripted_share) {
  OpponentsConfig c;
  c.pool_size = pool_size;
  c.pool_share = pool_share;
  c.scripted_share = scripted_share;
  return c;
}

TEST(LearnOpponents, SharesOfTheWorlds) {
  // Half of 8,192 is 4,096: 0.1 of it is 409.6, 0.2 is 819.2, which makes 16 groups of 51 = 816 worlds.
  const WorldShares s = world_shares(opponents(16, 0.2f, 0.1f), 8192);
  EXPECT_EQ(s.scripted, 410);
  EXPECT_EQ(s.groups, 16);
  EXPECT_EQ(s.group_size, 51);
  EXPECT_EQ(s.scripts(0), (ShardRange{{0, 410}, 8192}));
  EXPECT_EQ(s.pool(0), (ShardRange{{410, 816}, 8192}));
  EXPECT_EQ(s.self_play(), (ShardRange{{1226, 5740}, 8192}));
  EXPECT_EQ(s.pool(1), (ShardRange{{6966, 816}, 8192}));
  EXPECT_EQ(s.scripts(1), (ShardRange{{7782, 410}, 8192}));
  EXPECT_EQ(s.learning(0), (ShardRange{{0, 6966}, 8192}));
  EXPECT_EQ(s.learning(1), (ShardRange{{1226, 6966}, 8192}));
  // An odd number of worlds, all against the pool: 32 for each team, of which five groups of 6 take 30.
  EXPECT_EQ(world_shares(opponents(5, 1, 0), 65).self_play(), (ShardRange{{30, 5}, 65}));
  // No more groups than worlds or kMostGroups; scripts before the pool, both to the nearest.
  EXPECT_EQ(world_shares(opponents(10, 0.25f, 0), 24).groups, 3);
  EXPECT_EQ(world_shares(opponents(1000, 0.5f, 0), 1000).groups, kMostGroups);
  EXPECT_EQ(world_shares(opponents(1, 0.5f, 0.5f), 6).scripted, 2);  // 1.5 of 3
  EXPECT_EQ(world_shares(opponents(1, 0.5f, 0.5f), 6).pooled(), 1);  // what is left
  // Neither a pool nor scripts.
  EXPECT_EQ(world_shares(opponents(0, 1, 0), 24).learning(1), (ShardRange{{0, 24}, 24}));
}

TEST(LearnOpponents, EachShardHasTheSharesOfItsWorlds) {
  // Two shards of 12 worlds; half of 12 is 6: 0.5 of it are 3 worlds against scripts, 0.4 of it are 2.4.
  const WorldShares s = world_shares(opponents(16, 0.4f, 0.5f), 24, 2);
  EXPECT_EQ(s.shard_size, 12);
  EXPECT_EQ(s.n_worlds(), 24);
  EXPECT_EQ(s.scripted, 3);
  EXPECT_EQ(s.pooled(), 2);
  EXPECT_EQ(s.learning(1).of(0), (WorldRange{5, 7}));
  EXPECT_EQ(s.learning(1).of(1), (WorldRange{17, 7}));
  EXPECT_EQ(s.learning(1).count(), 14);
  EXPECT_EQ(s.learning(1).pieces(4), (std::vector<WorldRange>{{5, 4}, {9, 3}, {17, 4}, {21, 3}}));
}

TEST(LearnOpponents, PartsOfARange) {
  EXPECT_EQ(part_of({10, 7}, 0, 3), (WorldRange{10, 2}));
  EXPECT_EQ(part_of({10, 7}, 1, 3), (WorldRange{12, 2}));
  EXPECT_EQ(part_of({10, 7}, 2, 3), (WorldRange{14, 3}));
}

/// A pool of three with policies 1 to `kept`, each one number.
OpponentPool pool_of_three(int kept) {
  OpponentPool pool(3, at::full({1}, 1.0));
  for (int k = 1; k <= kept; ++k) {
    pool.set_present(at::full({1}, static_cast<double>(k)));
    pool.keep();
  }
  pool.set_present(at::full({1}, 9.0));
  return pool;
}

TEST(LearnOpponents, ThePoolKeepsTheLatestPolicies) {
  const auto rows = [](const OpponentPool& pool) { return pool.networks().flatten(); };
  EXPECT_EQ(pool_of_three(0).size(), 0);
  EXPECT_TRUE(at::equal(rows(pool_of_three(2)), at::tensor({9.0f, 1.0f, 2.0f, 0.0f})));
  EXPECT_EQ(pool_of_three(2).size(), 2);
  EXPECT_TRUE(at::equal(rows(pool_of_three(5)), at::tensor({9.0f, 4.0f, 5.0f, 3.0f})));
  EXPECT_EQ(pool_of_three(5).size(), 3);
}

TEST(LearnOpponents, RecordsFadeAndGoWithTheirPolicy) {
  OpponentPool pool = pool_of_three(3);
  EXPECT_EQ(pool.win_rate(1), 0.5);  // half a win in one game
  pool.note(0, 100, 100);            // the present policy has no record
  for (int64_t row = 1; row <= 3; ++row) pool.note(row, 4, 3.5);
  pool.note(2, 5, 0);
  EXPECT_DOUBLE_EQ(pool.win_rate(1), 4.0 / 5);   // 3.5 + 0.5 of 4 + 1
  EXPECT_DOUBLE_EQ(pool.win_rate(2), 4.0 / 10);  // 3.5 + 0.5 of 9 + 1
  pool.keep();                                   // in row 1, the oldest
  EXPECT_EQ(pool.win_rate(1), 0.5);
  EXPECT_DOUBLE_EQ(pool.win_rate(2), 2.25 / 5.5);  // 1.75 + 0.5 of 4.5 + 1
  EXPECT_DOUBLE_EQ(pool.win_rate(3), 2.25 / 3);    // 1.75 + 0.5 of 2 + 1
}

/// Draws 20,000 times; each row must come as often as its weight says, within four deviations.
void expect_drawn(const std::vector<double>& weights, const std::vector<double>& expected) {
  constexpr int kDraws = 20'000;
  std::vector<int> drawn(expected.size() + 1);
  for (uint32_t k = 0; k < kDraws; ++k) ++drawn.at(static_cast<size_t>(draw_opponent(weights, {7, k / 16, 1}, k % 16)));
  EXPECT_EQ(drawn[0], 0);
  for (size_t k = 0; k < expected.size(); ++k) {
    const double p = expected[k];
    EXPECT_NEAR(drawn[k + 1], kDraws * p, 4 * std::sqrt(kDraws * p * (1 - p))) << "row " << k + 1;
  }
}

TEST(LearnOpponents, DrawsFollowTheWeights) {
  OpponentsConfig c;
  OpponentPool pool = pool_of_three(4);  // rows: policies 4, 2, 3
  pool.note(2, 9, 9);                    // win rates 0.5, 9.5 / 10, 1.5 / 5
  pool.note(3, 4, 1);
  EXPECT_EQ(pool.weights(c), (std::vector<double>{1, 1, 1}));
  expect_drawn(pool.weights(c), {1 / 3.0, 1 / 3.0, 1 / 3.0});

  c.pool_draw = PoolDraw::recency;
  EXPECT_EQ(pool.weights(c), (std::vector<double>{3, 1, 2}));
  expect_drawn(pool.weights(c), {3 / 6.0, 1 / 6.0, 2 / 6.0});

  c.pool_draw = PoolDraw::pfsp;
  c.pool_hardness = 2;  // 0.5^2, 0.05^2, 0.7^2: 0.25, 0.0025, 0.49 of 0.7425
  expect_drawn(pool.weights(c), {0.25 / 0.7425, 0.0025 / 0.7425, 0.49 / 0.7425});
  c.pool_hardness = 1;  // 0.5, 0.05, 0.7 of 1.25
  expect_drawn(pool.weights(c), {0.4, 0.04, 0.56});
  c.pool_hardness = 0;
  expect_drawn(pool.weights(c), {1 / 3.0, 1 / 3.0, 1 / 3.0});

  expect_drawn({0, 0}, {0.5, 0.5});               // weights too small for a number
  expect_drawn({0, 1, 0}, {0, 1, 0});             // what has no weight is not drawn
  EXPECT_EQ(draw_opponent({}, {7, 0, 0}, 0), 0);  // an empty pool: the present policy
}

TEST(LearnOpponents, GuestsStayInThePool) {
  const auto with_guests = [](std::vector<float> guests) {
    return OpponentPool(2, at::full({1}, 9.0), at::tensor(guests).view({-1, 1}));
  };
  OpponentsConfig c;
  OpponentPool pool = with_guests({7, 8});  // rows 3 and 4
  EXPECT_EQ(pool.size(), 2);
  EXPECT_EQ(pool.weights(c), (std::vector<double>{0, 0, 1, 1}));
  EXPECT_FALSE(pool.has(2));
  for (int k = 1; k <= 3; ++k) {
    pool.set_present(at::full({1}, static_cast<double>(k)));
    pool.keep();
  }
  EXPECT_TRUE(at::equal(pool.networks().flatten(), at::tensor({3.0f, 3.0f, 2.0f, 7.0f, 8.0f})));
  EXPECT_EQ(pool.size(), 4);
  c.pool_draw = PoolDraw::recency;  // the newest of two twice as often as the older one, and guests as the newest
  EXPECT_EQ(pool.weights(c), (std::vector<double>{2, 1, 2, 2}));
  c.pool_draw = PoolDraw::pfsp;
  pool.note(1, 9, 9);  // 9.5 of 10, 1.5 of 3, half a game each of the others
  pool.note(4, 2, 1);
  NamedArrays saved;
  pool.save("", saved);
  const auto weights = [&](std::vector<float> guests) {
    OpponentPool other = with_guests(std::move(guests));
    other.load("", saved);
    return other.weights(c);
  };
  EXPECT_EQ(weights({7, 8}), pool.weights(c));
  // Others in their place, or none: the past policies keep their record, guests begin with 0.5 and so 0.5^2.
  const double first = pool.weights(c)[0], second = pool.weights(c)[1];
  EXPECT_EQ(weights({7, 6}), (std::vector<double>{first, second, 0.25, 0.25}));
  EXPECT_EQ(weights({5}), (std::vector<double>{first, second, 0.25}));
  EXPECT_TRUE(with_guests({5}).load("", saved).other_guests);
  OpponentPool adopted(2, at::full({1}, 9.0));
  EXPECT_FALSE(adopted.load("", saved, true).other_guests);
  EXPECT_EQ(adopted.weights(c), pool.weights(c));
  EXPECT_TRUE(at::equal(adopted.networks().narrow(0, 1, 4), pool.networks().narrow(0, 1, 4)));
  NamedArrays broken = saved;
  broken.back() = {"guests", ArrayType::f32, {}, std::vector<uint8_t>(sizeof(float))};  // a number instead of rows
  EXPECT_THROW(with_guests({7, 8}).load("", broken), InputError);
  // Weights too small for a number: those that there are, and no empty row.
  OpponentPool beaten = with_guests({7});
  beaten.note(3, 1e9, 1e9);
  c.pool_hardness = 100;
  EXPECT_EQ(beaten.weights(c), (std::vector<double>{0, 0, 1}));
  c.pool_hardness = 2;
  OpponentPool none(2, at::full({1}, 9.0));
  none.load("", saved);
  EXPECT_EQ(none.weights(c), (std::vector<double>{first, second}));
}

TEST(LearnOpponents, TeamsAndUpdatesDrawApart) {
  const auto draws = [](uint32_t update, int team) {
    std::vector<int32_t> rows;
    for (uint32_t k = 0; k < 16; ++k) rows.push_back(draw_opponent({1, 1, 1, 1}, {3, update, team}, k));
    return rows;
  };
  EXPECT_EQ(draws(5, 0), draws(5, 0));
  EXPECT_NE(draws(5, 0), draws(5, 1));
  EXPECT_NE(draws(5, 0), draws(6, 0));
}

TEST(LearnOpponents, GamesAreCounted) {
  GameCount games{2, 1, 0};
  games += {6, 1, 3};
  EXPECT_EQ(games.win_rate(), 2 / 8.0);
  EXPECT_EQ(games.points(), 3.5);
  Metrics metrics;
  LeagueRecord{games, {}}.add_metrics(1, metrics);
  EXPECT_EQ(metric(metrics, "pool_win_rate_1"), 0.25);
  EXPECT_TRUE(std::isnan(metric(metrics, "scripted_win_rate_1")));
}

}  // namespace
}  // namespace giga::test
