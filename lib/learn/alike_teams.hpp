// teams_are_alike: whether the two sides of a game differ in nothing but where they start.
#pragma once

#include "sim/spec.hpp"

namespace giga {

/// Whether each team has the same agents as the other, in whatever order, and none of them wins at the time limit.
bool teams_are_alike(const SimSpec& spec);

}  // namespace giga
