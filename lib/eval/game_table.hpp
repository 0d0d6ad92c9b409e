// GameTable: who won how often against whom, the input of ratings.
#pragma once

#include <string>
#include <vector>

namespace giga {

/// Results of a number of games, seen from side 0.
struct Games {
  int wins = 0, losses = 0, ties = 0;
};

/// A round robin of P players.
struct GameTable {
  std::vector<std::string> players;
  std::vector<Games> games;  ///< [P, P] row i = player i on side 0, column j = player j on side 1
};

}  // namespace giga
