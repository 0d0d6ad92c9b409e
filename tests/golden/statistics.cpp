// z tests and Fisher's exact test.
#include "golden/statistics.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace giga::golden {

Sample Sample::of(const std::vector<double>& values) {
  Sample s;
  s.n = static_cast<double>(values.size());
  if (values.empty()) return s;
  s.min = *std::min_element(values.begin(), values.end());
  s.max = *std::max_element(values.begin(), values.end());
  for (const double v : values) s.mean += v / s.n;
  double second = 0;
  for (const double v : values) {
    const double d2 = (v - s.mean) * (v - s.mean);
    second += d2 / s.n;
    s.fourth += d2 * d2 / s.n;
  }
  s.std = std::sqrt(second);
  return s;
}

namespace {

/// difference / error, where an error of zero asks for equality up to rounding.
double z_of(double difference, double error, double scale) {
  if (error > 1e-6 * std::max(1.0, scale)) return difference / error;
  return std::abs(difference) <= 1e-4 * std::max(1.0, scale) ? 0 : std::numeric_limits<double>::infinity();
}

double log_choose(double n, double k) { return std::lgamma(n + 1) - std::lgamma(k + 1) - std::lgamma(n - k + 1); }

/// The normal deviate z with P(|Z| > z) = p, by bisection.
double deviate_of(double p) {
  double lo = 0, hi = 40;
  for (int k = 0; k < 80; ++k) {
    const double mid = 0.5 * (lo + hi);
    (std::erfc(mid / std::sqrt(2.0)) > p ? lo : hi) = mid;
  }
  return lo;
}

}  // namespace

double z_of_means(const Sample& a, const Sample& b) {
  const double variance = (a.n * a.std * a.std + b.n * b.std * b.std) / (a.n + b.n);
  return z_of(a.mean - b.mean, std::sqrt(variance * (1 / a.n + 1 / b.n)), std::abs(b.mean));
}

double z_of_deviations(const Sample& ours, const Sample& recorded) {
  const double variance = ours.std * ours.std;
  const double of_variance = std::max(0.0, ours.fourth - variance * variance);
  const double error = ours.std > 0 ? std::sqrt(of_variance * (1 / ours.n + 1 / recorded.n)) / (2 * ours.std) : 0;
  return z_of(ours.std - recorded.std, error, recorded.std);
}

double z_of_counts(double k1, double n1, double k2, double n2) {
  const double k = k1 + k2, lo = std::max(0.0, k - n2), hi = std::min(k, n1);
  const auto log_p = [&](double x) { return log_choose(n1, x) + log_choose(n2, k - x) - log_choose(n1 + n2, k); };
  const double observed = log_p(k1);
  double p = 0;
  for (double x = lo; x <= hi; ++x)
    if (log_p(x) <= observed + 1e-7) p += std::exp(log_p(x));
  return deviate_of(std::min(1.0, p));
}

void CellReport::cell(const std::string& name, double z, double ours, double recorded) {
  ++n_cells_;
  EXPECT_LT(std::abs(z), kMaxZ) << what_ << " " << name << ": ours " << ours << ", recorded " << recorded;
  if (!(std::abs(z) <= worst_)) {
    worst_ = std::abs(z);
    worst_name_ = name;
  }
}

void CellReport::print() const {
  std::printf("%s: %ld cells, largest |z| %.2f (%s), limit %.1f\n", what_.c_str(), n_cells_, worst_,
              worst_name_.c_str(), kMaxZ);
}

}  // namespace giga::golden
