// Angles and trigonometry of core/geometry.hpp against double precision.
#include "core/geometry.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace giga {
namespace {

TEST(CoreGeometry, SinCosAgainstDouble) {
  // Every 1e-5 over [-10, 10]. The result is rounded to float: half a unit in the last place near 1 is 6e-8; the
  // polynomial and the reduction add about one unit (1.2e-7).
  double worst_sin = 0, worst_cos = 0, worst_norm = 0;
  for (int k = -1000000; k <= 1000000; ++k) {
    const float angle = static_cast<float>(k) * 1e-5f;
    const SinCos got = sin_cos(angle);
    worst_sin = std::max(worst_sin, std::abs(static_cast<double>(got.sin) - std::sin(static_cast<double>(angle))));
    worst_cos = std::max(worst_cos, std::abs(static_cast<double>(got.cos) - std::cos(static_cast<double>(angle))));
    const double norm = static_cast<double>(got.sin) * static_cast<double>(got.sin) +
                        static_cast<double>(got.cos) * static_cast<double>(got.cos);
    worst_norm = std::max(worst_norm, std::abs(norm - 1));
  }
  EXPECT_LT(worst_sin, 1.5e-7);
  EXPECT_LT(worst_cos, 1.5e-7);
  EXPECT_LT(worst_norm, 3e-7);
}

TEST(CoreGeometry, SinCosAtTheQuadrants) {
  EXPECT_EQ(sin_cos(0).sin, 0.0f);
  EXPECT_EQ(sin_cos(0).cos, 1.0f);
  const struct {
    float angle;
    float sin, cos;
  } corners[] = {{kPi / 2, 1, 0}, {kPi, 0, -1},        {-kPi / 2, -1, 0},
                 {-kPi, 0, -1},   {1.5f * kPi, -1, 0}, {-3 * kPi, 0, -1}};
  for (const auto& c : corners) {
    // The float nearest to the corner is off by up to 4e-7 (3 pi), and so is its sine or cosine.
    EXPECT_NEAR(sin_cos(c.angle).sin, c.sin, 5e-7f) << c.angle;
    EXPECT_NEAR(sin_cos(c.angle).cos, c.cos, 5e-7f) << c.angle;
  }
}

TEST(CoreGeometry, SinCosKeepsTheSignOfTheSine) {
  for (const float angle : {0.3f, 1.0f, 2.5f, 4.0f, 6.0f, 9.0f}) {
    EXPECT_EQ(sin_cos(-angle).sin, -sin_cos(angle).sin) << angle;
    EXPECT_EQ(sin_cos(-angle).cos, sin_cos(angle).cos) << angle;
  }
}

TEST(CoreGeometry, FmodIsThatOfTheLibrary) {
  for (int k = -200000; k <= 200000; ++k) {
    const float a = static_cast<float>(k) * 1e-4f;  // [-20, 20]: all three branches
    ASSERT_EQ(fmod_two_pi(a), std::fmod(a, kTwoPi)) << a;
  }
  EXPECT_EQ(fmod_two_pi(kTwoPi), 0.0f);
  EXPECT_EQ(fmod_two_pi(2 * kTwoPi), 0.0f);
}

TEST(CoreGeometry, WrapOriginalLeavesTheNegativeSide) {
  EXPECT_NEAR(wrap_original(1.0f), 1.0f, 1e-6f);
  EXPECT_NEAR(wrap_original(4.0f), 4.0f - 2 * M_PI, 1e-6);  // beyond pi it wraps
  EXPECT_NEAR(wrap_original(-4.0f), -4.0f, 1e-6);           // below -pi it does not (Q4)
  EXPECT_NEAR(wrap_original(-9.0f), -9.0f, 1e-6);           // down to -3 pi = -9.42
  EXPECT_NEAR(wrap_original(-10.0f), -10.0 + 2 * M_PI, 1e-6);
  EXPECT_EQ(wrap_original(kPi), -kPi);
}

TEST(CoreGeometry, WrapAngleIsHalfOpen) {
  EXPECT_NEAR(wrap_angle(4.0f), 4.0 - 2 * M_PI, 1e-6);
  EXPECT_NEAR(wrap_angle(-4.0f), -4.0 + 2 * M_PI, 1e-6);
  EXPECT_NEAR(wrap_angle(-10.0f), -10.0 + 4 * M_PI, 2e-6);
  EXPECT_EQ(wrap_angle(kPi), -kPi);
  EXPECT_EQ(wrap_angle(-kPi), -kPi);
  EXPECT_EQ(wrap_angle(0.0f), 0.0f);
  // The float below -pi, -pi - 2.4e-7, belongs to the upper end: pi - 2.4e-7 or the float beside it, never pi itself.
  EXPECT_LT(wrap_angle(std::nextafter(-kPi, -4.0f)), kPi);
  EXPECT_NEAR(wrap_angle(std::nextafter(-kPi, -4.0f)), kPi, 5e-7f);
  for (int k = -300000; k <= 300000; ++k) {
    const float q = static_cast<float>(k) * 1e-4f;
    const float w = wrap_angle(q);
    ASSERT_GE(w, -kPi) << q;
    ASSERT_LT(w, kPi) << q;
    ASSERT_NEAR(std::remainder(static_cast<double>(w) - static_cast<double>(q), 2 * M_PI), 0, 4e-6) << q;
  }
}

TEST(CoreGeometry, ClampAndExtremes) {
  EXPECT_EQ(clamp(-2, -1, 1), -1.0f);
  EXPECT_EQ(clamp(2, -1, 1), 1.0f);
  EXPECT_EQ(clamp(0.25f, -1, 1), 0.25f);
  EXPECT_EQ(min_of(1, 2), 1.0f);
  EXPECT_EQ(min_of(2, 1), 1.0f);
  EXPECT_EQ(max_of(1, 2), 2.0f);
  EXPECT_EQ(max_of(2, 1), 2.0f);
  // x / 0 and 0 / 0 as sight uses them: both compare false.
  const float zero = clamp(0, 0, 0), inf = 1 / zero, nan = zero / zero;
  EXPECT_FALSE(inf <= 1);
  EXPECT_FALSE(nan <= 1);
}

}  // namespace
}  // namespace giga
