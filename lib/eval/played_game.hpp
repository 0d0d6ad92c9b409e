// What players play: a scenario that is named or that of their runs, with changes, and what their policies observe.
#pragma once

#include <string>
#include <vector>

#include "learn/players/player.hpp"

namespace giga {

struct GameRequest {
  std::string scenario = {};              ///< name or path; empty: that of the players' runs
  std::vector<std::string> changes = {};  ///< assignments "environment.KEY=VALUE"
};

struct PlayedGame {
  Scenario scenario;
  SimSpec spec;
  std::vector<std::string> notes = {};  ///< for people: who was trained in another game, and what differs
};

/// Whether runs of different games may play without a scenario that is named: then it is that of the first.
enum class OtherGames : uint8_t { allowed, refused };

/// What an agent observes and how it acts belongs to its policy: in a scenario that is named the keys `observation` and
/// `action` are those of the players' runs, unless `changes` says otherwise. A run that differs in its rewards is of
/// the same game. Throws InputError, with the keys that differ, where a policy cannot play it.
PlayedGame choose_game(const GameRequest& request, const std::vector<const Player*>& teams, OtherGames others);

}  // namespace giga
