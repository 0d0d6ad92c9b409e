// Tables from the configs and from run.json.
#include "report/tables.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <set>

#include "config/names.hpp"
#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

void add_new(std::vector<std::string>& words, const std::string& word) {
  if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
}

Settings info_of(const RunData& run) { return flatten(run.info, plain_text); }

std::string info(const RunData& run, const char* key, const char* otherwise = "-") {
  const std::string value = setting(info_of(run), key);
  return value.empty() ? otherwise : value;
}

/// Different values of a config key over the runs of a group.
std::string values_of(const RunGroup& group, const std::string& path) {
  std::vector<std::string> values;
  for (const RunData* run : group.runs) add_new(values, setting(flatten(run->config, plain_text), path));
  return join(values);
}

double steps_done(const RunData& run) { return run.metrics.find("agent_steps")->back(); }
double seconds_spent(const RunData& run) { return run.metrics.find("seconds")->back(); }

/// Updates alone, by which metrics.csv and the charts tell the speed; nothing where their seconds were not kept. Rows
/// of metrics.csv may have been lost: what is counted is in those that are there.
struct Updates {
  double steps = 0, seconds = 0;
};
Updates updates_of(const RunData& run) {
  Updates sum;
  const std::vector<double>*seconds = run.metrics.find("update_seconds"),
        *rates = run.metrics.find("agent_steps_per_second");
  for (size_t row = 0; seconds && rates && row < seconds->size(); ++row) {
    const double steps = (*rates)[row] * (*seconds)[row];
    if (!std::isfinite(steps)) continue;
    sum.steps += steps;
    sum.seconds += (*seconds)[row];
  }
  return sum;
}

/// Agent-steps that the config asks for.
double steps_wanted(const RunData& run) {
  return std::strtod(setting(flatten(run.config), "train.total_agent_steps").c_str(), nullptr);
}

std::string progress_of(const RunData& run) {
  const std::string done = print_short(steps_done(run));
  return steps_done(run) >= steps_wanted(run) ? done : done + " of " + print_short(steps_wanted(run));
}

std::vector<const RunData*> all_runs(const std::vector<RunGroup>& groups) {
  std::vector<const RunData*> runs;
  for (const RunGroup& group : groups) runs.insert(runs.end(), group.runs.begin(), group.runs.end());
  return runs;
}

/// A default as values_of gives it, so that the two can be compared as texts.
std::string normal_text(const std::string& yaml) {
  if (yaml.empty()) return "";
  Errors errors;
  const Document document = parse_yaml_text(yaml, "default", errors);
  return errors.empty() ? plain_text(document.root) : yaml;
}

std::string bytes_text(const std::string& key, const std::string& value) {
  if (!key.ends_with("memory_bytes")) return value;
  constexpr double kGiB = 1024.0 * 1024 * 1024;
  return cat(std::lround(std::strtod(value.c_str(), nullptr) / kGiB), " GiB");
}

/// run.json without what is each run's own.
Settings machine_of(const RunData& run) {
  static const std::set<std::string> own = {"scenario", "algorithm",    "seed",
                                            "started",  "command_line", "restored_from"};
  Settings facts = info_of(run);
  std::erase_if(facts, [](const auto& fact) { return own.contains(fact.first); });
  for (auto& [key, value] : facts) {
    value = bytes_text(key, value);
    if (key.ends_with("memory_bytes")) key.resize(key.size() - std::string("_bytes").size());
  }
  return facts;
}

}  // namespace

void write_table(Markup& page, const std::string& caption, const TableRow& head, const std::vector<TableRow>& rows,
                 bool folded) {
  const auto card = page.open(folded ? "details" : "div", {{"class", folded ? "card folded" : "card scroll"}});
  if (folded) page.element("summary", caption);
  const auto frame = page.open("div", {{"class", folded ? "scroll" : ""}});
  const auto table = page.open("table");
  if (!folded && !caption.empty()) page.element("caption", caption);
  {
    const auto top = page.open("thead");
    const auto line = page.open("tr");
    for (const std::string& name : head) page.element("th", name);
  }
  // Of a table that has them: the column of the defaults, before which the values stand out that are others.
  const auto default_at = static_cast<size_t>(std::find(head.begin(), head.end(), "default") - head.begin());
  const auto body = page.open("tbody");
  for (const TableRow& row : rows) {
    const auto line = page.open("tr");
    for (size_t k = 0; k < row.size(); ++k) {
      const bool own = default_at < head.size() && k > 0 && k < default_at && row[k] != row[default_at];
      page.element("td", row[k], {{"class", own ? "own" : head[k] == "meaning" ? "meaning" : ""}});
    }
  }
}

std::string title_of(const RunGroup& group) {
  return group.letter.empty() ? group.label : group.letter + ": " + group.label;
}

std::vector<std::pair<std::string, std::string>> run_facts(const RunGroup& group) {
  std::vector<std::string> seeds, progress, devices, versions;
  double seconds = 0;
  Updates updates;
  for (const RunData* run : group.runs) {
    seeds.push_back(info(*run, "seed"));
    add_new(progress, progress_of(*run));
    const std::string gpu = info(*run, "hardware.gpu.name", "");
    add_new(devices, gpu.empty() ? info(*run, "hardware.cpu") : gpu);
    add_new(versions, info(*run, "versions.gigastep"));
    seconds += seconds_spent(*run);
    const Updates own = updates_of(*run);
    updates.steps += own.steps;
    updates.seconds += own.seconds;
  }
  const size_t n = group.runs.size();
  std::vector<std::pair<std::string, std::string>> facts;
  const auto add = [&facts](const std::string& name, const std::string& value) { facts.emplace_back(name, value); };
  add("algorithm", info(*group.runs.front(), "algorithm"));
  add(n > 1 ? "seeds" : "seed", join(seeds));
  add(n > 1 ? "agent-steps per run" : "agent-steps", join(progress));
  add(n > 1 ? "time per run" : "time", print_duration(seconds / static_cast<double>(n)));
  add("agent-steps per second", updates.seconds > 0 ? print_short(updates.steps / updates.seconds) : "-");
  add("ran on", join(devices));
  add("gigastep", join(versions));
  return facts;
}

void write_config(Markup& page, const std::vector<RunGroup>& groups, const std::vector<FieldInfo>& keys) {
  std::map<std::string, const FieldInfo*> known;
  for (const FieldInfo& key : keys) known[key.path] = &key;
  std::vector<std::string> paths;
  std::set<std::string> seen;
  for (const RunData* run : all_runs(groups))
    for (const auto& [path, value] : flatten(run->config))
      if (seen.insert(path).second) paths.push_back(path);

  TableRow head = {"key"};
  for (const RunGroup& group : groups) head.push_back(group.letter.empty() ? "value" : group.letter);
  head.insert(head.end(), {"default", "meaning"});
  std::vector<TableRow> all, changed;
  for (const std::string& path : paths) {
    const FieldInfo* key = known.contains(path) ? known[path] : nullptr;
    const std::string default_value = key ? normal_text(key->default_value) : "";
    TableRow row = {path};
    for (const RunGroup& group : groups) row.push_back(values_of(group, path));
    const bool is_default =
        std::all_of(row.begin() + 1, row.end(), [&](const auto& value) { return value == default_value; });
    row.insert(row.end(), {default_value, key ? key->doc : ""});
    if (!is_default) changed.push_back(row);
    all.push_back(std::move(row));
  }

  if (groups.size() > 1) {
    TableRow labels = {"key"};
    for (const RunGroup& group : groups) labels.push_back(group.letter);
    std::vector<TableRow> differing;
    for (const auto& [path, values] : differing_settings(groups)) {
      TableRow row = {path};
      for (const std::string& value : values) row.push_back(value.empty() ? "-" : value);
      differing.push_back(std::move(row));
    }
    write_table(page, "What differs", labels, differing);
  }
  write_table(page, "Changed from the defaults", head, changed);
  write_table(page, cat("All ", all.size(), " keys"), head, all, true);
}

void write_runs(Markup& page, const std::vector<RunGroup>& groups) {
  std::vector<TableRow> rows;
  for (const RunGroup& group : groups)
    for (const RunData* run : group.runs)
      rows.push_back({run->name, title_of(group), info(*run, "seed"), info(*run, "started"), cat(run->metrics.rows()),
                      progress_of(*run), print_duration(seconds_spent(*run))});
  write_table(page, "", {"run", "configuration", "seed", "started", "updates", "agent-steps", "time"}, rows);
}

void write_machines(Markup& page, const std::vector<RunGroup>& groups) {
  // A column for all runs that say the same.
  std::vector<Settings> machines;
  std::vector<std::vector<std::string>> names;
  std::vector<std::string> keys;
  for (const RunData* run : all_runs(groups)) {
    const Settings facts = machine_of(*run);
    for (const auto& [key, value] : facts) add_new(keys, key);
    const auto at = std::find(machines.begin(), machines.end(), facts);
    if (at == machines.end()) {
      machines.push_back(facts);
      names.push_back({run->name});
    } else {
      names[static_cast<size_t>(at - machines.begin())].push_back(run->name);
    }
  }
  TableRow head = {""};
  for (const std::vector<std::string>& runs : names) head.push_back(machines.size() > 1 ? join(runs) : "all runs");
  std::vector<TableRow> rows;
  for (const std::string& key : keys) {
    TableRow row = {key};
    for (const Settings& facts : machines) row.push_back(setting(facts, key));
    rows.push_back(std::move(row));
  }
  write_table(page, "", head, rows);
}

void write_commands(Markup& page, const std::vector<RunGroup>& groups) {
  const auto write = [&page](const Node& info) {
    const Node* words = info.find("command_line");
    if (!words || !words->is_sequence()) return;
    std::string line;
    for (const Node& word : words->items) line += (line.empty() ? "" : " ") + shell_word(word.text);
    page.element("pre", line, {{"class", "card"}});
  };
  for (const RunData* run : all_runs(groups)) {
    write(run->info);
    for (const Node& resume : run->resumes) write(resume);
  }
}

}  // namespace giga
