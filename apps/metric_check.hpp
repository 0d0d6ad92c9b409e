// MetricCheck: whether the runs of a sweep log what it compares.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "learn/run_config.hpp"
#include "sweep/space.hpp"

namespace giga {

/// The columns of metrics.csv, from an update of the smallest run of this kind; on the CPU, so that this process holds
/// nothing of a GPU while trials train there.
std::vector<std::string> metric_columns(LoadedRun run);

/// Whether runs log the columns of a metric. A learner tells its columns by an update of a small run, which is done
/// once for settings of one kind.
class MetricCheck {
 public:
  explicit MetricCheck(std::vector<std::string> metric) : metric_(std::move(metric)) {}
  /// The first column of the metric that a run with these settings would not log; empty: it logs all.
  std::string missing_in(const LoadedRun& run, const TrialSettings& settings);

 private:
  std::vector<std::string> metric_;
  std::map<std::string, std::vector<std::string>> known_;  // all columns, by the kind of settings
};

}  // namespace giga
