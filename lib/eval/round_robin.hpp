// A round robin of players.
#pragma once

#include <functional>
#include <vector>

#include "eval/match.hpp"
#include "learn/players/player.hpp"
#include "rating/game_table.hpp"

namespace giga {

/// Called before each pair: pairs that are done, pairs of all, who plays.
using RoundRobinProgress = std::function<void(int done, int all, const Player& side_0, const Player& side_1)>;

/// Plays every player on side 0 against every player on side 1, itself included, `options.episodes` times each.
/// Pairs of which one has no policy for its side are left at zero games. The episodes of a pair depend on
/// `options.seed` and the two names alone, not on who else plays or in which order. Throws InputError where a policy
/// does not fit the scenario, or two players have the same name.
GameTable play_table(std::vector<Player>& players, const SimSpec& spec, const MatchOptions& options,
                     const RoundRobinProgress& progress = {});

}  // namespace giga
