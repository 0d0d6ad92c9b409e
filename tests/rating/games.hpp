// Tables of games for tests of ratings: written by hand, or drawn from players of known strengths.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "rating/game_table.hpp"

namespace giga::test {

/// A table without games.
GameTable table_of(const std::vector<std::string>& players);

/// Adds games between players by name, the first on side 0.
void add(GameTable& table, const std::string& side_0, const std::string& side_1, Games games);

/// Strengths of players in Elo by side, and how far side 0 is ahead.
struct KnownStrengths {
  std::vector<double> side_0, side_1;
  double advantage = 0;
  double tie_rate = 0;  ///< games that are ties, whoever plays
};

/// Players "p0", "p1", ...; `n` games of each pair of different players on each side, and with `diagonal` of each with
/// itself. The win is drawn by the logistic model.
GameTable play_known(const KnownStrengths& truth, int n, bool diagonal, std::mt19937_64& generator);

}  // namespace giga::test
