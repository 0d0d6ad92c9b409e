// What stands in a report: the figures, the charts and the tables.
#include "report/sections.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>
#include <utility>

#include "chart/curve_plot.hpp"
#include "core/error.hpp"
#include "io/number.hpp"
#include "report/charts.hpp"
#include "report/ratings.hpp"
#include "report/tables.hpp"

namespace giga {
namespace {

constexpr int kNTeams = 2;

std::string seeds_of(const std::vector<const RunData*>& runs) {
  std::set<std::string> seeds;
  for (const RunData* run : runs) seeds.insert(setting(flatten(run->config), "seed"));
  return counted_seeds(runs.size(), seeds.size());
}

/// How the curves of a group are to be read.
std::string reading_of(const RunGroup& group) {
  const size_t n = group.runs.size();
  std::string text = n > 1 ? cat("Line: mean of ", seeds_of(group.runs), "; band: smallest to largest") : "One run";
  const bool uneven = std::any_of(group.runs.begin(), group.runs.end(), [&](const RunData* run) {
    return run->metrics.rows() != group.runs.front()->metrics.rows();
  });
  if (uneven) text += "; runs that have ended or not come so far are missing from the later points";
  if (group.rows_per_point > 1)
    text += cat("; each point stands for ", group.rows_per_point, " updates",
                n > 1 ? "" : " (line: mean; band: smallest to largest)");
  return text;
}

double last_known(const std::vector<double>& values) {
  const auto last = std::find_if(values.rbegin(), values.rend(), [](double v) { return !std::isnan(v); });
  return last == values.rend() ? std::nan("") : *last;
}

/// A team's share of the games of the last evaluation of each run.
struct LastWinRate {
  double mean = 0, low = 1, high = 0;
  std::vector<const RunData*> runs;  ///< that have one
};
LastWinRate last_win_rate(const RunGroup& group, const std::string& column) {
  LastWinRate rate;
  for (const RunData* run : group.runs) {
    const std::vector<double>* values = run->metrics.find(column);
    const double last = values ? last_known(*values) : std::nan("");
    if (std::isnan(last)) continue;
    const auto n = static_cast<double>(rate.runs.size());
    rate.mean = (rate.mean * n + last) / (n + 1);
    rate.low = std::min(rate.low, last);
    rate.high = std::max(rate.high, last);
    rate.runs.push_back(run);
  }
  return rate;
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

/// A team's bar from 0 to 1, with the spread over the runs.
void write_bar(Markup& page, int team, const LastWinRate& rate) {
  const auto bar = page.open("div", {{"class", "bar"}});
  page.element("span", cat("team ", team));
  {
    const auto track = page.open("div", {{"class", "track"}});
    page.element(
        "div", "",
        {{"class", "fill"}, {"style", cat("width: ", 100 * rate.mean, "%; background: var(--team-", team, ")")}});
    if (rate.runs.size() > 1)
      page.element("div", "",
                   {{"class", "spread"},
                    {"style", cat("left: ", 100 * rate.low, "%; width: ", 100 * (rate.high - rate.low), "%")}});
  }
  const auto number = page.open("span", {{"class", "number"}});
  page.element("b", print_share(rate.mean));
  if (rate.runs.size() > 1) page.element("span", cat(print_share(rate.low), " to ", print_share(rate.high)));
}

/// Win rates against one opponent at the end.
void write_result(Markup& page, const RunGroup& group, const std::string& opponent) {
  LastWinRate rates[kNTeams];
  std::vector<const RunData*> runs;
  for (int team = 0; team < kNTeams; ++team) {
    rates[team] = last_win_rate(group, cat("win_rate_", team, "_vs_", opponent));
    if (rates[team].runs.size() > runs.size()) runs = rates[team].runs;
  }
  const auto box = page.open("div");
  {
    const auto title = page.open("h4");
    page.insert(escaped("Won against " + opponent));
    page.element("span", cat(" in ", setting(flatten(group.runs.front()->config), "eval.episodes"), " episodes",
                             runs.size() > 1 ? cat(", mean of ", seeds_of(runs)) : ""));
  }
  for (int team = 0; team < kNTeams; ++team)
    if (!rates[team].runs.empty()) write_bar(page, team, rates[team]);
}

void write_figures(Markup& page, const std::vector<RunGroup>& groups) {
  for (const RunGroup& group : groups) {
    const auto card = page.open("div", {{"class", "card figures"}});
    if (groups.size() > 1) page.element("h3", title_of(group));
    {
      const auto facts = page.open("dl", {{"class", "facts"}});
      for (const auto& [name, value] : run_facts(group)) {
        const auto fact = page.open("div");
        page.element("dt", name);
        page.element("dd", value);
      }
    }
    const std::vector<std::string> opponents = opponents_of(group);
    if (opponents.empty()) continue;
    const auto results = page.open("div", {{"class", "results"}});
    for (const std::string& opponent : opponents) write_result(page, group, opponent);
  }
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

/// A short line that shows colour and dashes of the line that its parent stands for.
void write_sample(Markup& page) {
  const auto svg = page.open("svg", {{"class", "sample"}, {"aria-hidden", "true"}});
  page.add("path", {{"class", "curve"}, {"d", "M1 4H29"}});
}

/// A chart along agent-steps with the names of its lines, which page.js connects.
void write_chart(Markup& page, const Chart& chart, const std::vector<RunGroup>& groups) {
  static const std::vector<double> kNoBand;
  const auto card = page.open("article", {{"class", "card chart"}, {"data-fixed", chart.range ? "yes" : ""}});
  {
    const auto head = page.open("div", {{"class", "head"}});
    page.element("h3", chart.title);
    page.element("span", "", {{"class", "at"}});
  }
  page.element("p", chart.note, {{"class", "note"}});
  const bool has_teams =
      std::any_of(chart.series.begin(), chart.series.end(), [](const ChartSeries& s) { return s.team >= 0; });
  CurvePlot plot{chart.title + ", a chart", steps_range(groups), chart.range, {}};
  {
    const auto names = page.open("div", {{"class", "names"}});
    for (size_t index = 0; index < chart.series.size(); ++index) {
      const ChartSeries& s = chart.series[index];
      const bool alone = chart.series.size() == 1;
      const std::string colour = s.team >= 0 ? cat("team-", s.team)
                                 : alone     ? "neutral"
                                             : cat("hue-", has_teams ? 5 : index % 8);
      for (size_t g = 0; g < groups.size(); ++g) {
        const Curve* curve = groups[g].find(s.column);
        if (!curve) continue;
        const bool band = groups[g].has_band();
        plot.curves.push_back({line_style(colour, g, index), groups[g].agent_steps, curve->mean,
                               band ? curve->low : kNoBand, band ? curve->high : kNoBand});
        const auto button = page.open("button", {{"type", "button"},
                                                 {"class", "line"},
                                                 {"style", plot.curves.back().style},
                                                 {"aria-pressed", "true"},
                                                 {"data-group", std::to_string(g)}});
        write_sample(page);
        const std::string name = groups.size() == 1 ? s.label : groups[g].short_label() + (alone ? "" : ", " + s.label);
        if (!alone || groups.size() > 1) page.element("span", name, {{"class", "name"}});
        page.element("span", "", {{"class", "value"}});
      }
    }
  }
  const auto frame = page.open("div", {{"class", "plot-frame"}});
  draw_curve_plot(page, plot);
}

/// How the curves are to be read; the key of the groups where there are several.
void write_readings(Markup& page, const std::vector<RunGroup>& groups) {
  const auto list = page.open("ul", {{"class", "readings"}});
  for (size_t g = 0; g < groups.size(); ++g) {
    const auto item = page.open("li", {{"class", "line"}, {"style", line_style("neutral", g, 0)}});
    if (groups.size() > 1) {
      write_sample(page);
      page.element("b", title_of(groups[g]));
    }
    page.element("span", reading_of(groups[g]));
  }
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

void write_charts(Markup& page, const std::vector<RunGroup>& groups, const std::vector<Chart>& charts) {
  const auto grid = page.open("div", {{"class", "grid"}});
  for (const Chart& chart : charts) write_chart(page, chart, groups);
}

double total(const RunData& run, const char* column) {
  double sum = 0;
  if (const std::vector<double>* values = run.metrics.find(column))
    for (const double value : *values) sum += std::isnan(value) ? 0 : value;
  return sum;
}

/// Of its processes; without those before the first row where rows of metrics.csv were lost.
double seconds_told(const RunData& run) {
  const MetricsTable& rows = run.metrics;
  const std::vector<double>& seconds = *rows.find("seconds");
  const std::vector<double>* updates = rows.find("update");
  if (!updates || updates->front() <= 1) return seconds.back();
  double before = seconds.front();
  for (const char* part : {"update_seconds", "evaluation_seconds", "checkpoint_seconds"})
    if (const std::vector<double>* own = rows.find(part); own && std::isfinite(own->front())) before -= own->front();
  return seconds.back() - before;
}

/// Where the wall-clock time went, over the runs of a group.
void write_time(Markup& page, const std::vector<RunGroup>& groups) {
  const auto card = page.open("div", {{"class", "card time"}});
  for (const RunGroup& group : groups) {
    double update = 0, evaluation = 0, checkpoint = 0, all = 0;
    for (const RunData* run : group.runs) {
      update += total(*run, "update_seconds");
      evaluation += total(*run, "evaluation_seconds");
      checkpoint += total(*run, "checkpoint_seconds");
      all += seconds_told(*run);
    }
    struct Part {
      const char *name, *hue;
      double seconds;
    };
    const double rest = std::max(0.0, all - update - evaluation - checkpoint);
    const Part parts[] = {{"updates", "0", update},
                          {"evaluation", "2", evaluation},
                          {"checkpoints", "1", checkpoint},
                          {"the rest", "5", rest}};
    all = update + evaluation + checkpoint + rest;
    if (groups.size() > 1) page.element("h3", title_of(group));
    const auto box = page.open("div");
    {
      const auto stack = page.open("div", {{"class", "stack"}});
      for (const Part& p : parts)
        page.element("span", "", {{"style", cat("flex: ", p.seconds, " 0 0; background: var(--hue-", p.hue, ")")}});
    }
    const auto names = page.open("div", {{"class", "parts"}});
    for (const Part& p : parts) {
      const auto name = page.open("span");
      page.element("i", "", {{"style", cat("background: var(--hue-", p.hue, ")")}});
      char share[64];
      std::snprintf(share, sizeof share, "%s %.1f %% ", p.name, all > 0 ? 100 * p.seconds / all : 0);
      page.insert(share);
      page.element("span", print_duration(p.seconds));
    }
  }
}

/// A section with its title, and what `write` puts into it; `folded`: opened by the reader.
template <class Write>
void write_section(Markup& page, const std::string& title, const std::string& note, bool folded, const Write& write) {
  const auto section = page.open("section", {{"class", "section"}});
  const auto inner = page.open(folded ? "details" : "div");
  {
    const auto head = page.open(folded ? "summary" : "div");
    page.element("h2", title);
  }
  if (!note.empty()) page.element("p", note, {{"class", "note"}});
  write();
}

/// A path as a link: what is no plain character, as %20.
std::string url_path(const std::string& path) {
  static constexpr char kHex[] = "0123456789ABCDEF";
  std::string url;
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    const bool plain = std::isalnum(byte) || std::string_view("/._-~").find(c) != std::string_view::npos;
    url += plain ? std::string(1, c) : std::string{'%', kHex[byte >> 4], kHex[byte & 15]};
  }
  return url;
}

/// Links to the pages of replays beside the report.
void write_replays(Markup& page, const std::vector<RunGroup>& groups) {
  std::vector<const RunData*> runs;
  for (const RunGroup& group : groups)
    std::copy_if(group.runs.begin(), group.runs.end(), std::back_inserter(runs),
                 [](const RunData* run) { return !run->replays.empty(); });
  if (runs.empty()) return;
  write_section(page, "Replays", "Games of the teams against each other, as they played at evaluations.", false, [&] {
    const auto list = page.open("ul", {{"class", "readings"}});
    for (const RunData* run : runs) {
      const auto item = page.open("li");
      page.element("a", runs.size() > 1 ? "watch " + run->name : "watch the games", {{"href", url_path(run->replays)}});
    }
  });
}

}  // namespace

std::string page_sections(const std::vector<RunGroup>& groups, const std::vector<FieldInfo>& keys) {
  Markup page;
  const auto add = [&page](const std::string& title, const auto& write) {
    write_section(page, title, "", false, write);
  };
  add("Final figures", [&] { write_figures(page, groups); });
  for (const RunGroup& group : groups)
    for (const RunData* run : group.runs) {
      if (!run->ratings) continue;
      const bool alone = groups.size() == 1 && group.runs.size() == 1;
      const std::string title = alone ? "Ratings" : "Ratings of " + run->name;
      write_section(page, title, rating_note(*run->ratings), false,
                    [&] { write_rating_section(page, *run->ratings, title); });
    }
  write_replays(page, groups);
  bool first = true;
  for (const ChartSection& section : choose_charts(columns_of(groups)))
    write_section(page, section.title, section.note, section.folded, [&] {
      if (std::exchange(first, false)) write_readings(page, groups);
      write_charts(page, groups, section.charts);
    });
  add("Time spent", [&] { write_time(page, groups); });
  add("Configuration", [&] { write_config(page, groups, keys); });
  add("Runs", [&] { write_runs(page, groups); });
  add("Hardware and versions", [&] { write_machines(page, groups); });
  write_section(page, "Commands", "How the runs were started.", false, [&] { write_commands(page, groups); });
  return page.str();
}

Json group_axes(const std::vector<RunGroup>& groups) {
  Json list = Json::array();
  for (const RunGroup& group : groups) list.push_back({{"agent_steps", group.agent_steps}, {"seconds", group.seconds}});
  return list;
}

}  // namespace giga
