#include "apps/load_player.hpp"

#include <iostream>
#include <set>
#include <string>

#include "core/error.hpp"
#include "eval/match.hpp"

namespace giga {

Player load_player(const std::string& text, const PlayerOptions& options) {
  Player player = Player::load(text, options);
  for (const Player* member : player.members())
    if (member->origin())
      for (const std::string& line : member->origin()->warnings) std::cerr << "warning: " << line << '\n';
  return player;
}

void check_episodes(int episodes, std::span<const Player> players) {
  for (const Player& player : players) check_episodes(episodes, static_cast<int64_t>(player.members().size()));
}

void warn_of_opponents(const LoadedRun& run) {
  std::set<std::string> names(run.config.opponents.policies.begin(), run.config.opponents.policies.end());
  if (run.config.train.opponent.is_path()) names.insert(run.config.train.opponent.name);
  for (const std::string& name : names) load_player(name, {});
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
