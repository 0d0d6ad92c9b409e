#include "apps/scenario_picture.hpp"

#include <algorithm>
#include <cmath>

#include "chart/markup.hpp"
#include "core/error.hpp"
#include "core/geometry.hpp"

namespace giga {
namespace {

constexpr double kMapSize = 260, kMapGap = 24, kNameHeight = 22;
constexpr size_t kMapsInRow = 4;
constexpr const char *kGround = "#f4f6f8", *kBorder = "#9aa4b2", *kObstacle = "#6b7686";
constexpr const char* kTeamColour[kNTeams] = {"#0072b2", "#d55e00"};  // of Okabe and Ito (2008)

/// From units of a scenario to pixels of one map; y grows upwards in the game.
struct MapFrame {
  double left, top, scale, height;

  double x(double unit) const { return left + unit * scale; }
  double y(double unit) const { return top + (height - unit) * scale; }
};

void draw_area(Markup& svg, const MapFrame& at, double x1, double y1, double x2, double y2, const char* fill,
               double opacity, const std::string& hint) {
  svg.hint(hint);
  svg.add("rect", {{"x", at.x(x1)},
                   {"y", at.y(y2)},
                   {"width", (x2 - x1) * at.scale},
                   {"height", (y2 - y1) * at.scale},
                   {"fill", fill},
                   {"fill-opacity", svg_number(opacity)}});
}

/// A cone around a heading, or a disc where it is all round. Lengths in units.
void draw_cone(Markup& svg, const MapFrame& at, double x, double y, double heading, double depth, double half_angle,
               const char* colour, double opacity, const std::string& hint) {
  if (!(depth > 0)) return;
  const double far = std::min(depth, 100.0);  // "everywhere" is drawn as far as that
  svg.hint(hint);
  if (half_angle >= static_cast<double>(kPi)) {
    svg.add("circle", {{"cx", at.x(x)},
                       {"cy", at.y(y)},
                       {"r", far * at.scale},
                       {"fill", colour},
                       {"fill-opacity", svg_number(opacity)}});
    return;
  }
  const auto point = [&](double angle) {
    return cat(svg_number(at.x(x + far * std::cos(angle))), " ", svg_number(at.y(y + far * std::sin(angle))));
  };
  const std::string radius = svg_number(far * at.scale);
  const bool large = 2 * half_angle > static_cast<double>(kPi);
  svg.add("path", {{"d", cat("M", svg_number(at.x(x)), " ", svg_number(at.y(y)), "L", point(heading - half_angle), "A",
                             radius, " ", radius, " 0 ", large ? 1 : 0, " 0 ", point(heading + half_angle), "Z")},
                   {"fill", colour},
                   {"fill-opacity", svg_number(opacity)}});
}

/// The first agent of a team, in the middle of the team's start.
void draw_agent(Markup& svg, const MapFrame& at, const SimSpec& spec, const StartArea& start, int team) {
  const auto agent = std::find_if(spec.agents.begin(), spec.agents.end(), [team](auto& a) { return a.team == team; });
  if (agent == spec.agents.end()) return;
  const SimParams& p = spec.params;
  const double x = (start.x1 + start.x2) / 2.0, y = (start.y1 + start.y2) / 2.0;
  const double heading = (start.heading_lo + start.heading_hi) / 2.0;
  const auto half_angle = [](double cosine, bool full) {
    return full ? static_cast<double>(kPi) : std::acos(std::clamp(cosine, -1.0, 1.0));
  };
  const double sees = std::sqrt(static_cast<double>(p.cone_depth2 * agent->range));
  const double shoots = std::sqrt(static_cast<double>(p.damage_cone_depth2 * agent->damage_range));
  const std::string who = cat("an agent of team ", team);
  draw_cone(svg, at, x, y, heading, sees, half_angle(p.cone_cos, p.cone_is_full), kTeamColour[team], 0.14,
            cat(who, " sees as far as ", svg_number(sees)));
  draw_cone(svg, at, x, y, heading, shoots, half_angle(p.damage_cone_cos, p.damage_cone_is_full), kTeamColour[team],
            0.45, cat(who, " shoots as far as ", svg_number(shoots)));
  svg.add("circle", {{"cx", at.x(x)}, {"cy", at.y(y)}, {"r", 4.0}, {"fill", kTeamColour[team]}});
}

void draw_map(Markup& svg, const SimSpec& spec, const MapSpec& map, size_t number, const MapFrame& at) {
  const double wide = spec.params.limit_x, tall = spec.params.limit_y;
  const std::string clip = cat("map", number);
  {
    const auto definition = svg.open("clipPath", {{"id", clip}});
    svg.add("rect", {{"x", at.x(0)}, {"y", at.y(tall)}, {"width", wide * at.scale}, {"height", tall * at.scale}});
  }
  svg.text(map.name, {{"x", at.left}, {"y", at.top - 7}, {"font-size", kTextSize}, {"fill", kInk}});
  const auto inside = svg.open("g", {{"clip-path", cat("url(#", clip, ")")}});
  draw_area(svg, at, 0, 0, wide, tall, kGround, 1, map.name);
  for (int team = 0; team < kNTeams; ++team) {
    const StartArea& s = map.start[team];
    draw_area(svg, at, s.x1, s.y1, s.x2, s.y2, kTeamColour[team], 0.12, cat("team ", team, " starts here"));
  }
  for (const Box& box : map.boxes)
    draw_area(svg, at, box.x1, box.y1, box.x2, box.y2, kObstacle, 1,
              cat("obstacle from [", svg_number(box.x1), ", ", svg_number(box.y1), "] to [", svg_number(box.x2), ", ",
                  svg_number(box.y2), "]"));
  for (int team = 0; team < kNTeams; ++team) draw_agent(svg, at, spec, map.start[team], team);
  svg.add("rect", {{"x", at.x(0)},
                   {"y", at.y(tall)},
                   {"width", wide * at.scale},
                   {"height", tall * at.scale},
                   {"fill", "none"},
                   {"stroke", kBorder}});
}

}  // namespace

std::string scenario_picture(const SimSpec& spec) {
  const SimParams& p = spec.params;
  const double scale = kMapSize / static_cast<double>(std::max(p.limit_x, p.limit_y));
  const double wide = p.limit_x * scale, tall = p.limit_y * scale;
  const size_t columns = std::min(kMapsInRow, spec.maps.size()), rows = (spec.maps.size() + columns - 1) / columns;
  const std::string about = cat(p.n_team[0], " agents of team 0 (blue) against ", p.n_team[1],
                                " of team 1 (orange); light: starts and sight, dark: weapons; ", svg_number(p.limit_x),
                                " x ", svg_number(p.limit_y), " units");
  const double width = std::max(2 * kMargin + static_cast<double>(columns) * (wide + kMapGap) - kMapGap,
                                2 * kMargin + text_width(about, kTextSize));
  const double height = kHeadingHeight + static_cast<double>(rows) * (tall + kMapGap + kNameHeight);
  Markup svg;
  {
    const auto picture = open_picture(svg, width, height, cat("Maps of ", spec.name, ". ", about));
    svg.text(spec.name,
             {{"x", kMargin}, {"y", 32.0}, {"font-size", kTitleSize}, {"font-weight", "600"}, {"fill", kInk}});
    svg.text(about, {{"x", kMargin}, {"y", 52.0}, {"font-size", kTextSize}, {"fill", kQuiet}});
    for (size_t k = 0; k < spec.maps.size(); ++k) {
      const double left = kMargin + static_cast<double>(k % columns) * (wide + kMapGap);
      const double top =
          kHeadingHeight + kNameHeight + static_cast<double>(k / columns) * (tall + kMapGap + kNameHeight);
      draw_map(svg, spec, spec.maps[k], k, {left, top, scale, p.limit_y});
    }
  }
  return svg.str();
}

}  // namespace giga
