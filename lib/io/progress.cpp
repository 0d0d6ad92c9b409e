// How progress looks on a terminal and in a log.
#include "io/progress.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "io/number.hpp"

namespace giga {
namespace {

constexpr std::chrono::milliseconds kDrawEvery{100};
constexpr int kBarWidth = 16;

double share_done(const ProgressState& s) {
  if (s.total_agent_steps <= 0) return 0;
  return std::min(1.0, static_cast<double>(s.agent_steps) / static_cast<double>(s.total_agent_steps));
}

int terminal_width() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

/// What bar and text have in common; `unit` stands behind the counts.
std::string figures(const ProgressState& s, const std::string& unit) {
  std::string text = print_short(static_cast<double>(s.agent_steps)) + " of " +
                     print_short(static_cast<double>(s.total_agent_steps)) + unit + ", " +
                     print_short(s.agent_steps_per_second) + "/s, " + print_duration(seconds_left(s)) + " left";
  if (!s.win_rates.empty()) text += ", wins vs";
  for (const auto& [opponent, rate] : s.win_rates) text += " " + opponent + " " + rate;
  return text;
}

}  // namespace

double seconds_left(const ProgressState& s) {
  const double done = share_done(s);
  return done > 0 ? s.seconds * (1 - done) / done : std::numeric_limits<double>::quiet_NaN();
}

std::string progress_bar(const ProgressState& s, int width) {
  const double done = share_done(s);
  const auto filled = static_cast<size_t>(done * kBarWidth);
  char percent[16];
  std::snprintf(percent, sizeof percent, "%3d%% ", static_cast<int>(done * 100));
  std::string line = percent;
  if (width >= 60) line += '[' + std::string(filled, '=') + std::string(kBarWidth - filled, ' ') + "] ";
  line += figures(s, "");
  if (width > 0 && line.size() > static_cast<size_t>(width)) line.resize(static_cast<size_t>(width));
  return line;
}

std::string progress_text(const ProgressState& s) {
  return "update " + std::to_string(s.update) + " of " + std::to_string(s.n_updates) + ": " +
         figures(s, " agent-steps");
}

Progress::Progress(Logger& log, Mode mode, std::chrono::duration<double> cadence)
    : log_(log), mode_(mode), cadence_(std::chrono::duration_cast<Clock::duration>(cadence)) {}
Progress::~Progress() { finish(); }

void Progress::show(const ProgressState& state) {
  const Clock::time_point now = Clock::now();
  const bool last = state.update >= state.n_updates;
  if (now >= next_text_ || last) {
    const std::string text = progress_text(state);
    mode_ == Mode::lines ? log_.info(text) : log_.note(text);
    next_text_ = now + cadence_;
  }
  if (mode_ == Mode::terminal && (now >= next_draw_ || last)) {
    last_line_ = progress_bar(state, terminal_width() - 1);
    std::fprintf(stderr, "\r\x1b[K%s", last_line_.c_str());
    std::fflush(stderr);
    next_draw_ = now + kDrawEvery;
  }
}

void Progress::finish() {
  if (!last_line_.empty()) std::fputc('\n', stderr);
  last_line_.clear();
}

Progress::Mode progress_mode(bool quiet) {
  if (quiet) return Progress::Mode::off;
  return stderr_is_terminal() ? Progress::Mode::terminal : Progress::Mode::lines;
}

}  // namespace giga
