// GoodnessOfFit: whether strengths explain the outcome of games, by the deviance of the fit.
#pragma once

#include <vector>

#include "rating/bradley_terry.hpp"

namespace giga {

/// The fit against the model in which each pair has a share of points of its own (McCullagh and Nelder 1989, section
/// 4.4). Points count as the fit counts them, a tie as half a win and half a loss: with many ties shares vary less than
/// the deviance expects, and `p_value` is too large.
struct GoodnessOfFit {
  double deviance = 0;  ///< 2 (log-likelihood with each pair's own share - that of the fit), natural logarithm
  int n_pairs = 0;
  int degrees_of_freedom = 0;  ///< pairs without the differences of strength: of n joined players n - 1
  int n_sparse = 0;            ///< pairs that let one of the two expect less than 5 points: chi-square is rough there

  /// P(chi-square of these degrees of freedom >= deviance): small where strengths alone do not explain the games. NaN
  /// without degrees of freedom: any such games are explained.
  double p_value() const;

  /// Of two sets of players whom no games join.
  GoodnessOfFit& operator+=(const GoodnessOfFit& other);
};

/// Of what fit_bradley_terry() made of `scores`, which have one entry per pair.
GoodnessOfFit goodness_of_fit(const StrengthFit& fit, const std::vector<PairScore>& scores);

}  // namespace giga
