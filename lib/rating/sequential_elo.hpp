// Sequential Elo: the rating of the paper, updated match by match.
#pragma once

#include <vector>

namespace giga {

/// One match between two players; `score_a` is what a gets of the one point.
struct EloMatch {
  int a = 0, b = 0;
  double score_a = 0;
};

/// K and the start rating are those of the original's evaluator.
struct EloOptions {
  double k = 32;
  double start = 1200;
};

/// [n] ratings after the matches, one after the other: with E_a = 1 / (1 + 10^((R_b - R_a) / 400)),
/// R_a += K (score_a - E_a) and R_b -= the same. The result depends on the order of the matches, has no error bars, and
/// its scale no fixed point; it is here for comparison with published figures.
std::vector<double> sequential_elo(int n, const std::vector<EloMatch>& matches, const EloOptions& options = {});

}  // namespace giga
