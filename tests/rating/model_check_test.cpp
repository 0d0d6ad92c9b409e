// How well ratings explain the games: deviance and cyclic share against arithmetic by hand.
#include "rating/model_check.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "games.hpp"
#include "io/temporary_folder.hpp"

namespace giga::test {
namespace {

Ratings rate_alike_to(const GameTable& table, const std::string& anchor) {
  RatingOptions options;
  options.anchor = anchor;
  return rate(table, options);
}

/// Each beats the next 30 : 10, the last one the first.
GameTable rock_paper_scissors() {
  GameTable table = table_of({"rock", "scissors", "paper"});
  add(table, "rock", "scissors", {30, 10, 0});
  add(table, "scissors", "paper", {20, 0, 0});
  add(table, "paper", "scissors", {10, 10, 0});
  add(table, "paper", "rock", {25, 5, 10});  // 25 + 5 : 5 + 5
  return table;
}

// ln(30.5 / 10.5) = 1.066351, its variance 1 / 30.5 + 1 / 10.5 = 0.128025.
constexpr double kLink = 1.066351, kLinkVariance = 0.128025;

TEST(ModelCheck, RockPaperScissorsIsWhollyCyclic) {
  const Ratings ratings = rate_alike_to(rock_paper_scissors(), "rock");
  for (const Rating& r : ratings.list) EXPECT_NEAR(r.rating.value, 0, 1e-9);

  // Each pair is expected to be 20 : 20: 2 (30 ln(30 / 20) + 10 ln(10 / 20)) = 10.46496. Three pairs, two differences.
  EXPECT_NEAR(ratings.fit.deviance, 3 * 10.46496, 1e-4);
  EXPECT_EQ(ratings.fit.n_pairs, 3) << "both ways round are one pair";
  EXPECT_EQ(ratings.fit.degrees_of_freedom, 1);
  EXPECT_EQ(ratings.fit.n_sparse, 0);

  const Intransitivity& rest = ratings.intransitivity;
  EXPECT_EQ(rest.n_pairs, 3);
  EXPECT_NEAR(rest.share, 1, 1e-12);
  // Of the error of three equal pairs one third is cyclic: 1 of 3 degrees of freedom.
  EXPECT_NEAR(rest.share_by_chance, kLinkVariance / 3 / (kLink * kLink), 1e-5);
  ASSERT_TRUE(rest.strongest);
  EXPECT_EQ(rest.strongest->players, (std::array<int, 3>{0, 1, 2}));
  for (const double link : rest.strongest->log_odds) EXPECT_NEAR(link, kLink, 1e-5);
  EXPECT_NEAR(rest.strongest->sum(), 3 * kLink, 1e-5);
  EXPECT_NEAR(rest.strongest->standard_error, std::sqrt(3 * kLinkVariance), 1e-5);
}

// With the half, 10 : 3 are odds of 10.5 / 3.5 = 3, and 13 : 1 of 13.5 / 1.5 = 9 = 3 x 3.
TEST(ModelCheck, OddsThatMultiplyHaveNoCyclicPart) {
  GameTable table = table_of({"a", "b", "c"});
  add(table, "a", "b", {10, 3, 0});
  add(table, "b", "c", {10, 3, 0});
  add(table, "c", "a", {1, 13, 0});
  const Intransitivity rest = rate_alike_to(table, "b").intransitivity;
  EXPECT_NEAR(rest.share, 0, 1e-12);
  EXPECT_FALSE(rest.strongest);
}

// Log-odds L = ln 3, L and 0 along the triangle: the sum along it is 2 L, of which each pair has a third. Cyclic are
// 3 (2 L / 3)^2 = 4/3 L^2 of 2 L^2. Where the even pair has twice the games it has half as much of the sum as the
// others, 2 L (2, 2, 1) / 5, each weighed by its games: 4 L^2 (4 + 4 + 2) / 25 = 1.6 L^2, of 2 L^2.
TEST(ModelCheck, APairWeighsAsManyGamesAsItPlayed) {
  for (const auto& [even, share] : {std::pair{Games{6, 6, 1}, 2.0 / 3}, {Games{13, 13, 0}, 0.8}}) {
    GameTable table = table_of({"a", "b", "c"});
    add(table, "a", "b", {10, 3, 0});
    add(table, "b", "c", {10, 3, 0});
    add(table, "c", "a", even);
    const Intransitivity rest = rate_alike_to(table, "a").intransitivity;
    EXPECT_NEAR(rest.share, share, 1e-12);
    EXPECT_FALSE(rest.strongest) << "c is not ahead of a";
  }
}

TEST(ModelCheck, PairsMayBeMissing) {
  GameTable table = table_of({"a", "b", "c", "d"});
  add(table, "a", "b", {10, 3, 0});
  add(table, "b", "c", {10, 3, 0});
  add(table, "c", "d", {10, 3, 0});
  const Ratings chain = rate_alike_to(table, "a");
  EXPECT_NEAR(chain.intransitivity.share, 0, 1e-12) << "a chain has no way round";
  EXPECT_NEAR(chain.intransitivity.share_by_chance, 0, 1e-12);
  EXPECT_EQ(chain.fit.degrees_of_freedom, 0);
  EXPECT_NEAR(chain.fit.deviance, 0, 1e-9);
  EXPECT_TRUE(std::isnan(chain.fit.p_value()));
  add(table, "d", "a", {10, 3, 0});
  const Intransitivity rest = rate_alike_to(table, "a").intransitivity;
  EXPECT_NEAR(rest.share, 1, 1e-12) << "a way round of four";
  EXPECT_EQ(rest.n_pairs, 4);
  EXPECT_FALSE(rest.strongest) << "no three of them all played";
}

// a > b > c > a with odds 3, a > d > c > a with odds 3, 9 and 3, the other way round from the order of names.
TEST(ModelCheck, TheStrongestCycleIsThatOfTheLargestSum) {
  GameTable table = table_of({"a", "b", "c", "d"});
  add(table, "a", "b", {10, 3, 0});
  add(table, "b", "c", {10, 3, 0});
  add(table, "c", "a", {10, 3, 0});
  add(table, "a", "d", {10, 3, 0});
  add(table, "d", "c", {13, 1, 0});
  const Ratings ratings = rate_alike_to(table, "a");
  ASSERT_TRUE(ratings.intransitivity.strongest);
  EXPECT_EQ(ratings.intransitivity.strongest->players, (std::array<int, 3>{0, 3, 2}));
  EXPECT_NEAR(ratings.intransitivity.strongest->sum(), std::log(3.0 * 9 * 3), 1e-12);
  // Standard error: two of 1 / 10.5 + 1 / 3.5 = 0.380952 and 1 / 13.5 + 1 / 1.5 = 0.740741; 1.96 of it are 2.4021.
  EXPECT_TRUE(contains(intransitivity_line(ratings),
                       {"strongest cycle: a > d > c > a, log-odds 1.10 + 2.20 + 1.10 = 4.39 +- 2.40."}));
}

TEST(ModelCheck, PValueIsTheTailOfChiSquare) {
  GoodnessOfFit fit;
  fit.degrees_of_freedom = 2;
  for (const double x : {0.0, 0.3, 5.0, 80.0, 1000.0}) {
    fit.deviance = x;
    EXPECT_NEAR(fit.p_value(), std::exp(-x / 2), 1e-12 * std::exp(-x / 2)) << x;  // of two degrees
  }
  fit.degrees_of_freedom = 1;
  fit.deviance = 3.841459;  // 1.959964 squared
  EXPECT_NEAR(fit.p_value(), 0.05, 1e-7);
  fit.degrees_of_freedom = 10;
  fit.deviance = 18.307038;  // the 95 % point in tables
  EXPECT_NEAR(fit.p_value(), 0.05, 1e-7);
}

// A pair of 40 games at odds 99 lets the weaker expect 0.4 points; at odds 3 it is 10.
TEST(ModelCheck, PairsWithFewExpectedPointsAreCounted) {
  GameTable table = table_of({"a", "b", "c"});
  add(table, "a", "b", {30, 10, 0});
  add(table, "b", "c", {39, 0, 1});
  add(table, "a", "c", {39, 0, 1});
  EXPECT_EQ(rate_alike_to(table, "a").fit.n_sparse, 2);
  EXPECT_TRUE(contains(fit_line(rate_alike_to(table, "a").fit),
                       {" on 1 degree of freedom, p = ", "; rough: in 2 of 3 pairs one can expect less than 5"}));
}

// Two groups that no games join: their deviances and degrees of freedom add. Between the groups log-odds count too.
TEST(ModelCheck, GroupsAddUp) {
  GameTable table = table_of({"rock", "scissors", "paper", "x", "y"});
  for (const auto& [a, b] : {std::pair{"rock", "scissors"}, {"scissors", "paper"}, {"paper", "rock"}, {"x", "y"}})
    add(table, a, b, {30, 10, 0});
  Ratings ratings = rate_alike_to(table, "rock");
  EXPECT_EQ(ratings.n_groups, 2);
  EXPECT_NEAR(ratings.fit.deviance, 3 * 10.46496, 1e-4);
  EXPECT_EQ(ratings.fit.n_pairs, 4);
  EXPECT_EQ(ratings.fit.degrees_of_freedom, 1);
  EXPECT_NEAR(ratings.intransitivity.share, 0.75, 1e-12);  // three of four equal pairs
  add(table, "x", "rock", {40, 0, 0});                     // joins two groups infinitely far apart
  ratings = rate_alike_to(table, "rock");
  EXPECT_EQ(ratings.fit.n_pairs, 4);
  EXPECT_EQ(ratings.intransitivity.n_pairs, 5);
  EXPECT_TRUE(std::isfinite(ratings.intransitivity.share));
}

// Where the sides are apart a row and a column are what ratings explain. Log-odds L, L, L, -L (L = ln 3) are L/2 for
// all, L/2 for row and for column, and L/2 that neither explains: a quarter of the squares.
TEST(ModelCheck, SidesApartAreRowsAndColumns) {
  GameTable table = table_of({"a", "b"});
  add(table, "a", "a", {10, 3, 0});
  add(table, "a", "b", {10, 3, 0});
  add(table, "b", "a", {10, 3, 0});
  add(table, "b", "b", {3, 10, 0});
  RatingOptions options{"a", Sides::apart, {}};
  const Ratings ratings = rate(table, options);
  EXPECT_NEAR(ratings.intransitivity.share, 0.25, 1e-12);
  EXPECT_EQ(ratings.intransitivity.n_pairs, 4);
  EXPECT_FALSE(ratings.intransitivity.strongest);
  EXPECT_EQ(ratings.fit.degrees_of_freedom, 1);  // 4 pairs, 2 + 2 ratings of which one is free
}

// Players of known strengths: one test in twenty fails by chance (400 of them: 0.05 +- 0.033 is three standard errors),
// and the cyclic share is that of chance.
TEST(ModelCheck, WhereRatingsAreTheTruthTheTestsSaySo) {
  const std::vector<double> strengths = {0, 60, -120, 100, 30, 150};
  std::mt19937_64 generator(31);
  int refused = 0;
  double share = 0, by_chance = 0;
  constexpr int kTables = 400;
  for (int k = 0; k < kTables; ++k) {
    const Ratings ratings = rate_alike_to(play_known({strengths, strengths}, 40, false, generator), "p0");
    EXPECT_EQ(ratings.fit.degrees_of_freedom, 10);  // 15 pairs, 5 differences
    refused += ratings.fit.p_value() < 0.05;
    share += ratings.intransitivity.share / kTables;
    by_chance += ratings.intransitivity.share_by_chance / kTables;
  }
  EXPECT_NEAR(static_cast<double>(refused) / kTables, 0.05, 0.033);
  EXPECT_NEAR(share / by_chance, 1, 0.1);
}

TEST(ModelCheck, GamesAgainstItselfAreNoPairWhereSidesAreAlike) {
  GameTable table = rock_paper_scissors();
  add(table, "rock", "rock", {90, 10, 0});
  EXPECT_EQ(rate_alike_to(table, "rock").fit.n_pairs, 3);
  EXPECT_NEAR(rate_alike_to(table, "rock").intransitivity.share, 1, 1e-12);
}

TEST(ModelCheck, IsToldInSentences) {
  Ratings ratings = rate_alike_to(rock_paper_scissors(), "rock");
  EXPECT_EQ(fit_line(ratings.fit), "Fit: deviance 31.4 on 1 degree of freedom, p < 0.0001.");
  // 0.128025 / 3 / 1.066351^2 = 0.03753; 1.96 sqrt(3 x 0.128025) = 1.2147.
  EXPECT_EQ(intransitivity_line(ratings),
            "Intransitive: 100.0 % of the squared log-odds (by chance 3.8 %); strongest cycle: rock > scissors > paper "
            "> rock, log-odds 1.07 + 1.07 + 1.07 = 3.20 +- 1.21.");
  GameTable even = table_of({"a", "b"});
  add(even, "a", "b", {10, 10, 0});
  ratings = rate_alike_to(even, "a");
  EXPECT_EQ(fit_line(ratings.fit), "Fit: no more pairs than ratings need; there is nothing to test.");
  EXPECT_EQ(intransitivity_line(ratings), "Intransitive: nothing, all pairs are even.");
  EXPECT_TRUE(intransitivity_json(ratings)["strongest_cycle"].is_null());
}

TEST(ModelCheck, JsonHasNamesAndNumbers) {
  const Ratings ratings = rate_alike_to(rock_paper_scissors(), "paper");
  const Json fit = fit_json(ratings.fit), rest = intransitivity_json(ratings), &cycle = rest["strongest_cycle"];
  EXPECT_NEAR(fit["deviance"].get<double>(), 31.3949, 1e-3);
  EXPECT_NEAR(fit["p_value"].get<double>(), std::erfc(std::sqrt(31.39488 / 2)), 1e-12);  // of one degree
  EXPECT_EQ(fit["degrees_of_freedom"], 1);
  EXPECT_EQ(fit["pairs"], 3);
  EXPECT_EQ(fit["sparse_pairs"], 0);
  EXPECT_NEAR(rest["share"].get<double>(), 1, 1e-12);
  EXPECT_EQ(cycle["players"], (Json{"rock", "scissors", "paper"}));
  EXPECT_NEAR(cycle["sum"].get<double>(), 3 * kLink, 1e-5);
  EXPECT_NEAR(cycle["ci95"][1].get<double>(), 3 * kLink + 1.96 * std::sqrt(3 * kLinkVariance), 1e-4);
}

}  // namespace
}  // namespace giga::test
