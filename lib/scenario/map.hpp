// Map: obstacles and start areas, in units of a frame that is stretched to the size of the scenario.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "config/fields.hpp"
#include "core/geometry.hpp"

namespace giga {

/// An obstacle: [x1, y1, x2, y2], or [x1, y1, x2, y2, z1, z2] where it does not fill the whole height.
struct MapBox {
  std::array<float, 4> area{};
  std::array<float, 2> height = {0, 10};  ///< not stretched; only looked at with collision.obstacle_heights

  bool operator==(const MapBox&) const = default;
};

template <>
struct FieldCodec<MapBox> {
  static bool read(const Node& node, MapBox& box, const Allowed& allowed, const ReadSite& site);
  static std::string print(const MapBox& box);
  static std::string expected(const Allowed&) { return "a box [x1, y1, x2, y2] or [x1, y1, x2, y2, z1, z2]"; }
  static ValueShape shape(const Allowed&);
};

/// Where a team starts: everything is drawn uniformly.
struct MapStart {
  std::array<float, 4> area{};
  std::array<float, 2> height = {0, 0};
  std::array<float, 2> heading = {0, 0};

  bool operator==(const MapStart&) const = default;
};

template <class V>
void visit_fields(V& v, MapStart& c) {
  v("area", c.area, "x1, y1, x2, y2 in units of the map's size");
  v("height", c.height, "altitudes from, to; not stretched", range(0, 10));
  v("heading", c.heading, "headings from, to (radians, not degrees; 0 = along x, pi / 2 = along y)", range(-6.3, 6.3));
}

struct Map {
  std::string description;
  std::optional<std::string> flipped_of;
  std::array<float, 2> size = {10, 10};
  std::vector<MapBox> boxes;
  MapStart team_0 = {{6, 1, 9, 9}, {0, 0}, {kPi, kPi}};
  MapStart team_1 = {{1, 1, 4, 9}, {0, 0}, {0, 0}};

  bool operator==(const Map&) const = default;
};

template <class V>
void visit_fields(V& v, Map& c) {
  v("description", c.description, "one line for people");
  v("flipped_of", c.flipped_of, "name of another map: the same with the teams' starts exchanged; needs no other key");
  v("size", c.size,
    "width (x) and height (y) of the frame in which the map is drawn; the frame is stretched to limit_x, limit_y",
    at_least(0.01));
  v("boxes", c.boxes, "obstacles");
  v.group("team_0", c.team_0, "where team 0 starts");
  v.group("team_1", c.team_1, "where team 1 starts");
}

}  // namespace giga
