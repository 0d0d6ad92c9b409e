// The policy losses: hand numbers, and value and gradient against finite differences of the formula in double
// precision.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "core/philox.hpp"
#include "math/ppo_loss.hpp"
#include "support/numbers.hpp"

namespace giga {
namespace {

constexpr float kClip = 0.2f, kEntropyCoef = 0.1f;

TEST(MathPolicyLoss, ClippedSurrogateInAllFourCorners) {
  struct Case {
    float ratio, advantage, loss, d_log_prob, kl;
    bool clipped;
  };
  // loss = -min(ratio A, clip(ratio, 0.8, 1.2) A); its derivative by log p is -ratio A, or 0 where the clipped one
  // wins. kl = ratio - 1 - log ratio: 0.5 - 0.405465, -0.5 + 0.693147, 0.1 - 0.0953102.
  const Case cases[] = {
      {1.5f, 2, -2.4f, 0, 0.0945349f, true},  // min(3, 2.4)
      {1.5f, -2, 3, 3, 0.0945349f, true},     // min(-3, -2.4)
      {0.5f, 2, -1, -1, 0.1931472f, true},    // min(1, 1.6)
      {0.5f, -2, 1.6f, 0, 0.1931472f, true},  // min(-1, -1.6)
      {1.1f, 2, -2.2f, -2.2f, 0.0046898f, false}, {1.1f, -2, 2.2f, 2.2f, 0.0046898f, false}, {1, 2, -2, -2, 0, false},
  };
  for (const Case& c : cases) {
    const Surrogate s = clipped_surrogate(std::log(c.ratio) - 3.0f, -3.0f, c.advantage, kClip);
    EXPECT_NEAR(s.loss, c.loss, 2e-6) << "ratio " << c.ratio << ", advantage " << c.advantage;
    EXPECT_NEAR(s.d_log_prob, c.d_log_prob, 2e-6) << "ratio " << c.ratio << ", advantage " << c.advantage;
    EXPECT_NEAR(s.ratio, c.ratio, 1e-6);
    EXPECT_NEAR(s.kl, c.kl, 1e-6) << "ratio " << c.ratio;
    EXPECT_EQ(s.clipped, c.clipped) << "ratio " << c.ratio;
  }
}

/// What the losses read, for 3 states of 2 agents in the rollout, of which states 2 and 0 are the minibatch: its rows
/// are the rollout's rows 4, 5, 0, 1. Advantages are normalised with mean 1 and deviation 2.
struct Minibatch {
  const std::vector<int64_t> index = {2, 0};
  std::vector<float> old_log_prob = std::vector<float>(6, kNan), advantage = std::vector<float>(6, kNan);
  std::vector<uint8_t> alive = {1, 1, 0, 0, 1, 1};
  float advantage_mean = 1, advantage_inv_std = 0.5f, inv_count = 0.25f;

  PolicyLossInput input() const {
    return {.rows = {index.data(), 2},
            .old_log_prob = old_log_prob.data(),
            .advantage = advantage.data(),
            .alive = alive.data(),
            .advantage_mean = &advantage_mean,
            .advantage_inv_std = &advantage_inv_std,
            .inv_count = &inv_count,
            .entropy_coef = &kEntropyCoef,
            .clip_coef = &kClip};
  }
  static constexpr size_t kRows = 4;
  static constexpr size_t kSource[kRows] = {4, 5, 0, 1};
};

/// -min(ratio A, clip(ratio) A) - entropy_coef H, in double precision.
double objective(double log_prob, double old_log_prob, double advantage, double entropy) {
  const double ratio = std::exp(log_prob - old_log_prob), clip = static_cast<double>(kClip);
  const double held = std::min(std::max(ratio, 1 - clip), 1 + clip);
  return -std::min(ratio * advantage, held * advantage) - static_cast<double>(kEntropyCoef) * entropy;
}

/// The mean of log(1 - tanh(u)^2) for u ~ N(mean, exp(2 log_std)), by 8,001 nodes over +-8 deviations.
double squash_entropy_of(double mean, double log_std) {
  double sum = 0;
  for (int k = -4000; k <= 4000; ++k) {
    const double z = k * 0.002, far = std::abs(mean + std::exp(log_std) * z);
    sum += 0.002 * std::exp(-0.5 * z * z) * (2 * (std::log(2) - far) - 2 * std::log1p(std::exp(-2 * far)));
  }
  return sum / std::sqrt(2 * M_PI);
}

double slope(const std::function<double(double)>& f, double at) {
  const double h = 1e-5;
  return (f(at + h) - f(at - h)) / (2 * h);
}

struct alignas(16) LogitRow {
  float x[kLogitStride];
};

struct CategoricalRun {
  std::vector<LogitRow> d_logits;
  std::vector<float> diagnostics;
};
CategoricalRun run(const Minibatch& batch, const std::vector<LogitRow>& logits, const std::vector<int32_t>& action) {
  CategoricalRun out{std::vector<LogitRow>(Minibatch::kRows),
                     std::vector<float>(Minibatch::kRows * kNPolicyDiagnostics, kNan)};
  for (LogitRow& row : out.d_logits)
    for (float& x : row.x) x = kNan;
  const CategoricalLoss loss{batch.input(), logits[0].x, action.data(), out.d_logits[0].x, out.diagnostics.data()};
  for (size_t row = 0; row < Minibatch::kRows; ++row) loss(static_cast<int64_t>(row));
  return out;
}

TEST(MathPolicyLoss, CategoricalByHand) {
  // Uniform policy: log p = -log 27, entropy log 27, whose gradient is 0. Row 0: advantage (5 - 1) / 2 = 2, ratio 1:
  // d loss / d logit = -2 ([chosen] - 1/27) / 4. Row 1 is dead. Row 2: advantage (-3 - 1) / 2 = -2, ratio 1/2 below the
  // clip: no gradient. The 28th logit is not used, however large.
  Minibatch batch;
  const float uniform = -std::log(27.0f);
  batch.advantage = {-3, 1, 0, 0, 5, 7};
  batch.old_log_prob = {uniform + std::log(2.0f), uniform, 0, 0, uniform, uniform};
  batch.alive = {1, 1, 0, 0, 1, 0};
  std::vector<LogitRow> logits(Minibatch::kRows);
  for (LogitRow& row : logits) {
    for (float& x : row.x) x = 1.5f;
    row.x[27] = 50;
  }
  const std::vector<int32_t> action = {3, 3, 0, 0, 9, 9};
  const CategoricalRun out = run(batch, logits, action);
  for (size_t k = 0; k < kLogitStride; ++k) {
    const float expected = k == 27 ? 0.0f : (k == 9 ? -13.0f / 27 : 0.5f / 27);
    EXPECT_NEAR(out.d_logits[0].x[k], expected, 1e-6) << "logit " << k;
    EXPECT_EQ(out.d_logits[1].x[k], 0.0f) << "logit " << k << " of the dead";
    EXPECT_NEAR(out.d_logits[2].x[k], 0.0f, 1e-7) << "logit " << k << " of the clipped";
  }
  EXPECT_EQ(out.d_logits[0].x[27], 0.0f);
  const auto diagnostic = [&](size_t row, PolicyDiagnostic d) {
    return out.diagnostics[row * kNPolicyDiagnostics + d];
  };
  EXPECT_NEAR(diagnostic(0, kLossPolicy), -2.0f, 1e-6);
  EXPECT_NEAR(diagnostic(0, kLossEntropy), 3.2958369f, 2e-6);  // log 27
  EXPECT_NEAR(diagnostic(0, kLossRatioError), 0.0f, 1e-6);
  EXPECT_EQ(diagnostic(0, kLossClipped), 0.0f);
  EXPECT_EQ(diagnostic(0, kLossCount), 1.0f);
  for (int d = 0; d < kNPolicyDiagnostics; ++d) EXPECT_EQ(diagnostic(1, static_cast<PolicyDiagnostic>(d)), 0.0f);
  EXPECT_NEAR(diagnostic(2, kLossPolicy), 1.6f, 1e-6);  // -min(0.5 x -2, 0.8 x -2)
  EXPECT_EQ(diagnostic(2, kLossClipped), 1.0f);
  EXPECT_NEAR(diagnostic(2, kLossRatioError), 0.5f, 1e-6);
  EXPECT_NEAR(diagnostic(2, kLossKl), 0.1931472f, 1e-6);  // 0.5 - 1 + log 2
}

TEST(MathPolicyLoss, CategoricalAgainstFiniteDifferences) {
  // Random logits; ratios of 1, 0.6, 1.5 and 1.1 with advantages of both signs.
  int n_flat = 0;
  for (uint32_t trial = 0; trial < 16; ++trial) {
    DrawKey key(3, trial, 0);
    std::vector<LogitRow> logits(Minibatch::kRows);
    for (size_t row = 0; row < Minibatch::kRows; ++row)
      for (size_t k = 0; k < kLogitStride; ++k)
        logits[row].x[k] = 6 * key.uniform(Draw::init, static_cast<uint32_t>(row), static_cast<uint32_t>(k)) - 3;
    const auto log_softmax = [](const std::array<double, 27>& x) {
      double sum = 0;
      for (const double v : x) sum += std::exp(v);
      std::array<double, 27> log_p = x;
      for (double& v : log_p) v -= std::log(sum);
      return log_p;
    };
    const auto doubles = [&](size_t row) {
      std::array<double, 27> x{};
      for (size_t k = 0; k < 27; ++k) x[k] = static_cast<double>(logits[row].x[k]);
      return x;
    };
    Minibatch batch;
    std::vector<int32_t> action(6, 0);
    const double ratios[] = {1, 0.6, 1.5, 1.1};
    for (size_t row = 0; row < Minibatch::kRows; ++row) {
      const size_t source = Minibatch::kSource[row];
      action[source] = static_cast<int32_t>((trial * 5 + row * 7) % 27);
      const double log_p = log_softmax(doubles(row))[static_cast<size_t>(action[source])];
      batch.old_log_prob[source] = static_cast<float>(log_p - std::log(ratios[(row + trial) % 4]));
      batch.advantage[source] = (trial / 4 + row) % 2 ? 3.4f : -2.6f;  // (3.4 - 1) / 2 = 1.2, (-2.6 - 1) / 2 = -1.8
    }
    const CategoricalRun out = run(batch, logits, action);
    for (size_t row = 0; row < Minibatch::kRows; ++row) {
      const size_t source = Minibatch::kSource[row];
      const double advantage = (static_cast<double>(batch.advantage[source]) - 1) / 2;
      const double old = static_cast<double>(batch.old_log_prob[source]);
      double entropy = 0, chosen = 0;
      const auto loss = [&](size_t k, double value) {
        std::array<double, 27> x = doubles(row);
        x[k] = value;
        const std::array<double, 27> log_p = log_softmax(x);
        entropy = 0;
        for (const double v : log_p) entropy -= std::exp(v) * v;
        chosen = log_p[static_cast<size_t>(action[source])];
        return objective(chosen, old, advantage, entropy);
      };
      const double value = loss(0, static_cast<double>(logits[row].x[0]));
      const float* diagnostic = &out.diagnostics[row * kNPolicyDiagnostics];
      EXPECT_NEAR(diagnostic[kLossEntropy], entropy, 3e-6);
      EXPECT_NEAR(diagnostic[kLossPolicy] - kEntropyCoef * diagnostic[kLossEntropy], value, 5e-6)
          << "trial " << trial << ", row " << row;
      const double ratio = std::exp(chosen - old);
      n_flat += (advantage > 0 && ratio > 1.2) || (advantage < 0 && ratio < 0.8);
      for (size_t k = 0; k < 27; ++k) {
        const double expected = slope([&](double v) { return loss(k, v); }, static_cast<double>(logits[row].x[k])) / 4;
        EXPECT_NEAR(out.d_logits[row].x[k], expected, 2e-6) << "trial " << trial << ", row " << row << ", logit " << k;
      }
      EXPECT_EQ(out.d_logits[row].x[27], 0.0f);
    }
  }
  EXPECT_GE(n_flat, 8);  // of 64, the clipped gain was the smaller one: both branches were tested
  EXPECT_LE(n_flat, 48);
}

TEST(MathPolicyLoss, GaussianAgainstFiniteDifferences) {
  // Two living rows, one clipped, one dead; log p of the squashed action with the plain log(1 - tanh(u)^2).
  Minibatch batch;
  batch.alive = {1, 1, 0, 0, 1, 0};
  const std::vector<float> log_std = {-0.5f, 0.1f, 0.4f};
  const std::vector<float> mean = {0.3f, -0.2f, 0.1f, 9, 9, 9, -0.6f, 0.5f, 0.9f, 0.2f, 0, -0.4f};  // [4, 3]
  std::vector<float> pre_tanh_action(18, kNan);                                                     // [6, 3]
  const float u[] = {0.7f, -1.1f, 0.4f, 0, 0, 0, -0.9f, 1.2f, 1.6f, -0.1f, 0.3f, -1.5f};
  for (size_t row = 0; row < Minibatch::kRows; ++row)
    for (size_t k = 0; k < 3; ++k) pre_tanh_action[Minibatch::kSource[row] * 3 + k] = u[row * 3 + k];

  const auto log_prob = [&](size_t row, const std::array<double, 3>& m, const std::array<double, 3>& s) {
    double sum = 0;
    for (size_t k = 0; k < 3; ++k) {
      const double x = static_cast<double>(u[row * 3 + k]), e = (x - m[k]) / std::exp(s[k]);
      sum += -0.5 * e * e - s[k] - 0.5 * std::log(2 * M_PI) - std::log(1 - std::tanh(x) * std::tanh(x));
    }
    return sum;
  };
  const std::array<double, 3> s0 = {static_cast<double>(log_std[0]), static_cast<double>(log_std[1]),
                                    static_cast<double>(log_std[2])};
  const auto mean_of = [&](size_t row) {
    return std::array<double, 3>{static_cast<double>(mean[row * 3]), static_cast<double>(mean[row * 3 + 1]),
                                 static_cast<double>(mean[row * 3 + 2])};
  };
  const double ratio[] = {1.1, 1, 1.4, 0.7};  // rows 2 and 3 have advantages for which the clipped gain wins and loses
  const float advantage[] = {5, 1, 3, 4};     // normalised: 2, 0, 1, 1.5
  for (size_t row = 0; row < Minibatch::kRows; ++row) {
    batch.advantage[Minibatch::kSource[row]] = advantage[row];
    batch.old_log_prob[Minibatch::kSource[row]] =
        static_cast<float>(log_prob(row, mean_of(row), s0) - std::log(ratio[row]));
  }
  std::vector<float> d_mean(12, kNan), d_log_std(12, kNan), diagnostics(4 * kNPolicyDiagnostics, kNan);
  const GaussianLoss loss{.in = batch.input(),
                          .mean = mean.data(),
                          .log_std = log_std.data(),
                          .pre_tanh_action = pre_tanh_action.data(),
                          .d_mean = d_mean.data(),
                          .d_log_std = d_log_std.data(),
                          .diagnostics = diagnostics.data()};
  for (int64_t row = 0; row < 4; ++row) loss(row);

  for (size_t row = 0; row < Minibatch::kRows; ++row) {
    const float* diagnostic = &diagnostics[row * kNPolicyDiagnostics];
    if (row == 1) {
      for (size_t k = 0; k < 3; ++k) EXPECT_EQ(std::abs(d_mean[3 + k]) + std::abs(d_log_std[3 + k]), 0.0f);
      for (int d = 0; d < kNPolicyDiagnostics; ++d) EXPECT_EQ(diagnostic[d], 0.0f);
      continue;
    }
    const double old = static_cast<double>(batch.old_log_prob[Minibatch::kSource[row]]);
    const double a = (static_cast<double>(advantage[row]) - 1) / 2;
    const auto total = [&](const std::array<double, 3>& m, const std::array<double, 3>& s) {
      double entropy = 0;
      for (size_t k = 0; k < 3; ++k) entropy += s[k] + 0.5 * (1 + std::log(2 * M_PI)) + squash_entropy_of(m[k], s[k]);
      return objective(log_prob(row, m, s), old, a, entropy);
    };
    // The entropy to 2e-3, its slopes to 1e-2 (a deviation of 1.5, see squash_entropy); times kEntropyCoef, over 4.
    EXPECT_NEAR(diagnostic[kLossPolicy] - kEntropyCoef * diagnostic[kLossEntropy], total(mean_of(row), s0), 2e-4);
    for (size_t k = 0; k < 3; ++k) {
      const auto by_mean = [&](double v) {
        auto m = mean_of(row);
        m[k] = v;
        return total(m, s0);
      };
      const auto by_std = [&](double v) {
        auto s = s0;
        s[k] = v;
        return total(mean_of(row), s);
      };
      EXPECT_NEAR(d_mean[row * 3 + k], slope(by_mean, mean_of(row)[k]) / 4, k < 2 ? 2e-5 : 2.5e-4)
          << "row " << row << ", mean " << k;
      EXPECT_NEAR(d_log_std[row * 3 + k], slope(by_std, s0[k]) / 4, k < 2 ? 2e-5 : 2.5e-4)
          << "row " << row << ", log_std " << k;
    }
  }
  // Row 2 is clipped: only the entropy bonus is left. It draws means to the middle, where squashing takes the least,
  // and widens the narrow dimension: -0.1 / 4 before squashing. Row 3 is beyond the clip but still learns.
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_GT(d_mean[6 + k] * mean[6 + k], 0.0f);
    EXPECT_GT(d_log_std[6 + k], -0.025f);
    EXPECT_GT(std::abs(d_mean[9 + k]), 0.01f);
  }
}

TEST(MathPolicyLoss, TheEntropyOfASquashedActionHasAMostRandomDeviation) {
  // Narrow: hardly squashed, 0 - exp(-4) ^ 2. Wide: the actions gather at both ends, and more deviation is less
  // entropy.
  EXPECT_NEAR(squash_entropy(0, std::exp(-4.0f)).value, -std::exp(-8.0f), 1e-5);
  EXPECT_NEAR(squash_entropy(0, std::exp(-4.0f)).by_log_std, -2 * std::exp(-8.0f), 1e-5);
  EXPECT_GT(1 + squash_entropy(0, std::exp(-0.5f)).by_log_std, 0.3f);
  EXPECT_LT(1 + squash_entropy(0, std::exp(0.5f)).by_log_std, -0.3f);
  // At most that of all actions alike, log 2 a dimension.
  for (float log_std = -5; log_std <= 1; log_std += 0.25f)
    for (const float mean : {0.0f, 0.7f, -2.0f}) {
      const SquashEntropy s = squash_entropy(mean, std::exp(log_std));
      EXPECT_LT(log_std + 0.5f + kHalfLogTwoPi + s.value, kLogTwo) << mean << ", " << log_std;
      const double m = static_cast<double>(mean), d = static_cast<double>(log_std);
      const double allowed = log_std <= 0 ? 1e-4 : 2e-2;
      EXPECT_NEAR(s.value, squash_entropy_of(m, d), allowed) << mean << ", " << log_std;
      EXPECT_NEAR(s.by_mean, slope([&](double v) { return squash_entropy_of(v, d); }, m), 4 * allowed);
      EXPECT_NEAR(s.by_log_std, slope([&](double v) { return squash_entropy_of(m, v); }, d), 4 * allowed);
    }
}

}  // namespace
}  // namespace giga
