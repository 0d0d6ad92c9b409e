// A picture of a scenario: its maps from above.
#pragma once

#include <string>

#include "sim/spec.hpp"

namespace giga {

/// As SVG: of each map the obstacles and where the teams start, with an agent of each team in the middle of its start,
/// how far and how wide it sees and shoots.
std::string scenario_picture(const SimSpec& spec);

}  // namespace giga
