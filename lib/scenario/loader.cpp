// load_scenario: files, `base`, suffixes, and the agent types and maps that a scenario names.
#include "scenario/loader.hpp"

#include <algorithm>
#include <set>
#include <system_error>

#include "config/names.hpp"
#include "core/error.hpp"
#include "scenario/shorthand.hpp"

namespace giga {
namespace fs = std::filesystem;

namespace {

constexpr const char* kAgentTypesFile = "scenarios/agent_types.yaml";
constexpr const char* kScenarioFolder = "scenarios";
constexpr const char* kMapFolder = "scenarios/maps";

/// A scenario file: what it starts from, and the keys that it changes.
struct ScenarioFile {
  std::optional<std::string> base;
  Scenario scenario;
};
template <class V>
void visit_fields(V& v, ScenarioFile& c) {
  v("base", c.base, "scenario to start from: a name, also with suffixes, or a path; none = the defaults");
  visit_fields(v, c.scenario);
}

/// agent_types.yaml.
struct AgentTypesFile {
  std::map<std::string, AgentType> agent_types;
};
template <class V>
void visit_fields(V& v, AgentTypesFile& c) {
  v.table("agent_types", c.agent_types, "agent types by name");
}

/// Names of the YAML files of a folder of all data folders, sorted.
std::vector<std::string> names_in(const DataDirs& dirs, const char* folder) {
  std::vector<std::string> names = data_names(dirs, folder);
  std::erase(names, "agent_types");
  return names;
}

/// Names of the YAML files beside a file that is not there.
std::vector<std::string> neighbours(const fs::path& file) {
  std::vector<std::string> names;
  std::error_code code;
  const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code))
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

bool is_there(const fs::path& file) {
  std::error_code code;
  return fs::exists(file, code);
}

class Loader {
 public:
  Loader(const DataDirs& dirs, Errors& errors) : dirs_(dirs), errors_(errors) {}

  /// Loads a name or path that was written at `at` into the scenario.
  void load(const std::string& text, const Position& at, ScenarioFile& target) {
    if (is_path(text)) {
      const fs::path file = file_at(text, at);
      const std::string mistake = is_there(file) ? "" : suffix_mistake(text);
      if (mistake.empty()) return load_file(file, text, at, target);
      errors_.add(at, cat("no such file: ", file.string(), "; ", mistake));
      return incomplete();
    }
    for (const ShortName& reading : split_name(text)) {
      const auto file = find_data_file(dirs_, fs::path(kScenarioFolder) / (reading.base + ".yaml"));
      if (!file || reading.base == "agent_types") continue;
      load_file(*file, text, at, target);
      for (const std::string& suffix : reading.suffixes) apply_suffix(suffix, target.scenario);
      resolve_maps(target.scenario);
      target.scenario.name = text;
      return;
    }
    unknown_scenario(text, at);
  }

  /// Applies a map of keys, and loads what they name.
  void apply(const Node& root, const std::string& path, ScenarioFile& target) {
    Scenario& scenario = target.scenario;
    KeyPositions given;
    read_fields(root, path.empty() ? fields_of(target) : fields_of(scenario), errors_, &given, path);
    const auto own = [&](const std::string& key) { return path.empty() ? key : key.substr(path.size() + 1); };
    for (const auto& [key, at] : given) forget_parts(own(key), scenario.where);
    for (const auto& [key, at] : given) scenario.where[own(key)] = at;
    if (!complete_) return;  // what is named may be defined in the file that is missing
    resolve_types(scenario);
    resolve_maps(scenario);
    refuse_misspelt(root, path, scenario);
  }

  /// Could all the files be read of which the scenario is made?
  bool complete() const { return complete_; }

  /// Drops the definitions that are not used.
  static void prune(Scenario& scenario) {
    std::set<std::string> used;
    for (const auto* team : {&scenario.team_0, &scenario.team_1})
      for (const TeamEntry& entry : *team) used.insert(entry.type);
    std::erase_if(scenario.agent_types, [&](const auto& entry) { return !used.contains(entry.first); });
    used = {scenario.maps.names.begin(), scenario.maps.names.end()};
    std::erase_if(scenario.map_definitions, [&](const auto& entry) { return !used.contains(entry.first); });
  }

 private:
  void load_file(const fs::path& file, const std::string& asked, const Position& at, ScenarioFile& target) {
    if (!check_file(file, at)) return incomplete();
    std::error_code code;
    const std::string key = fs::weakly_canonical(file, code).string();
    if (std::find(open_files_.begin(), open_files_.end(), key) != open_files_.end()) {
      errors_.add(at, cat("base: '", asked, "' leads back to this file"));
      return incomplete();
    }
    open_files_.push_back(key);
    const size_t errors_before = errors_.size();
    const Document document = parse_yaml_file(file, errors_);
    load_document(document, errors_.size() > errors_before, target);
    target.scenario.name = file.stem().string();
    open_files_.pop_back();
  }

  void incomplete() { complete_ = false; }

 public:
  /// `has_errors`: the parser has complained, so that nothing may be what is left of a file.
  void load_document(const Document& document, bool has_errors, ScenarioFile& target) {
    if (document.root.is_null() && has_errors) return incomplete();
    const Node* base = document.root.find("base");
    if (base && base->is_scalar() && !is_none(*base)) load(base->text, base->at, target);
    target.scenario.description.clear();  // that of the base is not ours
    target.scenario.file_start = document.root.at;
    apply(document.root, "", target);
  }

 private:
  /// A type or a map that no team has and no game draws changes nothing. Beside one that is used and whose name is near
  /// it is a mistake; but for those of a file that stand there side by side, of which one may be kept for later.
  void refuse_misspelt(const Node& changes, const std::string& path, const Scenario& scenario) {
    std::vector<std::string> types, maps = scenario.maps.names;
    for (const auto* team : {&scenario.team_0, &scenario.team_1})
      for (const TeamEntry& entry : *team) types.push_back(entry.type);
    for (const auto& [table, used] : {std::pair{"agent_types", types}, {"map_definitions", maps}}) {
      const Node* entries = changes.find(table);
      if (!entries) continue;
      for (const Node::Entry& entry : entries->entries) {
        if (std::find(used.begin(), used.end(), entry.key) != used.end()) continue;
        const bool on_command_line = entry.value.at.line == 0;
        std::vector<std::string> elsewhere = used;
        if (entries == changes.find("agent_types"))  // one that nobody knows is the mistake itself
          std::erase_if(elsewhere, [&](const auto& name) {
            return !scenario.agent_types.contains(name) && !shipped_types().contains(name);
          });
        if (!on_command_line)
          std::erase_if(elsewhere, [&](const auto& name) { return entries->find(name) != nullptr; });
        const std::string hint = nearest_hint(entry.key, elsewhere);
        if (!hint.empty())
          errors_.add(entry.value.at, cat(path, path.empty() ? "" : ".", table, ".", entry.key, ": the game has no '",
                                          entry.key, "'", hint));
      }
    }
  }

  void unknown_scenario(const std::string& text, const Position& at) {
    const std::vector<std::string> known = names_in(dirs_, kScenarioFolder);
    const std::string base = split_name(text).back().base;
    const std::string mistake = suffix_mistake(text);
    std::string message =
        cat("unknown scenario '", text, "'", mistake.empty() ? nearest_hint(base, known, 3) : "; " + mistake);
    if (dirs_.empty()) message += "; no data folder was found (set GIGASTEP_DATA_DIR)";
    errors_.add(at, message + "; allowed: the names that `gigastep scenarios` lists, with suffixes in any order (" +
                        suffix_help() + "), or the path of a YAML file");
    incomplete();
  }

  // ---- Agent types

  void resolve_types(Scenario& scenario) {
    resolve_team("team_0", scenario.team_0, scenario);
    resolve_team("team_1", scenario.team_1, scenario);
  }

  void resolve_team(const std::string& team, std::vector<TeamEntry>& entries, Scenario& scenario) {
    for (size_t k = 0; k < entries.size(); ++k) {
      std::string& type = entries[k].type;
      if (scenario.agent_types.contains(type)) continue;
      const std::string key = cat(team, "[", k, "].type");
      const Position at = scenario.position_of({key, cat(team, "[", k, "]"), team});
      if (is_path(type)) {
        const fs::path file = file_at(type, at);
        const std::string name = file.stem().string();
        AgentType loaded;
        if (!check_file(file, at) || !read_part(file, loaded, "agent_types." + name, scenario)) continue;
        // Or who names the shipped one later in the file would get this one.
        const auto shipped = shipped_types().find(name);
        if (shipped != shipped_types().end() && !(shipped->second == loaded)) {
          errors_.add(at, cat(key, ": ", type, " has the name of the agent type '", name,
                              "', which gigastep brings: give the file another name"));
          continue;
        }
        const auto known = scenario.agent_types.emplace(name, loaded).first;
        if (!(known->second == loaded)) errors_.add(at, cat(key, ": there are two agent types named '", name, "'"));
        type = name;
      } else if (const auto known = shipped_types().find(type); known != shipped_types().end()) {
        scenario.agent_types.insert(*known);
      } else {
        std::vector<std::string> names;
        for (const auto& entry : scenario.agent_types) names.push_back(entry.first);
        for (const auto& entry : shipped_types())
          if (!scenario.agent_types.contains(entry.first)) names.push_back(entry.first);
        const std::string hint = nearest_hint(type, names) + "; known: " + join(names);
        errors_.add(at, cat(key, ": unknown agent type '", type, "'", hint));
      }
    }
  }

  const std::map<std::string, AgentType>& shipped_types() {
    if (!types_read_) {
      types_read_ = true;
      AgentTypesFile content;
      if (const auto file = find_data_file(dirs_, kAgentTypesFile)) {
        const Document document = parse_yaml_file(*file, errors_);
        if (!document.root.is_null()) read_fields(document.root, content, errors_);
      }
      types_ = std::move(content.agent_types);
    }
    return types_;
  }

  // ---- Maps

  void resolve_maps(Scenario& scenario) {
    // Those defined in place first: they may be flipped forms of others.
    for (auto& [name, map] : scenario.map_definitions) {
      const std::string key = cat("map_definitions.", name, ".flipped_of");
      if (map.flipped_of) flip(name, map, key, scenario.position_of({key}), scenario);
    }
    // A base's flipped forms of maps that have been changed since, unless they have been changed themselves.
    // One may stand for another, so each time the next of a chain is right. Chains that are rings are mistakes, told
    // above.
    for (size_t turn = 0; turn < flipped_forms_.size(); ++turn)
      for (auto& [name, form] : flipped_forms_) {
        const auto own = scenario.map_definitions.find(name), other = scenario.map_definitions.find(form.of);
        if (own == scenario.map_definitions.end() || other == scenario.map_definitions.end()) continue;
        if (own->second == form.map) own->second = form.map = exchanged(other->second, form.map.description);
      }
    std::vector<std::string>& names = scenario.maps.names;
    for (size_t k = 0; k < names.size(); ++k) {
      const Position at = scenario.position_of({cat("maps[", k, "]"), "maps"});
      Map map;
      if (is_path(names[k])) {
        const fs::path file = file_at(names[k], at);
        const std::string name = file.stem().string();
        if (!check_file(file, at) || !read_part(file, map, "map_definitions." + name, scenario)) continue;
        if (map.flipped_of) flip(name, map, "flipped_of", flip_of(name, scenario), scenario);
        const auto known = scenario.map_definitions.emplace(name, map).first;
        if (!(known->second == map)) errors_.add(at, cat("maps: there are two maps named '", name, "'"));
        names[k] = name;
      } else if (!scenario.map_definitions.contains(names[k]) && find_map(names[k], "maps", at, scenario, map, 0)) {
        scenario.map_definitions.emplace(names[k], map);
      }
      if (std::count(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(k), names[k]) > 0)
        errors_.add(at, cat("maps: '", names[k], "' is named twice"));
    }
  }

  /// The map of that name: defined in the scenario, or a file of the data folders.
  bool find_map(const std::string& name, const std::string& key, const Position& at, Scenario& scenario, Map& map,
                int depth) {
    if (const auto known = scenario.map_definitions.find(name); known != scenario.map_definitions.end()) {
      map = known->second;
      const std::string own_key = cat("map_definitions.", name, ".flipped_of");
      if (map.flipped_of) flip(name, map, own_key, scenario.position_of({own_key}), scenario, depth);
      return true;
    }
    if (const auto file = find_data_file(dirs_, fs::path(kMapFolder) / (name + ".yaml"))) {
      if (!read_part(*file, map, "map_definitions." + name, scenario)) return false;
      if (map.flipped_of) flip(name, map, "flipped_of", flip_of(name, scenario), scenario, depth);
      return true;
    }
    std::vector<std::string> names = names_in(dirs_, kMapFolder);
    if (name == "all" && key == "maps") {
      errors_.add(at, cat(key, ": 'all' stands alone, as maps: all; in a list name each map: ", join(names)));
      return false;
    }
    for (const auto& entry : scenario.map_definitions)
      if (std::find(names.begin(), names.end(), entry.first) == names.end()) names.push_back(entry.first);
    errors_.add(at, cat(key, ": unknown map '", name, "'", nearest_hint(name, names), "; known: ", join(names)));
    return false;
  }

  /// Makes of `map`, which is only said to be the flipped form of another, that map with the starts exchanged.
  void flip(const std::string& name, Map& map, const std::string& key, const Position& at, Scenario& scenario,
            int depth = 0) {
    constexpr int kDeepest = 8;
    Map alone;
    alone.description = map.description;
    alone.flipped_of = map.flipped_of;
    if (!(map == alone))
      errors_.add(at, cat(key, ": takes the whole map from '", *map.flipped_of, "'; drop the other keys"));
    Map other;
    if (depth >= kDeepest)
      errors_.add(at, cat(key, ": '", *map.flipped_of, "' leads back to this map"));
    else
      find_map(*map.flipped_of, key, at, scenario, other, depth + 1);
    const std::string of = *map.flipped_of;
    map = exchanged(other, map.description);
    flipped_forms_[name] = {of, map};
  }

  static Map exchanged(Map map, const std::string& description) {
    std::swap(map.team_0, map.team_1);
    map.description = description;
    map.flipped_of.reset();
    return map;
  }

  // ---- Helpers

  /// Is the file, which was named at `at`, there?
  bool check_file(const fs::path& file, const Position& at) {
    if (is_there(file)) return true;
    errors_.add(at, cat("no such file: ", file.string(), nearest_hint(file.filename().string(), neighbours(file))));
    return false;
  }

  /// Forgets where the items of a list that is now given, or the keys of an entry of a table, stood before.
  static void forget_parts(const std::string& key, KeyPositions& where) {
    const bool is_entry = std::count(key.begin(), key.end(), '.') == 1 &&
                          (key.starts_with("agent_types.") || key.starts_with("map_definitions."));
    std::erase_if(where, [&](const auto& known) {
      return known.first.starts_with(key + "[") || (is_entry && known.first.starts_with(key + "."));
    });
  }

  static Position flip_of(const std::string& map, const Scenario& scenario) {
    return scenario.position_of({cat("map_definitions.", map, ".flipped_of")});
  }

  /// Reads a file that holds one map or one agent type; remembers its positions under `prefix`.
  template <class T>
  bool read_part(const fs::path& file, T& part, const std::string& prefix, Scenario& scenario) {
    const size_t errors_before = errors_.size();
    const Document document = parse_yaml_file(file, errors_);
    KeyPositions given;
    if (errors_.size() == errors_before || !document.root.is_null()) read_fields(document.root, part, errors_, &given);
    forget_parts(prefix, scenario.where);
    scenario.where[prefix] = document.root.at;
    for (const auto& [key, at] : given) scenario.where[prefix + "." + key] = at;
    return errors_.size() == errors_before;
  }

  /// What a map is the flipped form of, and what it was when that was last looked at.
  struct FlippedForm {
    std::string of;
    Map map;
  };

  const DataDirs& dirs_;
  Errors& errors_;
  std::map<std::string, FlippedForm> flipped_forms_;  // by name
  std::vector<std::string> open_files_;               // the chain of bases
  std::map<std::string, AgentType> types_;
  bool types_read_ = false;
  bool complete_ = true;
};

}  // namespace

bool is_path(const std::string& text) {
  return text.find('/') != std::string::npos || text.ends_with(".yaml") || text.ends_with(".yml");
}

fs::path file_at(const std::string& path, const Position& at) {
  if (at.line == 0 || !at.source) return path;
  const fs::path whole = fs::path(*at.source).parent_path() / path, plain = whole.lexically_normal();
  // Behind a link to a folder `..` is another one than the text shows.
  std::error_code code;
  const bool differ = (is_there(whole) || is_there(plain)) && !fs::equivalent(whole, plain, code);
  return differ ? whole : plain;
}

std::string whole_path(const fs::path& file) {
  return (fs::weakly_canonical(fs::absolute(file).parent_path()) / file.filename()).string();
}

void for_each_file(Node& changes, const std::function<void(Node& path)>& visit) {
  const auto visit_path = [&visit](Node& node) {
    if (node.is_scalar() && is_path(node.text)) visit(node);
  };
  for (Node::Entry& entry : changes.entries) {
    if (entry.key == "maps") visit_path(entry.value);
    for (Node& item : entry.value.items) {
      if (entry.key == "maps") visit_path(item);
      for (Node::Entry& part : item.entries)
        if (entry.key.starts_with("team_") && part.key == "type") visit_path(part.value);
    }
  }
}

bool name_files(Node& changes) {
  bool found = false;
  for_each_file(changes, [&found](Node& path) {
    path.text = fs::path(path.text).stem().string();
    found = true;
  });
  return found;
}

std::optional<Scenario> load_scenario(const ScenarioRequest& request, const DataDirs& dirs, Errors& errors) {
  Loader loader(dirs, errors);
  ScenarioFile file;
  loader.load(request.name_or_path, request.at, file);
  if (request.changes && !request.changes->is_null()) loader.apply(*request.changes, request.changes_path, file);
  if (!loader.complete()) return std::nullopt;
  Loader::prune(file.scenario);
  return file.scenario;
}

Scenario load_scenario(const std::string& name_or_path, const DataDirs& dirs, const Node* changes,
                       const std::string& changes_path) {
  Errors errors;
  const ScenarioRequest request{name_or_path, {}, changes, changes_path.empty() ? "scenario" : changes_path};
  const std::optional<Scenario> scenario = load_scenario(request, dirs, errors);
  errors.throw_if_any();
  return *scenario;
}

void change_scenario(const Node& changes, const std::string& path, const DataDirs& dirs, Scenario& scenario,
                     Errors& errors) {
  Loader loader(dirs, errors);
  ScenarioFile file;
  file.scenario = std::move(scenario);
  loader.apply(changes, path, file);
  Loader::prune(file.scenario);
  scenario = std::move(file.scenario);
}

std::optional<Scenario> parse_scenario(std::string_view text, const std::string& name, const DataDirs& dirs,
                                       Errors& errors) {
  Loader loader(dirs, errors);
  ScenarioFile file;
  Errors in_text;
  const Document document = parse_yaml_text(text, name, in_text);
  errors.add_all(in_text);
  loader.load_document(document, !in_text.empty(), file);
  if (!loader.complete()) return std::nullopt;
  file.scenario.name = name;
  Loader::prune(file.scenario);
  return file.scenario;
}

Scenario parse_scenario(std::string_view text, const std::string& name, const DataDirs& dirs) {
  Errors errors;
  const std::optional<Scenario> scenario = parse_scenario(text, name, dirs, errors);
  errors.throw_if_any();
  return *scenario;
}

std::vector<ScenarioInfo> list_scenarios(const DataDirs& dirs) {
  std::vector<ScenarioInfo> list;
  for (const std::string& name : names_in(dirs, kScenarioFolder)) {
    ScenarioInfo info{name, "", *find_data_file(dirs, fs::path(kScenarioFolder) / (name + ".yaml"))};
    Errors errors;
    const Document document = parse_yaml_file(info.file, errors);
    if (const Node* description = document.root.find("description")) info.description = description->text;
    if (!errors.empty()) info.description = "(cannot be read: " + errors.text() + ")";
    list.push_back(std::move(info));
  }
  return list;
}

FieldList scenario_file_fields() { return fields_of_default<ScenarioFile>(); }

FieldList agent_types_file_fields() { return fields_of_default<AgentTypesFile>(); }

}  // namespace giga
