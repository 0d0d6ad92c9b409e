// Curves: runs that differ only in their seed become one curve with a mean and a band, thinned to what a page can hold.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "report/run_data.hpp"

namespace giga {

/// A column of metrics.csv along the points of its group. NaN = no value.
struct Curve {
  std::string name;
  /// Of the values that a point stands for, those of all runs and of `rows_per_point` updates.
  std::vector<double> mean, low, high;
};

/// Runs of one config. What differs is the seed and what has no part in what is learned (device, threads, where it
/// pauses, checkpoints).
struct RunGroup {
  std::vector<const RunData*> runs;
  std::string letter;         ///< "A", "B", ...; "" if there is but one group
  std::string label;          ///< what tells it from the other groups: "gamma=0.99"; the scenario, if there is but one
  size_t rows_per_point = 1;  ///< updates that a point stands for
  // Where the points are: the last update of each, and there the mean over the runs.
  std::vector<double> agent_steps, seconds;
  std::vector<Curve> curves;  ///< all other columns that have a finite value

  /// The label, cut where it is long.
  std::string short_label() const;
  const Curve* find(const std::string& name) const;
  /// Whether a point stands for more than one value.
  bool has_band() const { return runs.size() > 1 || rows_per_point > 1; }
};

/// Groups by the settings in which they differ, numbers by their size. The runs must outlive them. A curve has at most
/// `max_points` points (>= 1); columns without a finite value have none.
std::vector<RunGroup> group_runs(const std::vector<RunData>& runs, size_t max_points);

/// The points per curve that keep a page of these runs at a few megabytes: 2000, or fewer for many runs and columns.
size_t points_for(const std::vector<RunData>& runs);

/// A setting in which groups differ whose algorithms read it; "scenario.KEY" of a key of scenario.yaml.
struct DifferingSetting {
  std::string path;
  std::vector<std::string> values;  ///< by group; "" where its algorithm does not read it
};
/// In the order of the config, the algorithm first.
std::vector<DifferingSetting> differing_settings(const std::vector<RunGroup>& groups);

}  // namespace giga
