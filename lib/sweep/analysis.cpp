#include "sweep/analysis.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <random>
#include <set>

#include "config/fields.hpp"

namespace giga {
namespace {

/// Two-sided 95 % quantiles of Student's t with 1 to 30 degrees of freedom.
constexpr std::array kStudent95 = {12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
                                   2.201,  2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086,
                                   2.080,  2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042};

/// The numbers of a setting; empty where one is none.
std::vector<double> numbers_of(const std::vector<std::string>& setting) {
  std::vector<double> numbers;
  for (const std::string& text : setting) {
    const std::optional<double> number = plain_number(text);
    if (!number) return {};
    numbers.push_back(*number);
  }
  return numbers;
}

/// Ranks from 0, ties sharing theirs.
std::vector<double> ranks_of(const std::vector<double>& x) {
  std::vector<double> ranks;
  for (const double a : x) {
    const auto below = std::count_if(x.begin(), x.end(), [a](double b) { return b < a; });
    const auto same = std::count(x.begin(), x.end(), a);
    ranks.push_back(static_cast<double>(below) + (static_cast<double>(same) - 1) / 2);
  }
  return ranks;
}

}  // namespace

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double interquartile_mean(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto cut = static_cast<std::ptrdiff_t>(values.size() / 4);
  return mean_of({values.begin() + cut, values.end() - cut});
}

Interval mean_interval(const std::vector<double>& values) {
  const double mean = mean_of(values);
  if (values.size() < 2) return {mean, mean};
  double squares = 0;
  for (const double x : values) squares += (x - mean) * (x - mean);
  const auto n = static_cast<double>(values.size());
  const double t = values.size() - 1 <= kStudent95.size() ? kStudent95[values.size() - 2] : kNormal95;
  const double half = t * std::sqrt(squares / (n - 1) / n);
  return {mean - half, mean + half};
}

Interval bootstrap_interval(const std::vector<double>& values) {
  constexpr int kSamples = 2000;
  std::mt19937_64 generator(values.size());
  std::vector<double> means, sample(values.size());
  for (int k = 0; k < kSamples; ++k) {
    for (double& x : sample) x = values[generator() % values.size()];
    means.push_back(interquartile_mean(sample));
  }
  std::sort(means.begin(), means.end());
  return {means[kSamples * 25 / 1000], means[kSamples * 975 / 1000 - 1]};
}

double explained_share(const std::vector<size_t>& group, const std::vector<double>& values) {
  const std::set<size_t> names(group.begin(), group.end());
  const auto n = static_cast<double>(values.size()), k = static_cast<double>(names.size());
  if (names.size() < 2 || names.size() >= values.size()) return std::nan("");
  const double mean = mean_of(values);
  double total = 0, within = 0;
  for (const double x : values) total += (x - mean) * (x - mean);
  for (const size_t name : names) {
    std::vector<double> own;
    for (size_t j = 0; j < values.size(); ++j)
      if (group[j] == name) own.push_back(values[j]);
    const double centre = mean_of(own);
    for (const double x : own) within += (x - centre) * (x - centre);
  }
  if (total == 0) return 0;
  return std::clamp((total - within - (k - 1) * within / (n - k)) / total, 0.0, 1.0);
}

std::vector<size_t> groups_of(const std::vector<std::string>& setting, size_t most) {
  std::vector<std::string> texts = setting;
  std::sort(texts.begin(), texts.end());
  texts.erase(std::unique(texts.begin(), texts.end()), texts.end());
  const std::vector<double> numbers = numbers_of(setting);
  std::vector<size_t> groups;
  for (size_t j = 0; j < setting.size(); ++j) {
    if (texts.size() <= most || numbers.empty()) {
      groups.push_back(static_cast<size_t>(std::find(texts.begin(), texts.end(), setting[j]) - texts.begin()));
      continue;
    }
    const auto below = std::count_if(numbers.begin(), numbers.end(), [&](double x) { return x < numbers[j]; });
    groups.push_back(static_cast<size_t>(below) * most / setting.size());
  }
  return groups;
}

double rank_correlation(const std::vector<std::string>& setting, const std::vector<double>& values) {
  const std::vector<double> numbers = numbers_of(setting);
  if (numbers.empty()) return std::nan("");
  const std::vector<double> x = ranks_of(numbers), y = ranks_of(values);
  const double mx = mean_of(x), my = mean_of(y);
  double xy = 0, xx = 0, yy = 0;
  for (size_t k = 0; k < x.size(); ++k) {
    xy += (x[k] - mx) * (y[k] - my);
    xx += (x[k] - mx) * (x[k] - mx);
    yy += (y[k] - my) * (y[k] - my);
  }
  return xx > 0 && yy > 0 ? xy / std::sqrt(xx * yy) : std::nan("");
}

}  // namespace giga
