// The panel of a sweep at several sizes, and what it says is left.
#include <gtest/gtest.h>

#include <algorithm>

#include "sweep/outlook.hpp"
#include "sweep/sweep_panel.hpp"

namespace giga {
namespace {

constexpr TerminalStyle kPlainPanel{false, true}, kAsciiPanel{false, false};

std::string panel_lines(const SweepPanelState& state, TerminalSize size, TerminalStyle style) {
  std::string text;
  for (const Line& line : sweep_panel(state, size, style)) text += line.print(style) + "\n";
  return text;
}

SweepPanelState some_sweep() {
  SweepPanelState s;
  s.title = "sweep rates: sobol, 16 trials with 3 seeds";
  s.metric = "maximize win_rate_0";
  s.folder = "sweeps/rates";
  s.share_done = 0.259;
  s.trials = 16;
  s.done = 4;
  s.failed_runs = 1;
  s.rungs = {{4e6, 4}};
  s.runs_at_once = "2 (auto)";
  s.seconds = 150;
  s.seconds_left = 450;
  s.agent_steps_per_second = 1e6;
  s.best = {3, 0.912};
  s.runs = {{4, 2, 1e6, 4e6, 0.5}, {4, 3, 0, 4e6, std::nullopt}};
  return s;
}

TEST(SweepPanel, Whole) {
  EXPECT_EQ(panel_lines(some_sweep(), {80, 24}, kPlainPanel), R"(
 sweep rates: sobol, 16 trials with 3 seeds
 ━━━━━━━━━━━━━━━━━━──────────────────────────────────────────────────────   25%

 trials          4 of 16, 1 run failed          speed   1.00 M/s
 runs at once    2 (auto)
 elapsed         2:30                           left    7:30
 best            trial 3: 0.9120  (maximize win_rate_0)

 running                                     agent-steps                 metric
 trial 4, seed 2     ━━━━━─────────────────  1.00 M of 4.00 M            0.5000
 trial 4, seed 3     ──────────────────────  0 of 4.00 M                      -

 results         sweeps/rates
)");
}

TEST(SweepPanel, Narrow) {
  EXPECT_EQ(panel_lines(some_sweep(), {40, 24}, kAsciiPanel), R"( sweep rates: sobol, 16 trials with 3 s
 ========------------------------   25%
 trials       4 of 16, 1 run failed
 runs at once 2 (auto)
 left         7:30
 best         trial 3: 0.9120
 trial 4, seed 2  25%            0.5000
 trial 4, seed 3  0%                  -
)");
}

TEST(SweepPanel, OneLine) {
  EXPECT_EQ(panel_lines(some_sweep(), {29, 24}, kPlainPanel), "  25%  7:30 left\n");
  EXPECT_EQ(panel_lines(some_sweep(), {80, 3}, kPlainPanel),
            "  25%  7:30 left  4 of 16 trials  best trial 3: 0.9120\n");
}

TEST(SweepPanel, BeforeAnythingIsKnown) {
  SweepPanelState s;
  s.trials = 3;
  s.runs_at_once = "1";
  const std::string text = panel_lines(s, {80, 24}, kAsciiPanel);
  for (const char* part : {" 0%", "0 of 3", "best            -", "-:--"})
    EXPECT_NE(text.find(part), std::string::npos) << text;
  EXPECT_EQ(text.find("failed"), std::string::npos) << text;
}

TEST(SweepPanel, FitsEveryTerminalAndSaysHowManyRunsItLeavesOut) {
  SweepPanelState s = some_sweep();
  s.title += std::string(200, 'x');
  s.folder = "/" + std::string(300, 'y');
  s.rungs = {{1e6, 12345}, {3e6, 123}, {9e6, 1}};
  s.runs.assign(20, {99'999, 18'446'744'073'709'551'615u, 1.2345e9, 1e12, -1.2345e-300});
  for (int columns = 1; columns <= 200; columns += columns < 70 ? 1 : 13)
    for (const int rows : {1, 2, 8, 12, 14, 24, 50}) {
      const std::vector<Line> lines = sweep_panel(s, {columns, rows}, kPlainPanel);
      EXPECT_LT(static_cast<int>(lines.size()), std::max(rows, 2)) << columns << " x " << rows;
      for (const Line& line : lines) EXPECT_LT(line.width(), columns) << line.print(kPlainPanel);
    }
  // Without runs: title, bar, trials, halving, runs at once, times, best, a head, the folder. 19 - 9 = 10 are left.
  const std::string low = panel_lines(s, {80, 20}, kPlainPanel);
  EXPECT_EQ(std::count(low.begin(), low.end(), '\n'), 19);
  EXPECT_NE(low.find("and 11 more"), std::string::npos) << low;
}

TEST(SweepPanel, CountsByTheResults) {
  SweepSpec spec;
  spec.seeds = {1, 2};
  spec.metric = {"a", "b"};
  SweepProgress progress(spec, 3, 2);
  progress.finish({0, 0, 1}, {0.5, 0, 1, 100});
  progress.finish({0, 0, 2}, {0.7, 0, 1, 100});
  progress.finish({1, 0, 1}, {std::nullopt, 3, 1, 50});
  const SweepPanelState s = panel_state_of("x", spec, progress, {100, 400});
  EXPECT_EQ(s.title, "sweep x: sobol, 3 trials with 2 seeds");
  EXPECT_EQ(s.metric, "maximize a, b");
  EXPECT_EQ(s.done, 1);
  EXPECT_EQ(s.failed_runs, 1);
  EXPECT_EQ(s.best->first, 0);
  EXPECT_NEAR(s.best->second, 0.6, 1e-12);
  EXPECT_EQ(s.rungs, (std::vector<std::pair<double, int>>{{100, 1}, {400, 0}}));
}

TEST(SweepOutlook, CountsRunsAndHowFarTheyAre) {
  SweepSpec spec;
  spec.seeds = {1, 2};
  SweepProgress progress(spec, 3, 1);
  EXPECT_EQ(outlook_of(spec, progress, {100}, {}).left, 600);
  progress.begin(0, 0);
  progress.finish({0, 0, 1}, {0.5, 0, 1, 104});
  const SweepOutlook half = outlook_of(spec, progress, {100}, {{{0, 0, 2}, 25}});
  EXPECT_EQ(half.all, 600);
  EXPECT_EQ(half.left, 475) << "five runs, of one a quarter";
  progress.finish({0, 0, 2}, {std::nullopt, 3, 1, 30});
  EXPECT_EQ(outlook_of(spec, progress, {100}, {}).left, 400) << "one that failed does no more";
}

TEST(SweepOutlook, ExpectsTheBestThirdToGoOn) {
  SweepSpec spec;
  spec.seeds = {1};
  SweepProgress progress(spec, 9, 3);
  EXPECT_EQ(trials_expected(spec, progress, 3), (std::vector<int>{9, 3, 1}));
  // 9 of 100, 3 of 200 more, 1 of 600 more.
  EXPECT_EQ(outlook_of(spec, progress, {100, 300, 900}, {}).all, 2100);
  progress.finish({0, 0, 1}, {0.5, 0, 1, 100});
  progress.begin(0, 1);
  EXPECT_EQ(outlook_of(spec, progress, {100, 300, 900}, {{{0, 1, 1}, 250}}).left, 1850);
  for (int trial = 0; trial < 5; ++trial) progress.begin(trial, 1);
  EXPECT_EQ(trials_expected(spec, progress, 3), (std::vector<int>{9, 5, 1})) << "more went on than were expected";
}

}  // namespace
}  // namespace giga
