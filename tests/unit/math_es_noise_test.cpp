// Noise of evolution strategies: normal, addressed by counters, mirrored, of low rank; and the sums over it.
#include "math/es_noise.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace giga::test {
namespace {

EsNoise full(int64_t n_parameters, int antithetic = 0) {
  return {7, 3, 1, antithetic, 0, nullptr, nullptr, n_parameters};
}

/// Mean and variance of f(member, parameter).
template <class F>
std::pair<double, double> mean_and_variance(int64_t members, int64_t parameters, F&& f) {
  double sum = 0, square_sum = 0;
  for (int64_t m = 0; m < members; ++m)
    for (int64_t p = 0; p < parameters; ++p) {
      const auto x = static_cast<double>(f(m, p));
      sum += x;
      square_sum += x * x;
    }
  const double n = static_cast<double>(members * parameters), mean = sum / n;
  return {mean, square_sum / n - mean * mean};
}

TEST(MathEsNoise, IsStandardNormal) {
  const EsNoise noise = full(101);
  const auto [mean, variance] = mean_and_variance(1000, 101, noise);
  // 101,000 numbers: standard errors 0.0031 of the mean, sqrt(2 / 101000) = 0.0044 of the variance; 5 of them.
  EXPECT_NEAR(mean, 0, 0.016);
  EXPECT_NEAR(variance, 1, 0.023);
  // A fraction 0.0455 lies beyond 2; standard error 0.00066.
  int beyond = 0;
  for (int64_t m = 0; m < 1000; ++m)
    for (int64_t p = 0; p < 101; ++p) beyond += std::abs(noise(m, p)) > 2 ? 1 : 0;
  EXPECT_NEAR(beyond / 101000.0, 0.0455, 0.0033);
}

TEST(MathEsNoise, EveryCounterMatters) {
  const EsNoise noise = full(16);
  EsNoise seed = noise, generation = noise, team = noise;
  seed.seed ^= 1;
  generation.generation += 1;
  team.team = 0;
  for (const EsNoise& other : {seed, generation, team}) EXPECT_NE(noise(0, 5), other(0, 5));
  EXPECT_NE(noise(0, 5), noise(1, 5));
  EXPECT_NE(noise(0, 5), noise(0, 6));
  EXPECT_EQ(noise(0, 5), full(16)(0, 5)) << "the same numbers whenever it is asked";
}

TEST(MathEsNoise, AntitheticPairsAreMirrored) {
  const EsNoise noise = full(9, 1);
  for (int64_t m = 0; m < 6; m += 2)
    for (int64_t p = 0; p < 9; ++p) EXPECT_EQ(noise(m, p), -noise(m + 1, p));
  EXPECT_NE(noise(0, 0), noise(2, 0));
}

/// A 3 x 2 matrix at parameters 1 to 6, between two that have numbers of their own.
struct SmallMatrix {
  explicit SmallMatrix(int rank) {
    left.assign(8, -1);
    right.assign(8, -1);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 2; ++j) {
        left[static_cast<size_t>(1 + 2 * i + j)] = i * rank;
        right[static_cast<size_t>(1 + 2 * i + j)] = 3 * rank + j * rank;
      }
    noise = {11, 0, 0, 0, rank, left.data(), right.data(), 8};
  }
  std::vector<int32_t> left, right;
  EsNoise noise{};
};

TEST(MathEsNoise, LowRankIsAProductOfTwoFactors) {
  const SmallMatrix one(1);
  // Rank 1: all 2 x 2 minors of A B^T vanish.
  for (int64_t m = 0; m < 20; ++m) {
    const auto e = [&](int i, int j) { return static_cast<double>(one.noise(m, 1 + 2 * i + j)); };
    EXPECT_NEAR(e(0, 0) * e(1, 1), e(0, 1) * e(1, 0), 1e-5);
    EXPECT_NEAR(e(1, 0) * e(2, 1), e(1, 1) * e(2, 0), 1e-5);
  }
}

TEST(MathEsNoise, LowRankOfFullRankHasTheCovarianceOfTheFullOne) {
  // E[e_p e_q] = 1 for p = q, else 0, at any rank: here r = min(3, 2) = 2. 40,000 members: a product of two such
  // numbers has a variance of at most E[e^4] - 1 = 3 + 6 / r - 1 = 5; standard error sqrt(5 / 40000) = 0.011, 5 of them
  // 0.056.
  const SmallMatrix matrix(2);
  constexpr int64_t kMembers = 40'000;
  std::vector<double> covariance(64, 0);
  for (int64_t m = 0; m < kMembers; ++m) {
    double e[8];
    for (int p = 0; p < 8; ++p) e[p] = static_cast<double>(matrix.noise(m, p));
    for (int p = 0; p < 8; ++p)
      for (int q = 0; q < 8; ++q) covariance[static_cast<size_t>(8 * p + q)] += e[p] * e[q] / kMembers;
  }
  for (int p = 0; p < 8; ++p)
    for (int q = 0; q < 8; ++q)
      EXPECT_NEAR(covariance[static_cast<size_t>(8 * p + q)], p == q ? 1 : 0, 0.056) << p << ", " << q;
}

TEST(MathEsNoise, MembersAreMeanPlusSigmaTimesTheNoise) {
  const EsNoise noise = full(3);
  const std::vector<float> mean = {1, 2, 3}, sigma = {0.5f, 0, 2};
  std::vector<float> members(12, NAN);
  const PerturbMembers perturb{noise, 0, mean.data(), sigma.data(), members.data()};
  for (int64_t row = 0; row < 12; ++row) perturb(row);
  for (int64_t m = 0; m < 4; ++m)
    for (int64_t p = 0; p < 3; ++p)
      EXPECT_EQ(members[static_cast<size_t>(3 * m + p)],
                mean[static_cast<size_t>(p)] + sigma[static_cast<size_t>(p)] * noise(m, p));
}

TEST(MathEsNoise, MomentsAreSumsOverTheMembers) {
  const EsNoise noise = full(2);
  const std::vector<float> weight = {0.5f, -1, 0.25f};
  std::vector<float> first(2, NAN), second(2, NAN);
  const NoiseMoments moments{noise, 0, 2, weight.data(), 3, first.data(), second.data()};
  for (int64_t p = 0; p < 2; ++p) {
    moments(p);
    const float a = noise(0, p), b = noise(1, p), c = noise(2, p);
    EXPECT_NEAR(first[static_cast<size_t>(p)], 0.5f * a - b + 0.25f * c, 1e-6);
    EXPECT_NEAR(second[static_cast<size_t>(p)], 0.5f * a * a - b * b + 0.25f * c * c, 1e-6);
  }
}

// What several ranks make of a population, each of its members and of its parameters, is what one makes of all.
TEST(MathEsNoise, PiecesAreThoseOfTheWhole) {
  const EsNoise noise = full(5);
  constexpr size_t kMembers = 300, kParts = 3;
  const std::vector<float> mean = {1, 2, 3, 4, 5}, sigma = {0.5f, 0, 2, 1, 0.1f};
  std::vector<float> all(5 * kMembers), late(5, NAN), weight(kMembers);
  const PerturbMembers whole{noise, 0, mean.data(), sigma.data(), all.data()};
  for (int64_t row = 0; row < static_cast<int64_t>(all.size()); ++row) whole(row);
  const PerturbMembers piece{noise, 17, mean.data(), sigma.data(), late.data()};
  for (int64_t row = 0; row < 5; ++row) piece(row);
  EXPECT_EQ(late, std::vector<float>(all.begin() + 17 * 5, all.begin() + 18 * 5));

  for (size_t m = 0; m < kMembers; ++m) weight[m] = 0.01f * static_cast<float>(m) - 1;
  const auto sums = [&](int64_t first, int64_t n) {
    std::vector<float> parts(kParts * static_cast<size_t>(n), NAN), squares = parts, sum(static_cast<size_t>(n), NAN);
    const NoiseMoments moments{noise, first, n, weight.data(), kMembers, parts.data(), squares.data()};
    for (int64_t row = 0; row < static_cast<int64_t>(parts.size()); ++row) moments(row);
    for (int64_t k = 0; k < n; ++k) SumOfParts{kParts, n, parts.data(), sum.data()}(k);
    return sum;
  };
  std::vector<float> joined = sums(0, 3);
  for (const float x : sums(3, 2)) joined.push_back(x);
  EXPECT_EQ(joined, sums(0, 5));
}

TEST(MathEsNoise, MomentsOfPartsOfTheMembers) {
  const EsNoise noise = full(2);
  constexpr int64_t kMembers = 300;  // 128, 128 and 44
  ASSERT_EQ(NoiseMoments::parts(kMembers), 3);
  std::vector<float> weight(kMembers), first(6, NAN), second(6, NAN);
  for (size_t m = 0; m < weight.size(); ++m) weight[m] = 0.01f * static_cast<float>(m);
  const NoiseMoments moments{noise, 0, 2, weight.data(), kMembers, first.data(), second.data()};
  for (int64_t row = 0; row < 6; ++row) moments(row);
  for (int64_t p = 0; p < 2; ++p) {
    double expected[3] = {}, expected_square[3] = {};
    for (int64_t m = 0; m < kMembers; ++m) {
      const auto w = static_cast<double>(weight[static_cast<size_t>(m)]), e = static_cast<double>(noise(m, p));
      expected[m / 128] += w * e;
      expected_square[m / 128] += w * e * e;
    }
    for (int64_t part = 0; part < 3; ++part) {
      EXPECT_NEAR(first[static_cast<size_t>(2 * part + p)], expected[part], 1e-3);
      EXPECT_NEAR(second[static_cast<size_t>(2 * part + p)], expected_square[part], 1e-3);
    }
  }
}

}  // namespace
}  // namespace giga::test
