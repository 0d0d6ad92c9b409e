// Means with intervals, and what a parameter explains of the values of trials.
#include "sweep/analysis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace giga {
namespace {

TEST(SweepAnalysis, InterquartileMeans) {
  EXPECT_EQ(interquartile_mean({9}), 9);
  EXPECT_EQ(interquartile_mean({0, 3, 6}), 3);
  EXPECT_EQ(interquartile_mean({100, 1, 2, 3, 0}), 2) << "the least and the greatest of five are left out";
  EXPECT_EQ(interquartile_mean({1, 2, 3, 4, 5, 6, 7, 800}), 4.5);
  const Interval band = bootstrap_interval({0, 0, 0, 1, 1, 1});
  EXPECT_LT(band.lo, 0.3);
  EXPECT_GT(band.hi, 0.7);
  const Interval same = bootstrap_interval({2, 2, 2});
  EXPECT_EQ(same.lo, 2);
  EXPECT_EQ(same.hi, 2);
}

TEST(SweepAnalysis, IntervalsOfMeans) {
  // Mean 2, deviation 1, three values: 2 +- 4.303 / sqrt(3).
  const Interval three = mean_interval({1, 2, 3});
  EXPECT_NEAR(three.lo, 2 - 4.303 / std::sqrt(3), 1e-9);
  EXPECT_NEAR(three.hi, 2 + 4.303 / std::sqrt(3), 1e-9);
  EXPECT_EQ(mean_interval({5}).lo, 5);
}

TEST(SweepAnalysis, WhatAParameterExplains) {
  // Two groups of two: 0, 0 and 1, 1. All of the spread lies between them.
  EXPECT_EQ(explained_share({0, 0, 1, 1}, {0, 0, 1, 1}), 1);
  EXPECT_EQ(explained_share({0, 1, 0, 1}, {0, 0, 1, 1}), 0) << "none of it";
  // Total 5, within 2 x 0.5 = 1, between 4; less (2 - 1) x 1 / (4 - 2) = 0.5: 3.5 / 5.
  EXPECT_NEAR(explained_share({0, 0, 1, 1}, {0, 1, 2, 3}), 0.7, 1e-12);
  EXPECT_TRUE(std::isnan(explained_share({0, 0, 0}, {1, 2, 3})));
  EXPECT_EQ(groups_of({"0.5", "0.1", "0.9", "0.2", "0.8", "0.3", "0.7", "0.4"}, 4),
            (std::vector<size_t>{2, 0, 3, 0, 3, 1, 2, 1}));
  EXPECT_EQ(groups_of({"gelu", "tanh", "gelu"}), (std::vector<size_t>{0, 1, 0}));
  EXPECT_EQ(rank_correlation({"1", "10", "100"}, {0.1, 0.2, 0.9}), 1);
  EXPECT_EQ(rank_correlation({"1", "10", "100"}, {9, 8, 7}), -1);
  EXPECT_EQ(rank_correlation({"10_000", "2e4", "+30_000"}, {1, 2, 3}), 1) << "numbers as YAML has them";
  EXPECT_TRUE(std::isnan(rank_correlation({"a", "b"}, {1, 2})));
}

}  // namespace
}  // namespace giga
