// Round robins: everybody against everybody on both sides.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "eval/game_table.hpp"
#include "eval/match.hpp"

namespace giga {

/// Who plays. A side that it does not play has no player there.
struct Entrant {
  std::string name;
  Player side[2];
  bool plays[2] = {true, true};
};

/// Called before each pair: pairs that are done, pairs of all, who plays.
using RoundRobinProgress = std::function<void(int done, int all, const Entrant& side_0, const Entrant& side_1)>;

/// Plays `options.episodes` episodes of each pair (i on side 0, j on side 1), i = j included. Deterministic by seed;
/// each pair has episodes of its own.
GameTable play_round_robin(const SimSpec& spec, const std::vector<Entrant>& entrants, const MatchOptions& options,
                           const RoundRobinProgress& progress = {});

}  // namespace giga
