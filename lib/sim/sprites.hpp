// Sprites and tails: how an agent stands in an image (rules 8.3 and 8.4).
#pragma once

#include "sim/image_rows.hpp"
#include "sim/world.hpp"

namespace giga {

/// How an agent is painted.
enum class Paint : uint8_t {
  none,
  ego,   ///< bright, in an image of its own
  blue,  ///< a mate; in the global image team 0
  red,   ///< an opponent; in the global image team 1
};

constexpr int kTail = 4;  ///< pixels, each fainter than the one before
GIGA_HD int tail_strength(int k) { return 204 - 51 * k; }

/// An agent in an image.
struct Mark {
  int16_t x, y;  ///< its pixel
  int16_t tail_x[kTail], tail_y[kTail];
  uint8_t height;  ///< altitude, 0 to 255
  uint8_t sprite;  ///< bits: 1 centre, 2 edges, 4 corners
  Paint paint;
  bool tail;  ///< whether it has one
};

/// Where agent a is; neither paint nor tail.
GIGA_HD Mark place_mark(const Parameters auto& p, const World auto& w, int a) {
  Mark mark{};
  const int x = pixel_of(p, w.x[a], p.limit_x), y = pixel_of(p, w.y[a], p.limit_y);
  const float last = static_cast<float>(p.resolution - 1);
  const SinCos heading = sin_cos(w.heading[a]);
  for (int k = 0; k < kTail; ++k) {
    const float back = static_cast<float>(k + 1);
    mark.tail_x[k] = static_cast<int16_t>(clamp(static_cast<float>(x) - back * heading.cos, 0.0f, last));
    mark.tail_y[k] = static_cast<int16_t>(clamp(static_cast<float>(y) - back * heading.sin, 0.0f, last));
  }
  mark.x = static_cast<int16_t>(x);
  mark.y = static_cast<int16_t>(y);
  mark.height = static_cast<uint8_t>(std::rint(w.z[a] * 255.0f / kAltitudeLimit));
  mark.sprite = static_cast<uint8_t>(table_value(p.agents.sprite + a));
  return mark;
}

/// Pixel k of the tail of a mark that has one.
GIGA_HD void draw_tail(const ImageRows& image, const Mark& mark, bool blue, int k) {
  uint8_t* pixel = mark.tail ? image.at(mark.tail_x[k], mark.tail_y[k]) : nullptr;
  if (pixel) add_to(pixel + (blue ? 2 : 0), tail_strength(k), image.wraps);
}

constexpr int kSpritePixels = 9;  ///< 3 x 3

/// Pixel k of a sprite; where several overlap, the largest value of each channel counts.
GIGA_HD void draw_sprite(const ImageRows& image, const Mark& mark, int k) {
  const int dx = k / 3 - 1, dy = k % 3 - 1;
  const int bit = (dx != 0 ? 1 : 0) + (dy != 0 ? 1 : 0);  // centre, edge, corner
  if (mark.paint == Paint::none || !(mark.sprite >> bit & 1)) return;
  uint8_t* pixel = image.at(mark.x + dx, mark.y + dy);
  if (!pixel) return;
  const bool ego = mark.paint == Paint::ego;
  raise_to(pixel, ego ? 255 - mark.height : (mark.paint == Paint::red ? 255 : 0));
  raise_to(pixel + 1, ego ? 255 : mark.height);
  raise_to(pixel + 2, ego ? 255 - mark.height : (mark.paint == Paint::blue ? 255 : 0));
}

}  // namespace giga
