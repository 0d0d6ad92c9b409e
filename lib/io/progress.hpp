// Progress: how far a run is. On a terminal one line that is drawn anew, elsewhere a plain line now and then.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "io/logger.hpp"

namespace giga {

struct ProgressState {
  int64_t update = 0, n_updates = 0;
  int64_t agent_steps = 0, total_agent_steps = 0;
  double seconds = 0;                 ///< since the start
  double agent_steps_per_second = 0;  ///< recently
  /// By opponent, as text: {"random", "0.98/0.97"} for team 0 and team 1.
  std::vector<std::pair<std::string, std::string>> win_rates;
};

/// Seconds until the end at the mean speed so far; NaN where not known.
double seconds_left(const ProgressState& state);

/// One line of at most `width` columns (ASCII): bar, share, agent-steps, speed, time left, figures.
std::string progress_bar(const ProgressState& state, int width);
/// The same in words, for files.
std::string progress_text(const ProgressState& state);

class Progress {
 public:
  enum class Mode : uint8_t { terminal, lines, off };

  /// Plain lines go through the logger, at most one each `cadence`; with a terminal or off, to the log's file alone.
  Progress(Logger& log, Mode mode, std::chrono::duration<double> cadence = std::chrono::seconds(10));
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void show(const ProgressState& state);
  /// Leaves the line; what is printed next stands below it.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;

  Logger& log_;
  Mode mode_;
  Clock::duration cadence_;
  Clock::time_point next_text_, next_draw_;
  std::string last_line_;
};

/// The mode that fits stderr.
Progress::Mode progress_mode(bool quiet);

}  // namespace giga
