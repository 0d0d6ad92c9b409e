// Wilson's interval of a share.
#pragma once

#include <algorithm>
#include <cmath>

namespace giga {

struct Interval {
  double lo, hi;
};

/// The standard normal distribution has 95 % of its mass within this distance from 0.
constexpr double kNormal95 = 1.959963984540054;

/// 95 % interval of a share: k successes of n (Wilson 1927). [0, 1] for n = 0.
inline Interval wilson95(int k, int n) {
  if (n <= 0) return {0, 1};
  const double z = kNormal95, p = static_cast<double>(k) / n, z2n = z * z / n;
  const double centre = (p + z2n / 2) / (1 + z2n);
  const double half = z * std::sqrt(p * (1 - p) / n + z2n / (4.0 * n)) / (1 + z2n);
  return {std::max(0.0, centre - half), std::min(1.0, centre + half)};
}

}  // namespace giga
