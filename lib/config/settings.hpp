// Settings: the leaves of a config or scenario as a flat list, to be compared and shown.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "config/document.hpp"

namespace giga {

/// Path ("train.n_worlds") and value (on one line, as YAML unless told otherwise) of every leaf of a map, in its order;
/// lists and empty maps are leaves.
using Settings = std::vector<std::pair<std::string, std::string>>;
Settings flatten(const Node& map, const std::function<std::string(const Node&)>& print = print_node);

/// A value for people: a text without the quotes of YAML.
std::string plain_text(const Node& node);

/// Value of a path; "" where there is none.
std::string setting(const Settings& settings, const std::string& path);

/// Whether one path is the other, or that of a group that holds it.
bool paths_overlap(const std::string& a, const std::string& b);

/// A path with its values in two lists, of which one may lack it ("").
struct SettingChange {
  std::string path, before, after;
};
/// Those that are not the same in both, in the order of the first list, then of the second.
std::vector<SettingChange> compare_settings(const Settings& before, const Settings& after);

}  // namespace giga
