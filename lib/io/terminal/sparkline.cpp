// Series of figures, and drawing them by block characters.
#include "io/terminal/sparkline.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr size_t kMaxSums = 512;  // more columns than a sparkline ever has
constexpr int kLevels = 8;

}  // namespace

void Series::halve(std::vector<Sum>& sums) {
  for (size_t k = 0; 2 * k < sums.size(); ++k) {
    Sum pair = sums[2 * k];
    if (2 * k + 1 < sums.size()) pair += sums[2 * k + 1];
    sums[k] = pair;
  }
  sums.resize((sums.size() + 1) / 2);
}

void Series::add(double value) {
  const bool known = std::isfinite(value);
  if (sums_.empty() && !known) return;
  if (sums_.empty() || values_in_last_ == values_per_sum_) {
    if (sums_.size() == kMaxSums) {
      halve(sums_);
      values_per_sum_ *= 2;
    }
    sums_.emplace_back();
    values_in_last_ = 0;
  }
  if (known) sums_.back() += {value, 1};
  ++values_in_last_;
}

std::vector<double> Series::points(int n) const {
  GIGA_CHECK(n > 0, n);
  std::vector<Sum> sums = sums_;
  while (sums.size() > static_cast<size_t>(n)) halve(sums);
  std::vector<double> means;
  for (const Sum& s : sums) means.push_back(s.count > 0 ? s.sum / s.count : std::numeric_limits<double>::quiet_NaN());
  return means;
}

std::string sparkline(const std::vector<double>& values, double lowest, double highest, bool unicode) {
  std::string text;
  for (const double value : values) {
    if (std::isnan(value)) {
      text += ' ';
      continue;
    }
    const double height = highest > lowest ? (value - lowest) / (highest - lowest) : 0.5;
    const int level = std::clamp(static_cast<int>(height * kLevels), 0, kLevels - 1);
    if (unicode) {
      text += {'\xE2', '\x96', static_cast<char>(0x81 + level)};  // U+2581 + level
    } else {
      text += ".:-=+*#@"[level];
    }
  }
  return text;
}

std::string sparkline(const std::vector<double>& values, bool unicode) {
  double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
  for (const double value : values) {
    if (std::isnan(value)) continue;
    lowest = std::min(lowest, value);
    highest = std::max(highest, value);
  }
  return sparkline(values, lowest, highest, unicode);
}

}  // namespace giga
