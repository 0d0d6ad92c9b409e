// What stands in a report: the figures, the charts and the tables.
#include "report/sections.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <set>

#include "chart/curve_plot.hpp"
#include "core/error.hpp"
#include "io/number.hpp"
#include "report/charts.hpp"
#include "report/ratings.hpp"
#include "report/tables.hpp"

namespace giga {
namespace {

constexpr int kNTeams = 2;

/// To 6 significant digits: more than a chart can show, and a third of the bytes.
double rounded(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return std::strtod(text, nullptr);
}

Json rounded_array(const std::vector<double>& values) {
  Json list = Json::array();
  for (const double value : values) list.push_back(rounded(value));
  return list;
}

/// How the curves of a group are to be read.
std::string reading_of(const RunGroup& group) {
  const size_t n = group.runs.size();
  std::string text = n > 1 ? cat("Line: mean of ", n, " seeds; band: smallest to largest") : "One run";
  const bool uneven = std::any_of(group.runs.begin(), group.runs.end(), [&](const RunData* run) {
    return run->metrics.rows() != group.runs.front()->metrics.rows();
  });
  if (uneven) text += "; seeds that have ended or not come so far are missing from the later points";
  if (group.rows_per_point > 1)
    text += cat("; each point stands for ", group.rows_per_point, " updates",
                n > 1 ? "" : " (line: mean; band: smallest to largest)");
  return text;
}

double last_known(const std::vector<double>& values) {
  const auto last = std::find_if(values.rbegin(), values.rend(), [](double v) { return !std::isnan(v); });
  return last == values.rend() ? std::nan("") : *last;
}

/// A team's share of the games of the last evaluation of each run: mean, least and greatest; null where there is none.
Json last_win_rate(const RunGroup& group, const std::string& column) {
  double sum = 0, low = 1, high = 0;
  int count = 0;
  for (const RunData* run : group.runs) {
    const std::vector<double>* values = run->metrics.find(column);
    const double rate = values ? last_known(*values) : std::nan("");
    if (std::isnan(rate)) continue;
    sum += rate;
    low = std::min(low, rate);
    high = std::max(high, rate);
    ++count;
  }
  if (count == 0) return {};
  return {{"mean", sum / count}, {"low", low}, {"high", high}, {"runs", count}};
}

/// Names of the opponents in columns win_rate_T_vs_NAME.
std::vector<std::string> opponents_of(const RunGroup& group) {
  std::vector<std::string> names;
  for (const Curve& curve : group.curves) {
    const std::optional<std::string> name = opponent_of(curve.name);
    if (name && std::find(names.begin(), names.end(), *name) == names.end()) names.push_back(*name);
  }
  return names;
}

/// Win rates at the end.
Json figures_section(const std::vector<RunGroup>& groups) {
  Json list = Json::array();
  for (const RunGroup& group : groups) {
    Json results = Json::array();
    for (const std::string& opponent : opponents_of(group)) {
      Json teams = Json::array();
      for (int team = 0; team < kNTeams; ++team)
        teams.push_back(last_win_rate(group, cat("win_rate_", team, "_vs_", opponent)));
      results.push_back({{"opponent", opponent}, {"teams", std::move(teams)}});
    }
    const std::string episodes = setting(flatten(group.runs.front()->config), "eval.episodes");
    list.push_back({{"label", title_of(group)},
                    {"episodes", episodes},
                    {"facts", run_facts(group)},
                    {"results", std::move(results)}});
  }
  return {{"kind", "figures"}, {"title", "Final figures"}, {"groups", std::move(list)}};
}

/// A curve by team has the colour of its team and the dashes of its group; by configuration the colour of its group and
/// the dashes of its place in the chart. page.css chooses.
std::string line_style(const std::string& colour, size_t group, size_t index) {
  static constexpr std::array kDashes = {"none", "7 4", "2 3", "11 4 2 4", "16 5"};
  return cat("--by-team: var(--", colour, "); --dashes-by-team: ", kDashes[group % kDashes.size()],
             "; --by-group: var(--hue-", group % 8, "); --dashes-by-group: ", kDashes[index % kDashes.size()]);
}

/// The first and the last agent-steps of all groups.
std::pair<double, double> steps_range(const std::vector<RunGroup>& groups) {
  std::pair range(groups.front().agent_steps.front(), groups.front().agent_steps.back());
  for (const RunGroup& group : groups) {
    range.first = std::min(range.first, group.agent_steps.front());
    range.second = std::max(range.second, group.agent_steps.back());
  }
  return range;
}

/// A chart as it is drawn first, along agent-steps, with what the page's script needs to know of its lines.
Json chart_json(const Chart& chart, const std::vector<RunGroup>& groups) {
  static const std::vector<double> kNoBand;
  const bool has_teams =
      std::any_of(chart.series.begin(), chart.series.end(), [](const ChartSeries& s) { return s.team >= 0; });
  CurvePlot plot{steps_range(groups), chart.range, {}};
  Json lines = Json::array();
  for (size_t index = 0; index < chart.series.size(); ++index) {
    const ChartSeries& s = chart.series[index];
    const std::string colour = s.team >= 0                ? cat("team-", s.team)
                               : chart.series.size() == 1 ? "neutral"
                                                          : cat("hue-", has_teams ? 5 : index % 8);
    for (size_t g = 0; g < groups.size(); ++g) {
      const Curve* curve = groups[g].find(s.column);
      if (!curve) continue;
      const std::string name = chart.series.size() > 1 ? s.label : "", letter = groups[g].letter;
      const std::string style = line_style(colour, g, index);
      const bool band = groups[g].has_band();
      plot.curves.push_back(
          {style, groups[g].agent_steps, curve->mean, band ? curve->low : kNoBand, band ? curve->high : kNoBand});
      lines.push_back({{"name", letter.empty() ? s.label : letter + " " + name}, {"group", g}, {"style", style}});
    }
  }
  return {{"title", chart.title},
          {"note", chart.note},
          {"has_range", chart.range.has_value()},
          {"svg", draw_curve_plot(plot)},
          {"lines", std::move(lines)}};
}

std::vector<ColumnFacts> columns_of(const std::vector<RunGroup>& groups) {
  std::vector<ColumnFacts> columns;
  for (const RunGroup& group : groups) {
    for (const Curve& curve : group.curves) {
      const auto is_zero = [](double v) { return std::isnan(v) || v == 0; };
      const bool all_zero = std::all_of(curve.low.begin(), curve.low.end(), is_zero) &&
                            std::all_of(curve.high.begin(), curve.high.end(), is_zero);
      const auto known =
          std::find_if(columns.begin(), columns.end(), [&](const auto& c) { return c.name == curve.name; });
      if (known == columns.end()) {
        columns.push_back({curve.name, all_zero});
      } else {
        known->all_zero = known->all_zero && all_zero;
      }
    }
  }
  return columns;
}

void add_chart_sections(const std::vector<RunGroup>& groups, Json& sections) {
  for (const ChartSection& section : choose_charts(columns_of(groups))) {
    Json charts = Json::array();
    for (const Chart& chart : section.charts) charts.push_back(chart_json(chart, groups));
    sections.push_back({{"kind", "charts"},
                        {"title", section.title},
                        {"note", section.note},
                        {"folded", section.folded},
                        {"charts", std::move(charts)}});
  }
}

double total(const RunData& run, const char* column) {
  double sum = 0;
  if (const std::vector<double>* values = run.metrics.find(column))
    for (const double value : *values) sum += std::isnan(value) ? 0 : value;
  return sum;
}

/// Where the wall-clock time went, over the runs of a group.
Json time_section(const std::vector<RunGroup>& groups) {
  Json list = Json::array();
  for (const RunGroup& group : groups) {
    double update = 0, evaluation = 0, checkpoint = 0, all = 0;
    for (const RunData* run : group.runs) {
      update += total(*run, "update_seconds");
      evaluation += total(*run, "evaluation_seconds");
      checkpoint += total(*run, "checkpoint_seconds");
      all += run->metrics.find("seconds")->back();
    }
    Json parts = Json::array();
    const auto add = [&](const char* name, double seconds) {
      parts.push_back({{"name", name}, {"seconds", rounded(seconds)}, {"text", print_duration(seconds)}});
    };
    add("updates", update);
    add("evaluation", evaluation);
    add("checkpoints", checkpoint);
    add("the rest", std::max(0.0, all - update - evaluation - checkpoint));
    list.push_back({{"label", title_of(group)}, {"parts", std::move(parts)}});
  }
  return {{"kind", "time"}, {"title", "Time spent"}, {"groups", std::move(list)}};
}

}  // namespace

Json report_groups(const std::vector<RunGroup>& groups) {
  Json list = Json::array();
  for (const RunGroup& group : groups) {
    list.push_back({{"label", title_of(group)},
                    {"reading", reading_of(group)},
                    {"style", line_style("neutral", list.size(), 0)},
                    {"agent_steps", group.agent_steps},
                    {"seconds", rounded_array(group.seconds)}});
  }
  return list;
}

Json report_sections(const std::vector<RunGroup>& groups, const std::vector<FieldInfo>& keys) {
  Json sections = Json::array();
  sections.push_back(figures_section(groups));
  add_ratings_sections(groups, sections);
  add_chart_sections(groups, sections);
  sections.push_back(time_section(groups));
  sections.push_back(config_section(groups, keys));
  sections.push_back(runs_section(groups));
  sections.push_back(machine_section(groups));
  sections.push_back(commands_section(groups));
  return sections;
}

}  // namespace giga
