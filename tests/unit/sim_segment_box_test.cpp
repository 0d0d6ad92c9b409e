// Segments against boxes: what passes through, what touches, what ends before.
#include "sim/segment_box.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

namespace giga::test {
namespace {

using Point = std::array<float, 3>;

/// From `a` to `b` against the box [2, 4] x [1, 3] x [0, 5].
bool meets(const Point& a, const Point& b, int n_axes) {
  const float lo[3] = {2, 1, 0}, hi[3] = {4, 3, 5};
  const float delta[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  return segment_meets_box(a.data(), delta, lo, hi, n_axes);
}

TEST(SimSegmentBox, ThroughTheBoxOrNot) {
  EXPECT_TRUE(meets({0, 2}, {6, 2}, 2)) << "straight through, along an axis";
  EXPECT_TRUE(meets({6, 2}, {0, 2}, 2)) << "and back";
  EXPECT_TRUE(meets({3, 0}, {3, 4}, 2)) << "along the other axis";
  EXPECT_TRUE(meets({1, 1}, {5, 3}, 2)) << "aslant: y 1.5 at x 2";
  EXPECT_TRUE(meets({0, 2}, {3, 2}, 2)) << "ends inside";
  EXPECT_TRUE(meets({3, 2}, {9, 9}, 2)) << "begins inside";
  EXPECT_TRUE(meets({2.5f, 1.5f}, {3.5f, 2.5f}, 2)) << "lies inside";
  EXPECT_FALSE(meets({0, 2}, {1.9f, 2}, 2)) << "ends before it";
  EXPECT_FALSE(meets({0, 2}, {-6, 2}, 2)) << "leads away";
  EXPECT_FALSE(meets({0, 3.5f}, {6, 3.5f}, 2)) << "passes beside it";
  EXPECT_FALSE(meets({0, 0}, {2, 4}, 2)) << "passes a corner: x 1.5 at y 3";
}

TEST(SimSegmentBox, TouchingIsNotMeeting) {
  EXPECT_FALSE(meets({0, 1}, {6, 1}, 2)) << "along a face";
  EXPECT_FALSE(meets({0, 3}, {6, 3}, 2)) << "along the face beyond";
  EXPECT_FALSE(meets({0, 2}, {2, 2}, 2)) << "ends on a face";
  EXPECT_FALSE(meets({1, 2}, {3, 4}, 2)) << "through the corner (2, 3)";
  EXPECT_FALSE(meets({0, 0}, {0, 0}, 2)) << "of length 0 outside";
  EXPECT_TRUE(meets({3, 2}, {3, 2}, 2)) << "of length 0 inside";
}

TEST(SimSegmentBox, TheThirdAxisCountsOnlyWhereItIsAskedFor) {
  EXPECT_TRUE(meets({0, 2, 9}, {6, 2, 9}, 2));
  EXPECT_FALSE(meets({0, 2, 9}, {6, 2, 9}, 3)) << "above";
  EXPECT_TRUE(meets({0, 2, 8}, {6, 2, 2}, 3)) << "down into it: z 4 at x 4";
  EXPECT_FALSE(meets({0, 2, 9}, {6, 2, 5}, 3)) << "down to its height behind it";
}

// Against points along the segment: where one is well inside the box it meets, where none is near it does not.
TEST(SimSegmentBox, AgreesWithPointsAlongTheSegment) {
  std::mt19937 generator(5);
  std::uniform_real_distribution<float> place(-1, 7);
  int n_met = 0, n_missed = 0;
  for (int k = 0; k < 4000; ++k) {
    const Point a = {place(generator), place(generator), place(generator)};
    const Point b = {place(generator), place(generator), place(generator)};
    float deepest = -1e9f;  // units inside of the nearest face; below 0 outside
    for (int step = 0; step <= 1000; ++step) {
      const float t = static_cast<float>(step) / 1000;
      const float x = a[0] + t * (b[0] - a[0]), y = a[1] + t * (b[1] - a[1]), z = a[2] + t * (b[2] - a[2]);
      deepest = std::max(deepest, std::min({x - 2, 4 - x, y - 1, 3 - y, z, 5 - z}));
    }
    // Points lie at most sqrt(3) x 8 / 1000 = 0.014 apart.
    if (std::abs(deepest) < 0.015f) continue;
    ASSERT_EQ(meets(a, b, 3), deepest > 0) << "segment " << k;
    ++(deepest > 0 ? n_met : n_missed);
  }
  EXPECT_GT(n_met, 300);
  EXPECT_GT(n_missed, 300);
}

}  // namespace
}  // namespace giga::test
