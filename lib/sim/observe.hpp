// Vector observations: whom an agent sees, in which order, and each number of its row (SPEC sections 6 and 7).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/world.hpp"

namespace giga {

constexpr int kNeighborFeatures = 9;

/// Bits of w.talk: whom of its team agent e hears: the living, itself included, the nearer the more likely. A dead agent
/// listens on: the recordings of the original say so (SPEC section 6 has it wrong).
template <class Draws>
GIGA_HD void listen(const SimParams& p, WorldView& w, Draws& draws, int e, bool after_reset) {
  const int n = p.n_agents, words = words_for(n);
  for (int word = 0; word < words; ++word) {
    uint32_t bits = 0;
    const int end = (word + 1) * 32 < n ? (word + 1) * 32 : n;
    for (int b = word * 32; b < end; ++b) {
      if (p.team_of(b) != p.team_of(e) || !w.alive[b]) continue;
      bool heard = b == e;
      if (!heard) {
        const float dx = w.x[e] - w.x[b], dy = w.y[e] - w.y[b];
        const float loss = std::sqrt(dx * dx + dy * dy) / p.communication_range;
        heard = clamp(loss, 0.0f, 1.0f) <= draws.comm(e, b, after_reset);
      }
      if (heard) bits |= 1u << (b & 31);
    }
    w.talk[static_cast<int64_t>(e) * words + word] = bits;
  }
}

/// Bits of w.seen: agents that e hears, and those that somebody whom e hears detects. Without stochastic communication
/// everybody detected is seen, by the dead too (SPEC section 6).
GIGA_HD void look(const SimParams& p, WorldView& w, int e) {
  const int n = p.n_agents, words = words_for(n);
  const uint32_t* talk = w.talk + static_cast<int64_t>(e) * words;
  for (int word = 0; word < words; ++word) {
    uint32_t bits = p.stochastic_communication ? talk[word] : 0u;
    const int end = (word + 1) * 32 < n ? (word + 1) * 32 : n;
    for (int a = word * 32; a < end; ++a) {
      const uint32_t* detected = w.detected + static_cast<int64_t>(a) * words;
      uint32_t known = 0;
      for (int k = 0; k < words; ++k) known |= p.stochastic_communication ? detected[k] & talk[k] : detected[k];
      if (!p.stochastic_communication && p.team_of(a) == p.team_of(e) && w.alive[a]) known = 1;
      if (known) bits |= 1u << (a & 31);
    }
    w.seen[static_cast<int64_t>(e) * words + word] = bits;
  }
}

/// The agents of e's rows: e itself, then those seen by ascending distance (equal ones by index), then nobody.
GIGA_HD void rank_neighbors(const SimParams& p, WorldView& w, int e) {
  const int n = p.n_agents, words = words_for(n), limit = p.n_neighbors;
  const uint32_t* seen = w.seen + static_cast<int64_t>(e) * words;
  uint16_t* rows = w.neighbors + static_cast<int64_t>(e) * limit;
  float* keys = w.neighbor_keys + static_cast<int64_t>(e) * limit;
  rows[0] = (seen[e / 32] >> (e & 31) & 1u) ? static_cast<uint16_t>(e) : kNobody;
  int count = 1;
  for (int a = 0; a < n; ++a) {
    if (a == e || !(seen[a / 32] >> (a & 31) & 1u)) continue;
    const float dx = w.x[a] - w.x[e], dy = w.y[a] - w.y[e];
    const float key = std::sqrt(dx * dx + dy * dy);
    if (count == limit && (limit == 1 || key >= keys[limit - 1])) continue;
    int at = count < limit ? count++ : limit - 1;
    for (; at > 1 && key < keys[at - 1]; --at) {
      keys[at] = keys[at - 1];
      rows[at] = rows[at - 1];
    }
    keys[at] = key;
    rows[at] = static_cast<uint16_t>(a);
  }
  for (; count < limit; ++count) rows[count] = kNobody;
}

/// One of the nine numbers that ego e gets about agent a. Written as selections, not as a switch: on the GPU the lanes
/// of a warp work on different features, and branches would take turns.
GIGA_HD float neighbor_feature(const SimParams& p, const WorldView& w, int e, int a, int feature) {
  const float* field = feature == 2   ? w.x
                       : feature == 3 ? w.y
                       : feature == 4 ? w.z
                       : feature == 5 ? w.heading
                       : feature == 6 ? w.v
                                      : w.health;
  const bool relative = feature >= 2 && feature <= 6 && a != e;
  float value = field[a] - (relative ? field[e] : 0.0f);
  if (feature == 5 && relative) value = p.original() ? wrap_original(value) : wrap_angle(value);
  const float scale = feature == 2   ? p.inv_limit_x
                      : feature == 3 ? p.inv_limit_y
                      : feature == 4 ? 1.0f / kAltitudeLimit
                      : feature == 6 ? p.inv_diagonal
                                     : 1.0f;
  value *= scale;
  if (feature == 0 || (feature == 1 && p.team_of(a) == p.team_of(e))) value = 1.0f;
  if (feature == 1 && p.team_of(a) != p.team_of(e)) value = 0.0f;
  if (feature == 8) value = static_cast<float>(p.agents.sprite[a]);
  return value;
}

/// Numbers behind the neighbors: the waypoint relative to e and its remaining seconds, then the boxes of the map.
GIGA_HD float tail_feature(const SimParams& p, const WorldView& w, int e, int column) {
  if (p.waypoints) {
    if (column < 4)
      return (column & 1) ? (w.waypoint[column] - w.y[e]) * p.inv_limit_y : (w.waypoint[column] - w.x[e]) * p.inv_limit_x;
    if (column == 4) return *w.waypoint_time;
    column -= 5;
  }
  const int per_box = p.obstacle_heights ? 6 : 4;
  const Box& box = p.maps.boxes[static_cast<int64_t>(*w.map) * p.n_boxes + column / per_box];
  switch (column % per_box) {
    case 0:
      return box.x1 * p.inv_limit_x;
    case 1:
      return box.y1 * p.inv_limit_y;
    case 2:
      return box.x2 * p.inv_limit_x;
    case 3:
      return box.y2 * p.inv_limit_y;
    case 4:
      return box.z1 * (1.0f / kAltitudeLimit);
    default:
      return box.z2 * (1.0f / kAltitudeLimit);
  }
}

GIGA_HD int observation_size(const SimParams& p) {
  return p.n_neighbors * kNeighborFeatures + (p.waypoints ? 5 : 0) + p.n_boxes * (p.obstacle_heights ? 6 : 4);
}

/// Number `column` of e's observation, once rank_neighbors has run for e.
GIGA_HD float observation_value(const SimParams& p, const WorldView& w, int e, int column) {
  const int n_neighbor_columns = p.n_neighbors * kNeighborFeatures;
  if (column >= n_neighbor_columns) return tail_feature(p, w, e, column - n_neighbor_columns);
  const int row = column / kNeighborFeatures;
  const uint16_t a = w.neighbors[static_cast<int64_t>(e) * p.n_neighbors + row];
  return a == kNobody ? 0.0f : neighbor_feature(p, w, e, a, column - row * kNeighborFeatures);
}

}  // namespace giga
