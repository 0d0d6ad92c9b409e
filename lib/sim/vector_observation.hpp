// The vector observation, the original's: agents in order of distance, then waypoint and obstacles (rules 7).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/image_rows.hpp"
#include "sim/observation_text.hpp"
#include "sim/waypoint.hpp"
#include "sim/world.hpp"

namespace giga {

/// The place of an agent by which rows are ordered: beside images the original takes the pixel (Q17).
GIGA_HD bool orders_by_pixel(const Parameters auto& p) { return p.original() && p.resolution > 0; }
GIGA_HD float order_x(const Parameters auto& p, const World auto& w, int a) {
  return orders_by_pixel(p) ? static_cast<float>(pixel_of(p, w.x[a], p.limit_x)) : w.x[a];
}
GIGA_HD float order_y(const Parameters auto& p, const World auto& w, int a) {
  return orders_by_pixel(p) ? static_cast<float>(pixel_of(p, w.y[a], p.limit_y)) : w.y[a];
}

/// The agents of e's rows: e itself, then those seen by ascending distance (equal ones by index), then nobody. Stores
/// their headings relative to e in w.neighbor_turn.
GIGA_HD void rank_neighbors(const Parameters auto& p, World auto& w, int e) {
  const int n = p.n_agents, words = words_for(n), limit = p.n_neighbors;
  const uint32_t* seen = w.seen + static_cast<int64_t>(e) * words;
  uint16_t* rows = w.neighbors + static_cast<int64_t>(e) * limit;
  float* distance = w.neighbor_distance + static_cast<int64_t>(e) * limit;
  rows[0] = (seen[e / 32] >> (e & 31) & 1u) ? static_cast<uint16_t>(e) : kNobody;
  int count = 1;
  for (int a = 0; a < n; ++a) {
    if (a == e || !(seen[a / 32] >> (a & 31) & 1u)) continue;
    const float dx = order_x(p, w, a) - order_x(p, w, e), dy = order_y(p, w, a) - order_y(p, w, e);
    const float away = std::sqrt(dx * dx + dy * dy);
    if (count == limit && (limit == 1 || away >= distance[limit - 1])) continue;
    int at = count < limit ? count++ : limit - 1;
    for (; at > 1 && away < distance[at - 1]; --at) {
      distance[at] = distance[at - 1];
      rows[at] = rows[at - 1];
    }
    distance[at] = away;
    rows[at] = static_cast<uint16_t>(a);
  }
  const bool original = p.original();
  float* turns = w.neighbor_turn + static_cast<int64_t>(e) * limit;
  for (int k = 0; k < count; ++k) {
    const float turn = w.heading[rows[k] == kNobody ? e : rows[k]] - w.heading[e];
    turns[k] = original ? wrap_original(turn) : wrap_angle(turn);
  }
  for (; count < limit; ++count) rows[count] = kNobody;
}

/// The nine numbers of agent a as anyone sees it: w.features. A row about another agent takes the ego's own from those
/// in [kFirstRelative, kLastRelative].
enum Feature : int { kSeen, kSameTeam, kX, kY, kZ, kHeading, kSpeed, kHealth, kSprite };
constexpr int kFirstRelative = kX, kLastRelative = kSpeed;
GIGA_HD void describe_agent(const Parameters auto& p, World auto& w, int a) {
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

  GIGA_HD NeighborRows(const Parameters auto& p, const World auto& w, int e_)
      : agent(w.neighbors + static_cast<int64_t>(e_) * p.n_neighbors),
        turn(w.neighbor_turn + static_cast<int64_t>(e_) * p.n_neighbors),
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
GIGA_HD int box_features(const Parameters auto& p) { return p.obstacle_heights ? 6 : 4; }
/// The same of all boxes of the world's map, one after the other; a table (make_box_features).
GIGA_HD const float* features_of_boxes(const Parameters auto& p, const World auto& w) {
  return p.maps.box_features + *w.map * p.n_boxes * box_features(p);
}

/// Numbers behind the neighbors: the waypoint relative to e and its remaining seconds, then the boxes of the map.
constexpr int kWaypointFeatures = 5;
GIGA_HD float tail_value(const Parameters auto& p, const World auto& w, const float* boxes, int e, int column) {
  const int before = p.waypoints ? kWaypointFeatures : 0;
  if (column >= before) return table_value(boxes + column - before);
  if (p.waypoint_unseen_time > 0 && !waypoint_shown(p, w)) return 0;
  if (column == 4) return *w.waypoint_time;
  return (column & 1) ? (w.waypoint[column] - w.y[e]) * p.inv_limit_y : (w.waypoint[column] - w.x[e]) * p.inv_limit_x;
}

GIGA_HD int neighbor_columns(const Parameters auto& p) { return p.n_neighbors * kNeighborFeatures; }
GIGA_HD int tail_columns(const Parameters auto& p) {
  return (p.waypoints ? kWaypointFeatures : 0) + p.n_boxes * box_features(p);
}

/// Agents in order of distance, then the waypoint and the boxes; [n_neighbors * 9 + 5 + n_boxes * 4 or 6].
struct VectorObservation {
  static constexpr Observation id = Observation::vector;
  static constexpr const char* name = "vector";
  static constexpr ObservationOf of = ObservationOf::agent;
  using Element = float;
  static constexpr ElementType type = ElementType::f32;
  static std::vector<ObservationPart> describe(const SimParams& p);

  GIGA_HD static bool offered(const Parameters auto&) { return true; }
  GIGA_HD static ObservationShape shape(const Parameters auto& p) { return neighbor_columns(p) + tail_columns(p); }
  GIGA_HD static void prepare(const Parameters auto& p, World auto& w, int a) { describe_agent(p, w, a); }

  /// Number by number, so that neighboring lanes write neighboring numbers.
  template <class Lanes, class RowOf>
  GIGA_HD static void write(const Lanes& lanes, const Parameters auto& p, const World auto& w, int n, RowOf&& row_of) {
    struct Row {
      float* numbers;
      NeighborRows seen;
      GIGA_HD explicit operator bool() const { return numbers != nullptr; }
    };
    const auto rows = [&](int e) { return Row{row_of(e), {p, w, e}}; };
    const int front = neighbor_columns(p);
    lanes.each_cell(n, front, rows,
                    [](const Row& row, int column) { row.numbers[column] = neighbor_value(row.seen, column); });
    const float* boxes = features_of_boxes(p, w);
    lanes.each_cell(n, tail_columns(p), rows, [&](const Row& row, int column) {
      row.numbers[front + column] = tail_value(p, w, boxes, row.seen.e, column);
    });
  }
};

}  // namespace giga
