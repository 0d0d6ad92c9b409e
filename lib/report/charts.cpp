// The charts of a report.
#include "report/charts.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <set>
#include <span>
#include <string_view>

#include "core/error.hpp"
#include "learn/registry.hpp"

namespace giga {
namespace {

constexpr std::array kGames = {
    ChartRow{"pool_win_rate", "Games won against the pool", "against past policies of the other team"},
    ChartRow{"scripted_win_rate", "Games won against scripts", "those of opponents.scripted"},
    ChartRow{"return", "Return", "sum of a team's rewards in an episode, mean over the episodes that ended"},
    ChartRow{"score", "Score", "waypoints that a team collected in an episode"},
    ChartRow{"episode_length", "Episode length", "steps, mean over the episodes that ended"},
};
constexpr std::array kSpeed = {
    ChartRow{"agent_steps_per_second", "Speed", "agent-steps per second of an update, without evaluation"},
};

class Chooser {
 public:
  explicit Chooser(const std::vector<ColumnFacts>& columns) : columns_(columns) {}

  ChartSection strength();
  ChartSection games();
  std::vector<Chart> charts_of(std::span<const ChartRow> rows);
  ChartSection learning();
  ChartSection rewards();
  ChartSection speed();
  ChartSection further();

 private:
  const ColumnFacts* find(const std::string& name) const {
    const auto at = std::find_if(columns_.begin(), columns_.end(), [&](const auto& c) { return c.name == name; });
    return at == columns_.end() ? nullptr : &*at;
  }
  /// Adds a line where the column has values, and remembers that it has its place.
  void add(Chart& chart, const std::string& label, const std::string& column, int team) {
    if (!find(column)) return;
    placed_.insert(column);
    chart.series.push_back({label, column, team});
  }
  void add_teams(Chart& chart, const std::string& stem, const std::string& ending = "") {
    for (int team = 0; team < 2; ++team) add(chart, cat("team ", team), cat(stem, "_", team, ending), team);
  }
  static void keep_filled(std::vector<Chart>& charts, Chart chart) {
    if (!chart.series.empty()) charts.push_back(std::move(chart));
  }

  const std::vector<ColumnFacts>& columns_;
  std::set<std::string> placed_;
};

ChartSection Chooser::strength() {
  ChartSection section{
      "Playing strength", "Share of evaluation games won; each team plays on its own side.", false, {}};
  std::set<std::string> seen;
  for (const ColumnFacts& column : columns_) {
    const std::optional<std::string> opponent = opponent_of(column.name);
    if (!opponent || !seen.insert(*opponent).second) continue;
    Chart chart{"Win rate against " + *opponent, "share of games won", {{0, 1}}, {}};
    add_teams(chart, "win_rate", "_vs_" + *opponent);
    keep_filled(section.charts, std::move(chart));
  }
  return section;
}

ChartSection Chooser::games() {
  ChartSection section{"Training games", "The episodes of the training itself that ended during an update.", false, {}};
  Chart won{"Games won", "share of the episodes that ended", {{0, 1}}, {}};
  add_teams(won, "win_rate");
  add(won, "tie", "tie_rate", -1);
  keep_filled(section.charts, std::move(won));
  for (Chart& chart : charts_of(kGames)) section.charts.push_back(std::move(chart));
  return section;
}

std::vector<Chart> Chooser::charts_of(std::span<const ChartRow> rows) {
  std::vector<Chart> charts;
  for (const ChartRow& row : rows) {
    const std::string stem = row.stem;
    if (placed_.contains(stem) || placed_.contains(stem + "_0") || placed_.contains(stem + "_1")) continue;
    const auto is_silent = [&](const std::string& name) { return !find(name) || find(name)->all_zero; };
    if (is_silent(stem) && is_silent(stem + "_0") && is_silent(stem + "_1")) continue;
    Chart chart{row.title, row.note, std::nullopt, {}};
    add(chart, "all", stem, -1);
    add_teams(chart, stem);
    keep_filled(charts, std::move(chart));
  }
  return charts;
}

/// Charts of all algorithms: runs of several are compared on one page.
ChartSection Chooser::learning() {
  ChartSection section{"Learning", "", false, {}};
  for (const Algorithm* algorithm : algorithms())
    for (Chart& chart : charts_of(algorithm->charts)) section.charts.push_back(std::move(chart));
  return section;
}

ChartSection Chooser::rewards() {
  ChartSection section{
      "Rewards by term", "What the return is made of; terms that are always 0 are left out.", false, {}};
  constexpr std::string_view kStart = "reward_";
  for (int team = 0; team < 2; ++team) {
    const std::string ending = cat("_", team);
    Chart chart{cat("Reward terms of team ", team), "sum over an episode", std::nullopt, {}};
    for (const ColumnFacts& column : columns_) {
      const std::string& name = column.name;
      if (!name.starts_with(kStart) || !name.ends_with(ending)) continue;
      placed_.insert(name);
      if (column.all_zero) continue;
      std::string term = name.substr(kStart.size(), name.size() - kStart.size() - ending.size());
      std::replace(term.begin(), term.end(), '_', ' ');
      add(chart, term, name, -1);
    }
    keep_filled(section.charts, std::move(chart));
  }
  return section;
}

ChartSection Chooser::speed() {
  ChartSection section{"Speed", "", false, charts_of(kSpeed)};
  Chart times{"Seconds per update",
              "where the time of an update goes; an evaluation or a checkpoint is not at each",
              std::nullopt,
              {}};
  constexpr std::string_view kEnding = "_seconds";
  for (const ColumnFacts& column : columns_) {
    if (!column.name.ends_with(kEnding)) continue;
    std::string label = column.name.substr(0, column.name.size() - kEnding.size());
    std::replace(label.begin(), label.end(), '_', ' ');
    placed_.insert(column.name);
    if (!column.all_zero) add(times, label, column.name, -1);
  }
  keep_filled(section.charts, std::move(times));
  return section;
}

/// "entropy_0" = "entropy"; "win_rate_1_vs_circle" = "win_rate vs circle".
std::string without_team(const std::string& name, int& team) {
  team = -1;
  for (int t = 0; t < 2; ++t) {
    const std::string mark = cat("_", t);
    size_t at = name.find(mark + "_vs_");
    if (at == std::string::npos && name.ends_with(mark)) at = name.size() - mark.size();
    if (at == std::string::npos) continue;
    team = t;
    return name.substr(0, at) + name.substr(at + mark.size());
  }
  return name;
}

ChartSection Chooser::further() {
  ChartSection section{"Further figures", "", true, {}};
  std::string zero;
  for (const ColumnFacts& column : columns_) {
    if (placed_.contains(column.name)) continue;
    if (column.all_zero) {
      zero += (zero.empty() ? "" : ", ") + column.name;
      continue;
    }
    int team = -1;
    std::string title = without_team(column.name, team);
    std::replace(title.begin(), title.end(), '_', ' ');
    title[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(title[0])));
    auto chart =
        std::find_if(section.charts.begin(), section.charts.end(), [&](const Chart& c) { return c.title == title; });
    if (chart == section.charts.end())
      chart = section.charts.insert(section.charts.end(), {title, "", std::nullopt, {}});
    add(*chart, team < 0 ? "all" : cat("team ", team), column.name, team);
  }
  if (!zero.empty()) section.note = "Always 0 in these runs: " + zero + ".";
  return section;
}

}  // namespace

std::optional<std::string> opponent_of(const std::string& column) {
  constexpr std::string_view kStart = "win_rate_", kMiddle = "_vs_";
  const size_t middle = column.find(kMiddle);
  if (!column.starts_with(kStart) || middle == std::string::npos) return std::nullopt;
  return column.substr(middle + kMiddle.size());
}

std::vector<ChartSection> choose_charts(const std::vector<ColumnFacts>& columns) {
  Chooser choose(columns);
  std::vector<ChartSection> sections;
  sections.push_back(choose.strength());
  sections.push_back(choose.games());
  sections.push_back(choose.learning());
  sections.push_back(choose.rewards());
  sections.push_back(choose.speed());
  sections.push_back(choose.further());
  std::erase_if(sections, [](const ChartSection& s) { return s.charts.empty() && (!s.folded || s.note.empty()); });
  return sections;
}

}  // namespace giga
