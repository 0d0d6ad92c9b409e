// What agents of a scenario are shown: their images at one moment of a game.
#pragma once

#include <string>

#include "sim/spec.hpp"

namespace giga {

/// As PNG: the global image and those of all agents, team 0 first, some seconds into a game between two scripted teams
/// that chase each other. x runs to the right and y up. Throws InputError where there are no images.
std::string scenario_images(const SimSpec& spec);

}  // namespace giga
