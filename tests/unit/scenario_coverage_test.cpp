// Boxes that cover an area together, or leave a part of it.
#include <gtest/gtest.h>

#include "scenario/coverage.hpp"

namespace giga {
namespace {

constexpr Box kArea = {1, 1, 4, 9, 2, 3};

TEST(Coverage, OfOneBoxOrSeveral) {
  EXPECT_FALSE(covers({}, kArea, false));
  EXPECT_TRUE(covers({kArea}, kArea, true));
  EXPECT_TRUE(covers({{0, 0, 5, 5, 0, 10}, {0, 5, 5, 10, 0, 10}}, kArea, true));
  EXPECT_FALSE(covers({{0, 0, 5, 5, 0, 10}, {0, 5.01f, 5, 10, 0, 10}}, kArea, true)) << "a gap along x";
  // A ring leaves its middle, which a fifth box fills.
  std::vector<Box> ring = {{0, 0, 5, 3, 0, 10}, {0, 7, 5, 10, 0, 10}, {0, 3, 2, 7, 0, 10}, {3, 3, 5, 7, 0, 10}};
  EXPECT_FALSE(covers(ring, kArea, true));
  ring.push_back({1.5f, 2, 3.5f, 8, 0, 10});
  EXPECT_TRUE(covers(ring, kArea, true));
}

TEST(Coverage, HeightsCountWhereTheyAreAskedFor) {
  const std::vector<Box> low = {{0, 0, 5, 10, 0, 2.5f}};
  EXPECT_TRUE(covers(low, kArea, false));
  EXPECT_FALSE(covers(low, kArea, true));
  EXPECT_TRUE(covers({low[0], {0, 0, 5, 10, 2.5f, 10}}, kArea, true));
}

// All agents of a team may start at one point, or in a line: a box that touches it covers it.
TEST(Coverage, OfPointsAndLines) {
  constexpr Box kPoint = {2, 2, 2, 2, 0, 0}, kLine = {2, 2, 2, 6, 0, 0};
  EXPECT_TRUE(covers({{1, 1, 3, 3, 0, 10}}, kPoint, true));
  EXPECT_TRUE(covers({{2, 1, 3, 3, 0, 10}}, kPoint, true));
  EXPECT_FALSE(covers({{2.01f, 1, 3, 3, 0, 10}}, kPoint, true));
  EXPECT_FALSE(covers({{1, 1, 3, 5, 0, 10}}, kLine, true)) << "from y = 5 to 6";
  EXPECT_TRUE(covers({{1, 1, 3, 5, 0, 10}, {2, 4, 3, 7, 0, 10}}, kLine, true));
}

}  // namespace
}  // namespace giga
