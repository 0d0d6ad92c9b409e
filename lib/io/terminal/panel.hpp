// The panel of a run: its state and the course of its figures, laid out in lines for a terminal of some size.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "io/progress.hpp"
#include "io/terminal/line.hpp"
#include "io/terminal/live_lines.hpp"
#include "io/terminal/sparkline.hpp"

namespace giga {

/// What the sparklines show.
class PanelHistory {
 public:
  /// Returns count once per update, win rates once per evaluation: when its seconds have grown or a rate has changed.
  void add(const ProgressState& state);

  const Series& returns(int team) const { return returns_[team]; }
  /// Null for an opponent that the team has not met.
  const Series* win_rates(int team, const std::string& opponent) const;

 private:
  Series returns_[2];
  std::map<std::string, Series> win_rates_[2];
  int64_t update_ = 0;  // of the state before
  double evaluation_seconds_ = 0;
  std::vector<std::pair<std::string, double>> rates_[2];
};

/// All lines are narrower than the terminal and fewer than its rows:
/// from 60 columns on the whole panel, without its empty lines where the terminal is low; from 30 columns on fewer
/// figures and no sparklines; one line where the terminal is narrower still or not high enough.
std::vector<Line> panel(const ProgressState& state, const PanelHistory& history, TerminalSize size,
                        TerminalStyle style);

/// A figure in at most 9 columns with four or more significant digits: 0.0123, 12.34, 123456, 1.2e+07; "-" for NaN.
std::string print_figure(double value);

}  // namespace giga
