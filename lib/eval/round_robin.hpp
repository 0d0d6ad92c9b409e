// A round robin of contestants.
#pragma once

#include <functional>
#include <vector>

#include "eval/contestant.hpp"
#include "eval/game_table.hpp"
#include "eval/match.hpp"

namespace giga {

/// Called before each pair: pairs that are done, pairs of all, who plays.
using RoundRobinProgress = std::function<void(int done, int all, const Contestant& side_0, const Contestant& side_1)>;

/// Plays every contestant on side 0 against every contestant on side 1, itself included, `options.episodes` times each.
/// Pairs of which one has no policy for its side are left at zero games. The episodes of a pair depend on
/// `options.seed` and the two names alone, not on who else plays or in which order. Throws InputError where a policy
/// does not fit the scenario, or two contestants have the same name.
GameTable play_table(std::vector<Contestant>& contestants, const SimSpec& spec, const MatchOptions& options,
                     const RoundRobinProgress& progress = {});

}  // namespace giga
