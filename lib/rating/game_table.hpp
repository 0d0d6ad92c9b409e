// GameTable: who won how often against whom, by side.
#pragma once

#include <string>
#include <vector>

namespace giga {

/// Finished games between two players, from the first one's view.
struct Games {
  int wins = 0, losses = 0, ties = 0;
};

/// The outcome of a round robin. A player has a side, or both: a script, an exported policy, or a checkpoint with its
/// policy of team 0 on side 0 and that of team 1 on side 1. Pairs that did not play have no games.
struct GameTable {
  std::vector<std::string> players;  ///< [P] names, all different
  std::vector<Games> games;          ///< [P, P] row i = player i on side 0, column j = player j on side 1
};

/// The table in which players of one new name (`names`, [P]) are one, in the order in which names first appear.
GameTable pooled(const GameTable& table, const std::vector<std::string>& names);

}  // namespace giga
