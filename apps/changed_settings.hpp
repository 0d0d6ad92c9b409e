// changed_settings: for people, what differs between the settings of a folder and those that are wanted now.
#pragma once

#include <string>
#include <vector>

#include "config/settings.hpp"

namespace giga {

/// "mappo.gamma: 0.99 there, 0.9 now; seed: ...", the first five and how many more.
std::string changed_settings(const std::vector<SettingChange>& changes);

}  // namespace giga
