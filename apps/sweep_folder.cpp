// Beginning a sweep, and finding out how far it came.
#include "apps/sweep_folder.hpp"

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "apps/changed_settings.hpp"
#include "apps/command_line.hpp"
#include "apps/output.hpp"
#include "apps/run_process.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/files.hpp"
#include "io/number.hpp"
#include "learn/registry.hpp"
#include "learn/yaml_kind.hpp"
#include "report/report.hpp"
#include "scenario/loader.hpp"
#include "sweep/sobol.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr const char *kSweepFile = "sweep.yaml", *kConfigFile = "config.yaml", *kJournalFile = "sweep.jsonl",
                     *kSettingUp = "setting_up";

/// What must stay as it is when a sweep goes on.
std::string lasting_part(SweepSpec spec) {
  const SweepSpec usual;
  spec.parallel = usual.parallel;
  spec.max_wall_time = usual.max_wall_time;
  spec.config.clear();  // it is in the folder
  spec.set.clear();
  return print_yaml(spec, false);
}

/// Beside the file of the sweep, or as any command finds it.
std::string config_of_sweep(const SweepSpec& spec, const fs::path& file, const KeyPositions& given) {
  std::error_code code;
  const fs::path beside = file.parent_path() / spec.config;
  if (fs::is_regular_file(beside, code)) return beside.string();
  try {
    return find_config(spec.config);
  } catch (const InputError& e) {
    throw InputError(cat(given.at("config").text(), ": config: ", e.what()));
  }
}

/// A value with the files and folders that it names, as they are found from anywhere: beside the file of the sweep, or
/// else from where the command is given.
std::string with_whole_paths(const std::string& value, const fs::path& sweep) {
  Errors errors;
  Node root = parse_yaml_text(value, "value", errors).root;
  bool found = false;
  const auto make_whole = [&](auto&& self, Node& node) -> void {
    std::error_code code;
    if (node.is_scalar() && is_path(node.text))
      for (const fs::path& place : {sweep.parent_path() / node.text, fs::path(node.text)})
        if (fs::exists(place, code)) {
          node.text = whole_path(place);
          found = true;
          break;
        }
    for (Node& item : node.items) self(self, item);
    for (Node::Entry& entry : node.entries) self(self, entry.value);
  };
  if (errors.empty()) make_whole(make_whole, root);
  return found ? print_node(root) : value;
}

void make_paths_whole(SweepSpec& spec, const fs::path& file) {
  for (std::string& text : spec.set) {
    const size_t value = std::min(text.size(), text.find('=')) + 1;
    if (value < text.size()) text = text.substr(0, value) + with_whole_paths(text.substr(value), file);
  }
  for (auto& [key, parameter] : spec.parameters)
    for (Choice& choice : parameter.choices) choice.yaml = with_whole_paths(choice.yaml, file);
}

/// Mistakes in `set` are told as those of --set; here with their places in the file of the sweep.
std::string with_places_of_set(const std::string& message, const SweepSpec& spec, const KeyPositions& given) {
  const std::string option = "--set ";
  std::vector<std::string> lines;
  std::istringstream text(message);
  for (std::string line; std::getline(text, line);) {
    for (size_t k = spec.set.size(); k-- > 0;) {  // of a key that is set twice the last counts
      const std::string key = spec.set[k].substr(0, spec.set[k].find('='));
      const auto at = given.find(cat("set[", k, "]"));
      if (at == given.end() || !line.starts_with(cat(option, key, ":"))) continue;
      line = cat(at->second.text(), ": set: ", line.substr(option.size()));
      break;
    }
    lines.push_back(line);
  }
  return join(lines, "\n");
}

/// The first and the last value of a range, as the config reads them; of choices none, which are all tried.
std::vector<std::string> ends_of(const ParameterSpec& parameter) {
  std::vector<std::string> ends;
  for (const auto& range : {parameter.uniform, parameter.log_uniform})
    if (range)
      for (const double end : *range) ends.push_back(print_number(end));
  if (parameter.integers)
    for (const int64_t end : *parameter.integers) ends.push_back(std::to_string(end));
  return ends;
}

/// Mistakes of a trial are told as those of --set, and of the sweep's own copy of the config, which is gone when they
/// are read; here with the places of the parameters in the file of the sweep.
std::string with_places_of_parameters(const std::string& message, const TrialSettings& settings,
                                      const KeyPositions& given, const fs::path& copy) {
  const auto place = [&given](const std::string& key) {
    const auto at = given.find("parameters." + key);
    return cat(at == given.end() ? "" : at->second.text() + ": ", "parameters.", key, ": ");
  };
  std::vector<std::string> lines;
  std::istringstream text(message);
  for (std::string line; std::getline(text, line);) {
    std::string places;
    for (const auto& [key, value] : settings) {
      if (const std::string option = cat("--set ", key, ": "); line.starts_with(option))
        places = place(key), line.erase(0, option.size());
      else if (line.find(key) != std::string::npos)
        places += place(key);
    }
    if (line.starts_with(copy.string() + ":")) {  // FILE:LINE:COLUMN:
      line.erase(0, line.find(": ") + 2);
      if (places.empty())
        for (const auto& [key, value] : settings) places += cat(place(key), "with ", value, ": ");
    }
    lines.push_back(places + line);
  }
  return join(lines, "\n");
}

LoadedRun load_base(const SweepSpec& spec, const fs::path& file, const KeyPositions& given) {
  const std::string config = config_of_sweep(spec, file, given);
  try {
    return load_run_config(config, spec.set);
  } catch (const InputError& e) {
    throw InputError(with_places_of_set(e.what(), spec, given));
  }
}

/// Whether a folder has something else than a sweep in it. One that was stopped while it was set up has tried nothing,
/// and is written anew.
bool holds_others(const fs::path& folder) {
  std::error_code code;
  if (fs::exists(folder / kSweepFile, code) || fs::exists(folder / kSettingUp, code)) return false;
  return holds_files(folder);
}

}  // namespace

SweepFolder::SweepFolder(const fs::path& file, const fs::path& folder) : path_(folder) {
  KeyPositions given;
  std::error_code code;
  if (!fs::exists(file, code))
    throw InputError(cat(file.string(), ": no such file; a sweep is a YAML file that names a config (docs/sweep.md)"));
  try {
    spec_ = read_sweep(file, given);
  } catch (const InputError&) {
    if (const std::string other = not_asked_for(file, YamlKind::sweep); !other.empty()) throw InputError(other);
    throw;
  }
  make_paths_whole(spec_, file);
  trials_ = draw_trials(spec_, sobol_points);
  if (!fs::exists(path_ / kSweepFile, code)) {
    const LoadedRun run = check_base(file, given);  // takes a second: another process may begin this sweep meanwhile
    if (holds_others(path_)) throw InputError(cat("the folder ", path_.string(), " is not empty, and holds no sweep"));
    make_folder_of(path_ / kSweepFile);
    lock_.emplace(path_);
    if (!fs::exists(path_ / kSweepFile, code)) create(run, given);
  }

  KeyPositions before;
  SweepSpec known = read_sweep(path_ / kSweepFile, before);
  make_paths_whole(known, file);  // an older program left those as they were that lie in the working folder
  const auto settings_in = [](const SweepSpec& spec) { return flatten(parse_yaml_text(lasting_part(spec), "").root); };
  if (const auto changes = compare_settings(settings_in(known), settings_in(spec_)); !changes.empty())
    throw InputError(cat("the folder ", path_.string(), " holds another sweep than ", file.string(), " (",
                         changed_settings(changes), "): of a sweep that goes on only parallel and max_wall_time may ",
                         "change; --out takes another folder"));
  if (known.config != spec_.config || known.set != spec_.set)
    std::cerr << "note: config and set of " << file.string() << " have changed; this sweep goes on by "
              << (path_ / kConfigFile).string() << '\n';
  if (!lock_) lock_.emplace(path_);
  const LoadedRun run = load_run_config((path_ / kConfigFile).string(), {});
  rungs_ = rungs_of(spec_.halving, run.config.train.total_agent_steps);
  if (run.config.train.n_threads == 0 && spec_.parallel > 1)
    threads_ = std::max(1, static_cast<int>(std::thread::hardware_concurrency()) / spec_.parallel);
  progress_.emplace(spec_, static_cast<int>(trials_.size()), static_cast<int>(rungs_.size()));
  journal_.emplace(path_ / kJournalFile);
  for (const Json& event : journal_->events()) replay(event);
}

/// The config that trials change. What is wrong with it shows before there is a folder.
LoadedRun SweepFolder::check_base(const fs::path& file, const KeyPositions& given) const {
  LoadedRun run = load_base(spec_, file, given);
  parse_device(run.config.device);  // one that is not here is told now
  if (run.config.train.max_wall_time)
    std::cerr << "note: train.max_wall_time of " << spec_.config
              << " is left out: runs of a sweep end with their agent-steps, or with its max_wall_time\n";
  run.config.train.max_wall_time.reset();
  check_halving(spec_.halving, run.config.train.total_agent_steps, given);
  const std::vector<std::string> columns = metric_columns(run);
  for (const std::string& name : spec_.metric)
    if (std::find(columns.begin(), columns.end(), name) == columns.end())
      throw InputError(cat(given.at("metric").text(), ": metric: this run logs no column '", name, "'",
                           nearest_hint(name, columns, 3), "; all: ", join(columns)));
  return run;
}

/// Everything else that can be wrong shows before the first trial. The folder is this process's alone.
void SweepFolder::create(const LoadedRun& run, const KeyPositions& given) {
  std::error_code code;
  write_file(path_ / kSettingUp, "");
  fs::create_directories(path_ / "trials");
  fs::create_directories(path_ / "logs");
  write_config_files(path_, run);
  try {
    check_ends(given);
    MetricCheck check(spec_.metric);
    std::set<std::string> algorithms;
    for (const TrialSettings& settings : trials_)
      algorithms.insert(check_settings(settings, given, check).train.algorithm);
    refuse_unread(algorithms, given);
  } catch (const InputError&) {
    fs::remove_all(path_, code);
    throw;
  }
  write_file(path_ / kSweepFile, print_yaml(spec_, true));  // with it the folder is a sweep
  fs::remove(path_ / kSettingUp, code);
}

/// A range may reach beyond what its key allows where no draw happens to lie: both ends are tried, each alone. What
/// else is wrong with them may be right beside other values.
void SweepFolder::check_ends(const KeyPositions& given) const {
  for (const auto& [key, parameter] : spec_.parameters)
    for (const std::string& end : ends_of(parameter)) {
      const std::string option = cat("--set ", key, ": '", end, "' is not ");
      try {
        load_run_config((path_ / kConfigFile).string(), {cat(key, "=", end)});
      } catch (const InputError& e) {
        std::istringstream text(e.what());
        for (std::string line; std::getline(text, line);)
          if (line.starts_with(option))
            throw InputError(with_places_of_parameters(line, {{key, end}}, given, path_ / kConfigFile));
      }
    }
}

/// A parameter that no trial's algorithm reads would compare runs that are the same.
void SweepFolder::refuse_unread(const std::set<std::string>& algorithms, const KeyPositions& given) const {
  for (const auto& [key, parameter] : spec_.parameters) {
    const auto reads = [&key = key](const std::string& algorithm) { return reads_setting(algorithm, key); };
    if (std::any_of(algorithms.begin(), algorithms.end(), reads)) continue;
    throw InputError(cat(given.at("parameters." + key).text(), ": parameters.", key, ": this means nothing with ",
                         join({algorithms.begin(), algorithms.end()}), " (train.algorithm)"));
  }
}

RunConfig SweepFolder::check_settings(const TrialSettings& settings, const KeyPositions& given,
                                      MetricCheck& check) const {
  std::optional<LoadedRun> run;
  try {
    run = load_run_config((path_ / kConfigFile).string(), assignments_of(settings));
  } catch (const InputError& e) {
    throw InputError(with_places_of_parameters(e.what(), settings, given, path_ / kConfigFile));
  }
  if (const std::string missing = check.missing_in(*run, settings); !missing.empty())
    refuse_metric(missing, settings, given, check);
  return run->config;
}

/// Names the parameters that take the column away by themselves; all, where only several together do.
void SweepFolder::refuse_metric(const std::string& missing, const TrialSettings& settings, const KeyPositions& given,
                                MetricCheck& check) const {
  std::vector<std::string> guilty, all;
  for (const auto& setting : settings) {
    const auto at = given.find("parameters." + setting.first);
    all.push_back(cat(at == given.end() ? "" : at->second.text() + ": ", "parameters.", setting.first, ": with ",
                      setting.second));
    try {
      const LoadedRun alone = load_run_config((path_ / kConfigFile).string(), assignments_of({setting}));
      if (check.missing_in(alone, {setting}) == missing) guilty.push_back(all.back());
    } catch (const InputError&) {  // a value that needs others beside it
    }
  }
  std::string text;
  for (const std::string& place : guilty.empty() ? all : guilty)
    text += cat(text.empty() ? "" : "\n", place, " the run logs no column '", missing,
                "', by which trials are compared (metric)");
  throw InputError(text);
}

void SweepFolder::replay(const Json& event) {
  const std::string what = event.value("event", "");
  const int trial = event.value("trial", -1);
  if (what == "add") {
    TrialSettings settings;
    for (const auto& [key, value] : event.at("settings").items()) settings.emplace_back(key, value.get<std::string>());
    trials_.push_back(std::move(settings));
    progress_->add_trial();
  } else if (what == "begin") {
    progress_->begin(trial, event.at("rung"));
  } else if (what == "result") {
    SweepResult result;
    if (!event.at("value").is_null()) result.value = event.at("value").get<double>();
    result.exit_code = event.value("exit_code", 0);
    result.seconds = event.value("seconds", 0.0);
    result.agent_steps = event.value("agent_steps", 0.0);
    progress_->finish({trial, event.at("rung"), event.at("seed")}, result);
  } else {
    throw InputError(
        cat((path_ / kJournalFile).string(), " holds an event '", what, "', which this program does not know"));
  }
}

void SweepFolder::begin(const SweepJob& job) {
  journal_->write({{"event", "begin"}, {"trial", job.trial}, {"rung", job.rung}});
  progress_->begin(job.trial, job.rung);
}

void SweepFolder::finish(const SweepRun& run, const SweepResult& result) {
  Json event = {{"event", "result"},         {"trial", run.trial},
                {"rung", run.rung},          {"seed", run.seed},
                {"value", nullptr},          {"exit_code", result.exit_code},
                {"seconds", result.seconds}, {"agent_steps", result.agent_steps}};
  if (result.value) event["value"] = *result.value;
  journal_->write(event);
  progress_->finish(run, result);
}

int SweepFolder::add(const TrialSettings& settings) {
  MetricCheck check(spec_.metric);
  check_settings(settings, {}, check);
  Json values = Json::object();
  for (const auto& [key, value] : settings) values[key] = value;
  journal_->write({{"event", "add"}, {"settings", values}});
  trials_.push_back(settings);
  return progress_->add_trial();
}

int64_t SweepFolder::agent_steps(int trial, int rung) const {
  const LoadedRun run = load_run_config((path_ / kConfigFile).string(), assignments_of(settings(trial)));
  const int64_t total = run.config.train.total_agent_steps;
  const auto k = static_cast<size_t>(rung);
  return k + 1 < rungs_.size() ? std::min(rungs_[k], total) : total;
}

WantedRun SweepFolder::wanted(const SweepRun& run) const {
  WantedRun wanted;
  wanted.folder = trial_folder(path_, run.trial, run.seed);
  wanted.config = path_ / kConfigFile;
  if (threads_ > 0) wanted.overrides.push_back(cat("train.n_threads=", threads_));
  // Behind the share of the cores: what is set later counts, and a trial may set its threads itself.
  for (const std::string& assignment : assignments_of(settings(run.trial))) wanted.overrides.push_back(assignment);
  wanted.overrides.push_back(cat("seed=", run.seed));
  const auto rung = static_cast<size_t>(run.rung);
  if (rung + 1 < rungs_.size()) wanted.stop_at = rungs_[rung];
  return wanted;
}

fs::path SweepFolder::log_of(const SweepRun& run) const {
  return path_ / "logs" / (trial_folder(path_, run.trial, run.seed).filename().string() + ".txt");
}

void SweepFolder::write_outcome(const SweepOutcome& outcome) const {
  write_file(path_ / "trials.csv", outcome_csv(outcome));
  write_file(path_ / "sweep.json", json_text(outcome_json(outcome)) + "\n");
  // The page has the curves of the best trials as any report has them.
  std::vector<fs::path> runs;
  constexpr size_t kTrialsShown = 4;
  for (size_t k = 0; k < std::min(kTrialsShown, outcome.trials.size()); ++k)
    for (const std::string& run : outcome.trials[k].folders)
      if (agent_steps_of_run(run) > 0) runs.emplace_back(run);
  if (!runs.empty()) write_report(runs, path_ / "report.html", list_fields<RunConfig>(), outcome_section(outcome));
}

}  // namespace giga
