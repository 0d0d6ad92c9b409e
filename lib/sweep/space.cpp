#include "sweep/space.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "core/error.hpp"

namespace giga {
namespace {

/// A value of a range to four digits, and to more where these tell less than a hundred values of it apart: 0.99996 to
/// 0.99999 differ in the fifth.
std::string rounded_within(double value, const std::array<double, 2>& range) {
  const auto [low, high] = range;
  const double narrow = std::max(std::abs(low), std::abs(high)) / (high - low);
  const int digits = std::min(17, 3 + static_cast<int>(std::log10(std::max(narrow, 10.0))));
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  const double rounded = std::strtod(text, nullptr);
  if (rounded >= low && rounded <= high) return text;
  return std::string(text, std::to_chars(text, text + sizeof text, rounded < low ? low : high).ptr);
}

/// The value of a parameter at a point of [0, 1).
std::string value_at(const ParameterSpec& p, double u) {
  if (!p.choices.empty()) {
    const auto n = static_cast<double>(p.choices.size());
    return p.choices[std::min(p.choices.size() - 1, static_cast<size_t>(u * n))].yaml;
  }
  if (p.integers) {
    const auto [low, high] = *p.integers;
    const auto n = static_cast<double>(high - low + 1);
    return std::to_string(std::min(high, low + static_cast<int64_t>(u * n)));
  }
  if (p.log_uniform) {
    const auto [low, high] = *p.log_uniform;
    return rounded_within(low * std::pow(high / low, u), *p.log_uniform);
  }
  const auto [low, high] = *p.uniform;
  return rounded_within(low + u * (high - low), *p.uniform);
}

/// Different values of a parameter in a grid.
int64_t grid_size(const ParameterSpec& p) {
  return p.integers ? (*p.integers)[1] - (*p.integers)[0] + 1 : static_cast<int64_t>(p.choices.size());
}

/// Trial k of a grid, whose last parameter changes fastest; nothing behind the last.
TrialSettings grid_point(const SweepSpec& spec, int64_t k) {
  TrialSettings settings;
  for (auto p = spec.parameters.rbegin(); p != spec.parameters.rend(); ++p) {
    const int64_t n = grid_size(p->second);
    settings.emplace_back(p->first, value_at(p->second, (static_cast<double>(k % n) + 0.5) / static_cast<double>(n)));
    k /= n;
  }
  std::reverse(settings.begin(), settings.end());
  return k > 0 ? TrialSettings() : settings;
}

/// A number in [0, 1) with 53 bits, the same everywhere.
double uniform_of(std::mt19937_64& generator) { return static_cast<double>(generator() >> 11) * 0x1p-53; }

}  // namespace

std::vector<TrialSettings> draw_trials(const SweepSpec& spec, const SobolPoints& sobol) {
  const int d = static_cast<int>(spec.parameters.size()), n = n_trials(spec);
  std::mt19937_64 generator(spec.seed);
  std::vector<double> points, shift(static_cast<size_t>(d));
  if (spec.method == SweepMethod::sobol) {
    points = sobol(d, n);
    // Sobol's points turned round by one random shift, another for each seed (Cranley and Patterson 1976).
    for (double& s : shift) s = uniform_of(generator);
  }
  std::vector<TrialSettings> trials;
  for (int k = 0; k < n; ++k) {
    TrialSettings settings;
    if (spec.method == SweepMethod::grid) {
      settings = grid_point(spec, k);
      if (settings.empty()) break;
    }
    int j = 0;
    for (const auto& [key, parameter] : spec.parameters) {
      if (spec.method == SweepMethod::grid) break;
      double u = 0;
      if (spec.method == SweepMethod::sobol) {
        u = points.at(static_cast<size_t>(k * d + j)) + shift[static_cast<size_t>(j)];
        u -= std::floor(u);
      } else {
        u = uniform_of(generator);
      }
      settings.emplace_back(key, value_at(parameter, u));
      ++j;
    }
    if (std::find(trials.begin(), trials.end(), settings) == trials.end()) trials.push_back(std::move(settings));
  }
  return trials;
}

std::vector<std::string> assignments_of(const TrialSettings& settings) {
  std::vector<std::string> assignments;
  for (const auto& [key, value] : settings) assignments.push_back(cat(key, "=", value));
  return assignments;
}

}  // namespace giga
