// The panel of a sweep: which runs go on and how far they are, what is done, what is best.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/terminal/line.hpp"
#include "io/terminal/live_lines.hpp"
#include "sweep/progress.hpp"

namespace giga {

struct SweepPanelState {
  /// A run that goes on.
  struct Run {
    int trial = 0;
    uint64_t seed = 0;
    double agent_steps = 0, wanted_agent_steps = 1;  ///< so far, and where it stops
    std::optional<double> metric;                    ///< so far
  };
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

  std::string title;         ///< "sweep rates: sobol, 16 trials with 3 seeds"
  std::string metric;        ///< "maximize win_rate_0_vs_circle"
  std::string folder;        ///< of the sweep
  double share_done = 0;     ///< 0 to 1, of the agent-steps
  int trials = 0, done = 0;  ///< a trial is done once it was compared, with halving for the first time
  int failed_runs = 0;
  std::vector<std::pair<double, int>> rungs;    ///< agent-steps with the trials that came there; shown from two on
  std::string runs_at_once;                     ///< "2" or "2 (auto)"
  double seconds = 0, seconds_left = kUnknown;  ///< of this call; an estimate
  double agent_steps_per_second = 0;            ///< of all runs together
  std::optional<std::pair<int, double>> best;   ///< trial and value
  std::vector<Run> runs;
};

/// What the spec and the results say: all but the folder, the shares and times, and the runs that go on.
SweepPanelState panel_state_of(const std::string& name, const SweepSpec& spec, const SweepProgress& progress,
                               const std::vector<int64_t>& rungs);

/// All lines are narrower than the terminal and fewer than its rows: from 60 columns on the whole panel, from 30 on
/// without speed, times and folder; where the terminal is low without empty lines, then with fewer of the runs; one
/// line where there is no room for that.
std::vector<Line> sweep_panel(const SweepPanelState& state, TerminalSize size, TerminalStyle style);

}  // namespace giga
