// Which columns stand in which chart.
#include "report/charts.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

namespace giga::test {
namespace {

std::map<std::string, Chart> by_title(const std::vector<ChartSection>& sections) {
  std::map<std::string, Chart> charts;
  for (const ChartSection& section : sections)
    for (const Chart& chart : section.charts) charts[chart.title] = chart;
  return charts;
}

std::vector<std::string> columns_of(const Chart& chart) {
  std::vector<std::string> columns;
  for (const ChartSeries& series : chart.series) columns.push_back(series.column);
  return columns;
}

using Names = std::vector<std::string>;

TEST(Charts, AChartPerOpponentWithBothTeams) {
  const auto charts =
      by_title(choose_charts({{"win_rate_0_vs_random"}, {"win_rate_1_vs_random"}, {"win_rate_0_vs_reverse_circle"}}));
  EXPECT_EQ(columns_of(charts.at("Win rate against random")), (Names{"win_rate_0_vs_random", "win_rate_1_vs_random"}));
  EXPECT_EQ(columns_of(charts.at("Win rate against reverse_circle")), Names{"win_rate_0_vs_reverse_circle"});
  EXPECT_EQ(charts.at("Win rate against random").range, std::make_pair(0.0, 1.0));
  EXPECT_EQ(charts.at("Win rate against random").series[1].team, 1);
}

TEST(Charts, RewardTermsThatAreAlwaysZeroAreLeftOut) {
  const auto charts = by_title(choose_charts({{"reward_damage_0"}, {"reward_game_won_0"}, {"reward_idle_0", true}}));
  const Chart& chart = charts.at("Reward terms of team 0");
  EXPECT_EQ(columns_of(chart), (Names{"reward_damage_0", "reward_game_won_0"}));
  EXPECT_EQ(chart.series[1].label, "game won");
  EXPECT_FALSE(charts.contains("Reward terms of team 1"));
}

TEST(Charts, ScoresOnlyWhereTheyAreUsed) {
  EXPECT_TRUE(by_title(choose_charts({{"score_0"}, {"score_1", true}})).contains("Score"));
  const std::vector<ChartSection> unused = choose_charts({{"score_0", true}, {"score_1", true}});
  EXPECT_FALSE(by_title(unused).contains("Score"));
  ASSERT_EQ(unused.size(), 1u);
  EXPECT_EQ(unused[0].note, "Always 0 in these runs: score_0, score_1.");
}

TEST(Charts, AnUnknownFigureHasAChartOfItsOwn) {
  const std::vector<ChartSection> sections =
      choose_charts({{"entropy_0"}, {"new_figure_0"}, {"new_figure_1"}, {"sigma"}, {"loss_rate_1_vs_circle"}});
  EXPECT_EQ(sections.back().title, "Further figures");
  EXPECT_TRUE(sections.back().folded);
  const auto charts = by_title(sections);
  EXPECT_EQ(columns_of(charts.at("New figure")), (Names{"new_figure_0", "new_figure_1"}));
  EXPECT_EQ(columns_of(charts.at("Sigma")), Names{"sigma"});
  EXPECT_EQ(charts.at("Loss rate vs circle").series[0].team, 1);
}

TEST(Charts, EveryColumnStandsInOneChart) {
  std::vector<ColumnFacts> columns;
  for (const char* name : {"update_seconds",
                           "agent_steps_per_second",
                           "learning_rate_factor",
                           "episodes",
                           "episode_length",
                           "win_rate_0",
                           "win_rate_1",
                           "tie_rate",
                           "truncated_share",
                           "return_0",
                           "return_1",
                           "score_0",
                           "policy_loss_0",
                           "value_loss_0",
                           "entropy_0",
                           "approx_kl_0",
                           "clip_fraction_0",
                           "explained_variance_0",
                           "mutual_information_0",
                           "reward_damage_0",
                           "win_rate_0_vs_random",
                           "loss_rate_0_vs_random",
                           "mean_return_0_vs_random"})
    columns.push_back({name});
  Names charted;
  for (const auto& [title, chart] : by_title(choose_charts(columns)))
    for (const std::string& column : columns_of(chart)) charted.push_back(column);
  Names expected;
  for (const ColumnFacts& column : columns) expected.push_back(column.name);
  std::sort(charted.begin(), charted.end());
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(charted, expected);
}

}  // namespace
}  // namespace giga::test
