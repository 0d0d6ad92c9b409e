// The ego image: the world as one agent sees it, with itself in it (rules 8.3).
#pragma once

#include "sim/map_picture.hpp"
#include "sim/sight.hpp"
#include "sim/sprites.hpp"

namespace giga {

/// Agent a as e sees it. The ego is drawn whatever it sees, its tail among the others' only where it sees itself.
GIGA_HD Mark ego_mark(const Parameters auto& p, const World auto& w, int e, int a) {
  Mark mark = place_mark(p, w, a);
  const uint32_t* seen = w.seen + static_cast<int64_t>(e) * words_for(p.n_agents);
  mark.tail = (seen[a / 32] >> (a & 31) & 1u) != 0;
  const Paint other = !mark.tail ? Paint::none : (p.team_of(a) == p.team_of(e) ? Paint::blue : Paint::red);
  mark.paint = a == e ? Paint::ego : other;
  return mark;
}

/// Whether e took damage in its last step. Its counters say so, so that an image needs nothing but the state.
GIGA_HD bool took_damage(const Parameters auto& p, const World auto& w, int e) {
  const uint8_t* tracked = w.tracked + static_cast<int64_t>(e) * p.n_agents;
  bool hurt = false;
  for (int b = 0; b < p.n_agents; ++b) hurt = hurt || damage_units(p, tracked[b]) > 0;
  return hurt;
}
/// The same by all lanes.
template <class Lanes>
GIGA_HD bool was_hurt(const Lanes& lanes, const Parameters auto& p, const World auto& w, int e) {
  bool hurt = false;
  const uint8_t* tracked = w.tracked + static_cast<int64_t>(e) * p.n_agents;
  lanes.each(p.n_agents, [&](int b) { hurt = hurt || damage_units(p, tracked[b]) > 0; });
  return lanes.any(hurt);
}

/// The column y = side - 1: green as far as the health reaches, white beyond.
template <class Lanes>
GIGA_HD void draw_health_bar(const Lanes& lanes, const Parameters auto& p, const World auto& w, int e,
                             const ImageRows& image) {
  const int length = static_cast<int>(static_cast<float>(image.side) * w.health[e] / p.agents.max_health[e]);
  lanes.each(image.x1 - image.x0, [&](int k) {
    const int x = image.x0 + k, level = x < length ? 0 : 255;
    set_pixel(image.at(x, image.side - 1), level, 255, level);
  });
}

/// Pixel by pixel, the nearest to the agents first: the tails of all whom e sees, then that of e over them.
template <class Lanes>
GIGA_HD void draw_tails(const Lanes& lanes, int n, int e, const Mark* marks, const ImageRows& image) {
  for (int k = 0; k < kTail; ++k) {
    lanes.each(n, [&](int a) { draw_tail(image, marks[a], marks[a].paint != Paint::red, k); });
    lanes.each(kChannels, [&](int channel) {
      uint8_t* pixel = image.at(marks[e].tail_x[k], marks[e].tail_y[k]);
      if (pixel) raise_to(pixel + channel, tail_strength(k));
    });
  }
}

/// Draws the rows of the image; `hurt`: by was_hurt. `marks`: room for all agents.
template <class Lanes>
GIGA_HD void draw_ego_image(const Lanes& lanes, const Parameters auto& p, const World auto& w, int e, bool hurt,
                            const ImageRows& image, Mark* marks) {
  const int n = p.n_agents;
  const Picture picture = hurt ? Picture::hurt : Picture::ego;
  lanes.each(n, [&](int a) { marks[a] = ego_mark(p, w, e, a); });
  copy_bytes(lanes, picture_of(p, w, picture, image.x0), image.bytes, (image.x1 - image.x0) * row_bytes(image.side));
  draw_waypoint(lanes, p, w, image);
  draw_health_bar(lanes, p, w, e, image);
  draw_tails(lanes, n, e, marks, image);
  lanes.each(1, [&](int) { set_pixel(image.at(marks[e].x, marks[e].y), 0, 0, 0); });
  lanes.each(n * kSpritePixels, [&](int k) { draw_sprite(image, marks[k / kSpritePixels], k % kSpritePixels); });
}

template <class Lanes>
GIGA_HD void draw_ego_image(const Lanes& lanes, const Parameters auto& p, const World auto& w, int e,
                            const ImageRows& image, Mark* marks) {
  draw_ego_image(lanes, p, w, e, was_hurt(lanes, p, w, e), image, marks);
}

/// [resolution, resolution, 3] of bytes.
struct EgoImage {
  static constexpr Observation id = Observation::image;
  static constexpr const char* name = "image";
  static constexpr ObservationOf of = ObservationOf::agent;
  using Element = uint8_t;
  static constexpr ElementType type = ElementType::u8;

  GIGA_HD static bool offered(const Parameters auto& p) { return p.resolution > 0; }
  GIGA_HD static ObservationShape shape(const Parameters auto& p) { return {p.resolution, p.resolution, kChannels}; }
};

}  // namespace giga
