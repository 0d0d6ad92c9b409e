// The global image: a whole world, with all who live (rules 8.4).
#pragma once

#include "sim/map_picture.hpp"
#include "sim/sprites.hpp"

namespace giga {

/// Agent a in the image of its world; the dead are not drawn.
GIGA_HD Mark global_mark(const Parameters auto& p, const World auto& w, int a) {
  Mark mark = place_mark(p, w, a);
  mark.tail = w.alive[a] != 0;
  mark.paint = !mark.tail ? Paint::none : (p.team_of(a) == 0 ? Paint::blue : Paint::red);
  return mark;
}

/// Draws the rows of the image. `marks`: room for all agents.
template <class Lanes>
GIGA_HD void draw_global_image(const Lanes& lanes, const Parameters auto& p, const World auto& w,
                               const ImageRows& image, Mark* marks) {
  const int n = p.n_agents;
  lanes.each(n, [&](int a) { marks[a] = global_mark(p, w, a); });
  copy_bytes(lanes, picture_of(p, w, Picture::global, image.x0), image.bytes,
             (image.x1 - image.x0) * row_bytes(image.side));
  draw_waypoint(lanes, p, w, image);
  lanes.each(n * kTail, [&](int k) {
    const Mark& mark = marks[k / kTail];
    draw_tail(image, mark, mark.paint == Paint::blue, k % kTail);
  });
  lanes.each(n * kSpritePixels, [&](int k) { draw_sprite(image, marks[k / kSpritePixels], k % kSpritePixels); });
}

/// [resolution, resolution, 3] of bytes.
struct GlobalImage {
  static constexpr Observation id = Observation::global_image;
  static constexpr const char* name = "global_image";
  static constexpr ObservationOf of = ObservationOf::world;
  using Element = uint8_t;
  static constexpr ElementType type = ElementType::u8;

  GIGA_HD static bool offered(const Parameters auto& p) { return p.resolution > 0; }
  GIGA_HD static ObservationShape shape(const Parameters auto& p) { return {p.resolution, p.resolution, kChannels}; }
};

}  // namespace giga
