// Which columns of metrics.csv stand in which chart of a report.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace giga {

/// A line of a chart, once per group of runs.
struct ChartSeries {
  std::string label, column;
  int team = -1;  ///< colours the line; -1 = of no team
};

struct Chart {
  std::string title, note;                         ///< the note says unit and meaning
  std::optional<std::pair<double, double>> range;  ///< of the y axis, where it is known
  std::vector<ChartSeries> series;
};

struct ChartSection {
  std::string title, note;
  bool folded = false;  ///< opened by the reader
  std::vector<Chart> charts;
};

/// A column that has values.
struct ColumnFacts {
  std::string name;
  bool all_zero = false;
};

/// The opponent in a column win_rate_T_vs_OPPONENT; nothing for other columns.
std::optional<std::string> opponent_of(const std::string& column);

/// A place for every column: a column that no chart is made for gets one among the further figures, so that a new
/// figure shows without a change here; those that are always 0 are told in words.
std::vector<ChartSection> choose_charts(const std::vector<ColumnFacts>& columns);

}  // namespace giga
