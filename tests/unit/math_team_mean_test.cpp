// LivingMean and its gradient, and the rounding of BFloat16.
#include "math/team_mean.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "support/numbers.hpp"

namespace giga {
namespace {

TEST(MathTeamMean, MeanOverTheLiving) {
  // Three states of 3 agents with 2 features: the middle agent is dead; all live; none lives.
  const std::vector<float> x = {1, 10, 100, 1000, 3, 30, 1, 2, 3, 4, 8, 9, 5, 5, 6, 6, 7, 7};
  const std::vector<float> alive = {1, 0, 1, 1, 1, 1, 0, 0, 0};
  std::vector<float> mean(6, kNan);
  const LivingMean<float> op{x.data(), alive.data(), 3, 2, mean.data()};
  for (int64_t row = 0; row < 6; ++row) op(row);
  // (1 + 3) / 2, (10 + 30) / 2; (1 + 3 + 8) / 3, (2 + 4 + 9) / 3; nobody: 0
  EXPECT_EQ(mean, (std::vector<float>{2, 20, 4, 5, 0, 0}));
}

TEST(MathTeamMean, GradientIsTheShareOfTheLiving) {
  const std::vector<float> d_mean = {6, -4, 9, 3, 5, 5};
  const std::vector<float> alive = {1, 0, 1, 1, 1, 1, 0, 0, 0};
  std::vector<float> d_x(18, kNan);
  const LivingMeanGradient<float> op{d_mean.data(), alive.data(), 3, 2, d_x.data()};
  for (int64_t row = 0; row < 6; ++row) op(row);
  // 6 / 2 and -4 / 2 for the two living, 9 / 3 and 3 / 3 for all three, nothing where nobody lives.
  EXPECT_EQ(d_x, (std::vector<float>{3, -2, 0, 0, 3, -2, 3, 1, 3, 1, 3, 1, 0, 0, 0, 0, 0, 0}));
}

TEST(MathTeamMean, HalfPrecisionSumsInFullPrecision) {
  // 256 + 1 + 1 + 2: in BFloat16, with 8 bits of mantissa, 256 + 1 would stay 256. The mean is 260 / 4 = 65.
  const std::vector<BFloat16> x = {BFloat16(256.0f), BFloat16(1.0f), BFloat16(1.0f), BFloat16(2.0f)};
  const std::vector<float> alive = {1, 1, 1, 1};
  BFloat16 mean(kNan);
  const LivingMean<BFloat16> op{x.data(), alive.data(), 4, 1, &mean};
  op(0);
  EXPECT_EQ(static_cast<float>(mean), 65.0f);

  const BFloat16 d_mean(6.0f);
  std::vector<BFloat16> d_x(4, BFloat16(kNan));
  const std::vector<float> three = {1, 1, 0, 1};
  const LivingMeanGradient<BFloat16> gradient{&d_mean, three.data(), 4, 1, d_x.data()};
  gradient(0);
  const float expected[] = {2, 2, 0, 2};  // 6 / 3
  for (size_t i = 0; i < 4; ++i) EXPECT_EQ(static_cast<float>(d_x[i]), expected[i]) << "agent " << i;
}

TEST(MathBFloat16, RoundsToNearestEven) {
  struct Case {
    float value;
    uint16_t bits;
  };
  const Case cases[] = {
      {0.0f, 0x0000},
      {-0.0f, 0x8000},
      {1.0f, 0x3F80},
      {-2.5f, 0xC020},                      // -1.25 x 2^1: mantissa 0100000
      {1.0f + 0x1p-9f, 0x3F80},             // below half of the last place 2^-7
      {1.0f + 0x1p-8f, 0x3F80},             // a tie goes to the even one, down here
      {1.0f + 0x1p-8f + 0x1p-20f, 0x3F81},  // just above the tie
      {1.0f + 3 * 0x1p-8f, 0x3F82},         // a tie between ..01 and ..10: up
      {-(1.0f + 3 * 0x1p-8f), 0xBF82},      // and the same below zero
      {2.0f - 0x1p-10f, 0x4000},            // the carry runs into the exponent
      {std::numeric_limits<float>::max(), 0x7F80},
      {std::numeric_limits<float>::infinity(), 0x7F80},
      {-std::numeric_limits<float>::infinity(), 0xFF80},
  };
  for (const Case& c : cases) EXPECT_EQ(BFloat16(c.value).bits, c.bits) << c.value;
}

TEST(MathBFloat16, NanStaysNan) {
  for (const uint32_t bits : {0x7FFFFFFFu, 0x7F800001u, 0xFFFFFFFFu, 0xFFC00000u}) {
    float value;
    std::memcpy(&value, &bits, sizeof value);
    EXPECT_TRUE(std::isnan(static_cast<float>(BFloat16(value)))) << std::hex << bits;
  }
}

TEST(MathBFloat16, EveryValueSurvivesTheRoundTrip) {
  for (uint32_t bits = 0; bits < 65536; ++bits) {
    BFloat16 b;
    b.bits = static_cast<uint16_t>(bits);
    const float value = static_cast<float>(b);
    if (std::isnan(value)) continue;
    ASSERT_EQ(BFloat16(value).bits, bits) << value;
  }
}

}  // namespace
}  // namespace giga
