// The decomposition of log-odds by least squares, and the search for cycles.
#include "rating/intransitivity.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr double kHalfCount = 0.5;

double log_odds_of(const PairScore& p) { return std::log((p.score_a + kHalfCount) / (p.score_b + kHalfCount)); }

/// Of log_odds_of().
double variance_of(const PairScore& p) { return 1 / (p.score_a + kHalfCount) + 1 / (p.score_b + kHalfCount); }

/// Shares of the squared norm, into `result`.
void decompose(int n, const std::vector<PairScore>& scores, Intransitivity& result) {
  // Normal equations: the Laplacian of the graph of games, whose rank is that of the differences.
  Eigen::MatrixXd laplacian = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd flow = Eigen::VectorXd::Zero(n);
  for (const PairScore& p : scores) {
    const double weight = p.games(), y = log_odds_of(p);
    laplacian(p.a, p.a) += weight;
    laplacian(p.b, p.b) += weight;
    laplacian(p.a, p.b) -= weight;
    laplacian(p.b, p.a) -= weight;
    flow[p.a] += weight * y;
    flow[p.b] -= weight * y;
  }
  const Eigen::MatrixXd inverse = laplacian.completeOrthogonalDecomposition().pseudoInverse();
  const Eigen::VectorXd rating = inverse * flow;

  double all = 0, rest = 0, by_chance = 0;
  for (const PairScore& p : scores) {
    const double weight = p.games(), y = log_odds_of(p), residual = y - (rating[p.a] - rating[p.b]);
    const double leverage = weight * (inverse(p.a, p.a) + inverse(p.b, p.b) - 2 * inverse(p.a, p.b));
    all += weight * y * y;
    rest += weight * residual * residual;
    by_chance += weight * variance_of(p) * (1 - leverage);
  }
  result.share = all > 0 ? rest / all : std::numeric_limits<double>::quiet_NaN();
  result.share_by_chance = all > 0 ? by_chance / all : std::numeric_limits<double>::quiet_NaN();
}

std::optional<PlayerCycle> strongest_cycle(int n, const std::vector<PairScore>& scores) {
  // NaN where no games were played: it is never larger than anything.
  Eigen::MatrixXd log_odds = Eigen::MatrixXd::Constant(n, n, std::numeric_limits<double>::quiet_NaN());
  Eigen::MatrixXd variance = Eigen::MatrixXd::Zero(n, n);
  for (const PairScore& p : scores) {
    log_odds(p.a, p.b) = log_odds_of(p);
    log_odds(p.b, p.a) = -log_odds(p.a, p.b);
    variance(p.a, p.b) = variance(p.b, p.a) = variance_of(p);
  }
  std::optional<PlayerCycle> strongest;
  for (int a = 0; a < n; ++a)
    for (int b = a + 1; b < n; ++b) {  // b and c follow a in the cycle, in either order
      for (int c = a + 1; c < n; ++c) {
        if (!(log_odds(a, b) > 0 && log_odds(b, c) > 0 && log_odds(c, a) > 0)) continue;
        const PlayerCycle cycle{{a, b, c},
                                {log_odds(a, b), log_odds(b, c), log_odds(c, a)},
                                std::sqrt(variance(a, b) + variance(b, c) + variance(c, a))};
        if (!strongest || cycle.sum() > strongest->sum()) strongest = cycle;
      }
    }
  return strongest;
}

}  // namespace

Intransitivity find_intransitivity(int n, const std::vector<PairScore>& scores) {
  for (const PairScore& p : scores) {
    GIGA_CHECK(p.a >= 0 && p.a < n && p.b >= 0 && p.b < n && p.a != p.b, "a game of players ", p.a, " and ", p.b);
    GIGA_CHECK(p.games() > 0, "no games of players ", p.a, " and ", p.b);
  }
  Intransitivity result;
  result.n_pairs = static_cast<int>(scores.size());
  decompose(n, scores, result);
  result.strongest = strongest_cycle(n, scores);
  return result;
}

}  // namespace giga
