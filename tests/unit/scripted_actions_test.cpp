// ScriptedActions: every script with both kinds of actions.
#include "scripted/actions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "support/numbers.hpp"

namespace giga {
namespace {

/// Worlds of 3 agents that have lived `age` steps when the draw step is `step`.
struct ScriptedWorlds {
  ScriptedWorlds(size_t n_worlds, uint32_t step, int32_t age) : steps(n_worlds, step), ages(n_worlds, age) {}

  std::vector<int32_t> discrete(Scripted kind, int team = 0) const {
    std::vector<int32_t> action(steps.size() * 3, -1);
    run(kind, ActionKind::discrete, team, action.data());
    return action;
  }
  std::vector<float> continuous(Scripted kind, int team = 0) const {
    std::vector<float> action(steps.size() * 9, kNan);
    run(kind, ActionKind::continuous, team, action.data());
    return action;
  }

  std::vector<uint32_t> steps;
  std::vector<int32_t> ages;

 private:
  void run(Scripted kind, ActionKind actions, int team, void* out) const {
    const ScriptedActions op{kind, actions, {steps.data(), 5, 0, 3, team}, ages.data(), out};
    for (int64_t row = 0; row < static_cast<int64_t>(steps.size()) * 3; ++row) op(row);
  }
};

TEST(ScriptedActions, FixedScripts) {
  // Action 9 (throttle + 1) + 3 (heading + 1) + (dive + 1): noop is 9 + 3 + 1 = 13; heading +1 is 16, heading -1 is 10.
  struct Case {
    Scripted kind;
    int32_t action;
    float turn;
  };
  const ScriptedWorlds worlds(7, 4, 4);
  for (const Case& c :
       {Case{Scripted::noop, 13, 0}, Case{Scripted::circle, 16, 1}, Case{Scripted::reverse_circle, 10, -1}}) {
    EXPECT_EQ(worlds.discrete(c.kind), std::vector<int32_t>(21, c.action));
    const std::vector<float> controls = worlds.continuous(c.kind);
    for (size_t i = 0; i < controls.size(); ++i) EXPECT_EQ(controls[i], i % 3 == 0 ? c.turn : 0.0f) << "number " << i;
  }
}

TEST(ScriptedActions, CircleRandomKeepsItsSideForAnEpisode) {
  // 200 worlds whose episode began at draw step 100, looked at over 50 steps.
  const ScriptedWorlds start(200, 100, 0);
  const std::vector<int32_t> sides = start.discrete(Scripted::circle_random);
  int left = 0;
  for (const int32_t action : sides) {
    EXPECT_TRUE(action == 16 || action == 10) << action;
    left += action == 16;
  }
  EXPECT_NEAR(left, 300, 49);  // 600 agents: deviation sqrt(600) / 2 = 12.2, four of them
  for (const uint32_t passed : {1u, 2u, 17u, 50u}) {
    const ScriptedWorlds later(200, 100 + passed, static_cast<int32_t>(passed));
    EXPECT_EQ(later.discrete(Scripted::circle_random), sides) << "after " << passed << " steps";
    const std::vector<float> controls = later.continuous(Scripted::circle_random);
    for (size_t i = 0; i < sides.size(); ++i) {
      EXPECT_EQ(controls[3 * i], sides[i] == 16 ? 1.0f : -1.0f) << "agent " << i;
      EXPECT_EQ(controls[3 * i + 1], 0.0f);
      EXPECT_EQ(controls[3 * i + 2], 0.0f);
    }
  }
  // Another episode, and the other team, draw anew.
  for (const auto& other :
       {ScriptedWorlds(200, 101, 0).discrete(Scripted::circle_random), start.discrete(Scripted::circle_random, 1)}) {
    int changed = 0;
    for (size_t i = 0; i < sides.size(); ++i) changed += other[i] != sides[i];
    EXPECT_NEAR(changed, 300, 49);
  }
}

TEST(ScriptedActions, RandomIsUniformOverTheActions) {
  // 54,000 draws, 2,000 for each action; chi-square with 26 degrees of freedom is above 61.7 with probability 1e-4.
  const std::vector<int32_t> action = ScriptedWorlds(18'000, 9, 2).discrete(Scripted::random);
  std::vector<int> counts(27, 0);
  for (const int32_t a : action) {
    ASSERT_TRUE(a >= 0 && a < 27) << a;
    ++counts[static_cast<size_t>(a)];
  }
  double chi = 0;
  for (const int count : counts) chi += (count - 2000.0) * (count - 2000.0) / 2000.0;
  EXPECT_LT(chi, 61.7);
}

TEST(ScriptedActions, RandomIsUniformOverTheControls) {
  // 18,000 agents; each control in ten bins of [-1, 1), 1,800 each. Chi-square with 9 degrees: above 33.7 with 1e-4.
  const std::vector<float> controls = ScriptedWorlds(6'000, 9, 2).continuous(Scripted::random);
  double cross = 0;
  for (size_t k = 0; k < 3; ++k) {
    std::vector<int> counts(10, 0);
    for (size_t i = k; i < controls.size(); i += 3) {
      ASSERT_TRUE(controls[i] >= -1 && controls[i] < 1) << controls[i];
      ++counts[static_cast<size_t>((controls[i] + 1) * 5)];
    }
    double chi = 0;
    for (const int count : counts) chi += (count - 1800.0) * (count - 1800.0) / 1800.0;
    EXPECT_LT(chi, 33.7) << "control " << k;
  }
  for (size_t i = 0; i < controls.size(); i += 3) cross += static_cast<double>(controls[i] * controls[i + 1]);
  EXPECT_NEAR(cross / 18'000, 0, 4 / 3.0 / std::sqrt(18'000.0));  // independent: variance of the product is 1/9
}

TEST(ScriptedActions, RandomDrawsAnewEveryStep) {
  const std::vector<int32_t> now = ScriptedWorlds(100, 9, 2).discrete(Scripted::random);
  const std::vector<int32_t> next = ScriptedWorlds(100, 10, 3).discrete(Scripted::random);
  int equal = 0;
  for (size_t i = 0; i < now.size(); ++i) equal += now[i] == next[i];
  EXPECT_LT(equal, 25);  // 300 / 27 = 11 by chance, deviation 3.3
}

}  // namespace
}  // namespace giga
