// Sampling: frequencies of categorical actions, moments and density of squashed Gaussian ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "support/numbers.hpp"

#include "math/distributions.hpp"

namespace giga {
namespace {

/// Chi-square with 26 degrees of freedom lies above this with probability 1e-4.
constexpr double kChiSquare26 = 61.7;

struct alignas(16) SampledLogits {
  float x[kLogitStride];
};

/// W worlds of n agents, all at the draw step `step`.
struct Draws {
  Draws(int64_t n_worlds, int agents, uint32_t step) : n(agents), steps(static_cast<size_t>(n_worlds), step) {}
  RowDraws rows(int team = 0, uint64_t seed = 7, int64_t first_world = 0) const {
    return {steps.data(), seed, first_world, n, team};
  }
  int n;
  std::vector<uint32_t> steps;
};

double chi_square(const std::array<int, 27>& counts, const std::array<double, 27>& p, int total) {
  double sum = 0;
  for (size_t k = 0; k < 27; ++k) {
    const double expected = p[k] * total;
    sum += (counts[k] - expected) * (counts[k] - expected) / expected;
  }
  return sum;
}

TEST(MathSampling, CategoricalFrequenciesFollowTheSoftmax) {
  // 20,000 worlds of 5 agents, all with the logits 3 sin(k), and one that is not used.
  SampledLogits row{};
  std::array<double, 27> p{}, uniform{};
  double sum = 0;
  for (size_t k = 0; k < 27; ++k) {
    row.x[k] = 3 * std::sin(static_cast<float>(k));
    p[k] = std::exp(static_cast<double>(row.x[k]));
    sum += p[k];
  }
  for (double& v : p) v /= sum;
  uniform.fill(1.0 / 27);
  row.x[27] = 40;
  const int total = 100'000;
  const std::vector<SampledLogits> logits(static_cast<size_t>(total), row);
  std::vector<int32_t> action(static_cast<size_t>(total), -1);
  std::vector<float> log_prob(static_cast<size_t>(total), kNan);
  const Draws draws(total / 5, 5, 3);
  const SampleCategorical sample{logits[0].x, draws.rows(), action.data(), log_prob.data()};
  for (int64_t r = 0; r < total; ++r) sample(r);

  std::array<int, 27> counts{};
  for (size_t r = 0; r < action.size(); ++r) {
    ASSERT_GE(action[r], 0);
    ASSERT_LT(action[r], 27);
    ++counts[static_cast<size_t>(action[r])];
    ASSERT_NEAR(log_prob[r], std::log(p[static_cast<size_t>(action[r])]), 2e-6) << "row " << r;
  }
  EXPECT_LT(chi_square(counts, p, total), kChiSquare26);
  EXPECT_GT(chi_square(counts, uniform, total), 1e4);  // the test can tell
}

TEST(MathSampling, TeamsWorldsStepsAndSeedsDrawApart) {
  const SampledLogits row{};
  const std::vector<SampledLogits> logits(400, row);
  const auto actions = [&](const RowDraws& draws) {
    std::vector<int32_t> action(400, -1);
    const SampleCategorical sample{logits[0].x, draws, action.data(), nullptr};
    for (int64_t r = 0; r < 400; ++r) sample(r);
    return action;
  };
  const Draws now(100, 4, 3), later(100, 4, 4);
  const std::vector<int32_t> first = actions(now.rows());
  EXPECT_EQ(actions(now.rows()), first);
  for (const auto& other : {actions(now.rows(1)), actions(later.rows()), actions(now.rows(0, 8))}) {
    int equal = 0;
    for (size_t r = 0; r < 400; ++r) equal += other[r] == first[r];
    EXPECT_LT(equal, 40);  // 400 / 27 = 15 by chance, deviation 3.8
  }
  // World 1 of one device is world 0 of a device that starts there.
  const std::vector<int32_t> shifted = actions(now.rows(0, 7, 1));
  EXPECT_TRUE(std::equal(shifted.begin(), shifted.end() - 4, first.begin() + 4));
}

// Beyond 65,536 agents, where a number has bit 16 of the team.
TEST(MathSampling, NoTwoAgentsOfALargeTeamDrawAlike) {
  constexpr int kAgents = 200'000;
  const Draws now(1, kAgents, 3);
  std::vector<uint32_t> numbers;
  for (const int team : {0, 1})
    for (int64_t row = 0; row < kAgents; ++row) numbers.push_back(now.rows(team).agent(row));
  EXPECT_EQ(numbers[65'535], 65'535u);
  std::sort(numbers.begin(), numbers.end());
  EXPECT_EQ(std::adjacent_find(numbers.begin(), numbers.end()), numbers.end());
}

TEST(MathSampling, GreedyTakesTheFirstLargestLogit) {
  std::vector<SampledLogits> logits(3);
  for (SampledLogits& row : logits) row.x[27] = 9;  // not an action
  logits[0].x[0] = 1;
  logits[1].x[26] = 1;
  logits[2].x[13] = logits[2].x[20] = 2;
  std::vector<int32_t> action(3, -1);
  std::vector<float> log_prob(3, kNan);
  const Draws draws(3, 1, 0);
  const SampleCategorical sample{logits[0].x, draws.rows(), action.data(), log_prob.data(), true};
  for (int64_t r = 0; r < 3; ++r) sample(r);
  EXPECT_EQ(action, (std::vector<int32_t>{0, 26, 13}));
  EXPECT_NEAR(log_prob[0], 1 - std::log(26 + std::exp(1.0)), 1e-6);
  EXPECT_NEAR(log_prob[2], 2 - std::log(25 + 2 * std::exp(2.0)), 1e-6);
}

TEST(MathSampling, HugeLogitsDoNotOverflow) {
  SampledLogits row{};
  for (float& x : row.x) x = -1e4f;
  row.x[5] = 1e4f;
  int32_t action = -1;
  float log_prob = kNan;
  const Draws draws(1, 1, 0);
  const SampleCategorical sample{row.x, draws.rows(), &action, &log_prob};
  sample(0);
  EXPECT_EQ(action, 5);
  EXPECT_EQ(log_prob, 0.0f);
}

TEST(MathSampling, GaussianMoments) {
  // 40,000 rows; means 0.5, -1, 0 and deviations exp(-0.5), exp(0), exp(0.3).
  const int total = 40'000;
  const float mean3[3] = {0.5f, -1, 0}, log_std[3] = {-0.5f, 0, 0.3f};
  std::vector<float> mean, pre_tanh_action(3 * total, kNan), action(3 * total, kNan), log_prob(total, kNan);
  for (int r = 0; r < total; ++r) mean.insert(mean.end(), mean3, mean3 + 3);
  const Draws draws(total / 4, 4, 9);
  const SampleGaussian sample{.mean = mean.data(),
                              .log_std = log_std,
                              .draws = draws.rows(1),
                              .pre_tanh_action = pre_tanh_action.data(),
                              .action = action.data(),
                              .log_prob = log_prob.data()};
  for (int64_t r = 0; r < total; ++r) sample(r);

  double cross = 0;  // of the standardised dimensions 0 and 1
  for (size_t k = 0; k < 3; ++k) {
    const double m = static_cast<double>(mean3[k]), s = std::exp(static_cast<double>(log_std[k]));
    double m1 = 0, m2 = 0, m3 = 0, m4 = 0;
    for (size_t r = 0; r < total; ++r) {
      const double e = (static_cast<double>(pre_tanh_action[3 * r + k]) - m) / s;
      m1 += e;
      m2 += e * e;
      m3 += e * e * e;
      m4 += e * e * e * e;
      if (k == 0) cross += e * (static_cast<double>(pre_tanh_action[3 * r + 1]) - static_cast<double>(mean3[1]));
    }
    // A standard normal has moments 0, 1, 0, 3 with variances 1, 2, 15, 96; four deviations of the mean of 40,000.
    EXPECT_NEAR(m1 / total, 0, 4 * std::sqrt(1.0 / total)) << "dimension " << k;
    EXPECT_NEAR(m2 / total, 1, 4 * std::sqrt(2.0 / total)) << "dimension " << k;
    EXPECT_NEAR(m3 / total, 0, 4 * std::sqrt(15.0 / total)) << "dimension " << k;
    EXPECT_NEAR(m4 / total, 3, 4 * std::sqrt(96.0 / total)) << "dimension " << k;
  }
  EXPECT_NEAR(cross / total, 0, 4 * std::sqrt(1.0 / total));
  for (size_t r = 0; r < total; ++r) {
    float sum = 0;
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(action[3 * r + k], std::tanh(pre_tanh_action[3 * r + k]));
      sum += squashed_log_prob(pre_tanh_action[3 * r + k], mean3[k], log_std[k]);
    }
    ASSERT_EQ(log_prob[r], sum) << "row " << r;  // what the update computes again: the ratio starts at exactly 1
  }
}

TEST(MathSampling, GreedyGaussianIsTheSquashedMean) {
  const float mean[3] = {0.5f, -2, 0}, log_std[3] = {0, 0, 0};
  float action[3] = {kNan, kNan, kNan};
  const Draws draws(1, 1, 0);
  const SampleGaussian sample{.mean = mean,
                              .log_std = log_std,
                              .draws = draws.rows(),
                              .pre_tanh_action = nullptr,
                              .action = action,
                              .log_prob = nullptr,
                              .greedy = true};
  sample(0);
  for (size_t k = 0; k < 3; ++k) EXPECT_EQ(action[k], std::tanh(mean[k]));
}

TEST(MathSampling, SquashedDensityByHandAndAtTheEdges) {
  // u = mean = 0, sigma = 1: density of tanh(u) is 1 / sqrt(2 pi), the slope of tanh being 1 there.
  EXPECT_FLOAT_EQ(squashed_log_prob(0, 0, 0), -0.9189385f);
  // u = 1, mean = 0, log_std = log 2: -1/8 - log 2 - 0.9189385 - log(1 - tanh(1)^2 = 0.4199743) = -0.8695279
  EXPECT_NEAR(squashed_log_prob(1, 0, std::log(2.0f)), -0.125 - 0.6931472 - 0.9189385 - std::log(0.4199743), 1e-6);
  // log(1 - tanh(u)^2) -> log 4 - 2 |u|, where 1 - tanh(u)^2 itself is 0 in floats.
  for (const float u : {20.0f, -20.0f, 60.0f, -60.0f})
    EXPECT_NEAR(log_squash_slope(u), std::log(4.0) - 2 * std::abs(static_cast<double>(u)), 1e-5) << u;
}

TEST(MathSampling, SquashedDensityIntegratesToOne) {
  for (const float mean : {0.0f, 0.7f, -1.5f})
    for (const float log_std : {-1.0f, 0.0f, 0.5f}) {
      // Midpoints over the action a = tanh(u) in (-1, 1), finer towards the edges: a = sin(t), da = cos(t) dt.
      const int steps = 20'000;
      double integral = 0;
      for (int k = 0; k < steps; ++k) {
        const double t = M_PI * ((k + 0.5) / steps - 0.5), a = std::sin(t);
        integral += std::exp(static_cast<double>(squashed_log_prob(static_cast<float>(std::atanh(a)), mean, log_std))) *
                    std::cos(t) * M_PI / steps;
      }
      EXPECT_NEAR(integral, 1, 2e-3) << "mean " << mean << ", log_std " << log_std;
    }
}

}  // namespace
}  // namespace giga
