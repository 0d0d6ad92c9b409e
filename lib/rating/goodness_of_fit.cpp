// The deviance of a Bradley-Terry fit.
#include "rating/goodness_of_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unsupported/Eigen/SpecialFunctions>

namespace giga {
namespace {

constexpr double kFewPoints = 5;  // Cochran 1954: below, a cell does not follow chi-square well

/// k ln(k / n); 0 without points.
double own_log_likelihood(double points, double games) { return points > 0 ? points * std::log(points / games) : 0; }

}  // namespace

double GoodnessOfFit::p_value() const {
  if (degrees_of_freedom <= 0) return std::numeric_limits<double>::quiet_NaN();
  return Eigen::numext::igammac(degrees_of_freedom / 2.0, deviance / 2);
}

GoodnessOfFit& GoodnessOfFit::operator+=(const GoodnessOfFit& other) {
  deviance += other.deviance;
  n_pairs += other.n_pairs;
  degrees_of_freedom += other.degrees_of_freedom;
  n_sparse += other.n_sparse;
  return *this;
}

GoodnessOfFit goodness_of_fit(const StrengthFit& fit, const std::vector<PairScore>& scores) {
  GoodnessOfFit result;
  double saturated = 0;
  for (const PairScore& p : scores) {
    saturated += own_log_likelihood(p.score_a, p.games()) + own_log_likelihood(p.score_b, p.games());
    const double ahead = fit.strength[static_cast<size_t>(p.a)] - fit.strength[static_cast<size_t>(p.b)];
    if (p.games() * win_probability(-std::abs(ahead)) < kFewPoints) ++result.n_sparse;
  }
  result.deviance = std::max(0.0, 2 * (saturated - fit.log_likelihood));  // below 0 by rounding alone
  result.n_pairs = static_cast<int>(scores.size());
  result.degrees_of_freedom = result.n_pairs - (static_cast<int>(fit.strength.size()) - 1);
  return result;
}

}  // namespace giga
