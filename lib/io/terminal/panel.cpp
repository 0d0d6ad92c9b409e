// The layout of the panel: every figure keeps its place and its right edge, so that only digits change.
#include "io/terminal/panel.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "io/number.hpp"
#include "io/terminal/bar.hpp"

namespace giga {
namespace {

constexpr int kWholePanelFrom = 60, kPanelFrom = 30;  // columns of the terminal
constexpr int kMaxWidth = 100;                        // wider lines are hard to read
constexpr int kFigureWidth = 9;
constexpr int kMaxSparkWidth = 32;
constexpr Ink kTeamInk[] = {Ink::team_0, Ink::team_1};

std::string percent(double share) { return std::to_string(std::lround(share * 100)) + "%"; }
std::string percent_done(const ProgressState& s) { return print_percent_done(share_done(s)); }

std::string speed_of(const ProgressState& s) { return print_short(s.agent_steps_per_second) + "/s"; }

std::string gibibytes(int64_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", std::ldexp(static_cast<double>(bytes), -30));
  return text;
}

std::string degrees(double celsius, TerminalStyle style) {
  if (std::isnan(celsius)) return "-";
  return std::to_string(std::lround(celsius)) + (style.unicode ? " °C" : " C");
}

/// What all layouts share: the state, and where columns are.
class Layout {
 public:
  Layout(const ProgressState& s, const PanelHistory& history, int width, TerminalStyle style)
      : s_(s), history_(history), width_(width), style_(style), opponents_(opponents_of(s)) {}

  std::vector<Line> whole(bool spaced);
  std::vector<Line> narrow();
  Line one_line() const;

 private:
  void set_columns(int min_label, int max_label, const std::string& prefix);
  Line& line() { return lines_.emplace_back(); }
  Line& labelled(const std::string& label);
  void space(bool wanted) {
    if (wanted) line();
  }
  void head();
  void clock();
  void team_names();
  void returns_and_win_rates(const std::string& prefix, bool courses);
  void team_figures(const std::string& label, const double (&values)[2], const Series* const (&series)[2], bool rates);
  void spark(Line& to, int team, const Series& series, bool rates) const;
  void figures_of_learners(std::string TeamFigure::*label);
  void time_split();
  std::vector<Line> finished();

  const ProgressState& s_;
  const PanelHistory& history_;
  const int width_;
  const TerminalStyle style_;
  const std::vector<std::string> opponents_;
  std::vector<Line> lines_;
  int column_[3] = {0, 0, 0};  // where the values of team 0, those of team 1 begin, and where these end
};

/// Labels as wide as the longest win rate's needs, within bounds; the teams share the rest.
void Layout::set_columns(int min_label, int max_label, const std::string& prefix) {
  int label = min_label;
  for (const std::string& name : opponents_) label = std::max(label, columns_of(prefix + name) + 2);
  label = std::min(label, max_label);
  const int team = (width_ - label) / 2;
  column_[0] = label;
  column_[1] = label + team;
  column_[2] = label + 2 * team;
}

Line& Layout::labelled(const std::string& label) {
  Line& to = line();
  to.at(1).add(label, Ink::dim);
  to.clip(column_[0] - 1);
  return to.at(column_[0]);
}

void Layout::head() {
  line().at(1).add(s_.title, Ink::strong);
  Line& progress = line().at(1);
  add_bar(progress, share_done(s_), width_ - 7, style_);
  progress.add_right(percent_done(s_), width_);
}

void Layout::team_names() {
  Line& to = labelled("");
  for (int team = 0; team < 2; ++team) {
    to.at(column_[team]).add("team " + std::to_string(team), kTeamInk[team]);
    if (!s_.team[team].learns && width_ >= kWholePanelFrom - 1) to.add(" (fixed)", Ink::dim);
  }
}

void Layout::spark(Line& to, int team, const Series& series, bool rates) const {
  const int begin = column_[team] + kFigureWidth + 2, n = std::min(column_[team + 1] - 1 - begin, kMaxSparkWidth);
  if (n < 4) return;
  const std::vector<double> points = series.points(n);
  to.at(begin).add(rates ? sparkline(points, 0, 1, style_.unicode) : sparkline(points, style_.unicode), kTeamInk[team]);
}

/// One line with a figure of each team, and its course where `series` has one.
void Layout::team_figures(const std::string& label, const double (&values)[2], const Series* const (&series)[2],
                          bool rates) {
  Line& to = labelled(label);
  for (int team = 0; team < 2; ++team) {
    const std::string value = rates ? print_share(values[team]) : print_figure(values[team]);
    to.add_right(value, column_[team] + std::min(kFigureWidth, column_[1] - column_[0] - 1));
    if (series[team]) spark(to, team, *series[team], rates);
  }
}

void Layout::figures_of_learners(std::string TeamFigure::*label) {
  const std::vector<TeamFigure>&one = s_.team[0].figures, &two = s_.team[1].figures;
  for (size_t k = 0; k < one.size() && k < two.size(); ++k)
    if (!(one[k].*label).empty()) team_figures(one[k].*label, {one[k].value, two[k].value}, {nullptr, nullptr}, false);
}

void Layout::time_split() {
  const TimeSplit& t = s_.time;
  const double all = t.rollout + t.update + t.evaluation + t.rest;
  const bool roomy = width_ - column_[0] >= 56;
  Line& to = labelled("time");
  const std::pair<const char*, double> parts[] = {
      {"rollout", t.rollout}, {"update", t.update}, {roomy ? "evaluation" : "eval", t.evaluation}, {"rest", t.rest}};
  int column = column_[0];
  for (const auto& [name, seconds] : parts) {
    to.at(column).add(name, Ink::dim);
    column = to.width() + 4;
    to.add_right(all > 0 ? percent(seconds / all) : "-", column);
    column += roomy ? 3 : 1;
  }
}

std::vector<Line> Layout::finished() {
  for (Line& l : lines_) l.clip(width_);
  return std::move(lines_);
}

/// What the run has done; a second label and its value stand in the column of team 1.
void Layout::clock() {
  const auto second = [&](Line& to, const char* label, const std::string& value) {
    to.at(column_[1]).add(label, Ink::dim).at(column_[1] + 8).add(value);
  };
  second(labelled("agent-steps").add(steps_done(s_)), "speed", speed_of(s_));
  labelled("update").add(updates_done(s_));
  second(labelled("elapsed").add(print_duration(s_.seconds)), "left", print_duration(s_.seconds_left));
  time_split();
  if (s_.memory_total > 0)
    second(labelled("GPU memory").add(gibibytes(s_.memory_used) + " of " + gibibytes(s_.memory_total) + " GiB"),
           "temp.", degrees(s_.gpu_temperature, style_));
}

void Layout::returns_and_win_rates(const std::string& prefix, bool courses) {
  const auto series = [&](int team, const std::string& name) {
    return courses ? history_.win_rates(team, name) : nullptr;
  };
  team_figures("return", {s_.team[0].mean_return, s_.team[1].mean_return},
               {courses ? &history_.returns(0) : nullptr, courses ? &history_.returns(1) : nullptr}, false);
  for (const std::string& name : opponents_)
    team_figures(prefix + name, {win_rate(s_, 0, name), win_rate(s_, 1, name)}, {series(0, name), series(1, name)},
                 true);
}

std::vector<Line> Layout::whole(bool spaced) {
  set_columns(17, width_ / 3, "wins vs ");
  space(spaced);
  head();
  space(spaced);
  clock();
  space(spaced);
  team_names();
  returns_and_win_rates("wins vs ", true);
  figures_of_learners(&TeamFigure::label);
  space(spaced);
  labelled("results").add(s_.folder);
  return finished();
}

std::vector<Line> Layout::narrow() {
  const int label = width_ >= 40 ? 16 : 13;
  set_columns(label, label, "");
  head();
  labelled("agent-steps").add(steps_done(s_));
  labelled("speed").add(speed_of(s_));
  labelled("left").add(print_duration(s_.seconds_left));
  team_names();
  returns_and_win_rates("vs ", false);
  figures_of_learners(&TeamFigure::short_label);
  if (s_.memory_total > 0)
    labelled("GPU").add(gibibytes(s_.memory_used) + " GiB, " + degrees(s_.gpu_temperature, style_));
  return finished();
}

/// As many parts as there is room for, the most wanted first.
Line Layout::one_line() const {
  Line to;
  to.add_right(percent_done(s_), 5);
  if (width_ >= kWholePanelFrom - 1) add_bar(to.at(7), share_done(s_), 16, style_);
  to.at(to.width() + 2);
  for (const std::string& part : {print_duration(s_.seconds_left) + " left", speed_of(s_), steps_done(s_)}) {
    if (to.width() + 2 + columns_of(part) > width_) break;
    to.at(to.width() + 2).add(part);
  }
  to.clip(width_);
  return to;
}

}  // namespace

std::string print_figure(double value) {
  if (std::isnan(value)) return "-";
  const double size = std::abs(value);
  char text[32];
  if (size >= 999'999.5 || (size > 0 && size < 0.0005)) {
    std::snprintf(text, sizeof text, "%.1e", value);
  } else {
    const int decimals = size < 1 ? 4 : size < 10 ? 3 : size < 100 ? 2 : size < 1000 ? 1 : 0;
    std::snprintf(text, sizeof text, "%.*f", decimals, value);
  }
  return text;
}

void PanelHistory::add(const ProgressState& s) {
  const bool evaluated =
      s.time.evaluation > evaluation_seconds_ || s.team[0].win_rates != rates_[0] || s.team[1].win_rates != rates_[1];
  for (int team = 0; team < 2; ++team) {
    if (s.update > update_) returns_[team].add(s.team[team].mean_return);
    if (evaluated)
      for (const auto& [name, rate] : s.team[team].win_rates) win_rates_[team][name].add(rate);
    rates_[team] = s.team[team].win_rates;
  }
  update_ = s.update;
  evaluation_seconds_ = s.time.evaluation;
}

const Series* PanelHistory::win_rates(int team, const std::string& opponent) const {
  const auto found = win_rates_[team].find(opponent);
  return found == win_rates_[team].end() ? nullptr : &found->second;
}

std::vector<Line> panel(const ProgressState& state, const PanelHistory& history, TerminalSize size,
                        TerminalStyle style) {
  // A character in the last column leaves the cursor there, waiting to wrap; erasing the rest of the line would erase
  // it.
  const int width = std::min(size.columns - 1, kMaxWidth);
  const auto fits = [&](const std::vector<Line>& lines) { return static_cast<int>(lines.size()) < size.rows; };
  if (size.columns >= kWholePanelFrom) {
    for (const bool spaced : {true, false})
      if (std::vector<Line> lines = Layout(state, history, width, style).whole(spaced); fits(lines)) return lines;
  } else if (size.columns >= kPanelFrom) {
    if (std::vector<Line> lines = Layout(state, history, width, style).narrow(); fits(lines)) return lines;
  }
  return {Layout(state, history, width, style).one_line()};
}

}  // namespace giga
