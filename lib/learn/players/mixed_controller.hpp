// The controller of a mixed team: several controllers share its worlds.
#pragma once

#include <memory>
#include <vector>

#include "game/team_controller.hpp"

namespace giga {

/// Divides the worlds of each part of a game among controllers, evenly and in their order; where there are fewer worlds
/// than controllers, some have none. In a match, which has a world for each episode, all play as many; where worlds
/// play one game after another, who has short games plays more of them. Those that remember must remember as many
/// numbers each: throws InputError else. Nobody learns from them.
std::unique_ptr<TeamController> mixed_controller(std::vector<std::shared_ptr<TeamController>> members);

}  // namespace giga
