// Map pictures: what of an image does not change in an episode, prepared once for each map (rules 8.2), and the
// waypoint, which does.
#pragma once

#include "sim/image_rows.hpp"
#include "sim/waypoint.hpp"
#include "sim/world.hpp"

namespace giga {

/// The pictures that each map has.
enum class Picture : int {
  ego,     ///< obstacles and a white border
  hurt,    ///< obstacles and a red border
  global,  ///< obstacles and a white border on all four sides
};
constexpr int kNPictures = 3;

/// Bytes from one picture to the next: wide copies need a multiple of 16.
GIGA_HD int picture_stride(int side) { return (image_bytes(side) + 15) & ~15; }

/// A picture of the world's map, from row x0 on.
GIGA_HD const uint8_t* picture_of(const Parameters auto& p, const World auto& w, Picture picture, int x0) {
  const int64_t number = static_cast<int64_t>(*w.map) * kNPictures + static_cast<int>(picture);
  return p.maps.pictures + number * picture_stride(p.resolution) + x0 * row_bytes(p.resolution);
}

/// The square of the waypoint. All lanes draw the same image, so that they may leave together. The original paints it
/// black while there is none (Q21).
template <class Lanes>
GIGA_HD void draw_waypoint(const Lanes& lanes, const Parameters auto& p, const World auto& w, const ImageRows& image) {
  const bool active = waypoint_shown(p, w);
  if (!p.waypoints || !(active || p.original())) return;
  const int width = pixels_of(p.waypoint_size, p.limit_x, p.resolution);
  const int height = pixels_of(p.waypoint_size, p.limit_y, p.resolution);
  const int x = pixel_of(p, w.waypoint[0], p.limit_x), y = pixel_of(p, w.waypoint[1], p.limit_y);
  const int level = active ? 127 : 0;
  lanes.each(width * height, [&](int k) { set_pixel(image.at(x + k / height, y + k % height), level, 0, level); });
}

}  // namespace giga
