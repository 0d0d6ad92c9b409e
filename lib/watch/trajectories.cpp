#include "watch/trajectories.hpp"

#include <algorithm>
#include <cmath>

#include "chart/markup.hpp"
#include "core/error.hpp"
#include "watch/games.hpp"

namespace giga {
namespace {

constexpr double kGap = 22, kName = 22;
constexpr const char *kGround = "#f4f6f8", *kBorder = "#9aa4b2", *kObstacle = "#8a94a3", *kWaypoint = "#009e73";

/// Sizes in pixels of one. What is told of a few agents would hide the paths of a crowd.
struct Looks {
  double side, line, ring, ring_line, end, cross, cross_line, step;
  int in_row;
};
constexpr Looks kFew{300, 1.4, 3.2, 1.6, 3.6, 4, 2, 0, 4}, kCrowd{640, 0.6, 0.7, 0.5, 1.2, 1.4, 0.6, 2, 2};
const Looks& looks_of(const Replay& replay) { return replay.is_crowd() ? kCrowd : kFew; }

/// Where the episodes stand, and from map units to pixels of one.
struct Layout {
  const Looks& looks;
  double scale, width, height, top;
  int columns, rows;

  Layout(const Replay& replay, double head) : looks(looks_of(replay)), top(head) {
    const auto x = static_cast<double>(replay.rules.limit_x), y = static_cast<double>(replay.rules.limit_y);
    scale = looks.side / std::max(x, y);
    width = x * scale;
    height = y * scale;
    const int count = static_cast<int>(replay.episodes.size());
    columns = std::min(count, looks.in_row);
    rows = (count + looks.in_row - 1) / looks.in_row;
  }
  double left_of(size_t k) const { return kMargin + static_cast<double>(k % in_row()) * (width + kGap); }
  double top_of(size_t k) const { return top + kName + static_cast<double>(k / in_row()) * (height + kGap + kName); }
  Point at(size_t k, double x, double y) const { return {left_of(k) + x * scale, top_of(k) + height - y * scale}; }
  double picture_width() const { return 2 * kMargin + columns * (width + kGap) - kGap; }
  double picture_height() const { return top + rows * (height + kGap + kName) - kGap + kMargin; }

 private:
  size_t in_row() const { return static_cast<size_t>(looks.in_row); }
};

std::string point_text(const Point& p) { return cat(svg_number(p.x), " ", svg_number(p.y)); }

/// The path of an agent until it dies; of a crowd without points that lie less than a step from those before.
std::vector<Point> path_of(const GameView& game, const Layout& layout, size_t k, int agent) {
  std::vector<Point> path;
  const int last = game.last(agent);
  for (int state = 0; state <= last; ++state) {
    const AgentPlace p = game.place(agent, state);
    const Point at = layout.at(k, p.x, p.y);
    const bool near = state > 0 && std::hypot(at.x - path.back().x, at.y - path.back().y) < layout.looks.step;
    if (!near || state == last) path.push_back(at);
  }
  return path;
}

std::string ending(const ReplayEpisode& e) {
  const std::string winner =
      e.winner == ReplayEnd::tie ? "a tie" : cat("team ", e.winner == ReplayEnd::team_0 ? 0 : 1, " wins");
  return cat(winner, " after ", e.steps, " steps");
}

void draw_episode(Markup& svg, const GameView& game, const Layout& layout, size_t k, int number) {
  const ReplayRules& rules = game.replay().rules;
  const auto box = [&](double x1, double y1, double x2, double y2, const char* fill, double opacity) {
    const Point low = layout.at(k, x1, y2), high = layout.at(k, x2, y1);
    svg.add("rect", {{"x", low.x},
                     {"y", low.y},
                     {"width", high.x - low.x},
                     {"height", high.y - low.y},
                     {"fill", fill},
                     {"fill-opacity", svg_number(opacity)}});
  };
  svg.text(cat("episode ", number, ": ", ending(game.episode())),
           {{"x", layout.left_of(k)}, {"y", layout.top_of(k) - 7}, {"font-size", kTextSize}, {"fill", kQuiet}});
  box(0, 0, static_cast<double>(rules.limit_x), static_cast<double>(rules.limit_y), kGround, 1);
  for (const auto& b : game.boxes())
    box(static_cast<double>(b[0]), static_cast<double>(b[1]), static_cast<double>(b[2]), static_cast<double>(b[3]),
        kObstacle, 1);
  for (const ReplayWaypoint& w : game.episode().waypoints)
    box(static_cast<double>(w.x1), static_cast<double>(w.y1), static_cast<double>(w.x2), static_cast<double>(w.y2),
        kWaypoint, 0.25);
  const Looks& looks = layout.looks;
  const Point low = layout.at(k, 0, static_cast<double>(rules.limit_y));
  svg.add("rect", {{"x", low.x},
                   {"y", low.y},
                   {"width", layout.width},
                   {"height", layout.height},
                   {"fill", "none"},
                   {"stroke", kBorder}});
  for (int i = 0; i < game.replay().n_agents(); ++i) {
    const char* colour = kTeamColours[game.team(i)];
    const std::vector<Point> path = path_of(game, layout, k, i);
    std::string d = "M" + point_text(path[0]);
    for (size_t p = 1; p < path.size(); ++p) d += "L" + point_text(path[p]);
    if (!game.replay().is_crowd()) svg.hint(cat("agent ", i, " of team ", game.team(i)));
    svg.add("path", {{"d", d},
                     {"fill", "none"},
                     {"stroke", colour},
                     {"stroke-width", svg_number(looks.line)},
                     {"stroke-opacity", "0.75"},
                     {"stroke-linejoin", "round"}});
    svg.add("circle", {{"cx", path[0].x},
                       {"cy", path[0].y},
                       {"r", looks.ring},
                       {"fill", "#ffffff"},
                       {"stroke", colour},
                       {"stroke-width", svg_number(looks.ring_line)}});
    const Point end = path.back();
    if (game.alive(i, game.episode().steps)) {
      svg.add("circle", {{"cx", end.x}, {"cy", end.y}, {"r", looks.end}, {"fill", colour}});
    } else {
      const double r = looks.cross;
      svg.add("path", {{"d", cat("M", point_text({end.x - r, end.y - r}), "L", point_text({end.x + r, end.y + r}), "M",
                                 point_text({end.x - r, end.y + r}), "L", point_text({end.x + r, end.y - r}))},
                       {"stroke", colour},
                       {"stroke-width", svg_number(looks.cross_line)}});
    }
  }
}

}  // namespace

std::string trajectories_svg(const Replay& replay, int first) {
  GIGA_CHECK(!replay.episodes.empty(), "a replay without episodes");
  constexpr double kLine = 18;
  const Layout layout(replay, kHeadingHeight + kLine);
  Markup svg;
  {
    const auto picture = open_picture(svg, std::max(layout.picture_width(), 420.0), layout.picture_height(),
                                      cat("Paths of ", replay.players[0], " against ", replay.players[1]));
    svg.text(cat(replay.players[0], " against ", replay.players[1]),
             {{"x", kMargin}, {"y", kMargin + 12}, {"font-size", kTitleSize}, {"fill", kInk}});
    svg.text(cat(replay.scenario_name, ", ", replay.rules.limit_x, " x ", replay.rules.limit_y,
                 " units; blue: team 0, orange: team 1"),
             {{"x", kMargin}, {"y", kMargin + 33}, {"font-size", kTextSize}, {"fill", kQuiet}});
    svg.text(cat("rings: starts, crosses: deaths, dots: ends", replay.rules.waypoints ? ", green: waypoints" : ""),
             {{"x", kMargin}, {"y", kMargin + 33 + kLine}, {"font-size", kTextSize}, {"fill", kQuiet}});
    for (size_t k = 0; k < replay.episodes.size(); ++k)
      draw_episode(svg, GameView(replay, replay.episodes[k]), layout, k, first + static_cast<int>(k));
  }
  return svg.str();
}

Canvas trajectories_pixels(const Replay& replay) {
  GIGA_CHECK(!replay.episodes.empty(), "a replay without episodes");
  constexpr double kSharp = 2;  // pixels of the picture for one of the SVG
  const Layout layout(replay, kMargin - kName);
  const Looks& looks = layout.looks;
  const auto size = [](double length) { return static_cast<int>(std::lround(kSharp * length)); };
  Canvas canvas(size(layout.picture_width()), size(layout.picture_height()), colour_of("#ffffff"));
  const auto scaled = [](Point p) { return Point{kSharp * p.x, kSharp * p.y}; };
  for (size_t k = 0; k < replay.episodes.size(); ++k) {
    const GameView game(replay, replay.episodes[k]);
    const auto box = [&](auto x1, auto y1, auto x2, auto y2, const char* fill, double opacity) {
      canvas.rectangle(scaled(layout.at(k, static_cast<double>(x1), static_cast<double>(y1))),
                       scaled(layout.at(k, static_cast<double>(x2), static_cast<double>(y2))), colour_of(fill),
                       opacity);
    };
    box(0, 0, replay.rules.limit_x, replay.rules.limit_y, kGround, 1);
    for (const auto& b : game.boxes()) box(b[0], b[1], b[2], b[3], kObstacle, 1);
    for (const ReplayWaypoint& w : game.episode().waypoints) box(w.x1, w.y1, w.x2, w.y2, kWaypoint, 0.25);
    for (int i = 0; i < replay.n_agents(); ++i) {
      const Colour colour = colour_of(kTeamColours[game.team(i)]);
      std::vector<Point> path = path_of(game, layout, k, i);
      for (Point& p : path) p = scaled(p);
      canvas.path(path, kSharp * looks.line, colour, 0.75);
      canvas.disc(path[0], kSharp * looks.ring, colour_of("#ffffff"));
      canvas.ring(path[0], kSharp * looks.ring, kSharp * looks.ring_line, colour);
      const Point end = path.back();
      if (game.alive(i, game.episode().steps)) {
        canvas.disc(end, kSharp * looks.end, colour);
        continue;
      }
      const double r = kSharp * looks.cross;
      canvas.line({end.x - r, end.y - r}, {end.x + r, end.y + r}, kSharp * looks.cross_line, colour);
      canvas.line({end.x - r, end.y + r}, {end.x + r, end.y - r}, kSharp * looks.cross_line, colour);
    }
  }
  return canvas;
}

}  // namespace giga
