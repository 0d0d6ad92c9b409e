// Loading who is named on the command line, with what the user should know about it.
#pragma once

#include <filesystem>
#include <optional>
#include <span>

#include "io/checkpoint.hpp"
#include "learn/players/player.hpp"

namespace giga {

/// Player::load; says on stderr which better or newer checkpoints of a run are damaged and so were not taken.
Player load_player(const std::string& text, const PlayerOptions& options);

/// As check_episodes of eval/match.hpp, of all who are to play and before the first game.
void check_episodes(int episodes, std::span<const Player> players);

/// What load_player says, of those whom a run meets (train.opponent, opponents.policies), which its learner has loaded.
void warn_of_opponents(const LoadedRun& run);

/// A checkpoint; none where it is damaged, which is said on stderr: it is left out.
std::optional<Checkpoint> read_if_whole(const std::filesystem::path& file);

}  // namespace giga
