// Gae against numbers worked out by hand: ends of games, deaths, resets, the value normaliser, and the layout.
#include "math/gae.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "support/numbers.hpp"

namespace giga {
namespace {

/// A rollout of T = 3 steps with gamma = lambda = 1/2, so that all numbers are exact. One world and one agent unless
/// the vectors are made longer; rewards 1, 2, 4 and values 2, 4, 8, then 16 behind the rollout.
struct Rollout {
  int64_t n_worlds = 1;
  int n = 1;
  std::vector<float> reward = {1, 2, 4}, value = {2, 4, 8, 16}, final_value = {10};
  std::vector<uint8_t> alive = {1, 1, 1, 1}, final_alive = {1}, done = {0, 0, 0};
  float team_share = 0;
  const float* value_mean = nullptr;
  const float* value_std = nullptr;
  std::vector<float> advantage, returns;

  void run() {
    advantage.assign(reward.size(), kNan);
    returns.assign(reward.size(), kNan);
    const Gae gae{.horizon = 3,
                  .n_worlds = n_worlds,
                  .n = n,
                  .gamma = 0.5f,
                  .lambda = 0.5f,
                  .team_share = team_share,
                  .reward = reward.data(),
                  .done = done.data(),
                  .alive = alive.data(),
                  .value = value.data(),
                  .final_value = final_value.data(),
                  .final_alive = final_alive.data(),
                  .value_mean = value_mean,
                  .value_std = value_std,
                  .advantage = advantage.data(),
                  .returns = returns.data()};
    for (int64_t column = 0; column < n_worlds * n; ++column) gae(column);
  }
  void end(int t, Done how) { done[static_cast<size_t>(t)] = static_cast<uint8_t>(how); }
};

using Numbers = std::vector<float>;

// delta_2 = 4 + 16/2 - 8 = 4, delta_1 = 2 + 8/2 - 4 = 2, delta_0 = 1 + 4/2 - 2 = 1; gamma lambda = 1/4.
// A_2 = 4, A_1 = 2 + 4/4 = 3, A_0 = 1 + 3/4 = 1.75.
const Numbers kPlainAdvantage = {1.75f, 3, 4}, kPlainReturns = {3.75f, 7, 12};

TEST(MathGae, RunningEpisode) {
  Rollout r;
  r.run();
  EXPECT_EQ(r.advantage, kPlainAdvantage);
  EXPECT_EQ(r.returns, kPlainReturns);
}

TEST(MathGae, NothingIsWorthAnythingAfterATermination) {
  Rollout r;
  r.end(1, Done::terminated);
  r.run();
  // A_1 = 2 - 4 = -2, A_0 = 1 - 2/4 = 0.5; step 2 belongs to the next episode.
  EXPECT_EQ(r.advantage, (Numbers{0.5f, -2, 4}));
  EXPECT_EQ(r.returns, (Numbers{2.5f, 2, 12}));
}

TEST(MathGae, ATruncationIsWorthTheValueOfTheFinalObservation) {
  Rollout r;
  r.end(1, Done::truncated);
  r.run();
  // A_1 = 2 + 10/2 - 4 = 3, A_0 = 1 + 3/4 = 1.75.
  EXPECT_EQ(r.advantage, (Numbers{1.75f, 3, 4}));
  EXPECT_EQ(r.returns, (Numbers{3.75f, 7, 12}));
  r.final_value = {6};
  r.run();
  // A_1 = 2 + 6/2 - 4 = 1, A_0 = 1 + 1/4 = 1.25.
  EXPECT_EQ(r.advantage, (Numbers{1.25f, 1, 4}));
}

TEST(MathGae, NothingCrossesAReset) {
  for (const Done how : {Done::terminated, Done::truncated}) {
    Rollout plain, other;
    plain.end(1, how);
    other.end(1, how);
    other.reward[2] = 1e6f;  // the first step of the next episode,
    other.value[2] = -1e6f;  // the value of its first observation,
    other.value[3] = 3e6f;   // and of what comes behind
    plain.run();
    other.run();
    EXPECT_EQ(other.advantage[0], plain.advantage[0]);
    EXPECT_EQ(other.advantage[1], plain.advantage[1]);
    // 1e6 + 3e6/2 + 1e6
    EXPECT_EQ(other.advantage[2], 3.5e6f);
  }
}

TEST(MathGae, ATerminationInTheLastStepIgnoresWhatIsBehindTheRollout) {
  Rollout r;
  r.end(2, Done::terminated);
  r.run();
  // A_2 = 4 - 8 = -4, A_1 = 2 - 4/4 = 1, A_0 = 1 + 1/4 = 1.25.
  EXPECT_EQ(r.advantage, (Numbers{1.25f, 1, -4}));
}

TEST(MathGae, AnAgentThatDiesHasNoFuture) {
  // Two agents: slot 0 lives, slot 1 dies in step 1 (dead at the observations 2 and 3).
  Rollout r;
  r.n = 2;
  r.reward = {1, 1, 2, 2, 4, 4};
  r.value = {2, 2, 4, 4, 8, 8, 16, 16};
  r.final_value = {10, 10};
  r.alive = {1, 1, 1, 1, 1, 0, 1, 0};
  r.final_alive = {1, 1};
  r.run();
  // Slot 1: A_1 = 2 - 4 = -2, A_0 = 1 - 2/4 = 0.5; afterwards 0, although reward and values are not.
  EXPECT_EQ(r.advantage, (Numbers{1.75f, 0.5f, 3, -2, 4, 0}));
  EXPECT_EQ(r.returns, (Numbers{3.75f, 2.5f, 7, 2, 12, 0}));
}

TEST(MathGae, ADeadAgentLivesAgainAfterTheReset) {
  // It dies in step 0, the game ends in step 1, and step 2 is the first of the next game.
  Rollout r;
  r.alive = {1, 0, 1, 1};
  r.end(1, Done::truncated);
  r.run();
  // A_0 = 1 - 2 = -1: the final value is for those who lived to see it.
  EXPECT_EQ(r.advantage, (Numbers{-1, 0, 4}));
  EXPECT_EQ(r.returns, (Numbers{1, 0, 12}));
}

TEST(MathGae, DeathInTheLastStepOfATruncatedGame) {
  // Slot 0 lives at the final observation, slot 1 died in the very step that the time limit cut off.
  Rollout r;
  r.n = 2;
  r.reward = {1, 1, 2, 2, 4, 4};
  r.value = {2, 2, 4, 4, 8, 8, 16, 16};
  r.alive = {1, 1, 1, 1, 1, 1, 1, 1};
  r.final_value = {10, 10};
  r.final_alive = {1, 0};
  r.end(2, Done::truncated);
  r.run();
  // Slot 0: A_2 = 4 + 10/2 - 8 = 1,  A_1 = 2 + 1/4 = 2.25, A_0 = 1 + 2.25/4 = 1.5625.
  // Slot 1: A_2 = 4 - 8 = -4,        A_1 = 2 - 4/4 = 1,    A_0 = 1 + 1/4 = 1.25.
  EXPECT_EQ(r.advantage, (Numbers{1.5625f, 1.25f, 2.25f, 1, 1, -4}));
}

TEST(MathGae, NormalisedValuesAreBroughtBackToRewardUnits) {
  // value = 3 + 2 v: the numbers of the plain tests, as (value - 3) / 2.
  const float mean = 3, deviation = 2;
  Rollout r;
  r.value = {-0.5f, 0.5f, 2.5f, 6.5f};
  r.final_value = {1.5f};
  r.value_mean = &mean;
  r.value_std = &deviation;
  r.run();
  EXPECT_EQ(r.advantage, kPlainAdvantage);
  EXPECT_EQ(r.returns, kPlainReturns);  // in reward units

  // Final value 3 + 2 x 1.5 = 6, as above.
  r.end(1, Done::truncated);
  r.run();
  EXPECT_EQ(r.advantage, (Numbers{1.25f, 1, 4}));

  // The end of a game is worth 0 in reward units, not the normaliser's mean.
  r.end(1, Done::terminated);
  r.run();
  EXPECT_EQ(r.advantage, (Numbers{0.5f, -2, 4}));
}

TEST(MathGae, WorldsAndAgentsDoNotMix) {
  // 2 worlds of 3 agents; column c has the plain rewards and values times c + 1. World 1 ends in step 1.
  Rollout r;
  r.n_worlds = 2;
  r.n = 3;
  const size_t columns = 6;
  const Rollout plain;
  r.reward.clear();
  r.value.clear();
  for (size_t t = 0; t < 4; ++t)
    for (size_t c = 0; c < columns; ++c) {
      const float factor = static_cast<float>(c + 1);
      if (t < 3) r.reward.push_back(plain.reward[t] * factor);
      r.value.push_back(plain.value[t] * factor);
    }
  r.alive.assign(4 * columns, 1);
  r.final_alive.assign(columns, 1);
  r.final_value.assign(columns, 1e6f);  // not wanted by anybody: nothing is truncated
  r.done = {0, 0, 0, static_cast<uint8_t>(Done::terminated), 0, 0};
  r.run();
  const Numbers ended = {0.5f, -2, 4};
  for (size_t t = 0; t < 3; ++t)
    for (size_t c = 0; c < columns; ++c) {
      const float factor = static_cast<float>(c + 1);
      const float expected = factor * (c < 3 ? kPlainAdvantage[t] : ended[t]);
      EXPECT_EQ(r.advantage[t * columns + c], expected) << "step " << t << ", column " << c;
    }
}

/// Two agents in one world that get 1, 2, 4 and 3, 6, 8 and are both valued at 2, 4, 8, 16.
Rollout team_of_two(float share) {
  Rollout r;
  r.n = 2;
  r.reward = {1, 3, 2, 6, 4, 8};
  r.value = {2, 2, 4, 4, 8, 8, 16, 16};
  r.alive = {1, 1, 1, 1, 1, 1, 1, 1};
  r.final_value = {10, 10};
  r.final_alive = {1, 1};
  r.team_share = share;
  return r;
}

TEST(MathGae, AShareOfTheTeamsRewardGoesToEachAgent) {
  Rollout r = team_of_two(0.5f);
  r.run();
  // Means 2, 4, 6; half of them and half of the own: 1.5, 3, 5 for agent 0 and 2.5, 5, 7 for agent 1.
  // Agent 0: A_2 = 5 + 16/2 - 8 = 5, A_1 = 3 + 8/2 - 4 + 5/4 = 4.25, A_0 = 1.5 + 4/2 - 2 + 4.25/4 = 2.5625.
  // Agent 1: A_2 = 7, A_1 = 5 + 7/4 = 6.75, A_0 = 2.5 + 6.75/4 = 4.1875.
  EXPECT_EQ(r.advantage, (Numbers{2.5625f, 4.1875f, 4.25f, 6.75f, 5, 7}));
}

TEST(MathGae, WhoDiesForASharedRewardLeavesBehindWhatItsMatesExpect) {
  // Agent 1 dies in step 1: it is dead at the observations 2 and 3. With everything shared its mate's value, 8, is its
  // own future: A_1 = (2 + 6)/2 + 8/2 - 4 = 4, A_0 = (1 + 3)/2 + 4/2 - 2 + 4/4 = 3.
  Rollout r = team_of_two(1);
  r.alive = {1, 1, 1, 1, 1, 0, 1, 0};
  r.reward[5] = 0;
  r.run();
  EXPECT_EQ(r.advantage[3], 4);
  EXPECT_EQ(r.advantage[1], 3);
  EXPECT_EQ(r.advantage[5], 0);
  // Half of it shared: one of two lives, so its value counts 0.5 / (0.5 x 2 / 1 + 0.5) = 1/3.
  // A_1 = (0.5 x 6 + 0.5 x 4) + 8/3/2 - 4 = 1 + 4/3.
  r.team_share = 0.5f;
  r.run();
  EXPECT_NEAR(r.advantage[3], 1 + 4 / 3.0, 1e-6);
  // Nothing shared: it has no future, A_1 = 6 - 4 = 2.
  r.team_share = 0;
  r.run();
  EXPECT_EQ(r.advantage[3], 2);
}

TEST(MathGae, WhatIsLeftBehindDoesNotCrossTheEndOfAGame) {
  Rollout r = team_of_two(1);
  r.alive = {1, 1, 1, 1, 1, 1, 1, 1};  // the observation 2 is the next game's
  r.final_alive = {1, 0};
  r.end(1, Done::terminated);
  r.run();
  EXPECT_EQ(r.advantage[3], 0) << "(2 + 6)/2 - 4, and the game is decided";
  r.end(1, Done::truncated);
  r.run();
  EXPECT_EQ(r.advantage[3], 5) << "(2 + 6)/2 + 10/2 - 4: its mate lived at the time limit, valued at 10";
  EXPECT_EQ(r.advantage[2], 5) << "the mate itself";
}

}  // namespace
}  // namespace giga
