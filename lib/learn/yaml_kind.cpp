#include "learn/yaml_kind.hpp"

#include <algorithm>
#include <set>

#include "config/document.hpp"
#include "config/fields.hpp"
#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "learn/run_config_file.hpp"
#include "scenario/scenario.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

/// First levels of the keys.
std::set<std::string> names_of(const std::vector<FieldInfo>& fields) {
  std::set<std::string> names;
  for (const FieldInfo& field : fields) names.insert(field.path.substr(0, field.path.find_first_of(".[")));
  return names;
}

}  // namespace

YamlKind kind_of(const fs::path& file) {
  Errors errors;
  const Node root = parse_yaml_file(file, errors).root;
  if (!root.is_map() || root.entries.empty()) return YamlKind::unknown;
  const auto all_in = [&root](const std::set<std::string>& names) {
    return std::all_of(root.entries.begin(), root.entries.end(),
                       [&names](const Node::Entry& entry) { return names.contains(entry.key); });
  };
  if (root.find("parameters") && (root.find("config") || root.find("metric"))) return YamlKind::sweep;
  if (all_in({"policies"})) return YamlKind::mixed_team;
  const std::set<std::string> of_config = names_of(list_fields<RunConfigFile>());
  if (all_in(of_config)) return YamlKind::config;
  std::set<std::string> of_scenario = names_of(list_fields<Scenario>());
  of_scenario.insert("base");
  if (all_in(of_scenario)) return YamlKind::scenario;
  for (const char* key : {"train", "mappo", "population"})  // a config with a mistake
    if (root.find(key)) return YamlKind::config;
  return YamlKind::unknown;
}

std::string not_asked_for(const fs::path& file, YamlKind asked) {
  const YamlKind kind = kind_of(file);
  if (kind == asked || kind == YamlKind::unknown) return "";
  const std::string name = file.string(), word = shell_word(name),
                    wanted = asked == YamlKind::config  ? "config"
                             : asked == YamlKind::sweep ? "sweep"
                                                        : "policy";
  std::string text = cat(name, ": this is a ",
                         kind == YamlKind::config     ? "config"
                         : kind == YamlKind::scenario ? "scenario"
                         : kind == YamlKind::sweep    ? "sweep"
                                                      : "mixed team",
                         ", not a ", wanted);
  if (kind == YamlKind::sweep) return cat(text, "; to run it: gigastep sweep ", word);
  if (kind == YamlKind::scenario && asked == YamlKind::mixed_team)
    return cat(text, "; --scenario says which one is played");
  if (kind == YamlKind::scenario)
    return cat(text, "; to train in it: gigastep train quickstart --set ", shell_word("scenario=" + name));
  if (kind == YamlKind::mixed_team) return cat(text, "; it may play in eval, and be a config's train.opponent");
  std::error_code code;
  const fs::path folder = fs::absolute(file, code).parent_path();
  if (asked == YamlKind::mixed_team && fs::is_directory(folder / "checkpoints", code))
    return cat(text,
               "; the policies of its run: ", shell_word(file.has_parent_path() ? file.parent_path().string() : "."));
  return cat(text, "; to train by it: gigastep train ", word);
}

}  // namespace giga
