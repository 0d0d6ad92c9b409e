// The page of play: scenarios, who plays them, and the module that computes them, as one file or as a folder.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "io/replay.hpp"
#include "play/plain_network.hpp"
#include "scripted/script.hpp"
#include "sim/spec.hpp"

namespace giga {

/// Somebody who flies teams on the page.
struct PagePlayer {
  std::string name;
  /// By team: the script, or the number of a network; see network_of_script.
  std::array<int, kNTeams> who{};
};

struct PageScenario {
  std::string name;
  SimSpec spec;
  Replay frame;                                   ///< a replay of it without games
  std::array<std::vector<int>, kNTeams> players;  ///< by team: who can play it, as numbers of PlayPage::players
};

struct PlayPage {
  std::string title, about, version;
  std::vector<PageScenario> scenarios;  ///< the first is shown first
  std::vector<PagePlayer> players;
  int mates = 0, opponents = 0;  ///< those that are chosen first, where they can play the scenario
  std::vector<PlainNetwork> networks;
};

/// Whether this program has the module; else `play` cannot be had.
bool has_play_module();
/// What to do where it has none.
constexpr const char* kNoPlayModule =
    "this gigastep was built without the module for browsers: run scripts/bootstrap --web, which installs the compiler "
    "for it, then scripts/build";

/// One file that asks nothing of the network. Throws InputError without the module.
std::string play_page(const PlayPage& page);
/// The same for a web server: index.html, play.css, play.js, game.json and play.wasm in a folder, which is made.
void write_play_folder(const std::filesystem::path& folder, const PlayPage& page);

}  // namespace giga
