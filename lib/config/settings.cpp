#include "config/settings.hpp"

#include "core/error.hpp"

namespace giga {
namespace {

using PrintNode = std::function<std::string(const Node&)>;

void flatten_into(const Node& node, const std::string& path, const PrintNode& print, Settings& settings) {
  if (!node.is_map() || node.entries.empty()) {
    settings.emplace_back(path, print(node));
    return;
  }
  for (const Node::Entry& entry : node.entries) flatten_into(entry.value, path + "." + entry.key, print, settings);
}

}  // namespace

Settings flatten(const Node& map, const PrintNode& print) {
  Settings settings;
  for (const Node::Entry& entry : map.entries) flatten_into(entry.value, entry.key, print, settings);
  return settings;
}

std::string plain_text(const Node& node) { return node.is_scalar() ? node.text : print_node(node); }

std::string setting(const Settings& settings, const std::string& path) {
  for (const auto& [key, value] : settings)
    if (key == path) return value;
  return "";
}

bool paths_overlap(const std::string& a, const std::string& b) {
  return cat(a, ".").starts_with(cat(b, ".")) || cat(b, ".").starts_with(cat(a, "."));
}

std::vector<SettingChange> compare_settings(const Settings& before, const Settings& after) {
  std::vector<SettingChange> changes;
  for (const auto& [path, value] : before)
    if (const std::string now = setting(after, path); now != value) changes.push_back({path, value, now});
  for (const auto& [path, value] : after)
    if (setting(before, path).empty() && !value.empty()) changes.push_back({path, "", value});
  return changes;
}

}  // namespace giga
