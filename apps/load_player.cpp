#include "apps/load_player.hpp"

#include <iostream>

namespace giga {

Player load_player(const std::string& text, const PlayerOptions& options) {
  Player player = Player::load(text, options);
  if (player.origin())
    for (const std::string& line : player.origin()->warnings) std::cerr << "warning: " << line << '\n';
  return player;
}

}  // namespace giga
