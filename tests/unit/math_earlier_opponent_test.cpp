// Which games go on against the opponent before a draw, by numbers worked out by hand.
#include "math/earlier_opponent.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace giga {
namespace {

TEST(MathEarlierOpponent, AGameIsEarlierUntilItEnds) {
  // Drawn at step 100 of a world whose game began at step 95: it is 5 steps old, then 6 at step 101, 25 at step 120.
  EXPECT_TRUE(began_before(5, 100, 100));
  EXPECT_TRUE(began_before(6, 101, 100));
  EXPECT_TRUE(began_before(25, 120, 100));
  // It ends there: the next one begins at step 120, 20 after the draw, and is one step old at step 121.
  EXPECT_FALSE(began_before(0, 120, 100));
  EXPECT_FALSE(began_before(1, 121, 100));
  EXPECT_FALSE(began_before(40, 160, 100));
  // A game that begins with the draw is against the new opponent.
  EXPECT_FALSE(began_before(0, 100, 100));
  EXPECT_FALSE(began_before(1, 101, 100));
}

TEST(MathEarlierOpponent, StepsMayWrap) {
  // Drawn at the last number before 0; 3 steps later the count is 2. A game of 4 steps began one step before the draw.
  EXPECT_TRUE(began_before(4, 2, 0xFFFFFFFFu));
  EXPECT_FALSE(began_before(3, 2, 0xFFFFFFFFu));
  // Half of all numbers ago, longer than any game lasts.
  EXPECT_FALSE(began_before(1'000'000, 1, 0x80000000u));
}

TEST(MathEarlierOpponent, DrawsMoveUpToWhereGamesBegan) {
  // A game of 7 steps whose opponent was drawn 3 steps ago, one of 7 drawn 9 steps ago, one that has just begun, and
  // one whose draw was 2^32 - 1 steps ago: one more, and it would look like one of now.
  const std::vector<int32_t> length = {7, 7, 0, 12};
  const std::vector<uint32_t> step = {50, 50, 50, 4};
  std::vector<uint32_t> drawn_at = {47, 41, 20, 5};
  std::vector<uint8_t> earlier(4, 9);
  const NoteEarlierGames note{length.data(), step.data(), drawn_at.data(), earlier.data()};
  for (int64_t w = 0; w < 4; ++w) note(w);
  EXPECT_EQ(earlier, (std::vector<uint8_t>{1, 0, 0, 0}));
  // 50 - 7, 50 - 0, and 4 - 12 = -8.
  EXPECT_EQ(drawn_at, (std::vector<uint32_t>{47, 43, 50, 0xFFFFFFF8u}));
  const std::vector<uint32_t> once = drawn_at;
  for (int64_t w = 0; w < 4; ++w) note(w);
  EXPECT_EQ(drawn_at, once);
  EXPECT_EQ(earlier, (std::vector<uint8_t>{1, 0, 0, 0}));
}

TEST(MathEarlierOpponent, WhatItMakesIsTakenWhereItPlays) {
  const std::vector<int32_t> length = {7, 7, 0};
  const std::vector<uint32_t> step = {50, 50, 50}, drawn_at = {47, 41, 50};
  const std::vector<float> from = {1, 2, 3, 4, 5, 6};
  std::vector<float> to(6, -1);
  const TakeEarlier<float> take{{length.data(), step.data(), drawn_at.data()}, from.data(), to.data(), 2};
  for (int64_t row = 0; row < 6; ++row) take(row);
  EXPECT_EQ(to, (std::vector<float>{1, 2, -1, -1, -1, -1}));
}

}  // namespace
}  // namespace giga
