// The layout of a sweep's panel.
#include "sweep/sweep_panel.hpp"

#include <algorithm>

#include "config/names.hpp"
#include "core/error.hpp"
#include "io/number.hpp"
#include "io/terminal/bar.hpp"
#include "io/terminal/panel.hpp"

namespace giga {
namespace {

constexpr int kWholeSweepPanelFrom = 60, kSweepPanelFrom = 30;  // columns of the terminal
constexpr int kWidestSweepPanel = 100;

class SweepLayout {
 public:
  SweepLayout(const SweepPanelState& s, int width, TerminalStyle style) : s_(s), width_(width), style_(style) {}

  /// With the first `shown` of the runs.
  std::vector<Line> panel(bool whole, bool spaced, size_t shown);
  Line one_line() const;

 private:
  Line& line() { return lines_.emplace_back(); }
  Line& labelled(const std::string& label) { return line().at(1).add(label, Ink::dim).at(label_); }
  void space(bool wanted) {
    if (wanted) line();
  }
  void figures(bool whole);
  void runs(size_t shown);
  std::string best() const {
    return s_.best ? cat("trial ", s_.best->first, ": ", print_figure(s_.best->second)) : std::string("-");
  }
  std::string trials() const { return cat(s_.done, " of ", s_.trials); }

  const SweepPanelState& s_;
  const int width_;
  const TerminalStyle style_;
  int label_ = 17;  // where values begin
  std::vector<Line> lines_;
};

void SweepLayout::figures(bool whole) {
  const int column = label_ + (width_ - label_) / 2;
  const auto second = [&](Line& to, const char* label, const std::string& value) {
    if (whole) to.at(column).add(label, Ink::dim).at(column + 8).add(value);
  };
  Line& trials_done = labelled("trials").add(trials());
  if (s_.failed_runs > 0) trials_done.add(cat(", ", counted(s_.failed_runs, "runs"), " failed"), Ink::strong);
  second(trials_done, "speed", print_short(s_.agent_steps_per_second) + "/s");
  if (s_.rungs.size() > 1 && whole) {
    Line& rungs = labelled("halving");
    for (size_t k = 0; k < s_.rungs.size(); ++k)
      rungs.add(cat(k > 0 ? ", " : "", s_.rungs[k].second, " at ", print_short(s_.rungs[k].first)));
  }
  labelled("runs at once").add(s_.runs_at_once);
  if (whole) second(labelled("elapsed").add(print_duration(s_.seconds)), "left", print_duration(s_.seconds_left));
  if (!whole) labelled("left").add(print_duration(s_.seconds_left));
  Line& best_trial = labelled("best").add(best(), Ink::strong);
  if (whole) best_trial.add(cat("  (", s_.metric, ")"), Ink::dim);
}

/// A run each: its trial and seed, a bar, its agent-steps, its metric so far.
void SweepLayout::runs(size_t shown) {
  const bool with_bar = width_ >= kWholeSweepPanelFrom - 1;
  const int bar = width_ - label_ - 40, steps = label_ + 4 + bar + 2;
  if (with_bar && !s_.runs.empty())
    line().at(1).add("running", Ink::dim).at(steps).add("agent-steps", Ink::dim).add_right("metric", width_, Ink::dim);
  for (size_t k = 0; k < std::min(shown, s_.runs.size()); ++k) {
    const SweepPanelState::Run& run = s_.runs[k];
    Line& to = line().at(1).add(cat("trial ", run.trial, ", seed ", run.seed));
    to.clip(label_ + 3);
    to.at(label_ + 4);
    if (with_bar) {
      add_bar(to, std::clamp(run.agent_steps / run.wanted_agent_steps, 0.0, 1.0), bar, style_);
      to.at(steps).add(print_short(run.agent_steps) + " of " + print_short(run.wanted_agent_steps));
    } else {
      to.add(print_percent_done(std::clamp(run.agent_steps / run.wanted_agent_steps, 0.0, 1.0)));
    }
    to.add_right(run.metric ? print_figure(*run.metric) : "-", width_);
  }
  if (shown < s_.runs.size()) line().at(1).add(cat("and ", s_.runs.size() - shown, " more"), Ink::dim);
}

std::vector<Line> SweepLayout::panel(bool whole, bool spaced, size_t shown) {
  lines_.clear();
  label_ = whole ? 17 : 14;
  space(spaced);
  line().at(1).add(s_.title, Ink::strong);
  Line& progress = line().at(1);
  add_bar(progress, s_.share_done, width_ - 7, style_);
  progress.add_right(print_percent_done(s_.share_done), width_);
  space(spaced);
  figures(whole);
  space(spaced && !s_.runs.empty());
  runs(shown);
  space(spaced);
  if (whole) labelled("results").add(s_.folder);
  for (Line& l : lines_) l.clip(width_);
  return lines_;
}

/// As many parts as there is room for, the most wanted first.
Line SweepLayout::one_line() const {
  Line to;
  to.add_right(print_percent_done(s_.share_done), 5);
  for (const std::string& part : {print_duration(s_.seconds_left) + " left", trials() + " trials", "best " + best()}) {
    if (to.width() + 2 + columns_of(part) > width_) break;
    to.at(to.width() + 2).add(part);
  }
  to.clip(width_);
  return to;
}

}  // namespace

SweepPanelState panel_state_of(const std::string& name, const SweepSpec& spec, const SweepProgress& progress,
                               const std::vector<int64_t>& rungs) {
  SweepPanelState s;
  s.title =
      cat("sweep ", name, ": ", FieldCodec<SweepMethod>::print(spec.method), ", ",
          counted(progress.n_trials(), "trials"), " with ", counted(static_cast<int64_t>(spec.seeds.size()), "seeds"));
  s.metric = cat(FieldCodec<SweepGoal>::print(spec.goal), " ", join(spec.metric));
  s.trials = progress.n_trials();
  s.done = progress.n_compared();
  s.best = progress.best();
  for (size_t k = 0; k < rungs.size(); ++k) {
    const int rung = static_cast<int>(k);
    int there = 0;
    for (int trial = 0; trial < s.trials; ++trial) {
      there += progress.reached(trial) >= rung ? 1 : 0;
      for (const uint64_t seed : spec.seeds)
        if (const SweepResult* result = progress.result({trial, rung, seed})) s.failed_runs += result->value ? 0 : 1;
    }
    s.rungs.emplace_back(static_cast<double>(rungs[k]), there);
  }
  return s;
}

std::vector<Line> sweep_panel(const SweepPanelState& state, TerminalSize size, TerminalStyle style) {
  SweepLayout layout(state, std::min(size.columns - 1, kWidestSweepPanel), style);
  const bool whole = size.columns >= kWholeSweepPanelFrom;
  if (size.columns < kSweepPanelFrom) return {layout.one_line()};
  const size_t n = state.runs.size(), rows = size.rows > 0 ? static_cast<size_t>(size.rows) : 0;
  for (const bool spaced : {true, false})
    if (std::vector<Line> lines = layout.panel(whole, spaced && whole, n); lines.size() < rows) return lines;
  // A line says how many are left out.
  for (size_t shown = n; shown-- > 1;)
    if (std::vector<Line> lines = layout.panel(whole, false, shown); lines.size() < rows) return lines;
  return {layout.one_line()};
}

}  // namespace giga
