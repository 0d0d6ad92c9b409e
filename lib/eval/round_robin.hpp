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
/// Pairs of which one has no policy for its side are left at zero games. Pairs are played in spread_order, so that the
/// time of the first few tells that of all. The episodes of a pair depend on
/// `options.seed` and the two names alone, not on who else plays or in which order. Throws InputError where a policy
/// does not fit the scenario, or two players have the same name.
GameTable play_table(std::vector<Player>& players, const SimSpec& spec, const MatchOptions& options,
                     const RoundRobinProgress& progress = {});

/// The numbers from 0 to n - 1 by steps of the golden ratio of n: wherever one stops, those so far are spread evenly.
/// Neighbours in a table take alike, and games of those who survive ten times as long as others.
std::vector<size_t> spread_order(size_t n);

/// Seconds that all pairs take, from those of the first of them and of all that are `done` (at least 1). The first one
/// counts for itself, because it begins with what is done once.
double expected_seconds(double first, double elapsed, int done, int all);
/// So many pairs are enough for that: of 169 pairs with the scripts of 5 against 5 they told the time of all to a
/// tenth.
int pairs_for_estimate(int all);

}  // namespace giga
