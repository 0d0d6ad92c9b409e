// A sheet of players of known strengths, for tests of tables and pictures.
#pragma once

#include <string>
#include <vector>

#include "rating/sheet.hpp"

namespace giga::test {

/// Scripts random, noop and circle (0, -60 and 140 Elo) and of each run checkpoints "RUN@100", "RUN@200", ..., whose
/// team 0 gains and team 1 gains half as much from one to the next; the last but one is the best. An update has 1e5
/// agent-steps and takes 2 s. All play all, `n_games` a pair on each side.
struct SheetOptions {
  std::vector<std::string> runs = {"duel-mappo-seed1"};
  int n_checkpoints = 4;
  double gain = 120;  ///< Elo of team 0 from one checkpoint to the next
  Sides sides = Sides::alike;
  int n_games = 200;
};
RatingSheet make_sheet(const SheetOptions& options);

}  // namespace giga::test
