#include "apps/load_player.hpp"

#include <iostream>

#include "core/error.hpp"

namespace giga {

Player load_player(const std::string& text, const PlayerOptions& options) {
  Player player = Player::load(text, options);
  if (player.origin())
    for (const std::string& line : player.origin()->warnings) std::cerr << "warning: " << line << '\n';
  return player;
}

std::optional<Checkpoint> read_if_whole(const std::filesystem::path& file) {
  try {
    return read_checkpoint(file);
  } catch (const InputError& e) {
    std::cerr << "warning: " << e.what() << "; it is left out\n";
    return std::nullopt;
  }
}

}  // namespace giga
