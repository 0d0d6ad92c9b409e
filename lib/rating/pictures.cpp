// What of a sheet goes into which picture.
#include "rating/pictures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "chart/heat_map.hpp"
#include "chart/line_chart.hpp"
#include "core/error.hpp"
#include "math/wilson.hpp"
#include "rating/groups.hpp"

namespace giga {
namespace {

constexpr const char* kBeyond = "beyond any number: never lost (up) or never won (down) against who is rated";

void set_x_axis(TrainingAxis along, LineChart& chart) {
  const bool time = along == TrainingAxis::seconds;
  chart.x_label = time ? "wall-clock time of training" : "agent-steps";
  chart.x_unit = time ? AxisUnit::seconds : AxisUnit::count;
}

ChartPoint point_of(const PlayerInfo& info, TrainingAxis along) {
  ChartPoint point;
  point.x = along == TrainingAxis::seconds ? info.seconds : info.agent_steps;
  point.ringed = info.best;
  return point;
}

/// The group that is shown: the anchor's, unless no checkpoint is in it.
int shown_group(const RatingSheet& sheet) {
  std::vector<int> checkpoints(static_cast<size_t>(sheet.ratings.n_groups), 0);
  for (const Rating& r : sheet.ratings.list)
    if (!sheet.infos[static_cast<size_t>(r.player)].is_baseline()) ++checkpoints[static_cast<size_t>(r.group)];
  if (checkpoints[0] > 0) return 0;
  return static_cast<int>(std::max_element(checkpoints.begin(), checkpoints.end()) - checkpoints.begin());
}

class RatingChart {
 public:
  RatingChart(const RatingSheet& sheet, TrainingAxis along)
      : sheet_(sheet), along_(along), shown_(shown_group(sheet)) {}

  std::string draw() const {
    const Ratings& ratings = sheet_.ratings;
    LineChart chart;
    chart.title = "Rating over training: " + sheet_.scenario;
    chart.subtitle = cat("Elo by maximum likelihood, ", reference(), " = 0; bars: 95 % intervals; grey: baselines");
    set_x_axis(along_, chart);
    chart.y_label = "Elo";
    chart.ring_label = "best checkpoint";
    chart.beyond_label = kBeyond;
    if (ratings.sides == Sides::alike) {
      chart.panels = {panel(-1)};
    } else {
      for (int side = 0; side < kNSides; ++side) chart.panels.push_back(panel(side));
    }
    std::erase_if(chart.panels, [](const ChartPanel& p) { return p.lines.empty(); });
    return chart.panels.empty() ? "" : draw_line_chart(chart);
  }

 private:
  /// Who is at 0.
  std::string reference() const {
    for (const Rating& r : sheet_.ratings.list)
      if (r.group == shown_) return sheet_.ratings.name(sheet_.ratings.list[static_cast<size_t>(r.reference)]);
    return sheet_.ratings.anchor;
  }

  const Rating* find(size_t player, int side) const {
    for (const Rating& r : sheet_.ratings.list)
      if (r.player == static_cast<int>(player) && r.side == side) return &r;
    return nullptr;
  }

  /// Where a rating stands on the scale of the shown group; NaN = nowhere.
  Estimate shown(const Rating& r) const {
    if (r.group == shown_) return r.in_group;
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    return shown_ == 0 ? r.rating : Estimate{kUnknown, kUnknown};
  }

  ChartPanel panel(int side) const {
    ChartPanel panel;
    if (side >= 0) panel.title = cat("Team ", side);
    const std::vector<RatedRun> runs = runs_of(sheet_);
    for (size_t k = 0; k < runs.size(); ++k) {
      ChartLine line{runs[k].short_name, runs.size() == 1 ? std::max(side, 0) : static_cast<int>(k), false, {}};
      if (runs.size() == 1 && side >= 0) line.label = panel.title;
      for (const size_t player : runs[k].players) {
        const Rating* rating = find(player, side);
        if (!rating || std::isnan(shown(*rating).value)) continue;
        const Estimate e = shown(*rating);
        ChartPoint point = point_of(sheet_.infos[player], along_);
        point.y = e.value;
        point.low = e.low();
        point.high = e.high();
        point.hint =
            cat(sheet_.ratings.label(*rating),
                std::isfinite(e.value) ? cat(": ", std::lround(e.value), " +- ", std::lround(e.high() - e.value)) : "");
        line.points.push_back(point);
      }
      if (!line.points.empty()) panel.lines.push_back(std::move(line));
    }
    for (const Rating& r : sheet_.ratings.list) {
      const Estimate e = shown(r);
      if (r.side != side || !std::isfinite(e.value) || !sheet_.infos[static_cast<size_t>(r.player)].is_baseline())
        continue;
      panel.levels.push_back({sheet_.ratings.name(r), e.value, e.low(), e.high()});
    }
    return panel;
  }

  const RatingSheet& sheet_;
  TrainingAxis along_;
  int shown_;
};

/// A run's team against a baseline.
ChartLine win_rate_line(const RatingSheet& sheet, TrainingAxis along, const RatedRun& run, int side, size_t baseline) {
  ChartLine line;
  const size_t n = sheet.table.players.size();
  for (const size_t player : run.players) {
    const Games& g = sheet.table.games[side == 0 ? player * n + baseline : baseline * n + player];
    if (n_games(g) == 0) continue;
    const int wins = side == 0 ? g.wins : g.losses;
    const Interval interval = wilson95(wins, n_games(g));
    ChartPoint point = point_of(sheet.infos[player], along);
    point.y = static_cast<double>(wins) / n_games(g);
    point.low = interval.lo;
    point.high = interval.hi;
    point.hint = cat(sheet.table.players[player], ", team ", side, ": won ", wins, " of ", n_games(g));
    line.points.push_back(point);
  }
  return line;
}

}  // namespace

std::string rating_picture(const RatingSheet& sheet, TrainingAxis along) { return RatingChart(sheet, along).draw(); }

std::string win_rate_picture(const RatingSheet& sheet, TrainingAxis along) {
  LineChart chart;
  chart.title = "Win rate against baselines over training: " + sheet.scenario;
  chart.subtitle = "share of games won, each team on its own side (a tie is no win); bars: 95 % intervals";
  set_x_axis(along, chart);
  chart.y_label = "games won";
  chart.ring_label = "best checkpoint";
  chart.y_range = {{0, 1}};
  chart.y_percent = true;
  const std::vector<RatedRun> runs = runs_of(sheet);
  for (size_t baseline = 0; baseline < sheet.infos.size(); ++baseline) {
    if (!sheet.infos[baseline].is_baseline()) continue;
    ChartPanel panel;
    panel.title = "against " + sheet.table.players[baseline];
    for (size_t k = 0; k < runs.size(); ++k) {
      for (int side = 0; side < kNSides; ++side) {
        ChartLine line = win_rate_line(sheet, along, runs[k], side, baseline);
        if (line.points.empty()) continue;
        line.label = runs.size() == 1 ? cat("team ", side) : cat(runs[k].short_name, ", team ", side);
        line.colour = runs.size() == 1 ? side : static_cast<int>(k);
        line.dashed = side == 1;
        panel.lines.push_back(std::move(line));
      }
    }
    if (!panel.lines.empty()) chart.panels.push_back(std::move(panel));
  }
  return chart.panels.empty() ? "" : draw_line_chart(chart);
}

std::string matrix_picture(const RatingSheet& sheet) {
  const GameTable& table = sheet.table;
  const size_t n = table.players.size();
  HeatMap map;
  map.title = "Cross-play: " + sheet.scenario;
  map.subtitle = "percent of the points that the row takes from the column; a tie is half a point";
  map.row_label = "plays side 0";
  map.column_label = "plays side 1";
  map.scale_label = "points of side 0";
  map.rows = map.columns = short_names(sheet);
  for (size_t k = 1; k < n; ++k)
    if (sheet.infos[k].run != sheet.infos[k - 1].run) map.blocks.push_back(k);
  for (size_t i = 0; i < n; ++i)
    for (size_t j = 0; j < n; ++j) {
      const Games& g = table.games[i * n + j];
      map.values.push_back(share_of_points(g));
      map.hints.push_back(cat(table.players[i], " against ", table.players[j], ": ", g.wins, " won, ", g.ties,
                              " tied, ", g.losses, " lost"));
    }
  return n == 0 ? "" : draw_heat_map(map);
}

}  // namespace giga
