#include "apps/metric_check.hpp"

#include <algorithm>
#include <optional>

#include "apps/evaluation.hpp"
#include "apps/training.hpp"
#include "core/error.hpp"
#include "io/number.hpp"
#include "learn/registry.hpp"
#include "learn/team_policy.hpp"

namespace giga {
namespace {

/// The columns of evaluations that have values: those of a team that does not learn are empty.
std::vector<std::string> evaluation_columns(const RunConfig& config) {
  std::vector<std::string> names;
  for (const auto& [name, value] : evaluation_metrics(config, {})) {
    bool has_values = true;
    for (int team = 0; team < kNTeams; ++team)
      has_values = has_values && (learns(config.train, team) || name.find(cat("_", team, "_vs_")) == std::string::npos);
    if (has_values) names.push_back(name);
  }
  return names;
}

/// What of settings may decide which columns a learner has: choices that are no numbers, and of numbers whether they
/// are 0, which switches things off. An update for each of all trials would take long.
std::string kind_of_settings(const TrialSettings& settings) {
  std::string kind;
  for (const auto& [key, value] : settings) {
    const std::optional<double> number = plain_number(value);
    kind += cat(key, "=", !number ? value : *number == 0 ? "0" : "a number", "\n");
  }
  return kind;
}

}  // namespace

std::vector<std::string> metric_columns(LoadedRun run) {
  const Algorithm& algorithm = algorithm_of(run.config);
  const RunSize size = algorithm.size(run.config);
  constexpr int64_t kSmall = 64;
  const int64_t wanted = std::min(size.value, std::max(size.smallest, kSmall));
  algorithm.set_size(run.config, (wanted + size.step - 1) / size.step * size.step);
  algorithm.shorten(run.config);
  const auto learner = make_learner(run, Device{});
  std::vector<std::string> names = training_columns();
  for (const auto& [name, value] : learner->update()) names.push_back(name);
  for (const std::string& name : evaluation_columns(run.config)) names.push_back(name);
  return names;
}

std::string MetricCheck::missing_in(const LoadedRun& run, const TrialSettings& settings) {
  // Those against scripts follow from the config, which is quick.
  std::vector<std::string> names = training_columns();
  for (const std::string& name : evaluation_columns(run.config)) names.push_back(name);
  const auto first_missing = [&](const std::vector<std::string>& columns) {
    for (const std::string& name : metric_)
      if (std::find(columns.begin(), columns.end(), name) == columns.end() &&
          std::find(names.begin(), names.end(), name) == names.end())
        return name;
    return std::string();
  };
  if (first_missing({}).empty()) return "";
  const std::string kind = kind_of_settings(settings);
  if (!known_.contains(kind)) known_[kind] = metric_columns(run);
  return first_missing(known_[kind]);
}

}  // namespace giga
