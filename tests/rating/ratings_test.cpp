// Ratings against arithmetic by hand, and against players of known strengths.
#include "rating/ratings.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "games.hpp"
#include "io/temporary_folder.hpp"

namespace giga::test {
namespace {

const Rating& find(const Ratings& ratings, const std::string& player, int side = -1) {
  for (const Rating& r : ratings.list)
    if (ratings.name(r) == player && r.side == side) return r;
  throw Error(cat("no rating of ", player, " on side ", side));
}

Ratings rate_alike(const GameTable& table, const std::string& anchor = "random") {
  RatingOptions options;
  options.anchor = anchor;
  return rate(table, options);
}
Ratings rate_apart(const GameTable& table, const std::string& anchor = "random") {
  RatingOptions options;
  options.anchor = anchor;
  options.sides = Sides::apart;
  return rate(table, options);
}

// 30 of 40 points: odds 3, so 400 log10(3) = 190.849 Elo. Information 40 x 0.75 x 0.25 = 7.5 in natural units of
// 400 / ln 10 = 173.718 Elo: standard error 173.718 / sqrt(7.5) = 63.433.
constexpr double kOdds3 = 190.849, kError40At3 = 63.433;

TEST(Ratings, TwoPlayersByHand) {
  GameTable table = table_of({"random", "a"});
  add(table, "a", "random", {20, 5, 0});
  add(table, "random", "a", {5, 10, 0});  // together 30 : 10 for a
  const Ratings ratings = rate_alike(table);
  const Rating& a = find(ratings, "a");
  EXPECT_EQ(a.standing, Standing::rated);
  EXPECT_NEAR(a.rating.value, kOdds3, 1e-3);
  EXPECT_NEAR(a.rating.standard_error, kError40At3, 1e-3);
  EXPECT_NEAR(a.rating.low(), 190.849 - 1.96 * 63.433, 0.01);
  EXPECT_NEAR(a.rating.high(), 190.849 + 1.96 * 63.433, 0.01);
  EXPECT_EQ(a.games.wins, 30);
  EXPECT_EQ(a.games.losses, 10);
  const Rating& random = find(ratings, "random");
  EXPECT_EQ(random.rating.value, 0);
  EXPECT_EQ(random.rating.standard_error, 0);
  EXPECT_EQ(random.games.wins, 10);
  EXPECT_NEAR(ratings.log_likelihood, -22.4934, 1e-4);  // 30 ln 0.75 + 10 ln 0.25
  EXPECT_GE(ratings.iterations, 3);
  EXPECT_LE(ratings.iterations, 12);
  EXPECT_FALSE(ratings.side_advantage);
  EXPECT_TRUE(remarks(ratings).empty());
}

TEST(Ratings, ATieIsHalfAWin) {
  GameTable table = table_of({"random", "a"});
  add(table, "a", "random", {25, 5, 10});  // 25 + 5 : 5 + 5
  const Ratings ratings = rate_alike(table);
  EXPECT_NEAR(find(ratings, "a").rating.value, kOdds3, 1e-3);
  EXPECT_NEAR(find(ratings, "a").rating.standard_error, kError40At3, 1e-3);
  EXPECT_EQ(find(ratings, "random").games.ties, 10);
}

TEST(Ratings, AlongAChainDifferencesAndVariancesAdd) {
  GameTable table = table_of({"random", "a", "b"});
  add(table, "a", "random", {30, 10, 0});
  add(table, "b", "a", {30, 10, 0});
  const Ratings ratings = rate_alike(table);
  EXPECT_NEAR(find(ratings, "b").rating.value, 2 * kOdds3, 1e-3);
  EXPECT_NEAR(find(ratings, "b").rating.standard_error, std::sqrt(2) * kError40At3, 1e-3);
}

// random is joined to a by 4 games, a and b by 40. To random both have wide intervals, whose errors are one error; to a
// the one of b is as narrow as their own games make it, and that of random as wide as before.
TEST(Ratings, IntervalsAreThoseOfTheDifferenceToTheAnchor) {
  GameTable table = table_of({"random", "a", "b"});
  add(table, "a", "random", {3, 1, 0});
  add(table, "b", "a", {30, 10, 0});
  const double error4_at_3 = std::sqrt(10.0) * kError40At3;  // a tenth of the games
  const Ratings to_random = rate_alike(table), to_a = rate_alike(table, "a");
  EXPECT_NEAR(find(to_random, "b").rating.standard_error, std::sqrt(11.0) * kError40At3, 1e-3);
  EXPECT_NEAR(find(to_a, "b").rating.value, kOdds3, 1e-3);
  EXPECT_NEAR(find(to_a, "b").rating.standard_error, kError40At3, 1e-3);
  EXPECT_NEAR(find(to_a, "random").rating.value, -kOdds3, 1e-3);
  EXPECT_NEAR(find(to_a, "random").rating.standard_error, error4_at_3, 1e-3);
  EXPECT_EQ(find(to_a, "a").rating.standard_error, 0);
  EXPECT_NEAR(to_a.log_likelihood, to_random.log_likelihood, 1e-9) << "the anchor changes no fit";
  // A third way round: a and b are compared through random too, and their errors are no sum of variances.
  add(table, "b", "random", {4, 0, 0});
  EXPECT_LT(find(rate_alike(table, "a"), "b").rating.standard_error, kError40At3);
}

TEST(Ratings, GamesAgainstItselfSayNothingWhereSidesAreAlike) {
  GameTable table = table_of({"random", "a"});
  add(table, "a", "random", {30, 10, 0});
  const Ratings without = rate_alike(table);
  add(table, "a", "a", {90, 10, 0});
  const Ratings with = rate_alike(table);
  EXPECT_EQ(find(with, "a").rating.value, find(without, "a").rating.value);
  EXPECT_EQ(find(with, "a").games.wins, 30);
}

TEST(Ratings, LargeDifferencesConverge) {
  GameTable table = table_of({"random", "a", "b", "c"});
  add(table, "a", "random", {99'999, 1, 0});
  add(table, "b", "a", {99'999, 1, 0});
  add(table, "c", "b", {99'999, 1, 0});
  EXPECT_NEAR(find(rate_alike(table), "c").rating.value, 3 * 400 * std::log10(99'999.0), 1e-3);
}

TEST(Ratings, NeitherTheOrderOfGamesNorThatOfPlayersMatters) {
  std::mt19937_64 generator(7);
  const KnownStrengths truth{{0, 100, -150, 300}, {0, 100, -150, 300}};
  const GameTable table = play_known(truth, 30, false, generator);
  struct OneGame {
    std::string side_0, side_1;
    Games games;
  };
  std::vector<OneGame> games;
  for (size_t i = 0; i < 4; ++i)
    for (size_t j = 0; j < 4; ++j) {
      const Games& g = table.games[i * 4 + j];
      for (int k = 0; k < g.wins; ++k) games.push_back({table.players[i], table.players[j], {1, 0, 0}});
      for (int k = 0; k < g.losses; ++k) games.push_back({table.players[i], table.players[j], {0, 1, 0}});
    }
  ASSERT_EQ(games.size(), 12u * 30u);
  std::shuffle(games.begin(), games.end(), generator);
  GameTable shuffled = table_of(table.players), renamed = table_of({"p2", "p0", "p3", "p1"});
  for (const OneGame& g : games) {
    add(shuffled, g.side_0, g.side_1, g.games);
    add(renamed, g.side_0, g.side_1, g.games);
  }
  const Ratings first = rate_alike(table, "p0"), second = rate_alike(shuffled, "p0"), third = rate_alike(renamed, "p0");
  for (const std::string& name : table.players) {
    const Estimate &a = find(first, name).rating, &b = find(second, name).rating, &c = find(third, name).rating;
    EXPECT_EQ(a.value, b.value);
    EXPECT_EQ(a.standard_error, b.standard_error);
    EXPECT_NEAR(a.value, c.value, 1e-6);
    EXPECT_NEAR(a.standard_error, c.standard_error, 1e-6);
  }
}

/// Share of 95 % intervals that hold the truth over many tables of games.
double coverage(const KnownStrengths& truth, Sides sides, int games_per_pair, int repetitions) {
  std::mt19937_64 generator(2026);
  int held = 0, intervals = 0;
  const auto count = [&](const Estimate& e, double value) {
    ++intervals;
    held += e.low() <= value && value <= e.high();
  };
  for (int k = 0; k < repetitions; ++k) {
    const GameTable table = play_known(truth, games_per_pair, sides == Sides::apart, generator);
    const Ratings ratings = sides == Sides::apart ? rate_apart(table, "p0") : rate_alike(table, "p0");
    for (const Rating& r : ratings.list)
      if (r.player != 0) count(r.rating, (r.side == 1 ? truth.side_1 : truth.side_0)[static_cast<size_t>(r.player)]);
    if (ratings.side_advantage) count(*ratings.side_advantage, truth.advantage);
  }
  EXPECT_GE(intervals, 2000);
  return static_cast<double>(held) / intervals;
}

// 2000 and more intervals, in repetitions that are independent: 0.95 +- 0.015 is three standard errors.
TEST(Ratings, KnownStrengthsAreInTheirIntervalsInNineteenOfTwentyCases) {
  const std::vector<double> strengths = {0, 60, -120, 200, 130, 320};
  EXPECT_NEAR(coverage({strengths, strengths}, Sides::alike, 40, 500), 0.95, 0.015);
}

TEST(Ratings, KnownStrengthsBySideAreInTheirIntervals) {
  const KnownStrengths truth{{0, 150, -100, 60}, {0, -80, 120, 250}, 110};
  EXPECT_NEAR(coverage(truth, Sides::apart, 60, 400), 0.95, 0.015);
}

TEST(Ratings, WithManyTiesIntervalsAreTooWideRatherThanTooNarrow) {
  const KnownStrengths truth{{0, 0, 0, 0, 0}, {0, 0, 0, 0, 0}, 0, 0.5};
  EXPECT_GT(coverage(truth, Sides::alike, 40, 500), 0.97);
}

TEST(Ratings, SidesApartByHand) {
  GameTable table = table_of({"random", "a"});
  add(table, "random", "random", {30, 10, 0});  // side 0 is ahead by 190.849
  add(table, "a", "random", {36, 4, 0});        // odds 9 = 2 x 190.849, of which one is the side's
  add(table, "random", "a", {20, 20, 0});       // a makes up for the side
  const Ratings ratings = rate_apart(table);
  ASSERT_EQ(ratings.list.size(), 4u);
  ASSERT_TRUE(ratings.side_advantage);
  EXPECT_NEAR(ratings.side_advantage->value, kOdds3, 1e-3);
  EXPECT_NEAR(ratings.side_advantage->standard_error, kError40At3, 1e-3);
  EXPECT_NEAR(find(ratings, "a", 0).rating.value, kOdds3, 1e-3);
  EXPECT_NEAR(find(ratings, "a", 1).rating.value, kOdds3, 1e-3);
  // Variances 1 / (40 x 0.9 x 0.1) + 1 / 7.5 and 1 / (40 x 0.5 x 0.5) + 1 / 7.5, in units of 173.718 Elo.
  EXPECT_NEAR(find(ratings, "a", 0).rating.standard_error, 111.384, 1e-3);
  EXPECT_NEAR(find(ratings, "a", 1).rating.standard_error, 83.914, 1e-3);
  EXPECT_EQ(find(ratings, "random", 0).rating.value, 0);
  EXPECT_EQ(find(ratings, "random", 1).rating.value, 0);
  EXPECT_EQ(find(ratings, "a", 0).games.wins, 36);
  EXPECT_EQ(find(ratings, "a", 1).games.wins, 20);
}

TEST(Ratings, APlayerOfOneSideIsRatedOnThatSideAlone) {
  GameTable table = table_of({"random", "a"});
  add(table, "random", "random", {20, 20, 0});
  add(table, "a", "random", {30, 10, 0});
  const Ratings ratings = rate_apart(table);
  EXPECT_EQ(ratings.list.size(), 3u);
  EXPECT_NEAR(find(ratings, "a", 0).rating.value, kOdds3, 1e-3);
}

TEST(Ratings, WhoNeverLostOrNeverWonIsInfinite) {
  GameTable table = table_of({"best", "random", "a", "worst"});
  add(table, "a", "random", {30, 10, 0});
  for (const char* other : {"random", "a", "worst"}) add(table, "best", other, {20, 0, 0});
  for (const char* other : {"random", "a"}) add(table, "worst", other, {0, 20, 0});
  const Ratings ratings = rate_alike(table);
  EXPECT_EQ(find(ratings, "best").standing, Standing::above);
  EXPECT_EQ(find(ratings, "best").rating.value, INFINITY);
  EXPECT_TRUE(std::isnan(find(ratings, "best").rating.standard_error));
  EXPECT_EQ(find(ratings, "worst").standing, Standing::below);
  EXPECT_EQ(find(ratings, "worst").rating.value, -INFINITY);
  // The rest as if those two had not been there.
  EXPECT_NEAR(find(ratings, "a").rating.value, kOdds3, 1e-3);
  EXPECT_NEAR(find(ratings, "a").rating.standard_error, kError40At3, 1e-3);
  EXPECT_NEAR(ratings.log_likelihood, -22.4934, 1e-4);
  const std::vector<std::string> lines = remarks(ratings);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0], "best: won all of its 60 games; its rating is +infinity");
  EXPECT_EQ(lines[1], "worst: lost all of its 60 games; its rating is -infinity");
}

// Scripts come first among the players: it is not their order that tells who is above whom.
TEST(Ratings, GroupsAreNumberedFromTheStrongestOn) {
  GameTable table = table_of({"random", "circle", "worst", "run"});
  add(table, "circle", "random", {20, 0, 0});
  for (const char* other : {"random", "circle"}) add(table, "run", other, {20, 0, 0});
  for (const char* other : {"random", "circle", "run"}) add(table, "worst", other, {0, 20, 0});
  const Ratings ratings = rate_alike(table);
  EXPECT_EQ(find(ratings, "random").group, 0) << "the anchor's";
  EXPECT_LT(find(ratings, "run").group, find(ratings, "circle").group);
  EXPECT_LT(find(ratings, "circle").group, find(ratings, "worst").group);
}

TEST(Ratings, OneTiePutsAnEndToInfinity) {
  GameTable table = table_of({"random", "a"});
  add(table, "a", "random", {39, 0, 1});
  EXPECT_NEAR(find(rate_alike(table), "a").rating.value, 400 * std::log10(39.5 / 0.5), 1e-6);
}

TEST(Ratings, AGroupThatTheAnchorNeverBeatsIsRatedAmongItself) {
  GameTable table = table_of({"random", "a", "b", "circle"});
  add(table, "b", "a", {30, 10, 0});
  add(table, "circle", "random", {20, 20, 0});
  for (const char* strong : {"a", "b"})
    for (const char* weak : {"random", "circle"}) add(table, strong, weak, {10, 0, 0});
  const Ratings ratings = rate_alike(table);
  EXPECT_EQ(ratings.n_groups, 2);
  const Rating& b = find(ratings, "b");
  EXPECT_EQ(b.standing, Standing::above);
  EXPECT_EQ(b.rating.value, INFINITY);
  EXPECT_EQ(b.group, 1);
  EXPECT_EQ(ratings.name(ratings.list[static_cast<size_t>(b.reference)]), "a");
  EXPECT_NEAR(b.in_group.value, kOdds3, 1e-3);
  EXPECT_NEAR(b.in_group.standard_error, kError40At3, 1e-3);
  EXPECT_EQ(find(ratings, "random").group, 0);
  ASSERT_EQ(remarks(ratings).size(), 1u);
  EXPECT_TRUE(contains(remarks(ratings)[0],
                       {"never lost a point to random", "a 0 +- 0; b 191 +- 124", "+infinity", "relative to a"}));
}

TEST(Ratings, PoolsThatNoGamesJoinAreToldApart) {
  GameTable table = table_of({"c", "random", "a", "d", "idle", "e"});
  add(table, "a", "random", {30, 10, 0});
  add(table, "c", "d", {30, 10, 0});
  add(table, "e", "c", {5, 0, 0});  // never lost, but to no one who is compared with the anchor
  const Ratings ratings = rate_alike(table);
  EXPECT_EQ(ratings.list.size(), 5u) << "who never played is not rated";
  EXPECT_EQ(find(ratings, "c").standing, Standing::not_compared);
  EXPECT_TRUE(std::isnan(find(ratings, "c").rating.value));
  EXPECT_NEAR(find(ratings, "d").in_group.value, -kOdds3, 1e-3);
  EXPECT_NEAR(find(ratings, "a").rating.value, kOdds3, 1e-3);
  EXPECT_EQ(find(ratings, "e").standing, Standing::not_compared);
  const std::vector<std::string> lines = remarks(ratings);
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0], "e: won all of its 5 games; it has no rating relative to random");
  EXPECT_TRUE(contains(lines[1], {"no games compare these with random", "c 0 +- 0; d -191 +- 124", "relative to c"}));
  EXPECT_EQ(lines[2], "idle: played no game; it has no rating");
}

TEST(Ratings, SidesThatAreFarApartHaveNoAdvantageInNumbers) {
  GameTable table = table_of({"random", "a"});
  add(table, "random", "random", {40, 0, 0});
  add(table, "a", "random", {40, 0, 0});
  add(table, "random", "a", {20, 20, 0});
  const Ratings ratings = rate_apart(table);
  EXPECT_EQ(ratings.side_advantage->value, INFINITY);
  EXPECT_EQ(find(ratings, "a", 1).rating.value, INFINITY);
  EXPECT_EQ(find(ratings, "random", 0).standing, Standing::rated);
  EXPECT_EQ(find(ratings, "random", 1).standing, Standing::rated);
  EXPECT_FALSE(remarks(ratings).empty());
}

TEST(Ratings, SequentialEloByHand) {
  // 1: E = 1/2, +16: a 1216, b 1184. 2: E_b = 1 / (1 + 10^(16/400)) = 0.476990, +16.736: b 1200.736, c 1183.264.
  // 3: E_c = 1 / (1 + 10^(32.736/400)) = 0.453029, +1.503: c 1184.767, a 1214.497.
  const std::vector<EloMatch> matches = {{0, 1, 1}, {1, 2, 1}, {2, 0, 0.5}};
  const std::vector<double> elo = sequential_elo(3, matches);
  EXPECT_NEAR(elo[0], 1214.497, 1e-3);
  EXPECT_NEAR(elo[1], 1200.736, 1e-3);
  EXPECT_NEAR(elo[2], 1184.767, 1e-3);
  const std::vector<double> backwards = sequential_elo(3, {matches.rbegin(), matches.rend()});
  EXPECT_GT(std::abs(backwards[0] - elo[0]), 0.1) << "its order matters";
  EXPECT_NEAR(sequential_elo(2, {{0, 1, 1}}, {16, 0})[0], 8, 1e-12);
}

TEST(Ratings, ThePapersEloTakesAPairAsOneMatchWonByMoreThanHalf) {
  GameTable table = table_of({"random", "a"});
  add(table, "random", "a", {51, 20, 29});  // more than half: 1200 + 16
  add(table, "a", "random", {50, 1, 49});   // half is not more: a loss of a, E_a = 1 / (1 + 10^(32/400)) = 0.454076
  const Ratings ratings = rate_alike(table);
  EXPECT_NEAR(find(ratings, "random").paper_elo, 1216 + 32 * 0.454076, 1e-3);
  EXPECT_NEAR(find(ratings, "a").paper_elo, 1184 - 32 * 0.454076, 1e-3);
}

TEST(Ratings, SaysWhatIsWrongWithTheAnchor) {
  GameTable table = table_of({"random", "a"});
  add(table, "a", "random", {30, 10, 0});
  EXPECT_EQ(input_error_of([&] { rate_alike(table, "circle"); }),
            "the anchor 'circle', whose rating is 0, is not among the players");
  EXPECT_EQ(input_error_of([&] { rate_apart(table); }),
            "the anchor 'random', whose rating is 0, has played no game on side 0");
  EXPECT_EQ(input_error_of([&] { rate_alike(table_of({"random"})); }),
            "the anchor 'random', whose rating is 0, has played no game");
  EXPECT_EQ(input_error_of([&] { rate_alike(table_of({"random", "a", "a"})); }), "two players are called 'a'");
}

}  // namespace
}  // namespace giga::test
