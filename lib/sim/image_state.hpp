// The image state: what the ego images of a world are drawn from, some 30 bytes an agent where an image of 84 x 84 has
// 21,168. Whoever needs images again later keeps these rows, and draws the images once more (Simulator::redraw).
#pragma once

#include <bit>
#include <type_traits>

#include "sim/ego_image.hpp"

namespace giga {

/// Numbers of a row: for all agents x, then y and so on, then what is common to them.
enum ImageStateNumber : int { kImageX, kImageY, kImageZ, kImageHeading, kImageHealth, kImageHurt, kImageSeen };
constexpr int kImageWaypoint = 4;  ///< x1 y1 x2 y2
GIGA_HD int image_state_size(const Parameters auto& p) {
  return p.n_agents * (kImageSeen + words_for(p.n_agents)) + 1 + kImageWaypoint + 1;
}

/// What a row says of a world, as the functions that draw ego images read it.
struct ImageWorld : WorldView {
  const int32_t* hurt;  // [N] 0 or 1

  GIGA_HD ImageWorld(const Parameters auto& p, const int32_t* row) : WorldView{} {
    const int n = p.n_agents;
    const auto floats = [&](int number) {
      return reinterpret_cast<float*>(const_cast<int32_t*>(row)) + number * n;  // nobody writes to it
    };
    x = floats(kImageX);
    y = floats(kImageY);
    z = floats(kImageZ);
    heading = floats(kImageHeading);
    health = floats(kImageHealth);
    hurt = row + kImageHurt * n;
    seen = reinterpret_cast<uint32_t*>(const_cast<int32_t*>(row)) + kImageSeen * n;
    const int common = n * (kImageSeen + words_for(n));
    map = const_cast<int32_t*>(row) + common;
    waypoint = floats(0) + common + 1;
    waypoint_time = waypoint + kImageWaypoint;
  }
};

GIGA_HD int32_t bits_of(float value) {
#if defined(__CUDA_ARCH__)
  return __float_as_int(value);
#else
  return std::bit_cast<int32_t>(value);
#endif
}

/// Writes the row of a world.
template <class Lanes>
GIGA_HD void write_image_state(const Lanes& lanes, const Parameters auto& p, const World auto& w, int32_t* row) {
  const int n = p.n_agents, words = words_for(n);
  lanes.each(n, [&](int e) {
    const float numbers[] = {w.x[e], w.y[e], w.z[e], w.heading[e], w.health[e]};
    for (int k = 0; k < kImageHurt; ++k) row[k * n + e] = bits_of(numbers[k]);
    row[kImageHurt * n + e] = took_damage(p, w, e) ? 1 : 0;
    for (int k = 0; k < words; ++k)
      row[kImageSeen * n + e * words + k] = static_cast<int32_t>(w.seen[static_cast<int64_t>(e) * words + k]);
  });
  int32_t* common = row + n * (kImageSeen + words);
  lanes.each(1, [&](int) {
    common[0] = *w.map;
    for (int k = 0; k < kImageWaypoint; ++k) common[1 + k] = bits_of(w.waypoint[k]);
    common[1 + kImageWaypoint] = bits_of(*w.waypoint_time);
  });
}

/// [image_state_size(p)] of words: floats and whole numbers by their bits.
struct ImageState {
  static constexpr Observation id = Observation::image_state;
  static constexpr const char* name = "image_state";
  static constexpr ObservationOf of = ObservationOf::world;
  using Element = int32_t;
  static constexpr ElementType type = ElementType::i32;

  GIGA_HD static bool offered(const Parameters auto& p) { return p.resolution > 0; }
  GIGA_HD static ObservationShape shape(const Parameters auto& p) { return offered(p) ? image_state_size(p) : 0; }
};

/// Ego images of a team that are drawn again from rows of the image state.
struct Redraw {
  int team = 0;
  const int32_t* states = nullptr;  // [any, image_state_size(p)]
  const int64_t* rows = nullptr;    // [count] which of them; null: the first ones
  int64_t count = 0;
  uint8_t* images = nullptr;  // [count, agents of the team, resolution, resolution, 3]
};

/// Agent number `slot` of a team.
GIGA_HD int agent_of(const Parameters auto& p, int team, int slot) {
  int a = p.first_of(team);
  while (p.team_of(a) != team || p.slot_of(a) != slot) ++a;
  return a;
}

/// Draws rows [image.x0, image.x1) of image `number` of a request.
template <class Lanes>
GIGA_HD void redraw_image(const Lanes& lanes, const Parameters auto& p, const Redraw& request, int64_t number,
                          const ImageRows& image, Mark* marks) {
  const int n = p.n_team[request.team];
  const int64_t k = number / n, row = request.rows ? request.rows[k] : k;
  const ImageWorld w(p, request.states + row * image_state_size(p));
  const int e = agent_of(p, request.team, static_cast<int>(number - k * n));
  draw_ego_image(lanes, p, w, e, w.hurt[e] != 0, image, marks);
}

}  // namespace giga
