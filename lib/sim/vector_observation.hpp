// The vector observation, the original's: agents in order of distance, then waypoint and obstacles (rules 7).
#pragma once

#include <bit>
#include <cmath>

#include "core/geometry.hpp"
#include "core/lowest_keys.hpp"
#include "sim/image_rows.hpp"
#include "sim/lanes.hpp"
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

/// How far an agent is from another where rows are ordered.
GIGA_HD float order_distance(float dx, float dy) { return square_root(dx * dx + dy * dy); }
GIGA_HD float order_distance(const Parameters auto& p, const World auto& w, int e, int a) {
  return order_distance(order_x(p, w, a) - order_x(p, w, e), order_y(p, w, a) - order_y(p, w, e));
}

constexpr uint32_t kUnseenKey = 0x80000000u;  ///< see rank_by_sorting

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

/// The same by a sorting network, for a constant number of agents: no branches and nothing but registers. A key is the
/// squared distance, of which the lowest bits give way to the agent's index. Where that leaves open which of two agents
/// comes first, as with equal distances, which are roots and so equal more often than their squares, it is done anew by
/// insertion.
GIGA_HD void rank_by_sorting(const Parameters auto& p, World auto& w, int e) {
  constexpr int kAgents = std::remove_cvref_t<decltype(p)>::kAgents;
  constexpr int kRows = std::remove_cvref_t<decltype(p)>::n_neighbors;
  constexpr uint32_t kIndex = std::bit_ceil(static_cast<unsigned>(kAgents > 2 ? kAgents : 4)) - 1;
  using Bits = AgentBits<kAgents>;
  const Bits seen = read_agent_bits<kAgents>(w.seen + e * words_for(kAgents)), ranked = seen | Bits{1} << e;
  const float x = w.x[e], y = w.y[e];
  uint32_t keys[kAgents];
  GIGA_UNROLL
  for (int a = 0; a < kAgents; ++a) {
    const float dx = w.x[a] - x, dy = w.y[a] - y;
    // Squares are not negative, so that their bits are in the same order; e itself has 0. The keys of whom e does not
    // see are beyond all, and far from each other.
    const uint32_t key = (float_bits(dx * dx + dy * dy) & ~kIndex) | static_cast<uint32_t>(a);
    keys[a] = ranked >> a & 1u ? key : kUnseenKey | static_cast<uint32_t>(a) << 25;
  }
  sort_lowest(keys);

  // Squares whose roots are equal lie within four of the smallest steps.
  static_assert(kIndex >= 3);
  uint32_t apart = kUnseenKey;
  GIGA_UNROLL
  for (int k = 0; k < kRows && k + 1 < kAgents; ++k) apart = lower_key(apart, keys[k + 1] - keys[k]);
  if (apart < 2 * (kIndex + 1)) return rank_by_insertion(p, w, e);

  uint16_t* rows = w.neighbors + e * kRows;
  GIGA_UNROLL
  for (int k = 0; k < kRows; ++k) rows[k] = keys[k] < kUnseenKey ? static_cast<uint16_t>(keys[k] & kIndex) : kNobody;
  if (!(seen >> e & 1u)) rows[0] = kNobody;
}

/// Whether the lowest keys that are sorted are those of all rows.
template <class P>
constexpr bool ranks_by_sorting() {
  if constexpr (P::kTeam > 0)
    return P::kAgents <= kSortedKeys || P::n_neighbors < kSortedKeys;
  else
    return false;
}
GIGA_HD void rank_neighbors(const Parameters auto& p, World auto& w, int e) {
  if constexpr (ranks_by_sorting<std::remove_cvref_t<decltype(p)>>())
    rank_by_sorting(p, w, e);
  else
    rank_by_insertion(p, w, e);
}

/// The numbers of a row about an agent, in this order. Those in [kFirstRelative, kLastRelative] are relative to the
/// ego, but in its own row.
enum Feature : int { kSeen, kSameTeam, kX, kY, kZ, kHeading, kSpeed, kHealth, kSprite };
constexpr int kFirstRelative = kX, kLastRelative = kSpeed;

GIGA_HD void describe_agent(const Parameters auto& p, World auto& w, int a) {
  AgentFeatures f;  // all is read before any is written: it may be the same memory for all that the compiler knows
  f.x = w.x[a] * p.inv_limit_x;
  f.y = w.y[a] * p.inv_limit_y;
  f.z = w.z[a] * (1.0f / kAltitudeLimit);
  f.speed = w.v[a] * p.inv_diagonal;
  f.heading = w.heading[a];
  f.health = w.health[a];
  f.sprite = static_cast<float>(table_value(p.agents.sprite + a));
  w.features[a] = f;
}

/// A number about agent k of a row, `some`: if there is one, from `value` of the agent and `own` of the ego, to which
/// others are told relative. Selections rather than branches: on the GPU the lanes of a warp keep in step.
GIGA_HD float neighbor_number(const Parameters auto& p, int feature, bool some, int k, float value, float own) {
  const bool relative = feature >= kFirstRelative && feature <= kLastRelative;
  const float apart = value - (k == 0 || !relative ? 0.0f : own);
  const float turn = p.original() ? wrap_original(apart) : wrap_angle(apart);
  return some ? (feature == kHeading && k > 0 ? turn : apart) : 0.0f;
}

/// Agent k of e's row, after rank_neighbors; kNobody where there is none.
GIGA_HD auto neighbor(const Parameters auto& p, const World auto& w, int e, int k) {
  return w.neighbors[static_cast<int64_t>(e) * p.n_neighbors + k];
}

/// What e's row says of neighbor(k) `a`, after describe_agent of all: put(feature, number), in their order. `own`: e
/// itself.
template <class Put>
GIGA_HD void write_neighbor(const Parameters auto& p, const World auto& w, int e, const AgentFeatures& own, int k,
                            auto a, Put&& put) {
  const bool some = a != kNobody;
  const AgentFeatures f = w.features[some ? a : e];
  const auto tell = [&](int feature, float value, float from) {
    put(feature, neighbor_number(p, feature, some, k, value, from));
  };
  tell(kSeen, 1, 0);
  tell(kSameTeam, some && p.team_of(a) == p.team_of(e) ? 1.0f : 0.0f, 0);
  tell(kX, f.x, own.x);
  tell(kY, f.y, own.y);
  tell(kZ, f.z, own.z);
  tell(kHeading, f.heading, own.heading);
  tell(kSpeed, f.speed, own.speed);
  tell(kHealth, f.health, 0);
  tell(kSprite, f.sprite, 0);
}

/// The same as one piece.
struct NeighborNumbers {
  float number[kNeighborFeatures];
};

/// Numbers of a box: x1 y1 x2 y2 as shares of the world's size, with obstacle_heights z1 z2 too.
GIGA_HD int box_features(const Parameters auto& p) { return p.obstacle_heights ? 6 : 4; }
/// The same of all boxes of the world's map, one after the other; a table (make_box_features).
GIGA_HD const float* features_of_boxes(const Parameters auto& p, const World auto& w) {
  return p.maps.box_features + *w.map * p.n_boxes * box_features(p);
}

/// Numbers behind the neighbors: the waypoint relative to e and its remaining seconds, then the boxes of the map.
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
          write_neighbor(p, w, e, w.features[e], k, neighbor(p, w, e, k),
                         [&](int feature, float number) { row[k * kNeighborFeatures + feature] = number; });
      });
    } else if constexpr (P::kTeam > 0) {
      send_rows(lanes, p, w, n, to);
    } else if constexpr (WideLanes<Lanes>) {
      write_by_piece(lanes, p, w, n, rows);
    } else {
      for (int first = 0; first < p.n_neighbors; first += kStageAgents) {
        const int left = p.n_neighbors - first, agents = left < kStageAgents ? left : kStageAgents;
        lanes.each(n * agents, [&](int item) {
          const int e = item / agents, k = item - e * agents;
          float* out = w.stage + e * kStageColumns + k * kNeighborFeatures;
          write_neighbor(p, w, e, w.features[e], first + k, neighbor(p, w, e, first + k),
                         [&](int feature, float number) { out[feature] = number; });
        });
        copy_rows<kStageColumns>(lanes, p, n > 0, w.stage, to, {first * kNeighborFeatures, agents * kNeighborFeatures});
      }
    }
    if constexpr ((P::kTeam == 0 && !WideLanes<Lanes>) || Lanes::kSerial) write_tail(lanes, p, w, n > 0, rows);
  }

  /// A row by the crew of its agent (sim/crew.hpp), which has ranked it; null: none is wanted. Each member works out
  /// what it says of one agent at a time, then neighboring members write neighboring numbers. Worlds without a tail.
  template <class Crew>
  GIGA_HD static void write_by_crew(const Crew& crew, const Parameters auto& p, const World auto& w, int e,
                                    float* row) {
    using P = std::remove_cvref_t<decltype(p)>;
    static_assert(!P::waypoints && P::n_boxes == 0);
    const int index = crew.index();
    const AgentFeatures own = w.features[e];
    crew.meet();  // it is known who is in the row
    GIGA_ROLLED
    for (int front = 0; front < p.n_neighbors; front += Crew::kWidth) {
      const int k = front + index, left = p.n_neighbors - front;
      if (row && k < p.n_neighbors) {
        float* piece = crew.stage() + index * kNeighborFeatures;
        write_neighbor(p, w, e, own, k, neighbor(p, w, e, k),
                       [&](int feature, float number) { piece[feature] = number; });
      }
      crew.meet();
      const int count = row ? (left < Crew::kWidth ? left : Crew::kWidth) * kNeighborFeatures : 0;
      for (int c = index; c < count; c += Crew::kWidth) row[front * kNeighborFeatures + c] = crew.stage()[c];
      crew.meet();
    }
  }

  /// A worker for each agent of each row; one per row for the few numbers that follow.
  template <class Lanes, class Rows>
  GIGA_HD static void write_by_piece(const Lanes& lanes, const Parameters auto& p, const World auto& w, int n,
                                     Rows&& rows) {
    const int waypoint_at = neighbor_columns(p), boxes_at = waypoint_at + (p.waypoints ? kWaypointFeatures : 0);
    const int n_boxes = p.n_boxes * box_features(p);
    const float* boxes = features_of_boxes(p, w);
    without_barrier(lanes).each_agent(waypoint_at < boxes_at + n_boxes ? n : 0, [&](int e) {
      float* row = rows(e);
      for (int k = waypoint_at; row && k < boxes_at; ++k) row[k] = waypoint_value(p, w, e, k - waypoint_at);
      for (int k = 0; row && k < n_boxes; ++k) row[boxes_at + k] = table_value(boxes + k);
    });
    const auto of = [&](int e, int k) { return neighbor(p, w, e, k); };
    lanes.write_pieces(n, p.n_neighbors, rows, of, [&](int e, int k, auto a) {
      NeighborNumbers piece;
      write_neighbor(p, w, e, w.features[e], k, a, [&](int feature, float number) { piece.number[feature] = number; });
      return piece;
    });
  }

  /// So many rows at a time: some workers put together each of them in shared memory, then they are sent, all of a team
  /// at once where they lie one behind the other, while the next are made.
  template <class Lanes, Parameters P>
  GIGA_HD static void send_rows(const Lanes& lanes, const P& p, const World auto& w, int n,
                                const TeamRows (&to)[kNTeams]) {
    constexpr int kRows = kStageRows<P>, kPitch = kStageRow<P>, kNeighbors = P::n_neighbors * kNeighborFeatures;
    constexpr int kFront = kNeighbors + (P::waypoints ? kWaypointFeatures : 0);  // numbers before the boxes
    constexpr int kWorkers = P::n_agents / kRows;                                // of a row
    constexpr int kShare = (P::n_neighbors + kWorkers - 1) / kWorkers;  // agents of a row that one of them writes
    constexpr bool kFull = P::n_agents % kRows == 0;                    // the last rows are as many as the others
    constexpr bool kOneTeam = P::kTeam0 % kRows == 0;                   // those together are of one team
    const float* boxes = features_of_boxes(p, w);
    const int n_tail = p.n_boxes * box_features(p);
    const bool whole = kFront + n_tail <= kPitch;  // else there are too many boxes for the stage
    const int columns = whole ? kFront + n_tail : kFront;
    lanes.each_agent(n, [&](int i) {
      // The same in all rows; behind them zeros, as in the rows themselves.
      GIGA_UNROLL
      for (int at = 0; at < kPitch - kFront; at += P::n_agents) {
        const int k = at + i;
        const float number = k < n_tail ? table_value(boxes + k) : 0.0f;
        GIGA_UNROLL
        for (int slot = 0; slot < kRows; ++slot)
          if (k < kPitch - kFront) w.stage[slot * kPitch + kFront + k] = number;
      }
    });
    GIGA_ROLLED
    for (int first = 0; first < P::n_agents; first += kRows) {
      const int team = p.team_of(first);
      TeamRows rows = team == 0 ? to[0] : to[1];
      if (rows) rows.first = rows.row(first - p.first_of(team));
      if (first > 0) lanes.each_agent(n, [&](int) { lanes.wait_sent(); });
      lanes.each_agent(n, [&](int i) {
        const int slot = i % kRows, part = i / kRows, e = first + slot;
        if ((!kFull && e >= P::n_agents) || (kOneTeam && !rows)) return;
        const AgentFeatures own = w.features[e];
        float* row = w.stage + slot * kPitch;
        GIGA_UNROLL
        for (int j = 0; j < kShare; ++j) {
          // Each worker begins with another agent, so that they write to different banks.
          const int k = part * kShare + (j + slot) % kShare;
          if ((kFull && kWorkers * kShare == P::n_neighbors) || k < P::n_neighbors)
            write_neighbor(p, w, e, own, k, neighbor(p, w, e, k),
                           [&](int feature, float number) { row[k * kNeighborFeatures + feature] = number; });
        }
        if (P::waypoints && part == kWorkers - 1)
          for (int k = 0; k < kWaypointFeatures; ++k) row[kNeighbors + k] = waypoint_value(p, w, e, k);
        lanes.before_sending();
      });
      const auto deliver = [&](const TeamRows& there, const float* stage, int count) {
        if (there.aligned(sizeof(FourNumbers))) {
          const bool together = whole && there.stride == kPitch && (columns == kPitch || there.room >= kPitch);
          const int sent = together ? count * kPitch : columns / 4 * 4;
          lanes.each_agent(n, [&](int i) {
            if (there && i < (together ? 1 : count)) {
              lanes.send(there.row(i), stage + i * kPitch, sent);
              for (int k = sent; k < columns; ++k) there.row(i)[k] = stage[i * kPitch + k];
            }
          });
        } else {
          lanes.each(n > 0 && there ? columns : 0, [&](int k) {
            for (int slot = 0; slot < count; ++slot) there.row(slot)[k] = stage[slot * kPitch + k];
          });
        }
      };
      const int left = p.end_of(team) - first, count = (kFull && kOneTeam) || left > kRows ? kRows : left;
      deliver(rows, w.stage, count);
      if constexpr (!kOneTeam) {
        const int here = kFull || P::n_agents - first > kRows ? kRows : P::n_agents - first;  // rows
        if (count < here && team == 0) deliver(to[1], w.stage + count * kPitch, here - count);
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
