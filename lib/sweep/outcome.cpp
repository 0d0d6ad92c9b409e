#include "sweep/outcome.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "core/error.hpp"
#include "io/files.hpp"
#include "report/run_data.hpp"
#include "sweep/analysis.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr size_t kCurves = 5;

/// The worst of some columns' values: what counts of several.
double worst_of(const SweepSpec& spec, const std::vector<double>& values) {
  return spec.goal == SweepGoal::maximize ? *std::min_element(values.begin(), values.end())
                                          : *std::max_element(values.begin(), values.end());
}

std::vector<const std::vector<double>*> metric_columns(const SweepSpec& spec, const MetricsTable& table,
                                                       const std::string& file) {
  std::vector<const std::vector<double>*> columns;
  for (const std::string& name : spec.metric) {
    columns.push_back(table.find(name));
    if (!columns.back()) throw InputError(cat(file, " has no column ", name));
  }
  return columns;
}

/// Agent-steps and metric by update, where all columns are known.
std::map<double, std::pair<double, double>> metric_points(const SweepSpec& spec, const MetricsTable& table,
                                                          const std::string& file) {
  const std::vector<const std::vector<double>*> columns = metric_columns(spec, table, file);
  std::map<double, std::pair<double, double>> points;
  for (size_t row = 0; row < table.rows(); ++row) {
    std::vector<double> values;
    for (const auto* column : columns) values.push_back((*column)[row]);
    if (std::none_of(values.begin(), values.end(), [](double v) { return std::isnan(v); }))
      points[(*table.find("update"))[row]] = {(*table.find("agent_steps"))[row], worst_of(spec, values)};
  }
  return points;
}

std::optional<SweepOutcome::Curve> curve_of(const SweepSpec& spec, const SweepOutcome::Trial& trial) {
  std::vector<std::map<double, std::pair<double, double>>> runs;
  for (const std::string& folder : trial.folders) {
    const std::string file = (fs::path(folder) / "metrics.csv").string();
    std::error_code code;
    if (!fs::exists(file, code)) continue;
    runs.push_back(metric_points(spec, parse_metrics(read_file(file), file), file));
  }
  if (runs.empty()) return std::nullopt;
  SweepOutcome::Curve curve{trial.number, {}, {}, {}, {}};
  for (const auto& [update, first] : runs.front()) {  // those that all know
    std::vector<double> steps, values;
    for (const auto& run : runs) {
      const auto point = run.find(update);
      if (point == run.end()) break;
      steps.push_back(point->second.first);
      values.push_back(point->second.second);
    }
    if (values.size() < runs.size()) continue;
    const Interval band = bootstrap_interval(values);
    curve.agent_steps.push_back(mean_of(steps));
    curve.middle.push_back(interquartile_mean(values));
    curve.low.push_back(band.lo);
    curve.high.push_back(band.hi);
  }
  return curve;
}

std::string value_of_key(const TrialSettings& settings, const std::string& key) {
  for (const auto& [name, value] : settings)
    if (name == key) return value;
  return "";
}

std::vector<SweepOutcome::Parameter> explain(const SweepSpec& spec, const std::vector<TrialSettings>& trials,
                                             const SweepProgress& progress, int& compared) {
  std::vector<double> values;
  std::vector<size_t> there;
  for (size_t k = 0; k < trials.size(); ++k) {
    const std::optional<double> value = progress.value(static_cast<int>(k), 0);
    if (!value) continue;
    values.push_back(*value);
    there.push_back(k);
  }
  compared = static_cast<int>(values.size());
  std::vector<SweepOutcome::Parameter> parameters;
  for (const auto& [key, parameter] : spec.parameters) {
    std::vector<std::string> setting;
    std::vector<double> own;  // values of the trials that set it: one that was told need not
    for (size_t k = 0; k < there.size(); ++k) {
      const std::string value = value_of_key(trials[there[k]], key);
      if (value.empty()) continue;
      setting.push_back(value);
      own.push_back(values[k]);
    }
    if (own.empty()) {
      parameters.push_back({key, std::nan(""), std::nan("")});
      continue;
    }
    parameters.push_back({key, explained_share(groups_of(setting), own), rank_correlation(setting, own)});
  }
  std::stable_sort(parameters.begin(), parameters.end(), [](auto& a, auto& b) {
    return (std::isnan(a.share) ? -1 : a.share) > (std::isnan(b.share) ? -1 : b.share);
  });
  return parameters;
}

}  // namespace

fs::path trial_folder(const fs::path& sweep, int trial, uint64_t seed) {
  char number[16];
  std::snprintf(number, sizeof number, "%03d", trial);
  return sweep / "trials" / cat(number, "-seed", seed);
}

std::optional<double> metric_of_values(const SweepSpec& spec, const std::vector<std::vector<double>>& known) {
  std::vector<double> values;
  for (const std::vector<double>& column : known) {
    if (column.empty()) return std::nullopt;
    const auto n = std::min(static_cast<std::ptrdiff_t>(column.size()), static_cast<std::ptrdiff_t>(spec.last_values));
    values.push_back(mean_of({column.end() - n, column.end()}));
  }
  return worst_of(spec, values);
}

namespace {

/// Rows up to the first with `stop` agent-steps.
std::ptrdiff_t rows_up_to(const MetricsTable& table, std::optional<int64_t> stop) {
  const std::vector<double>& steps = *table.find("agent_steps");
  const auto at =
      std::find_if(steps.begin(), steps.end(), [&](double n) { return stop && n >= static_cast<double>(*stop); });
  return std::min(at - steps.begin() + 1, std::ssize(steps));
}

}  // namespace

std::optional<double> metric_of_run(const SweepSpec& spec, const fs::path& run, std::optional<int64_t> stop) {
  const std::string file = (run / "metrics.csv").string();
  const MetricsTable table = parse_metrics(read_file(file), file);
  const std::ptrdiff_t rows = rows_up_to(table, stop);
  std::vector<std::vector<double>> known;
  for (const std::vector<double>* column : metric_columns(spec, table, file)) {
    known.emplace_back();
    std::copy_if(column->begin(), column->begin() + rows, std::back_inserter(known.back()),
                 [](double value) { return !std::isnan(value); });
  }
  return metric_of_values(spec, known);
}

namespace {

/// The last number of a column of its metrics; 0 where there is none yet.
double last_of(const fs::path& run, const char* column, std::optional<int64_t> stop) {
  const fs::path file = run / "metrics.csv";
  std::error_code code;
  if (!fs::exists(file, code)) return 0;
  const std::string text = read_file(file);
  if (std::count(text.begin(), text.end(), '\n') < 2) return 0;  // no row yet
  const MetricsTable table = parse_metrics(text, file.string());
  return table.find(column)->at(static_cast<size_t>(rows_up_to(table, stop) - 1));
}

}  // namespace

double agent_steps_of_run(const fs::path& run, std::optional<int64_t> stop) {
  return last_of(run, "agent_steps", stop);
}
double seconds_of_run(const fs::path& run, std::optional<int64_t> stop) { return last_of(run, "seconds", stop); }

SweepOutcome outcome_of(const SweepSpec& spec, const std::vector<TrialSettings>& trials, const SweepProgress& progress,
                        const fs::path& folder) {
  SweepOutcome outcome;
  outcome.spec = spec;
  for (const int number : progress.ranking()) {
    SweepOutcome::Trial trial;
    trial.number = number;
    trial.settings = trials.at(static_cast<size_t>(number));
    trial.rung = progress.reached(number);
    for (const uint64_t seed : spec.seeds) {
      trial.folders.push_back(trial_folder(folder, number, seed).string());
      for (int rung = 0; rung <= trial.rung; ++rung)
        if (const SweepResult* result = progress.result({number, rung, seed})) trial.seconds += result->seconds;
    }
    if (trial.rung >= 0) {
      trial.values = progress.values(number, trial.rung);
      trial.value = progress.value(number, trial.rung);
      for (const uint64_t seed : spec.seeds)
        if (const SweepResult* result = progress.result({number, trial.rung, seed}))
          trial.agent_steps = std::max(trial.agent_steps, result->agent_steps);
    }
    outcome.trials.push_back(std::move(trial));
  }
  outcome.parameters = explain(spec, trials, progress, outcome.compared);
  for (const SweepOutcome::Trial& trial : outcome.trials) {
    if (!trial.value || outcome.curves.size() == kCurves) continue;
    if (auto curve = curve_of(spec, trial)) outcome.curves.push_back(std::move(*curve));
  }
  return outcome;
}

}  // namespace giga
