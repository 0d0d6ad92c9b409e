// The panel's parts: lines with inks, sparklines, the layout at several sizes.
#include <gtest/gtest.h>
#include <stdlib.h>

#include <cmath>
#include <limits>

#include "io/terminal/panel.hpp"
#include "panel_state.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

constexpr double kNotKnown = std::numeric_limits<double>::quiet_NaN();
constexpr TerminalStyle kPlain{false, true}, kAscii{false, false}, kColor{true, true};

std::string text_of(const std::vector<Line>& lines, TerminalStyle style = kPlain) {
  std::string text;
  for (const Line& line : lines) text += line.print(style) + "\n";
  return text;
}

TEST(Sparkline, HeightsBetweenLowestAndHighest) {
  // Eighths of 0 to 8: 0 is the lowest block, 4 the fifth of eight, 8 the highest.
  EXPECT_EQ(sparkline({0, 1, 4, 7.9, 8}, true), "▁▂▅██");
  EXPECT_EQ(sparkline({0, 1, 2, 3, 4, 5, 6, 7, 8}, false), ".:-=+*#@@");
  EXPECT_EQ(sparkline({0.5, kNotKnown, 1}, 0, 1, true), "▅ █");
  EXPECT_EQ(sparkline({3, 3}, true), "▅▅") << "no course: middle height";
  EXPECT_EQ(sparkline({-1, 2}, 0, 1, true), "▁█") << "beyond the scale";
  EXPECT_EQ(sparkline({}, true), "");
}

TEST(Sparkline, SeriesIsThinnedByMeans) {
  Series series;
  series.add(kNotKnown);  // before the first value
  for (int k = 1; k <= 7; ++k) series.add(k);
  EXPECT_EQ(series.points(7), (std::vector<double>{1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(series.points(6), (std::vector<double>{1.5, 3.5, 5.5, 7}));
  EXPECT_EQ(series.points(3), (std::vector<double>{2.5, 6}));  // (1 + 2 + 3 + 4) / 4, (5 + 6 + 7) / 3
  series.add(kNotKnown);
  EXPECT_EQ(series.points(3), (std::vector<double>{2.5, 6}));
  EXPECT_TRUE(std::isnan(series.points(8).back()));
}

TEST(Sparkline, LongSeriesKeepTheirWholeCourse) {
  Series series;
  for (int k = 0; k < 100'000; ++k) series.add(k);
  const std::vector<double> points = series.points(10);
  ASSERT_EQ(points.size(), 7u);  // of 2^14 values each: 100000 / 16384 = 6.1
  for (size_t k = 0; k < 6; ++k) EXPECT_EQ(points[k], 16384.0 * static_cast<double>(k) + 16383.0 / 2) << k;
  EXPECT_EQ(points[6], (6 * 16384 + 99'999) / 2.0);
}

TEST(TerminalLine, CountsColumns) {
  Line line;
  line.at(2).add("größe").add_right("7", 10, Ink::team_1).at(12);
  EXPECT_EQ(line.width(), 10);
  EXPECT_EQ(line.print(kPlain), "  größe  7");
  EXPECT_EQ(line.print(kAscii), "  gr??e  7");
  EXPECT_EQ(line.print(kColor), "  größe  \x1b[38;5;208m7\x1b[m");
  line.clip(4);
  EXPECT_EQ(line.width(), 4);
  EXPECT_EQ(line.print(kPlain), "  gr");
  line.add("x y");
  line.clip(6);
  EXPECT_EQ(line.print(kPlain), "  grx") << "a space at the end";
  line.clip(2);
  EXPECT_EQ(line.width(), 0);
}

TEST(TerminalLine, ShowsNothingThatTakesOtherThanOneColumn) {
  Line line;
  line.add("a\x1b[2J\t\n東e\u0301\xff");  // escape, tab, newline; wide; combining; no UTF-8
  EXPECT_EQ(line.print(kPlain), "a?[2J???e??");
  EXPECT_EQ(line.width(), 11);
}

/// The environment variables that say how to draw, put back at the end.
class StyleByEnvironment : public ::testing::Test {
 protected:
  StyleByEnvironment() {
    for (const char* name : kNames) {
      const char* value = ::getenv(name);
      before_.emplace_back(value ? value : "");
      ::unsetenv(name);
    }
    ::setenv("TERM", "xterm-256color", 1);
  }
  ~StyleByEnvironment() override {
    for (size_t k = 0; k < before_.size(); ++k)
      before_[k].empty() ? ::unsetenv(kNames[k]) : ::setenv(kNames[k], before_[k].c_str(), 1);
  }
  static constexpr const char* kNames[] = {"NO_COLOR", "TERM", "LC_ALL", "LC_CTYPE", "LANG"};
  std::vector<std::string> before_;
};

TEST_F(StyleByEnvironment, Color) {
  EXPECT_TRUE(terminal_style().color);
  ::setenv("NO_COLOR", "", 1);
  EXPECT_TRUE(terminal_style().color) << "empty is as not set";
  ::setenv("NO_COLOR", "0", 1);
  EXPECT_FALSE(terminal_style().color);
  ::unsetenv("NO_COLOR");
  ::setenv("TERM", "dumb", 1);
  EXPECT_FALSE(terminal_style().color);
}

TEST_F(StyleByEnvironment, Characters) {
  EXPECT_FALSE(terminal_style().unicode) << "the C locale";
  ::setenv("LANG", "de_DE.UTF-8", 1);
  EXPECT_TRUE(terminal_style().unicode);
  ::setenv("LC_CTYPE", "C.utf8", 1);
  EXPECT_TRUE(terminal_style().unicode);
  ::setenv("LC_ALL", "C", 1);
  EXPECT_FALSE(terminal_style().unicode) << "LC_ALL comes first";
  ::setenv("LC_ALL", "C.UTF-8", 1);
  ::setenv("TERM", "linux", 1);
  EXPECT_FALSE(terminal_style().unicode);
}

/// Run_at(100) with a history of returns 1 to 8 and -1 to -8, and of two evaluations.
PanelHistory some_history() {
  PanelHistory history;
  for (int k = 1; k <= 8; ++k) {
    ProgressState s = run_at(92 + k);
    s.time.evaluation = k < 5 ? 1 : 2;
    s.team[0].mean_return = k;
    s.team[1].mean_return = -k;
    s.team[0].win_rates = {{"random", k < 5 ? 0.2 : 0.98}};
    history.add(s);
    history.add(s);  // shown twice
  }
  return history;
}

TEST(Panel, HistoryCountsUpdatesAndEvaluationsOnce) {
  const PanelHistory history = some_history();
  EXPECT_EQ(history.returns(0).points(100), (std::vector<double>{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(history.returns(1).points(100).front(), -1);
  EXPECT_EQ(history.win_rates(0, "random")->points(100), (std::vector<double>{0.2, 0.98}));
  EXPECT_EQ(history.win_rates(0, "circle"), nullptr);
}

TEST(Panel, Whole) {
  EXPECT_EQ(text_of(panel(run_at(100), some_history(), {80, 24}, kPlain)),
            R"(
 identical_5_vs_5, mappo, seed 1, cuda:0 (NVIDIA H200)
 ━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━────────────────────────────────────   50%

 agent-steps     150 M of 300 M                 speed   1.00 M/s
 update          100 of 200
 elapsed         2:30                           left    2:30
 time            rollout 50%   update 25%   evaluation  5%   rest 20%
 GPU memory      12.0 of 139.0 GiB              temp.   41 °C

                 team 0                         team 1
 return              12.34  ▁▂▃▄▅▆▇█               -3.500  █▇▆▅▄▃▂▁
 wins vs random       0.98  ▂█                       0.97  ██
 wins vs circle       0.40                           0.31  ▃▃
 policy loss       -0.0123                        -0.0200
 value loss         0.2500                         0.5000
 entropy             1.500                          1.250
 approximate KL     0.0100                         0.0200
 expl. variance     0.8750                         0.7500

 results         runs/identical_5_vs_5-mappo-seed1-001
)");
}

TEST(Panel, Narrow) {
  EXPECT_EQ(text_of(panel(run_at(50), PanelHistory(), {40, 24}, kAscii)),
            R"( identical_5_vs_5, mappo, seed 1, cuda:
 ========------------------------   25%
 agent-steps 75.0 M of 300 M
 speed       1.00 M/s
 left        3:45
             team 0       team 1
 return          12.34       -3.500
 vs random        0.98         0.97
 vs circle        0.40         0.31
 value loss     0.2500       0.5000
 entropy         1.500        1.250
 approx. KL     0.0100       0.0200
 GPU         12.0 GiB, 41 C
)");
}

TEST(Panel, OneLine) {
  EXPECT_EQ(text_of(panel(run_at(50), PanelHistory(), {20, 24}, kPlain)), "  25%  3:45 left\n");
  EXPECT_EQ(text_of(panel(run_at(50), PanelHistory(), {80, 8}, kAscii)),
            "  25%  ====------------  3:45 left  1.00 M/s  75.0 M of 300 M\n");
}

TEST(Panel, LowTerminalsGetItWithoutEmptyLines) {
  const PanelHistory history;
  EXPECT_EQ(panel(run_at(50), history, {80, 22}, kPlain).size(), 21u);
  EXPECT_EQ(panel(run_at(50), history, {80, 21}, kPlain).size(), 17u);
  EXPECT_EQ(panel(run_at(50), history, {80, 18}, kPlain).size(), 17u);
  EXPECT_EQ(panel(run_at(50), history, {80, 17}, kPlain).size(), 1u);
}

TEST(Panel, FitsEveryTerminal) {
  ProgressState s = run_at(199);
  s.title += std::string(200, 'x');
  s.folder = "/" + std::string(300, 'y');
  s.n_updates = s.update = 123'456'789;
  s.seconds = s.seconds_left = 360'000;
  s.team[0].win_rates.emplace_back("an_opponent_with_a_very_long_name", 1);
  s.team[1].mean_return = s.team[1].figures[1].value = -1.2345e-300;
  const PanelHistory history = some_history();
  for (int columns = 1; columns <= 250; ++columns) {
    for (const int rows : {1, 2, 12, 18, 19, 24, 50}) {
      const std::vector<Line> lines = panel(s, history, {columns, rows}, kColor);
      EXPECT_LT(static_cast<int>(lines.size()), std::max(rows, 2)) << columns << " x " << rows;
      for (const Line& line : lines) EXPECT_LT(line.width(), columns) << line.print(kPlain);
    }
  }
}

TEST(Panel, UnknownFiguresAreDashes) {
  ProgressState s;
  s.title = "nothing known";
  s.n_updates = 10;
  s.team[0].win_rates = {{"random", kNotKnown}};
  for (TeamProgress& team : s.team)
    team.figures = learner_figures({kNotKnown, kNotKnown, kNotKnown, kNotKnown, kNotKnown});
  const std::string text = text_of(panel(s, PanelHistory(), {80, 30}, kAscii));
  for (const char* label : {"return", "wins vs random", "policy loss", "value loss", "entropy", "approximate KL"}) {
    const size_t at = text.find(std::string("\n ") + label);
    ASSERT_NE(at, std::string::npos) << label;
    const std::string values = text.substr(at + 18, text.find('\n', at + 1) - at - 18);
    EXPECT_EQ(values, "        -" + std::string(30, ' ') + "-") << label;  // team 1 begins (79 - 17) / 2 columns later
  }
  EXPECT_TRUE(contains(text, {"left    -:--", "team 0 (fixed)", "rollout   -"}));
  EXPECT_EQ(text.find("GPU"), std::string::npos) << "a run without GPU:\n" << text;
}

TEST(Panel, WithoutColorThereIsNoEscapeSequence) {
  const std::vector<Line> lines = panel(run_at(50), some_history(), {80, 30}, kPlain);
  EXPECT_EQ(text_of(lines, {false, true}).find('\x1b'), std::string::npos);
  EXPECT_TRUE(contains(text_of(lines, kColor), {"\x1b[38;5;33mteam 0\x1b[m", "\x1b[38;5;208mteam 1\x1b[m"}));
}

TEST(Panel, InAsciiWhereTheLocaleIsNotUtf8) {
  for (const char c : text_of(panel(run_at(50), some_history(), {80, 30}, kAscii), kAscii))
    EXPECT_LT(static_cast<unsigned char>(c), 0x80);
}

TEST(Panel, Figures) {
  EXPECT_EQ(print_figure(kNotKnown), "-");
  EXPECT_EQ(print_figure(0), "0.0000");
  EXPECT_EQ(print_figure(-0.01234), "-0.0123");
  EXPECT_EQ(print_figure(0.0004), "4.0e-04");
  EXPECT_EQ(print_figure(12.345), "12.35");
  EXPECT_EQ(print_figure(-999'999.4), "-999999");
  EXPECT_EQ(print_figure(-1.25e7), "-1.2e+07");
  EXPECT_EQ(print_figure(INFINITY), "inf");
}

}  // namespace
}  // namespace giga::test
