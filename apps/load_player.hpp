// Loading who is named on the command line, with what the user should know about it.
#pragma once

#include "learn/players/player.hpp"

namespace giga {

/// Player::load; says on stderr which better or newer checkpoints of a run are damaged and so were not taken.
Player load_player(const std::string& text, const PlayerOptions& options);

}  // namespace giga
