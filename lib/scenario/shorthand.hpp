// The suffixes of scenario names: `_fobs`, `_rgb`, `_void`, `_disc` and their opposites.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "scenario/scenario.hpp"

namespace giga {

/// A name taken apart: "identical_5_vs_5_fobs_disc" = "identical_5_vs_5" and the suffixes "fobs", "disc".
struct ShortName {
  std::string base;
  std::vector<std::string> suffixes;
};

/// All ways to read the name, the longest base (the whole name) first. Suffixes may stand in any order, one of a pair.
std::vector<ShortName> split_name(std::string_view name);

/// Sets the keys for which a suffix stands.
void apply_suffix(std::string_view suffix, Scenario& scenario);

/// What is wrong with the suffixes of a name that is unknown, or of a path; empty = nothing.
std::string suffix_mistake(std::string_view name);

/// "_fobs|_pobs, _rgb|_vec, ..." for messages.
std::string suffix_help();

}  // namespace giga
