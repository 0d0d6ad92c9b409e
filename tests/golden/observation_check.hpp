// Comparing vector observations, exactly by row or as a set of rows.
#pragma once

#include "golden/comparison.hpp"
#include "golden/golden_world.hpp"

namespace giga::golden {

/// Row by row, in the recorded order. `modulo_turn`: relative headings may differ by a whole turn.
void compare_observation(Comparison& c, const GoldenWorld& world, int agent, const float* recorded, bool modulo_turn);

/// For records in which two agents are equally far away: the rows in any order; the last row may be another agent at
/// the same distance. The rest of the observation as above.
void compare_observation_as_set(Comparison& c, const GoldenWorld& world, int agent, const float* recorded);

}  // namespace giga::golden
