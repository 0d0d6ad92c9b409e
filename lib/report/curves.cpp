// Grouping and thinning.
#include "report/curves.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <system_error>

#include "config/names.hpp"
#include "core/error.hpp"
#include "learn/registry.hpp"

namespace giga {
namespace {

constexpr size_t kMostPoints = 2000, kFewestPoints = 200;
constexpr size_t kNumbersOnPage = 400'000;  // at about 8 bytes each
constexpr size_t kSettingsInLabel = 3;

constexpr const char* kAlgorithm = "train.algorithm";

/// What has a part in what is learned: nothing that the run's algorithm does not read.
Settings learning_settings(const Node& config, std::string (*print)(const Node&) = print_node) {
  Settings settings = flatten(config, print);
  const std::string algorithm = setting(settings, kAlgorithm);
  std::erase_if(settings, [&](const auto& entry) {
    return is_run_time_setting(entry.first) || !reads_setting(algorithm, entry.first);
  });
  return settings;
}

/// What `resume --set` changed on the way, as "mappo.gamma: 0.99 -> 0.999", as far as it has a part in what is learned.
std::vector<std::string> changes_on_the_way(const RunData& run) {
  std::vector<std::string> changes;
  for (const Node& resume : run.resumes)
    if (const Node* list = resume.find("changes"); list && list->is_sequence())
      for (const Node& change : list->items)
        if (!is_run_time_setting(change.text.substr(0, change.text.find(':')))) changes.push_back(change.text);
  return changes;
}

bool same_config(const RunData& a, const RunData& b) {
  return learning_settings(a.config) == learning_settings(b.config) &&
         game_settings(a.scenario) == game_settings(b.scenario) && changes_on_the_way(a) == changes_on_the_way(b);
}

/// Rows [begin, end) of a metrics file.
struct RowRange {
  size_t begin, end;
};

/// Mean, least and greatest of a column over some rows of all runs.
void add_point(Curve& curve, const std::vector<const RunData*>& runs, RowRange rows) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double sum = 0, low = kInfinity, high = -kInfinity;
  size_t count = 0;
  for (const RunData* run : runs) {
    const std::vector<double>* column = run->metrics.find(curve.name);
    if (!column) continue;
    for (size_t row = rows.begin; row < std::min(rows.end, column->size()); ++row) {
      const double value = (*column)[row];
      if (std::isnan(value)) continue;
      sum += value;
      low = std::min(low, value);
      high = std::max(high, value);
      ++count;
    }
  }
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  curve.mean.push_back(count ? sum / static_cast<double>(count) : kNone);
  curve.low.push_back(count ? low : kNone);
  curve.high.push_back(count ? high : kNone);
}

/// Mean of a column in a row over the runs that have come so far.
double mean_of(const std::vector<const RunData*>& runs, const std::string& column, size_t row) {
  double sum = 0;
  int count = 0;
  for (const RunData* run : runs) {
    if (row >= run->metrics.rows()) continue;
    sum += (*run->metrics.find(column))[row];
    ++count;
  }
  return sum / count;
}

const RunData& longest(const std::vector<const RunData*>& runs) {
  return **std::max_element(runs.begin(), runs.end(),
                            [](const RunData* a, const RunData* b) { return a->metrics.rows() < b->metrics.rows(); });
}

void make_curves(RunGroup& group, size_t max_points) {
  const size_t n_rows = longest(group.runs).metrics.rows();
  group.rows_per_point = (n_rows + max_points - 1) / max_points;
  std::vector<RowRange> points;
  for (size_t begin = 0; begin < n_rows; begin += group.rows_per_point)
    points.push_back({begin, std::min(begin + group.rows_per_point, n_rows)});

  double latest = 0, latest_steps = 0;  // a run that stopped early leaves the means, which must not run back
  for (const RowRange rows : points) {
    latest_steps = std::max(latest_steps, mean_of(group.runs, "agent_steps", rows.end - 1));
    group.agent_steps.push_back(latest_steps);
    latest = std::max(latest, mean_of(group.runs, "seconds", rows.end - 1));
    group.seconds.push_back(latest);
  }
  for (const RunData* run : group.runs) {
    for (const std::string& name : run->metrics.names) {
      if (name == "update" || name == "agent_steps" || name == "seconds" || group.find(name)) continue;
      Curve curve{name, {}, {}, {}};
      for (const RowRange rows : points) add_point(curve, group.runs, rows);
      const bool known = std::any_of(curve.mean.begin(), curve.mean.end(), [](double v) { return std::isfinite(v); });
      if (known) group.curves.push_back(std::move(curve));
    }
  }
}

/// Whether a key means something in a run of these settings.
bool reads(const Settings& settings, const std::string& key) {
  return reads_setting(setting(settings, kAlgorithm), key);
}

/// The keys in which any two differ that both read them, the algorithm before all others.
std::vector<std::string> differing_keys(const std::vector<Settings>& all) {
  std::vector<std::string> keys;
  std::set<std::string> seen;
  for (const Settings& settings : all) {
    for (const auto& [path, value] : settings) {
      if (!seen.insert(path).second) continue;
      const bool same = std::all_of(all.begin(), all.end(), [&, &key = path, &first = value](const Settings& other) {
        return !reads(other, key) || setting(other, key) == first;
      });
      if (!same) keys.push_back(path);
    }
  }
  std::stable_partition(keys.begin(), keys.end(), [](const std::string& key) { return key == kAlgorithm; });
  return keys;
}

/// What is compared of each group: its config and, where two groups have the same, what differs in their scenarios.
std::vector<Settings> distinguishing_settings(const std::vector<RunGroup>& groups) {
  std::vector<Settings> all, scenarios;
  for (const RunGroup& group : groups) {
    all.push_back(learning_settings(group.runs.front()->config, plain_text));
    scenarios.push_back(game_settings(group.runs.front()->scenario, plain_text));
    if (const auto changes = changes_on_the_way(*group.runs.front()); !changes.empty())
      all.back().emplace_back("resume", join(changes, "; "));
  }
  std::vector<std::string> keys;
  for (size_t g = 0; g < groups.size(); ++g)
    for (size_t h = 0; h < g; ++h) {
      if (all[g] != all[h]) continue;
      for (const SettingChange& change : compare_settings(scenarios[h], scenarios[g]))
        if (std::find(keys.begin(), keys.end(), change.path) == keys.end()) keys.push_back(change.path);
    }
  for (size_t g = 0; g < groups.size(); ++g)
    for (const std::string& key : keys) all[g].emplace_back("scenario." + key, setting(scenarios[g], key));
  return all;
}

std::string last_part(const std::string& path) { return path.substr(path.rfind('.') + 1); }

/// Of the keys that this group reads, as few as tell it apart from all others of its algorithm: again and again the one
/// that does so for most of those that are left.
std::set<std::string> telling_keys(const std::vector<Settings>& all, size_t group,
                                   const std::vector<std::string>& keys) {
  std::vector<const Settings*> left;
  for (size_t k = 0; k < all.size(); ++k)
    if (k != group && setting(all[k], kAlgorithm) == setting(all[group], kAlgorithm)) left.push_back(&all[k]);
  std::set<std::string> chosen;
  while (!left.empty()) {
    const auto differs_in = [&](const std::string& key) {
      const std::string own = setting(all[group], key);
      return [&key, own](const Settings* other) { return setting(*other, key) != own; };
    };
    const std::string* best = nullptr;
    int64_t most = 0;
    for (const std::string& key : keys) {
      const auto count = std::count_if(left.begin(), left.end(), differs_in(key));
      if (count > most) best = &key, most = count;
    }
    if (!best) break;  // groups that nothing tells apart are one group
    chosen.insert(*best);
    std::erase_if(left, differs_in(*best));
  }
  return chosen;
}

/// "gamma=0.99, horizon=32, clip_coef=0.2 and 4 more", "openai_es, sigma_init=0.02": no label is that of another group.
std::string label_of(const std::vector<Settings>& all, size_t group, std::vector<std::string> keys) {
  std::erase_if(keys, [&](const std::string& key) { return !reads(all[group], key); });
  const std::set<std::string> telling = telling_keys(all, group, keys);
  // Where not all are shown, what tells it apart stands first.
  const auto is_needed = [&](const std::string& key) { return key == kAlgorithm || telling.contains(key); };
  const auto needed = static_cast<size_t>(std::count_if(keys.begin(), keys.end(), is_needed));
  const size_t shown = std::min(keys.size(), std::max(kSettingsInLabel, needed));
  if (shown < keys.size()) std::stable_partition(keys.begin(), keys.end(), is_needed);
  std::string label;
  for (size_t k = 0; k < shown; ++k) {
    const std::string name = last_part(keys[k]), value = setting(all[group], keys[k]);
    const auto same_name =
        std::count_if(keys.begin(), keys.end(), [&](const auto& other) { return last_part(other) == name; });
    label += label.empty() ? "" : ", ";
    if (keys[k] != kAlgorithm) label += cat(same_name > 1 ? keys[k] : name, "=");
    label += value.empty() ? "-" : value;
  }
  if (keys.size() > shown) label += cat(" and ", keys.size() - shown, " more");
  return label;
}

/// Numbers by their size, before all else; texts by their letters.
bool is_below(const std::string& a, const std::string& b) {
  const auto number = [](const std::string& text, double& value) {
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    return code == std::errc() && end == text.data() + text.size();
  };
  double x = 0, y = 0;
  const bool first = number(a, x), second = number(b, y);
  if (first && second) return x < y;
  return first != second ? first : a < b;
}

/// By the settings in which they differ.
void sort_groups(std::vector<RunGroup>& groups) {
  const std::vector<Settings> settings = distinguishing_settings(groups);
  const std::vector<std::string> keys = differing_keys(settings);
  std::vector<size_t> order(groups.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    for (const std::string& key : keys) {
      const std::string x = setting(settings[a], key), y = setting(settings[b], key);
      if (is_below(x, y)) return true;
      if (is_below(y, x)) return false;
    }
    return false;
  });
  std::vector<RunGroup> sorted;
  for (const size_t k : order) sorted.push_back(std::move(groups[k]));
  groups = std::move(sorted);
}

void label_groups(std::vector<RunGroup>& groups) {
  if (groups.size() == 1) {
    groups[0].label = setting(flatten(groups[0].runs.front()->config, plain_text), "scenario");
    return;
  }
  sort_groups(groups);
  const std::vector<Settings> settings = distinguishing_settings(groups);
  const std::vector<std::string> keys = differing_keys(settings);
  for (size_t k = 0; k < groups.size(); ++k) {
    groups[k].letter = k < 26 ? std::string(1, static_cast<char>('A' + k)) : std::to_string(k + 1);
    groups[k].label = label_of(settings, k, keys);
  }
}

}  // namespace

std::string RunGroup::short_label() const {
  constexpr size_t kMost = 32;
  if (letter.empty() || label.size() <= kMost) return label;
  const size_t comma = label.rfind(", ", kMost - 2);  // whole settings, where one fits
  return cat(letter, ": ", label.substr(0, comma == std::string::npos ? kMost : comma + 2), "...");
}

const Curve* RunGroup::find(const std::string& name) const {
  const auto at = std::find_if(curves.begin(), curves.end(), [&](const Curve& curve) { return curve.name == name; });
  return at == curves.end() ? nullptr : &*at;
}

std::vector<RunGroup> group_runs(const std::vector<RunData>& runs, size_t max_points) {
  GIGA_CHECK(max_points > 0, "no points");
  std::vector<RunGroup> groups;
  for (const RunData& run : runs) {
    const auto group = std::find_if(groups.begin(), groups.end(),
                                    [&](const RunGroup& g) { return same_config(*g.runs.front(), run); });
    if (group == groups.end()) {
      groups.emplace_back().runs = {&run};
    } else {
      group->runs.push_back(&run);
    }
  }
  for (RunGroup& group : groups) make_curves(group, max_points);
  if (!groups.empty()) label_groups(groups);
  return groups;
}

size_t points_for(const std::vector<RunData>& runs) {
  size_t numbers = 1;  // of one point of all curves: mean, low and high
  for (const RunGroup& group : group_runs(runs, 1)) numbers += 3 * group.curves.size();
  return std::clamp(kNumbersOnPage / numbers, kFewestPoints, kMostPoints);
}

std::vector<DifferingSetting> differing_settings(const std::vector<RunGroup>& groups) {
  const std::vector<Settings> all = distinguishing_settings(groups);
  std::vector<DifferingSetting> differing;
  for (const std::string& path : differing_keys(all)) {
    differing.push_back({path, {}});
    for (const Settings& settings : all) differing.back().values.push_back(setting(settings, path));
  }
  return differing;
}

}  // namespace giga
