// Bradley-Terry: strengths of players from the outcome of games between pairs, by maximum likelihood.
#pragma once

#include <cmath>
#include <vector>

namespace giga {

/// All games between two players, as points: a win is 1 point, a tie half a point for both.
struct PairScore {
  int a = 0, b = 0;
  double score_a = 0, score_b = 0;

  double games() const { return score_a + score_b; }
};

/// The same games with one entry for each two players, in the order in which these first appear.
std::vector<PairScore> one_per_pair(const std::vector<PairScore>& scores);

/// P(a beats b) where a is ahead by s_a - s_b.
inline double win_probability(double ahead) { return 1 / (1 + std::exp(-ahead)); }

/// Strengths in the natural unit (win_probability()). Only differences have a meaning; player 0 is put at 0.
struct StrengthFit {
  std::vector<double> strength;    ///< [n]
  std::vector<double> covariance;  ///< [n, n] inverse of the Hessian of -log-likelihood; 0 in row and column 0
  double log_likelihood = 0;       ///< natural logarithm, the sum over all points
  int iterations = 0;              ///< of Newton's method

  /// Standard error of strength[i] - strength[j].
  double standard_error(int i, int j) const;
};

/// Fits n >= 1 players (Bradley and Terry 1952; Newton with halved steps). The maximum exists where each player is
/// reached from each other by a chain of "took points from" (Ford 1957; groups.hpp finds such sets); Error elsewhere.
/// Ties count as half a win and half a loss. Their share of points varies less than that of games without ties, so that
/// standard errors are right without ties and too large with many.
StrengthFit fit_bradley_terry(int n, const std::vector<PairScore>& scores);

}  // namespace giga
