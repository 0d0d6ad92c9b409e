// Progress: how far a run is. On a terminal a panel that is drawn anew in place, elsewhere a plain line now and then.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/logger.hpp"
#include "io/terminal/line.hpp"

namespace giga {

/// A figure of the learner.
struct TeamFigure {
  std::string label;
  std::string short_label;  ///< of the narrow panel; empty: not shown there
  double value = 0;
};

/// Figures of one team; NaN is shown as "-".
struct TeamProgress {
  bool learns = false;
  double mean_return = kUnknown;                          ///< of the episodes that ended in the latest update
  std::vector<std::pair<std::string, double>> win_rates;  ///< by opponent, of the latest evaluation
  std::vector<TeamFigure> figures;                        ///< the same of both teams

  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
};

/// Seconds of the whole run so far, in this process. A growing `evaluation` also says that an evaluation took place.
struct TimeSplit {
  double rollout = 0, update = 0, evaluation = 0, rest = 0;
};

struct ProgressState {
  std::string title;                               ///< "identical_5_vs_5, mappo, seed 1, cuda:0 (NVIDIA H200)"
  std::string folder;                              ///< of the run
  int64_t update = 0, n_updates = 0;               ///< n 0: not known beforehand
  int64_t agent_steps = 0, total_agent_steps = 0;  ///< where the run is complete
  double seconds = 0;                 ///< since the start of the run, earlier processes of a resumed run included
  double agent_steps_per_second = 0;  ///< recently
  double seconds_left = TeamProgress::kUnknown;  ///< estimate
  TimeSplit time;
  std::array<TeamProgress, 2> team;
  int64_t memory_used = 0, memory_total = 0;        ///< bytes of the GPU; 0 = no GPU
  double gpu_temperature = TeamProgress::kUnknown;  ///< degrees Celsius
};

/// Share of the run that is done, 0 to 1.
double share_done(const ProgressState& state);

/// "150M of 300M" agent-steps; only what is done where the total is not known.
std::string steps_done(const ProgressState& state);

/// "12 of 50" updates, or "12".
std::string updates_done(const ProgressState& state);

/// The names of the opponents that either team was evaluated against, in order of appearance.
std::vector<std::string> opponents_of(const ProgressState& state);

/// Team `team` against `opponent` in the latest evaluation; NaN where they did not meet.
double win_rate(const ProgressState& state, int team, const std::string& opponent);

/// One line for files.
std::string progress_text(const ProgressState& state);

class PanelHistory;

class Progress {
 public:
  enum class Mode : uint8_t {
    terminal,  ///< the panel on stderr; plain lines in the log's file
    lines,     ///< plain lines on stderr and in the log's file
    off,       ///< plain lines in the log's file alone
  };

  /// At most one plain line each `cadence`, and the last.
  Progress(Logger& log, Mode mode, std::chrono::duration<double> cadence = std::chrono::seconds(10),
           TerminalStyle style = terminal_style());
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// May be called whenever something is new: the panel is drawn at most every 100 ms.
  void show(const ProgressState& state);
  /// What goes on before the first state is there: a line that is drawn anew on a terminal, else a plain line at times.
  void wait_line(const std::string& text);
  /// Draws the latest state and leaves it on the terminal; what is printed next stands below it.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;
  void draw();

  Logger& log_;
  Mode mode_;
  Clock::duration cadence_;
  TerminalStyle style_;
  Clock::time_point next_text_, next_draw_;
  std::optional<ProgressState> latest_;
  std::unique_ptr<PanelHistory> history_;  // null where there is nothing to draw (any more)
};

/// The mode that fits stderr.
Progress::Mode progress_mode(bool quiet);

}  // namespace giga
