// The vector observation, the original's: agents in order of distance, then waypoint and obstacles (rules 7).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/image_rows.hpp"
#include "sim/observation_text.hpp"
#include "sim/rows.hpp"
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

/// How far agent a is from e where rows are ordered.
GIGA_HD float order_distance(const Parameters auto& p, const World auto& w, int e, int a) {
  const float dx = order_x(p, w, a) - order_x(p, w, e), dy = order_y(p, w, a) - order_y(p, w, e);
  return square_root(dx * dx + dy * dy);
}

/// The agents of e's rows: e itself, then those seen by ascending distance (equal ones by index), then nobody. By
/// insertion, for any number of agents.
GIGA_HD void rank_by_insertion(const Parameters auto& p, World auto& w, int e) {
  const int n = p.n_agents, words = words_for(n), limit = p.n_neighbors;
  const uint32_t* seen = w.seen + static_cast<int64_t>(e) * words;
  uint16_t* rows = w.neighbors + static_cast<int64_t>(e) * limit;
  float* distance = w.neighbor_distance + static_cast<int64_t>(e) * limit;
  rows[0] = (seen[e / 32] >> (e & 31) & 1u) ? static_cast<uint16_t>(e) : kNobody;
  int count = 1;
  for (int a = 0; a < n; ++a) {
    if (a == e || !(seen[a / 32] >> (a & 31) & 1u)) continue;
    const float away = order_distance(p, w, e, a);
    if (count == limit && (limit == 1 || away >= distance[limit - 1])) continue;
    int at = count < limit ? count++ : limit - 1;
    for (; at > 1 && away < distance[at - 1]; --at) {
      distance[at] = distance[at - 1];
      rows[at] = rows[at - 1];
    }
    distance[at] = away;
    rows[at] = static_cast<uint16_t>(a);
  }
  for (; count < limit; ++count) rows[count] = kNobody;
}

/// The same by counting for each agent those that come before it: no branches and nothing but registers, for a constant
/// number of agents that all have a row.
GIGA_HD void rank_by_counting(const Parameters auto& p, World auto& w, int e) {
  constexpr int kTeam = std::remove_cvref_t<decltype(p)>::kTeam;
  const uint32_t seen = w.seen[e], others = seen & ~(1u << e);
  const int team = p.team_of(e);
  // Distances are not negative, so that their bits are in the same order. The key of whom e does not see is beyond all.
  uint32_t mate[kTeam], opponent[kTeam];
  const auto key = [&](int a) {
    const float dx = w.x[a] - w.x[e], dy = w.y[a] - w.y[e];
    return others >> a & 1u ? float_bits(square_root(dx * dx + dy * dy)) : 0xFFFFFF00u;
  };
  for_team(p, team, [&](int a, int k) { mate[k] = key(a); });
  // Of equal distances the smaller index comes first: for team 0 that is the mate.
  for_team(p, 1 - team, [&](int a, int k) { opponent[k] = key(a) + (team == 0 ? 1u : 0u); });

  int mate_rank[kTeam], opponent_rank[kTeam];
  GIGA_UNROLL
  for (int k = 0; k < kTeam; ++k) mate_rank[k] = opponent_rank[k] = 1;
  GIGA_UNROLL
  for (int k = 0; k < kTeam; ++k) {
    GIGA_UNROLL
    for (int j = 0; j < kTeam; ++j) {
      if (k < j) {
        const bool mates = mate[k] <= mate[j], opponents = opponent[k] <= opponent[j];
        mate_rank[j] += mates, mate_rank[k] += !mates;
        opponent_rank[j] += opponents, opponent_rank[k] += !opponents;
      }
      const bool mate_first = mate[k] < opponent[j];
      opponent_rank[j] += mate_first, mate_rank[k] += !mate_first;
    }
  }

  uint16_t* rows = w.neighbors + e * 2 * kTeam;
  GIGA_UNROLL
  for (int k = 0; k < 2 * kTeam; ++k) rows[k] = kNobody;
  if (seen >> e & 1u) rows[0] = static_cast<uint16_t>(e);
  const auto put = [&](int a, int rank) {
    if (others >> a & 1u) rows[rank] = static_cast<uint16_t>(a);
  };
  for_team(p, team, [&](int a, int k) { put(a, mate_rank[k]); });
  for_team(p, 1 - team, [&](int a, int k) { put(a, opponent_rank[k]); });
}

GIGA_HD void rank_neighbors(const Parameters auto& p, World auto& w, int e) {
  if constexpr (std::remove_cvref_t<decltype(p)>::kTeam > 0)
    rank_by_counting(p, w, e);
  else
    rank_by_insertion(p, w, e);
}

/// The numbers of a row about an agent, in this order. Those in [kFirstRelative, kLastRelative] are relative to the
/// ego, but in its own row.
enum Feature : int { kSeen, kSameTeam, kX, kY, kZ, kHeading, kSpeed, kHealth, kSprite };
constexpr int kFirstRelative = kX, kLastRelative = kSpeed;

GIGA_HD void describe_agent(const Parameters auto& p, World auto& w, int a) {
  AgentFeatures& f = w.features[a];
  f.x = w.x[a] * p.inv_limit_x;
  f.y = w.y[a] * p.inv_limit_y;
  f.z = w.z[a] * (1.0f / kAltitudeLimit);
  f.speed = w.v[a] * p.inv_diagonal;
  f.heading = w.heading[a];
  f.health = w.health[a];
  f.sprite = static_cast<float>(table_value(p.agents.sprite + a));
}

/// Agent k of e's row, after rank_neighbors and describe_agent of all: put(feature, number), in their order. `own`: e
/// itself; the row tells of the others relative to it. Selections rather than branches: on the GPU the lanes of a warp
/// keep in step.
template <class Put>
GIGA_HD void write_neighbor(const Parameters auto& p, const World auto& w, int e, const AgentFeatures& own, int k,
                            Put&& put) {
  const auto a = w.neighbors[static_cast<int64_t>(e) * p.n_neighbors + k];
  const bool some = a != kNobody;
  const AgentFeatures f = w.features[some ? a : e];
  const auto apart = [&](float value, float from) { return some ? value - (k == 0 ? 0.0f : from) : 0.0f; };
  const float turn = f.heading - own.heading;
  const float heading = k == 0 ? f.heading : p.original() ? wrap_original(turn) : wrap_angle(turn);
  put(kSeen, some ? 1.0f : 0.0f);
  put(kSameTeam, some && p.team_of(a) == p.team_of(e) ? 1.0f : 0.0f);
  put(kX, apart(f.x, own.x));
  put(kY, apart(f.y, own.y));
  put(kZ, apart(f.z, own.z));
  put(kHeading, some ? heading : 0.0f);
  put(kSpeed, apart(f.speed, own.speed));
  put(kHealth, some ? f.health : 0.0f);
  put(kSprite, some ? f.sprite : 0.0f);
}

/// Numbers of a box: x1 y1 x2 y2 as shares of the world's size, with obstacle_heights z1 z2 too.
GIGA_HD int box_features(const Parameters auto& p) { return p.obstacle_heights ? 6 : 4; }
/// The same of all boxes of the world's map, one after the other; a table (make_box_features).
GIGA_HD const float* features_of_boxes(const Parameters auto& p, const World auto& w) {
  return p.maps.box_features + *w.map * p.n_boxes * box_features(p);
}

/// Numbers behind the neighbors: the waypoint relative to e and its remaining seconds, then the boxes of the map.
constexpr int kWaypointFeatures = 5;
GIGA_HD float waypoint_value(const Parameters auto& p, const World auto& w, int e, int k) {
  if (p.waypoint_unseen_time > 0 && !waypoint_shown(p, w)) return 0;
  if (k == 4) return *w.waypoint_time;
  return (k & 1) ? (w.waypoint[k] - w.y[e]) * p.inv_limit_y : (w.waypoint[k] - w.x[e]) * p.inv_limit_x;
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

  /// Where each worker sees to whole worlds, row by row. Else part by part: each agent's worker puts together its part,
  /// and then all copy, so that neighboring lanes write neighboring numbers.
  template <class Lanes, class Rows>
  GIGA_HD static void write(const Lanes& lanes, const Parameters auto& p, const World auto& w, int n, Rows&& rows) {
    using P = std::remove_cvref_t<decltype(p)>;
    const TeamRows to[kNTeams] = {rows.of_team(0), rows.of_team(1)};
    if constexpr (Lanes::kSerial) {
      lanes.each_agent(n, [&](int e) {
        float* row = rows(e);
        for (int k = 0; row && k < p.n_neighbors; ++k)
          write_neighbor(p, w, e, w.features[e], k,
                         [&](int feature, float number) { row[k * kNeighborFeatures + feature] = number; });
      });
    } else if constexpr (P::kTeam > 0) {
      send_rows(lanes, p, w, n, to);
    } else {
      for (int first = 0; first < p.n_neighbors; first += kStageAgents) {
        const int left = p.n_neighbors - first, agents = left < kStageAgents ? left : kStageAgents;
        lanes.each(n * agents, [&](int item) {
          const int e = item / agents, k = item - e * agents;
          float* out = w.stage + e * kStageColumns + k * kNeighborFeatures;
          write_neighbor(p, w, e, w.features[e], first + k, [&](int feature, float number) { out[feature] = number; });
        });
        copy_rows<kStageColumns>(lanes, p, n > 0, w.stage, to, {first * kNeighborFeatures, agents * kNeighborFeatures});
      }
    }
    if constexpr (P::kTeam == 0 || Lanes::kSerial) write_tail(lanes, p, w, n > 0, rows);
  }

  /// The rows of a team at a time: two workers put together each of them in shared memory, then they are sent, all at
  /// once where they lie one behind the other, while those of the other team are made.
  template <class Lanes, Parameters P>
  GIGA_HD static void send_rows(const Lanes& lanes, const P& p, const World auto& w, int n,
                                const TeamRows (&to)[kNTeams]) {
    static_assert(!P::waypoints && P::n_neighbors == 2 * P::kTeam);
    constexpr int kTeam = P::kTeam, kPitch = kStageRow<P>, kFront = P::n_neighbors * kNeighborFeatures;
    const float* boxes = features_of_boxes(p, w);
    const int n_tail = p.n_boxes * box_features(p);
    const bool whole = kFront + n_tail <= kPitch;  // else there are too many boxes for the stage
    const int columns = whole ? kFront + n_tail : kFront;
    lanes.each_agent(n, [&](int i) {
      // The same in all rows; behind them zeros, as in the rows themselves.
      GIGA_UNROLL
      for (int at = 0; at < kPitch - kFront; at += 2 * kTeam) {
        const int k = at + i;
        const float number = k < n_tail ? table_value(boxes + k) : 0.0f;
        GIGA_UNROLL
        for (int slot = 0; slot < kTeam; ++slot)
          if (k < kPitch - kFront) w.stage[slot * kPitch + kFront + k] = number;
      }
    });
    GIGA_ROLLED
    for (int team = 0; team < kNTeams; ++team) {
      const TeamRows rows = team == 0 ? to[0] : to[1];
      if (team > 0) lanes.each_agent(n, [&](int) { lanes.wait_sent(); });
      lanes.each_agent(n, [&](int i) {
        const int slot = i % kTeam, half = i / kTeam, e = p.first_of(team) + slot;
        const AgentFeatures own = w.features[e];
        float* row = w.stage + slot * kPitch;
        GIGA_UNROLL
        for (int j = 0; j < kTeam; ++j) {
          // Each worker begins with another agent, so that they write to different banks.
          const int turned = j + slot, k = half * kTeam + (turned < kTeam ? turned : turned - kTeam);
          write_neighbor(p, w, e, own, k,
                         [&](int feature, float number) { row[k * kNeighborFeatures + feature] = number; });
        }
        lanes.before_sending();
      });
      if (rows.aligned(sizeof(FourNumbers))) {
        const bool together = whole && rows.stride == kPitch;
        const int sent = together ? kTeam * kPitch : columns / 4 * 4;
        lanes.each_agent(n, [&](int i) {
          if (rows && i < (together ? 1 : kTeam)) {
            lanes.send(rows.row(i), w.stage + i * kPitch, sent);
            for (int k = sent; k < columns; ++k) rows.row(i)[k] = w.stage[i * kPitch + k];
          }
        });
      } else {
        lanes.each(n > 0 && rows ? columns : 0, [&](int k) {
          for (int slot = 0; slot < kTeam; ++slot) rows.row(slot)[k] = w.stage[slot * kPitch + k];
        });
      }
    }
    if (!whole) lanes.each(n > 0 ? n_tail : 0, [&](int k) { write_box_number(p, to, k, table_value(boxes + k)); });
  }

  /// The waypoint, which is relative to each agent; the boxes, which are the same for all.
  template <class Lanes, class Rows>
  GIGA_HD static void write_tail(const Lanes& lanes, const Parameters auto& p, const World auto& w, bool active,
                                 Rows&& rows) {
    const TeamRows to[kNTeams] = {rows.of_team(0), rows.of_team(1)};
    const float* boxes = features_of_boxes(p, w);
    if (p.waypoints)
      lanes.each_agent(active ? p.n_agents : 0, [&](int e) {
        float* row = rows(e);
        for (int k = 0; row && k < kWaypointFeatures; ++k) row[neighbor_columns(p) + k] = waypoint_value(p, w, e, k);
      });
    lanes.each(active ? p.n_boxes * box_features(p) : 0,
               [&](int k) { write_box_number(p, to, k, table_value(boxes + k)); });
  }

  /// Number k about boxes, the same in all rows.
  GIGA_HD static void write_box_number(const Parameters auto& p, const TeamRows (&to)[kNTeams], int k, float number) {
    const int column = neighbor_columns(p) + (p.waypoints ? kWaypointFeatures : 0) + k;
    for (int team = 0; team < kNTeams; ++team)
      if (to[team]) for_team(p, team, [&](int, int slot) { to[team].row(slot)[column] = number; });
  }
};

}  // namespace giga
