#include "apps/match_report.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "config/names.hpp"
#include "core/error.hpp"
#include "io/metrics_csv.hpp"
#include "io/number.hpp"
#include "math/wilson.hpp"

namespace giga {
namespace {

/// How A fared, by kind of outcome.
struct Share {
  const char *word, *rate_name, *count_name;
  int count;
};
std::vector<Share> shares(const TeamResult& r) {
  return {{"won", "win_rate", "wins", r.wins()},
          {"lost", "loss_rate", "losses", r.losses()},
          {"tied", "tie_rate", "ties", r.match.ties}};
}

/// Whether the information of any side was measured.
bool is_measured(const MatchResult& m) { return m.mutual_information[0] || m.mutual_information[1]; }

/// The figures of one side of a match.
MetricsRow side_figures(const MatchResult& m, int side) {
  MetricsRow row = {{"mean_return", m.mean_return[side]},
                    {"mean_return_original", m.mean_return_masked[side]},
                    {"mean_score", m.mean_score[side]},
                    {"mean_survivors", m.mean_survivors[side]}};
  for (size_t cause = 0; cause < kNDeaths; ++cause)
    row.emplace_back(cat("mean_deaths_", kDeathNames[cause]), m.mean_deaths[side][cause]);
  if (is_measured(m))
    row.emplace_back("mutual_information", m.mutual_information[static_cast<size_t>(side)].value_or(NAN));
  return row;
}

/// The same of the episodes of each policy that shares a side; the result as `side` sees it.
struct Part {
  std::string policy;
  TeamResult result;
};
std::vector<Part> parts_of(const MatchReport& report, const TeamResult& r, int side) {
  const std::vector<std::string>& names = side == r.team ? report.policies_of_a : report.policies_of_b;
  const std::vector<MatchResult>& all = r.match.of_each[side];
  std::vector<Part> parts;
  for (size_t k = 0; k < all.size(); ++k) parts.push_back({names[k], {side, r.opponent, all[k]}});
  return parts;
}

Json shares_json(const TeamResult& r) {
  Json json{{"episodes", r.match.episodes}};
  for (const Share& s : shares(r)) json[s.count_name] = s.count;
  for (const Share& s : shares(r)) {
    const Interval ci = wilson95(s.count, r.match.episodes);
    json[s.rate_name] = r.share(s.count);
    json[cat(s.rate_name, "_ci95")] = {ci.lo, ci.hi};
  }
  return json;
}

Json policies_json(const std::vector<Part>& parts) {
  Json all = Json::array();
  for (const Part& part : parts) {
    all.push_back({{"policy", part.policy}});
    all.back().update(shares_json(part.result));
  }
  return all;
}

std::string information_text(const MatchResult& m) {
  if (!is_measured(m)) return "";
  std::string text = "  mutual information of observation and action:";
  for (size_t side = 0; side < kNTeams; ++side) {
    char nats[32] = "none";
    if (m.mutual_information[side]) std::snprintf(nats, sizeof nats, "%.3f nats", *m.mutual_information[side]);
    text += cat(side == 0 ? " side " : ", side ", side, " ", nats);
  }
  return text + "\n";
}

/// A line for each policy that shares a side.
std::string parts_text(const MatchReport& report, const TeamResult& r) {
  std::string text;
  for (int side = 0; side < kNTeams; ++side)
    for (const Part& part : parts_of(report, r, side)) {
      const Interval ci = wilson95(part.result.wins(), part.result.match.episodes);
      char line[200];
      std::snprintf(line, sizeof line, "  side %d: won %.3f  [%.3f, %.3f], lost %.3f of %d episodes: ", side,
                    part.result.share(part.result.wins()), ci.lo, ci.hi, part.result.share(part.result.losses()),
                    part.result.match.episodes);
      text += cat(line, part.policy, "\n");
    }
  return text;
}

std::string result_text(const MatchReport& report, const TeamResult& r) {
  char line[200];
  std::string text =
      cat(report.a, " on side ", r.team, " against ", r.opponent, ", ", counted(r.match.episodes, "episodes"), "\n");
  for (const Share& s : shares(r)) {
    const Interval ci = wilson95(s.count, r.match.episodes);
    std::snprintf(line, sizeof line, "  %-6s %.3f  [%.3f, %.3f]\n", s.word, r.share(s.count), ci.lo, ci.hi);
    text += line;
  }
  std::snprintf(line, sizeof line, "  %.1f steps an episode\n", r.match.mean_length);
  text += line;
  std::snprintf(line, sizeof line, "  side %10s %8s %11s | died of: %s %9s %9s %14s\n", "return", "score", "survivors",
                "damage", "an agent", "obstacle", "out of bounds");
  text += line;
  for (int side = 0; side < kNTeams; ++side) {
    const MatchResult& m = r.match;
    const double* deaths = m.mean_deaths[side];
    std::snprintf(line, sizeof line, "  %4d %10.4g %8.2f %11.2f | %16.2f %9.2f %9.2f %14.2f\n", side,
                  m.mean_return[side], m.mean_score[side], m.mean_survivors[side], deaths[0], deaths[1], deaths[2],
                  deaths[3]);
    text += line;
  }
  return text + information_text(r.match) + parts_text(report, r);
}

}  // namespace

std::string report_text(const MatchReport& report) {
  std::string text;
  for (const TeamResult& r : report.results) text += (text.empty() ? "" : "\n") + result_text(report, r);
  return text;
}

std::string report_csv(const MatchReport& report) {
  std::string text;
  for (const TeamResult& r : report.results) {
    std::vector<std::string> names = {"a", "b", "scenario", "side_of_a", "episodes"};
    std::vector<std::string> fields = {csv_field(report.a), csv_field(r.opponent), csv_field(report.scenario),
                                       cat(r.team), cat(r.match.episodes)};
    const auto add = [&](const std::string& name, double value) {
      names.push_back(name);
      fields.push_back(std::isnan(value) ? "" : print_number(value));  // as in metrics.csv
    };
    for (const Share& s : shares(r)) {
      const Interval ci = wilson95(s.count, r.match.episodes);
      add(s.count_name, s.count);
      add(s.rate_name, r.share(s.count));
      add(cat(s.rate_name, "_lo95"), ci.lo);
      add(cat(s.rate_name, "_hi95"), ci.hi);
    }
    add("mean_length", r.match.mean_length);
    for (const auto& [suffix, side] : {std::pair{"_a", r.team}, std::pair{"_b", 1 - r.team}})
      for (const auto& [name, value] : side_figures(r.match, side)) add(name + suffix, value);
    if (text.empty()) text = join(names, ",") + "\r\n";
    text += join(fields, ",") + "\r\n";
  }
  return text;
}

Json result_json(const MatchReport& report, const TeamResult& r) {
  Json json{{"team", r.team}};
  json.update(shares_json(r));
  json["mean_length"] = r.match.mean_length;
  for (const auto& [name, value] : side_figures(r.match, r.team)) json[name] = value;
  for (const auto& [name, value] : side_figures(r.match, 1 - r.team)) json["opponent"][name] = value;
  if (const auto parts = parts_of(report, r, r.team); !parts.empty()) json["policies"] = policies_json(parts);
  if (const auto parts = parts_of(report, r, 1 - r.team); !parts.empty())
    json["opponent"]["policies"] = policies_json(parts);
  return json;
}

}  // namespace giga
