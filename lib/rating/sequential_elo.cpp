// The paper's updates.
#include "rating/sequential_elo.hpp"

#include <cmath>

namespace giga {

std::vector<double> sequential_elo(int n, const std::vector<EloMatch>& matches, const EloOptions& options) {
  std::vector<double> rating(static_cast<size_t>(n), options.start);
  for (const EloMatch& m : matches) {
    double &a = rating.at(static_cast<size_t>(m.a)), &b = rating.at(static_cast<size_t>(m.b));
    const double change = options.k * (m.score_a - 1 / (1 + std::pow(10, (b - a) / 400)));
    a += change;
    b -= change;
  }
  return rating;
}

}  // namespace giga
