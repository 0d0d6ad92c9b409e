// Showing progress: when a line is written and when the panel is drawn.
#include "io/progress.hpp"

#include <algorithm>
#include <cmath>

#include "io/number.hpp"
#include "io/terminal/live_lines.hpp"
#include "io/terminal/panel.hpp"

namespace giga {
namespace {

constexpr std::chrono::milliseconds kDrawEvery{100};

/// "0.98/0.97" for teams 0 and 1, "0.98" where one team alone has a value.
template <class Print>
std::string of_teams(double team_0, double team_1, Print print) {
  if (std::isnan(team_1)) return print(team_0);
  return std::isnan(team_0) ? print(team_1) : print(team_0) + "/" + print(team_1);
}

}  // namespace

double share_done(const ProgressState& s) {
  const auto share = [](int64_t done, int64_t all) {
    return std::clamp(static_cast<double>(done) / static_cast<double>(all), 0.0, 1.0);
  };
  if (s.n_updates > 0) return share(s.update, s.n_updates);
  return s.total_agent_steps > 0 ? share(s.agent_steps, s.total_agent_steps) : 0;
}

std::vector<std::string> opponents_of(const ProgressState& s) {
  std::vector<std::string> names;
  for (const TeamProgress& team : s.team)
    for (const auto& [name, rate] : team.win_rates)
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  return names;
}

double win_rate(const ProgressState& s, int team, const std::string& opponent) {
  for (const auto& [name, rate] : s.team[team].win_rates)
    if (name == opponent) return rate;
  return TeamProgress::kUnknown;
}

std::string steps_done(const ProgressState& s) {
  const std::string done = print_short(static_cast<double>(s.agent_steps));
  return s.total_agent_steps > 0 ? done + " of " + print_short(static_cast<double>(s.total_agent_steps)) : done;
}

std::string updates_done(const ProgressState& s) {
  const std::string done = std::to_string(s.update);
  return s.n_updates > 0 ? done + " of " + std::to_string(s.n_updates) : done;
}

std::string progress_text(const ProgressState& s) {
  std::string text = "update " + updates_done(s) + ": " + steps_done(s) + " agent-steps, " +
                     print_short(s.agent_steps_per_second) + "/s, " + print_duration(s.seconds_left) + " left";
  const double returns[] = {s.team[0].mean_return, s.team[1].mean_return};
  if (!std::isnan(returns[0]) || !std::isnan(returns[1]))
    text += ", return " + of_teams(returns[0], returns[1], print_short);
  const std::vector<std::string> opponents = opponents_of(s);
  if (!opponents.empty()) text += ", wins vs";
  for (const std::string& name : opponents)
    text += " " + name + " " + of_teams(win_rate(s, 0, name), win_rate(s, 1, name), print_share);
  return text;
}

Progress::Progress(Logger& log, Mode mode, std::chrono::duration<double> cadence, TerminalStyle style)
    : log_(log), mode_(mode), cadence_(std::chrono::duration_cast<Clock::duration>(cadence)), style_(style) {
  if (mode == Mode::terminal) history_ = std::make_unique<PanelHistory>();
}
Progress::~Progress() { finish(); }

void Progress::show(const ProgressState& state) {
  const Clock::time_point now = Clock::now();
  const bool last = share_done(state) >= 1;
  if (now >= next_text_ || last) {
    const std::string text = progress_text(state);
    mode_ == Mode::lines ? log_.info(text) : log_.note(text);
    next_text_ = now + cadence_;
  }
  if (!history_) return;
  history_->add(state);
  latest_ = state;
  if (now < next_draw_ && !last) return;
  draw();
  next_draw_ = now + kDrawEvery;
}

void Progress::wait_line(const std::string& text) {
  const auto columns = static_cast<size_t>(log_.live().size().columns);
  if (history_) log_.live().show({Line().add(text.substr(0, columns - 1))}, style_);
  const Clock::time_point now = Clock::now();
  if (now < next_text_) return;
  mode_ == Mode::lines ? log_.info(text) : log_.note(text);
  next_text_ = now + cadence_;
}

void Progress::draw() { log_.live().show(panel(*latest_, *history_, log_.live().size(), style_), style_); }

void Progress::finish() {
  if (!history_) return;
  if (latest_) draw();
  log_.live().leave();
  history_.reset();
}

Progress::Mode progress_mode(bool quiet) {
  if (quiet) return Progress::Mode::off;
  return stderr_is_terminal() ? Progress::Mode::terminal : Progress::Mode::lines;
}

}  // namespace giga
