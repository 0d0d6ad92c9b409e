// For people: what differs between the settings of a folder and those that are wanted now, and which mean nothing.
#pragma once

#include <string>
#include <vector>

#include "config/settings.hpp"

namespace giga {

/// "mappo.gamma: 0.99 there, 0.9 now; seed: ...", the first five and how many more.
std::string changed_settings(const std::vector<SettingChange>& changes);

/// Warns of each `--set` of what the algorithm of that name does not read.
void warn_of_unread(const std::vector<std::string>& overrides, const std::string& algorithm);

}  // namespace giga
