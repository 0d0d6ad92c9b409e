// Intransitivity: how much of who beats whom no ratings explain, and the strongest cycle of three players.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "rating/bradley_terry.hpp"

namespace giga {

/// Three players of whom each is ahead of the next, and the last of the first.
struct PlayerCycle {
  std::array<int, 3> players{};      ///< the first one has the smallest index
  std::array<double, 3> log_odds{};  ///< of each against the next: three positive numbers
  double standard_error = 0;         ///< of the sum: that of log-odds from counts, to the points with the half

  double sum() const { return log_odds[0] + log_odds[1] + log_odds[2]; }
};

/// The matrix of log-odds A[a, b] = ln((points of a + 1/2) / (points of b + 1/2)) (the half, Haldane 1956, keeps it
/// finite) is the differences of one number per player, which come as near to A as can be, and a cyclic rest
/// (HodgeRank: Jiang et al. 2011; Balduzzi et al. 2019, arXiv 1901.08106). Near is by the squares over the pairs that
/// played, each weighed by its games. Where all pairs played equally often these are the means of rows of A. A norm has
/// the same weights.
struct Intransitivity {
  int n_pairs = 0;   ///< that played
  double share = 0;  ///< of the rest in the squared norm of A, 0 to 1; NaN where A is 0
  /// What `share` would be on average if the rest were sampling error alone: its expected squared norm over that of A.
  double share_by_chance = 0;
  /// The one with the largest sum, which the rest alone makes. Empty where there is none among three of whom all pairs
  /// played.
  std::optional<PlayerCycle> strongest;
};

/// Of n players, from one entry per pair.
Intransitivity find_intransitivity(int n, const std::vector<PairScore>& scores);

}  // namespace giga
