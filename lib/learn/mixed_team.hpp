// Mixed teams: several policies that share the worlds of a team, so that nobody can prepare for one of them. A best
// response to all of them has to do well against their mean (a mixed strategy, in the words of game theory).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "config/fields.hpp"

namespace giga {

constexpr size_t kMostMixed = 64;

/// What a file of a mixed team says.
struct MixedTeam {
  std::vector<std::string> policies;
  std::string at = "";  ///< where they stand in it, for messages: file and line
};
template <class V>
void visit_fields(V& v, MixedTeam& c) {
  v("policies", c.policies,
    "who plays, each in as many worlds as the others: runs (their best checkpoint, or else the newest), checkpoints, "
    "exported policies, by their paths from the folder of this file, with a slash or a dot in them; or scripts",
    Allowed{}.items(2, kMostMixed));
}

/// Whether a path is that of a file that may name a mixed team: it ends in .yaml or .yml, and is no folder.
bool names_mixed_team(const std::filesystem::path& file);
/// The policies as Player::load takes them. Throws InputError, with the line, where the file cannot be read, has other
/// keys, or too few or too many policies.
MixedTeam read_mixed_team(const std::filesystem::path& file);
/// What such a file contains.
std::string print_mixed_team(const MixedTeam& team);

}  // namespace giga
