// Finds and reads scenarios by name, with the suffix shorthand, or by path.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "config/document.hpp"
#include "scenario/data_dirs.hpp"
#include "scenario/scenario.hpp"

namespace giga {

/// Reads a scenario; throws InputError with all errors.
///
/// `name_or_path` with a slash or ending in .yaml is a file; else a scenario of the data folders, where the name may
/// carry suffixes in any order, each standing for keys:
///   _fobs | _pobs   full observability: use_stochastic_obs and use_stochastic_comm false, cone_depth 100, cone_angle
///                   2 pi, rewards.detection 0 | as the scenario says
///   _vec            nothing: agents observe numbers, not images
///   _maps | _void   maps: all | empty
///   _cont | _disc   action: continuous | discrete
/// (A bare base name means vector observations and discrete actions; in the original it meant images and continuous
/// ones.)
///
/// A file states differences from the defaults, or from another scenario that its key `base` names. Paths in a file are
/// relative to that file.
///
/// `changes`, if given, is a map of scenario keys that is applied last (the environment part of a run's config);
/// `changes_path` stands before its keys in messages.
Scenario load_scenario(const std::string& name_or_path, const DataDirs& dirs, const Node* changes = nullptr,
                       const std::string& changes_path = "");

/// What load_scenario is asked for, where that matters for messages.
struct ScenarioRequest {
  const std::string& name_or_path;
  Position at;  ///< where the user names it
  const Node* changes = nullptr;
  std::string changes_path;
};
/// The same, with all mistakes added to `errors`. Nothing where a file of which the scenario is made cannot be read;
/// else what could be read, which is worth checking further (compile), so that the user sees all mistakes at once.
std::optional<Scenario> load_scenario(const ScenarioRequest& request, const DataDirs& dirs, Errors& errors);

/// Changes keys of a scenario; mistakes are added to `errors`. `path` stands before the keys in messages.
void change_scenario(const Node& changes, const std::string& path, const DataDirs& dirs, Scenario& scenario,
                     Errors& errors);

/// Reads a scenario from a text, such as print_scenario gives.
Scenario parse_scenario(std::string_view text, const std::string& name, const DataDirs& dirs);
std::optional<Scenario> parse_scenario(std::string_view text, const std::string& name, const DataDirs& dirs,
                                       Errors& errors);

/// Whether this is the path of a file, not a name.
bool is_path(const std::string& name_or_path);
/// The file that a path written at `at` means: in a file it is relative to that file's folder, on the command line to
/// the shell's.
std::filesystem::path file_at(const std::string& path, const Position& at);
/// That file as it is found from anywhere. It keeps its own name, after which a scenario or a map is called.
std::string whole_path(const std::filesystem::path& file);
/// Visits each file of a map or an agent type that changes to a scenario name.
void for_each_file(Node& changes, const std::function<void(Node& path)>& visit);
/// Changes to a scenario with the names of maps and agent types in the place of their files; whether there were files.
bool name_files(Node& changes);

struct ScenarioInfo {
  std::string name, description;
  std::filesystem::path file;
};

/// The scenarios of the data folders, by name.
std::vector<ScenarioInfo> list_scenarios(const DataDirs& dirs);

/// All keys of a scenario file, `base` included, and of agent_types.yaml, for the reference and the schema.
FieldList scenario_file_fields();
FieldList agent_types_file_fields();

}  // namespace giga
