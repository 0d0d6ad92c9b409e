// Vector observations: whom an agent sees, in which order, and each number of its row (SPEC sections 6 and 7).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/body_view.hpp"
#include "sim/world.hpp"

namespace giga {

/// Bits of w.talk: whom of its team agent e hears: the living, itself included, the nearer the more likely. A dead
/// agent listens on: the recordings of the original say so (SPEC section 6 has it wrong).
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

/// The agents of e's rows: e itself, then those seen by ascending distance (equal ones by index), then nobody. Leaves
/// in w.neighbor_keys how they head relative to e.
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
  const bool original = p.original();
  for (int k = 0; k < count; ++k) {
    const float turn = w.heading[rows[k] == kNobody ? e : rows[k]] - w.heading[e];
    keys[k] = original ? wrap_original(turn) : wrap_angle(turn);
  }
  for (; count < limit; ++count) rows[count] = kNobody;
}

/// The nine numbers of agent a as anyone sees it: w.features. A row about another agent takes the ego's own from those
/// in [kFirstRelative, kLastRelative].
enum Feature : int { kSeen, kSameTeam, kX, kY, kZ, kHeading, kSpeed, kHealth, kSprite };
constexpr int kFirstRelative = kX, kLastRelative = kSpeed;
GIGA_HD void describe(const SimParams& p, WorldView& w, int a) {
  float* f = w.features + a * kNeighborFeatures;
  f[kSeen] = 1.0f;
  f[kSameTeam] = static_cast<float>(p.team_of(a));  // compared with the ego's
  f[kX] = w.x[a] * p.inv_limit_x;
  f[kY] = w.y[a] * p.inv_limit_y;
  f[kZ] = w.z[a] * (1.0f / kAltitudeLimit);
  f[kHeading] = w.heading[a];
  f[kSpeed] = w.v[a] * p.inv_diagonal;
  f[kHealth] = w.health[a];
  f[kSprite] = static_cast<float>(p.agents.sprite[a]);
}

/// What e sees, as far as agents go; after rank_neighbors and describe.
struct NeighborRows {
  const uint16_t* agent;  // [p.n_neighbors] or kNobody
  const float* turn;      // [p.n_neighbors] how they head relative to e
  const float *own, *features;
  int e;

  GIGA_HD NeighborRows(const SimParams& p, const WorldView& w, int e_)
      : agent(w.neighbors + static_cast<int64_t>(e_) * p.n_neighbors),
        turn(w.neighbor_keys + static_cast<int64_t>(e_) * p.n_neighbors),
        own(w.features + e_ * kNeighborFeatures),
        features(w.features),
        e(e_) {}
};

/// Number `column` of the part of an observation that is about agents. Selections rather than branches: on the GPU the
/// lanes of a warp work on different features.
GIGA_HD float neighbor_value(const NeighborRows& rows, int column) {
  const int row = column / kNeighborFeatures, feature = column - row * kNeighborFeatures;
  const uint16_t a = rows.agent[row];
  if (a == kNobody) return 0.0f;
  const float own = rows.own[feature];
  const float value = rows.features[a * kNeighborFeatures + feature];
  const float apart = feature == kHeading ? rows.turn[row] : value - own;
  const bool relative = a != rows.e && feature >= kFirstRelative && feature <= kLastRelative;
  const float same = value == own ? 1.0f : 0.0f;
  return feature == kSameTeam ? same : relative ? apart : value;
}

/// Numbers of a box: x1 y1 x2 y2 as shares of the world's size, with obstacle_heights z1 z2 too.
GIGA_HD int box_features(const SimParams& p) { return p.obstacle_heights ? 6 : 4; }
/// The same of all boxes of the world's map, one after the other; a table (make_box_features).
GIGA_HD const float* features_of_boxes(const SimParams& p, const WorldView& w) {
  return p.maps.box_features + *w.map * p.n_boxes * box_features(p);
}

/// Numbers behind the neighbors: the waypoint relative to e and its remaining seconds, then the boxes of the map.
constexpr int kWaypointFeatures = 5;
GIGA_HD float tail_value(const SimParams& p, const WorldView& w, const float* boxes, int e, int column) {
  const int before = p.waypoints ? kWaypointFeatures : 0;
  if (column >= before) return table_value(boxes + column - before);
  if (column == 4) return *w.waypoint_time;
  return (column & 1) ? (w.waypoint[column] - w.y[e]) * p.inv_limit_y : (w.waypoint[column] - w.x[e]) * p.inv_limit_x;
}

GIGA_HD int neighbor_columns(const SimParams& p) { return p.n_neighbors * kNeighborFeatures; }
GIGA_HD int tail_columns(const SimParams& p) {
  return (p.waypoints ? kWaypointFeatures : 0) + p.n_boxes * box_features(p);
}
/// First number of the body view in an observation.
GIGA_HD int body_at(const SimParams& p) { return body_at(neighbor_columns(p) + tail_columns(p)); }
GIGA_HD int observation_size(const SimParams& p) {
  return p.body_view ? body_at(p) + body_columns(p) : neighbor_columns(p) + tail_columns(p);
}

}  // namespace giga
