// Newton's method for the Bradley-Terry likelihood.
#include "rating/bradley_terry.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr int kMostIterations = 200;     // from equal strengths, 10 or 20 are usual
constexpr double kSmallestStep = 1e-10;  // in natural units: 2e-8 Elo
constexpr double kRounding = 1e-12;      // share of the log-likelihood that may be lost to rounding

/// log(1 / (1 + exp(-d))), for any d.
double log_sigmoid(double d) { return d < 0 ? d - std::log1p(std::exp(d)) : -std::log1p(std::exp(-d)); }

double log_likelihood(const Eigen::VectorXd& s, const std::vector<PairScore>& scores) {
  double sum = 0;
  for (const PairScore& p : scores)
    sum += p.score_a * log_sigmoid(s[p.a] - s[p.b]) + p.score_b * log_sigmoid(s[p.b] - s[p.a]);
  return sum;
}

/// First derivative of the log-likelihood, and the second one with the sign changed: what the games tell.
struct Derivatives {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd information;
};

Derivatives derivatives(const Eigen::VectorXd& s, const std::vector<PairScore>& scores) {
  const Eigen::Index n = s.size();
  Derivatives d{Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Zero(n, n)};
  for (const PairScore& p : scores) {
    const double games = p.games(), expected = win_probability(s[p.a] - s[p.b]);
    const double surprise = p.score_a - games * expected, weight = games * expected * (1 - expected);
    d.gradient[p.a] += surprise;
    d.gradient[p.b] -= surprise;
    d.information(p.a, p.a) += weight;
    d.information(p.b, p.b) += weight;
    d.information(p.a, p.b) -= weight;
    d.information(p.b, p.a) -= weight;
  }
  return d;
}

/// The information without player 0, who stays where he is.
Eigen::LDLT<Eigen::MatrixXd> factor(const Derivatives& d) {
  const Eigen::Index rest = d.gradient.size() - 1;
  Eigen::LDLT<Eigen::MatrixXd> solver(d.information.bottomRightCorner(rest, rest));
  GIGA_CHECK(solver.info() == Eigen::Success && solver.isPositive(), "the games do not join the players");
  return solver;
}

/// One step of Newton's method, halved until the likelihood does not fall; returns the largest change.
double improve(Eigen::VectorXd& s, const std::vector<PairScore>& scores) {
  const Derivatives d = derivatives(s, scores);
  const Eigen::Index rest = s.size() - 1;
  Eigen::VectorXd step = Eigen::VectorXd::Zero(s.size());
  step.tail(rest) = factor(d).solve(d.gradient.tail(rest));
  GIGA_CHECK(step.allFinite(), "a step of Newton's method is not finite");
  const double before = log_likelihood(s, scores), least = before - kRounding * std::abs(before);
  while (log_likelihood(s + step, scores) < least) step /= 2;
  s += step;
  return step.cwiseAbs().maxCoeff();
}

}  // namespace

std::vector<PairScore> one_per_pair(const std::vector<PairScore>& scores) {
  std::vector<PairScore> pairs;
  std::map<std::pair<int, int>, size_t> place;
  for (const PairScore& p : scores) {
    const auto [found, is_new] = place.try_emplace(std::minmax(p.a, p.b), pairs.size());
    if (is_new) {
      pairs.push_back(p);
      continue;
    }
    PairScore& pair = pairs[found->second];
    const bool same_way = pair.a == p.a;
    pair.score_a += same_way ? p.score_a : p.score_b;
    pair.score_b += same_way ? p.score_b : p.score_a;
  }
  return pairs;
}

double StrengthFit::standard_error(int i, int j) const {
  const size_t n = strength.size(), a = static_cast<size_t>(i), b = static_cast<size_t>(j);
  const double variance = covariance[a * n + a] + covariance[b * n + b] - 2 * covariance[a * n + b];
  return std::sqrt(variance > 0 ? variance : 0.0);
}

StrengthFit fit_bradley_terry(int n, const std::vector<PairScore>& scores) {
  GIGA_CHECK(n >= 1, n, " players");
  for (const PairScore& p : scores) {
    GIGA_CHECK(p.a >= 0 && p.a < n && p.b >= 0 && p.b < n && p.a != p.b, "a game of players ", p.a, " and ", p.b);
    GIGA_CHECK(p.score_a >= 0 && p.score_b >= 0, "points ", p.score_a, " and ", p.score_b);
  }
  StrengthFit fit;
  Eigen::VectorXd s = Eigen::VectorXd::Zero(n);
  double change = n == 1 ? 0 : 1;
  while (change > kSmallestStep) {
    GIGA_CHECK(fit.iterations < kMostIterations, "no maximum of the likelihood after ", kMostIterations, " iterations");
    change = improve(s, scores);
    ++fit.iterations;
  }
  fit.strength.assign(s.begin(), s.end());
  fit.log_likelihood = log_likelihood(s, scores);

  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
  if (n > 1)
    covariance.bottomRightCorner(n - 1, n - 1) =
        factor(derivatives(s, scores)).solve(Eigen::MatrixXd::Identity(n - 1, n - 1));
  fit.covariance.assign(covariance.data(), covariance.data() + covariance.size());  // symmetric: rows are columns
  return fit;
}

}  // namespace giga
