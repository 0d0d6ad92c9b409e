// The outcome of a sweep as CSV, JSON, text and HTML.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "chart/line_chart.hpp"
#include "chart/markup.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "io/metrics_csv.hpp"
#include "io/number.hpp"
#include "report/tables.hpp"
#include "sweep/analysis.hpp"
#include "sweep/outcome.hpp"

namespace giga {
namespace {

constexpr size_t kShown = 5;

std::string digits(double value, const char* format = "%.4g") {
  if (std::isnan(value)) return "-";
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// Whether all values of a column of metrics.csv are from 0 to 1.
bool is_share(const std::string& column) {
  const auto holds = [&](const char* part) { return column.find(part) != std::string::npos; };
  return holds("win_rate") || holds("loss_rate") || holds("tie_rate") || holds("_share") || holds("_fraction");
}

/// Student's interval; of shares cut at 0 and 1.
Interval interval_of(const SweepSpec& spec, const std::vector<double>& values) {
  const Interval interval = mean_interval(values);
  if (!std::all_of(spec.metric.begin(), spec.metric.end(), is_share)) return interval;
  return {std::clamp(interval.lo, 0.0, 1.0), std::clamp(interval.hi, 0.0, 1.0)};
}

/// "0.91 [0.88, 0.94]".
std::string with_interval(const SweepSpec& spec, const std::vector<double>& values) {
  if (values.empty()) return "-";
  const Interval interval = interval_of(spec, values);
  if (values.size() == 1) return digits(values[0]);
  return cat(digits(mean_of(values)), " [", digits(interval.lo), ", ", digits(interval.hi), "]");
}

std::string metric_text(const SweepSpec& spec) {
  if (spec.metric.size() == 1) return spec.metric.front();
  return cat(spec.goal == SweepGoal::maximize ? "smallest of " : "largest of ", join(spec.metric));
}

/// Those that have a value.
std::vector<const SweepOutcome::Trial*> best_trials(const SweepOutcome& outcome) {
  std::vector<const SweepOutcome::Trial*> best;
  for (const SweepOutcome::Trial& trial : outcome.trials)
    if (trial.value && best.size() < kShown) best.push_back(&trial);
  return best;
}

std::string settings_text(const TrialSettings& settings) {
  std::vector<std::string> parts;
  for (const auto& [key, value] : settings) parts.push_back(cat(key, " ", value));
  return join(parts);
}

/// A row of the table of the best: trial, value, agent-steps, settings.
std::vector<std::string> row_of(const SweepSpec& spec, const SweepOutcome::Trial& trial) {
  return {std::to_string(trial.number), with_interval(spec, trial.values), print_short(trial.agent_steps),
          settings_text(trial.settings)};
}

void write_outcome(Markup& page, const SweepOutcome& outcome) {
  const auto section = page.open("section", {{"class", "section"}});
  page.element("h2", "Sweep");
  const size_t seeds = outcome.spec.seeds.size();
  page.element("p",
               cat("Compared by ", metric_text(outcome.spec), ", mean over ",
                   counted(static_cast<int64_t>(seeds), "seeds"), ". The charts below are those of the best trials."),
               {{"class", "note"}});
  std::vector<TableRow> rows;
  for (const SweepOutcome::Trial* trial : best_trials(outcome)) rows.push_back(row_of(outcome.spec, *trial));
  write_table(page, "Best settings, with 95 % intervals over the seeds (Student's t)",
              {"trial", "value", "agent-steps", "settings"}, rows);
  rows.clear();
  for (const SweepOutcome::Parameter& p : outcome.parameters)
    rows.push_back({p.key, digits(p.share, "%.2f"), digits(p.correlation, "%+.2f")});
  write_table(page,
              cat("Importance over ", counted(outcome.compared, "trials"),
                  ": the share of the spread that a parameter alone explains, and how its rank goes with the value's"),
              {"parameter", "explained share", "rank correlation"}, rows);
  if (outcome.curves.empty()) return;
  LineChart chart;
  chart.title = metric_text(outcome.spec);
  chart.subtitle = "Interquartile mean over seeds, 95 % bootstrap intervals (Agarwal et al. 2021)";
  chart.x_label = "agent-steps";
  chart.y_label = metric_text(outcome.spec);
  chart.panels.push_back({});
  for (size_t c = 0; c < outcome.curves.size(); ++c) {
    const SweepOutcome::Curve& curve = outcome.curves[c];
    ChartLine line{cat("trial ", curve.trial), static_cast<int>(c), false, {}};
    for (size_t k = 0; k < curve.middle.size(); ++k)
      line.points.push_back({curve.agent_steps[k], curve.middle[k], curve.low[k], curve.high[k], false, ""});
    if (!line.points.empty()) chart.panels[0].lines.push_back(std::move(line));
  }
  if (!chart.panels[0].lines.empty()) page.insert(draw_line_chart(chart));
}

}  // namespace

std::string outcome_csv(const SweepOutcome& outcome) {
  std::string text = "trial,rung,agent_steps,value,low,high,seeds,seconds";
  for (const auto& [key, parameter] : outcome.spec.parameters) text += "," + csv_field(key);
  text += "\r\n";
  const auto number = [](double value) { return std::isfinite(value) ? print_number(value) : std::string(); };
  for (const SweepOutcome::Trial& t : outcome.trials) {
    const bool known = !t.values.empty();
    const Interval interval = known ? interval_of(outcome.spec, t.values) : Interval{std::nan(""), std::nan("")};
    text += cat(t.number, ",", t.rung < 0 ? "" : std::to_string(t.rung), ",", number(t.agent_steps), ",",
                t.value ? number(*t.value) : "", ",", number(interval.lo), ",", number(interval.hi), ",",
                t.values.size(), ",", number(t.seconds));
    for (const auto& [key, parameter] : outcome.spec.parameters) {
      text += ",";  // a trial that was told may have no setting of it
      for (const auto& [name, value] : t.settings)
        if (name == key) text += csv_field(value);
    }
    text += "\r\n";
  }
  return text;
}

Json outcome_json(const SweepOutcome& outcome) {
  Json trials = Json::array();
  for (const SweepOutcome::Trial& t : outcome.trials) {
    Json settings = Json::object();
    for (const auto& [key, value] : t.settings) settings[key] = json_of(parse_yaml_text(value, key).root);
    Json one = {{"trial", t.number}, {"settings", settings}, {"rung", t.rung},       {"agent_steps", t.agent_steps},
                {"value", nullptr},  {"values", t.values},   {"seconds", t.seconds}, {"folders", t.folders}};
    if (t.value) one["value"] = *t.value;
    if (!t.values.empty()) {
      const Interval interval = interval_of(outcome.spec, t.values);
      one["interval"] = {interval.lo, interval.hi};
    }
    trials.push_back(std::move(one));
  }
  Json parameters = Json::array();
  for (const SweepOutcome::Parameter& p : outcome.parameters)
    parameters.push_back({{"key", p.key}, {"explained_share", p.share}, {"rank_correlation", p.correlation}});
  return {{"metric", outcome.spec.metric},
          {"goal", FieldCodec<SweepGoal>::print(outcome.spec.goal)},
          {"trials", trials},
          {"parameters", parameters},
          {"compared", outcome.compared}};
}

std::string outcome_text(const SweepOutcome& outcome) {
  std::string text = cat("best trials by ", metric_text(outcome.spec), " (mean over ",
                         counted(static_cast<int64_t>(outcome.spec.seeds.size()), "seeds"),
                         outcome.spec.seeds.size() == 1 ? "" : ", 95 % interval", "):\n");
  for (const SweepOutcome::Trial* trial : best_trials(outcome)) {
    const std::vector<std::string> row = row_of(outcome.spec, *trial);
    text += cat("  trial ", row[0], "  ", row[1], "  after ", row[2], " agent-steps: ", row[3], "\n");
  }
  if (best_trials(outcome).empty()) text += "  none has a value yet\n";
  text += cat("what explains the spread of ", counted(outcome.compared, "trials"), ":\n");
  for (const SweepOutcome::Parameter& p : outcome.parameters)
    text +=
        cat("  ", p.key, "  ", digits(p.share, "%.2f"),
            std::isnan(p.correlation) ? "" : cat("  (rank correlation ", digits(p.correlation, "%+.2f"), ")"), "\n");
  return text;
}

std::string outcome_section(const SweepOutcome& outcome) {
  Markup page;
  write_outcome(page, outcome);
  return page.str();
}

}  // namespace giga
