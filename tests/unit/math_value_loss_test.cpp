// ValueLoss: squared, Huber and clipped, by hand and against finite differences.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/philox.hpp"
#include "math/ppo_loss.hpp"
#include "support/numbers.hpp"

namespace giga {
namespace {

struct Result {
  float loss, d_value;
};

/// The loss of one living row; value_coef 1/2 and inv_count 1/4. The normaliser says value = 10 + 2 v; both values are
/// v.
Result value_loss(float value, float old_value, float returns, float clip_coef, float huber_delta, bool alive = true) {
  const float mean = 10, deviation = 2, inv_count = 0.25f;
  const uint8_t lives = alive;
  Result r{kNan, kNan};
  const ValueLoss op{.rows = {nullptr, 1},
                     .value = &value,
                     .old_value = &old_value,
                     .returns = &returns,
                     .alive = &lives,
                     .value_mean = &mean,
                     .value_std = &deviation,
                     .inv_count = &inv_count,
                     .value_coef = 0.5f,
                     .error = {.clip_coef = clip_coef, .huber_delta = huber_delta},
                     .d_value = &r.d_value,
                     .loss = &r.loss};
  op(0);
  return r;
}

TEST(MathValueLoss, ByHand) {
  struct Case {
    const char* what;
    float value, old_value, returns, clip, huber, loss, d_value;
  };
  // The target is (returns - 10) / 2 = 3 in the normaliser's units; d = 0.5 x slope / 4.
  const Case cases[] = {
      {"squared: e = -2, loss 2, slope -2", 1, 0, 16, 0, 0, 2, -0.25f},
      {"squared: e = 1.5", 4.5f, 0, 16, 0, 0, 1.125f, 0.1875f},
      {"Huber, linear: 1 (2 - 1/2), slope -1", 1, 0, 16, 0, 1, 1.5f, -0.125f},
      {"Huber, linear above: 1 (1.5 - 1/2), slope 1", 4.5f, 0, 16, 0, 1, 1, 0.125f},
      {"Huber, quadratic: e = -0.5", 2.5f, 0, 16, 0, 1, 0.125f, -0.0625f},
      {"clipped: old 0, held at 0.5, e = -2.5 is worse than -2: flat", 1, 0, 16, 0.5f, 0, 3.125f, 0},
      {"clipped: old 3.5, held at 3, e = 0 is better than -2: the plain error", 1, 3.5f, 16, 0.5f, 0, 2, -0.25f},
      {"clipped: old 6, held at 5.5, e = 2.5 is worse than 1.5: flat", 4.5f, 6, 16, 0.5f, 0, 3.125f, 0},
      {"clipped: old 0.75, within 0.5: the plain error", 1, 0.75f, 16, 0.5f, 0, 2, -0.25f},
      {"clipped Huber: held at 0.5, 1 (2.5 - 1/2)", 1, 0, 16, 0.5f, 1, 2, 0},
  };
  for (const Case& c : cases) {
    const Result r = value_loss(c.value, c.old_value, c.returns, c.clip, c.huber);
    EXPECT_FLOAT_EQ(r.loss, c.loss) << c.what;
    EXPECT_FLOAT_EQ(r.d_value, c.d_value) << c.what;
  }
}

TEST(MathValueLoss, WhatTheNetworkSaidHasNotMovedWhateverTheNormaliserDid) {
  // value = old value: the plain error, however narrow the clip and wherever the normaliser is. Target (returns - 10)
  // / 2.
  for (uint32_t trial = 0; trial < 100; ++trial) {
    DrawKey key(12, trial, 0);
    const float value = 4 * key.uniform(Draw::init, 0, 0) - 2, returns = 30 * key.uniform(Draw::init, 0, 1);
    const Result plain = value_loss(value, value, returns, 0, 0), clipped = value_loss(value, value, returns, 1e-6f, 0);
    EXPECT_EQ(clipped.loss, plain.loss) << "value " << value << ", returns " << returns;
    EXPECT_EQ(clipped.d_value, plain.d_value) << "value " << value << ", returns " << returns;
  }
}

TEST(MathValueLoss, TheDeadDoNotCount) {
  const Result r = value_loss(1, 0, 16, 0, 0, false);
  EXPECT_EQ(r.loss, 0.0f);
  EXPECT_EQ(r.d_value, 0.0f);
}

TEST(MathValueLoss, WithoutNormaliserAndByIndex) {
  // Minibatch states 2 and 0 of 2 agents: rollout rows 4, 5, 0, 1. Returns are 10 x row, values are 1.
  const std::vector<int64_t> index = {2, 0};
  const std::vector<float> value(4, 1), old(6, kNan), returns = {0, 10, 20, 30, 40, 50};
  const std::vector<uint8_t> alive = {1, 1, 1, 1, 1, 0};
  const float inv_count = 1;
  std::vector<float> d_value(4, kNan), loss(4, kNan);
  const ValueLoss op{.rows = {index.data(), 2},
                     .value = value.data(),
                     .old_value = old.data(),
                     .returns = returns.data(),
                     .alive = alive.data(),
                     .value_mean = nullptr,
                     .value_std = nullptr,
                     .inv_count = &inv_count,
                     .value_coef = 1,
                     .error = {.clip_coef = 0, .huber_delta = 0},
                     .d_value = d_value.data(),
                     .loss = loss.data()};
  for (int64_t row = 0; row < 4; ++row) op(row);
  EXPECT_EQ(d_value, (std::vector<float>{-39, 0, 1, -9}));        // 1 - 40, dead, 1 - 0, 1 - 10
  EXPECT_EQ(loss, (std::vector<float>{760.5f, 0, 0.5f, 40.5f}));  // 39^2 / 2, ...
}

TEST(MathValueLoss, GradientAgainstFiniteDifferences) {
  // max(error(v), error(clip(v, old +- clip))) in double precision at random places away from its kinks.
  struct Kind {
    double clip, huber;
  };
  int n_flat = 0, n_tested = 0;
  for (const Kind kind : {Kind{0, 0}, Kind{0, 0.7}, Kind{0.4, 0}, Kind{0.4, 0.7}})
    for (uint32_t trial = 0; trial < 100; ++trial) {
      DrawKey key(11, trial, 0);
      const auto draw = [&](uint32_t k) { return 4 * key.uniform(Draw::init, 0, k) - 2; };
      const float value = draw(0), old_value = draw(1), returns = 10 + 2 * draw(2);
      const double old = static_cast<double>(old_value), target = (static_cast<double>(returns) - 10) / 2;
      const auto error = [&](double v) {
        const double e = std::abs(v - target);
        return kind.huber > 0 && e > kind.huber ? kind.huber * (e - kind.huber / 2) : e * e / 2;
      };
      const auto loss = [&](double v) {
        if (kind.clip <= 0) return error(v);
        return std::max(error(v), error(std::clamp(v, old - kind.clip, old + kind.clip)));
      };
      const double h = 1e-4, v = static_cast<double>(value);
      const double left = (loss(v) - loss(v - h)) / h, right = (loss(v + h) - loss(v)) / h;
      if (std::abs(left - right) > 1e-3) continue;  // a kink
      const Result r =
          value_loss(value, old_value, returns, static_cast<float>(kind.clip), static_cast<float>(kind.huber));
      EXPECT_NEAR(r.loss, loss(v), 5e-6);
      EXPECT_NEAR(r.d_value, (left + right) / 2 * 0.5 * 0.25, 1e-5)
          << "value " << value << ", old " << old << ", target " << target << ", clip " << kind.clip;
      n_flat += left == 0 && right == 0;
      ++n_tested;
    }
  EXPECT_GT(n_tested, 350);
  EXPECT_GT(n_flat, 20);
}

TEST(MathValueLoss, InsideTheClipTheGradientIsThePlainOne) {
  // Rounding must not decide: old + (value - old) is often one unit in the last place beside the value.
  const float zero = 0, one = 1;
  int n_wrong = 0;
  for (uint32_t trial = 0; trial < 1000; ++trial) {
    DrawKey key(13, trial, 0);
    const auto draw = [&](uint32_t k) { return 0.2f * key.uniform(Draw::init, 0, k) - 0.1f; };
    const float value = draw(0), old_value = draw(1), returns = 0.3f + draw(2);
    const uint8_t alive = 1;
    Result r{kNan, kNan};
    const ValueLoss op{.rows = {nullptr, 1},
                       .value = &value,
                       .old_value = &old_value,
                       .returns = &returns,
                       .alive = &alive,
                       .value_mean = &zero,
                       .value_std = &one,
                       .inv_count = &one,
                       .value_coef = 1,
                       .error = {.clip_coef = 0.5f, .huber_delta = 0},
                       .d_value = &r.d_value,
                       .loss = &r.loss};
    op(0);
    n_wrong += std::abs(r.d_value - (value - returns)) > 1e-6f;
  }
  EXPECT_EQ(n_wrong, 0) << "of 1000 gradients";
}

}  // namespace
}  // namespace giga
