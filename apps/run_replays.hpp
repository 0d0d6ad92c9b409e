// The replays of a run: games that are recorded while it trains, and the page that plays them.
#pragma once

#include <cstdint>

#include "io/run_folder.hpp"
#include "learn/learner.hpp"

namespace giga {

/// Why `eval.record` games of a run are too large for a replay; empty: they are not.
std::string why_games_have_no_room(const LoadedRun& run);
/// The page of the replays up to an update: those of the last evaluation first, then earlier ones at even distances.
/// None where there are no replays.
void write_replays_page(const RunFolder& folder, int64_t updates);

}  // namespace giga
