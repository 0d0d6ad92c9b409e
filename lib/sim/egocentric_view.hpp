// The egocentric view: what is around an agent, told along its own heading (rules 7.5; ours, off by default). It adds
// nothing to the vector observation; it only tells part of it in a form that is easier to use. It leaves out agents
// beyond the nearest kViewOpponents and kViewTeamMates, how long the waypoint stays, and of obstacles all but where the
// twelve directions meet them. Types of agents are told where a team mixes them; elsewhere the team tells the type.
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/movement.hpp"
#include "sim/rows.hpp"
#include "sim/waypoint.hpp"

namespace giga {

/// Numbers of the block, in this order: the agent itself, how near walls are in each direction, the waypoint, then the
/// nearest opponents and the nearest team mates among its rows (rules 7.1). All are 0 if the agent does not see itself.
constexpr int kViewSelf = 7;      ///< x and y in [-1, 1], cosine and sine of the heading, z / 10, speed / 5, health
constexpr int kViewRays = 12;     ///< directions, counterclockwise from straight ahead
constexpr int kViewWaypoint = 3;  ///< nearness, ahead, left
constexpr int kViewAgent = 8;     ///< see ViewFeature
constexpr int kViewKind = 3;  ///< behind the numbers of an agent, itself included, in mixed teams: bits of its sprite
constexpr int kViewOpponents = 3;  ///< at most
constexpr int kViewTeamMates = 2;  ///< at most
static_assert(kNearestAgents == kViewOpponents + kViewTeamMates);
enum ViewFeature : int {
  kViewNearness,  ///< 1 / (1 + distance); 0 = nobody
  kViewAhead,     ///< cosine and sine of the bearing: where it is
  kViewLeft,
  kViewCourseAhead,  ///< cosine and sine of its heading relative to the agent's: where it flies
  kViewCourseLeft,
  kViewClimb,      ///< z / 10, relative
  kViewOvertakes,  ///< speed / 5, relative
  kViewHealth
};

GIGA_HD int view_opponents(const Parameters auto& p) {
  const int most = p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1];
  return most < kViewOpponents ? most : kViewOpponents;
}
GIGA_HD int view_team_mates(const Parameters auto& p) {
  const int most = (p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1]) - 1;
  return most < kViewTeamMates ? most : kViewTeamMates;
}
GIGA_HD int view_agents(const Parameters auto& p) { return view_opponents(p) + view_team_mates(p); }
GIGA_HD int view_kind_columns(const Parameters auto& p) { return p.mixed_teams ? kViewKind : 0; }
GIGA_HD int view_self_columns(const Parameters auto& p) { return kViewSelf + view_kind_columns(p); }
GIGA_HD int view_agent_columns(const Parameters auto& p) { return kViewAgent + view_kind_columns(p); }
/// First number about other agents.
GIGA_HD int view_agents_at(const Parameters auto& p) {
  return view_self_columns(p) + kViewRays + (p.waypoints ? kViewWaypoint : 0);
}
GIGA_HD int view_size(const Parameters auto& p) { return view_agents_at(p) + view_agents(p) * view_agent_columns(p); }
/// Near things change much, far ones little; 0 for what is not there.
GIGA_HD float nearness(float distance) { return 1.0f / (1.0f + distance); }

/// How far one can fly along a line through a point, forwards and backwards, before the border or an obstacle.
struct FreeWay {
  float ahead, behind;

  /// Takes in the stretch [enter, leave] of the line that lies in an obstacle, if there is one.
  GIGA_HD void block(bool solid, float enter, float leave) {
    const bool met = solid && enter < leave;
    ahead = met && leave > 0 ? min_of(ahead, max_of(enter, 0.0f)) : ahead;
    behind = met && enter < 0 ? min_of(behind, max_of(-leave, 0.0f)) : behind;
  }
};

/// From (x, y) inside the world, along the unit vector (dx, dy), at altitude z.
GIGA_HD FreeWay free_way(const Parameters auto& p, const Box* boxes, float x, float y, float z, float dx, float dy) {
  // A line that runs along an axis never meets what lies across the other one.
  constexpr float kBeyond = 1e9f;
  const float inv_x = dx != 0 ? 1.0f / dx : 0.0f, inv_y = dy != 0 ? 1.0f / dy : 0.0f;
  const float x0 = -x * inv_x, x1 = (p.limit_x - x) * inv_x, y0 = -y * inv_y, y1 = (p.limit_y - y) * inv_y;
  const float ahead_x = dx != 0 ? max_of(x0, x1) : kBeyond, ahead_y = dy != 0 ? max_of(y0, y1) : kBeyond;
  const float behind_x = dx != 0 ? -min_of(x0, x1) : kBeyond, behind_y = dy != 0 ? -min_of(y0, y1) : kBeyond;
  FreeWay way{max_of(min_of(ahead_x, ahead_y), 0.0f), max_of(min_of(behind_x, behind_y), 0.0f)};
  GIGA_ROLLED
  for (int b = 0; b < p.n_boxes; ++b) {
    const Box box = table_box(boxes + b);
    if (!(box.x1 < box.x2 && box.y1 < box.y2)) continue;  // padding, which most maps have
    const bool at_height = !p.obstacle_heights || !(z < box.z1 || z > box.z2);
    const bool beside = (dx == 0 && (x <= box.x1 || x >= box.x2)) || (dy == 0 && (y <= box.y1 || y >= box.y2));
    const float a = (box.x1 - x) * inv_x, c = (box.x2 - x) * inv_x;
    const float e = (box.y1 - y) * inv_y, f = (box.y2 - y) * inv_y;
    way.block(at_height && !beside, max_of(dx != 0 ? min_of(a, c) : -kBeyond, dy != 0 ? min_of(e, f) : -kBeyond),
              min_of(dx != 0 ? max_of(a, c) : kBeyond, dy != 0 ? max_of(e, f) : kBeyond));
  }
  return way;
}

/// After rank_neighbors: the nearest opponents and team mates among e's rows, and the direction in which e flies.
GIGA_HD void gather_nearest(const Parameters auto& p, World auto& w, int e) {
  auto* nearest = w.nearest_agents + e * kNearestAgents;
  for (int k = 0; k < kNearestAgents; ++k) nearest[k] = kNobody;
  const int opponents = view_opponents(p), end = opponents + view_team_mates(p);
  int opponent = 0, mate = opponents;  // where the next one goes
  const auto* rows = w.neighbors + static_cast<int64_t>(e) * p.n_neighbors;
  for (int k = 1; k < p.n_neighbors && rows[k] != kNobody; ++k) {
    const bool is_mate = p.team_of(rows[k]) == p.team_of(e);
    if (is_mate ? mate == end : opponent == opponents) continue;
    nearest[is_mate ? mate : opponent] = rows[k];
    (is_mate ? mate : opponent) += 1;
  }
  face(w, e);
}

/// The kind of agent a: its sprite's bits, each as 0 or 1; out [view_kind_columns(p)].
GIGA_HD void write_view_kind(const Parameters auto& p, int a, float* out) {
  if (!p.mixed_teams) return;
  const int sprite = table_value(p.agents.sprite + a);
  for (int bit = 0; bit < kViewKind; ++bit) out[bit] = static_cast<float>(sprite >> bit & 1);
}

/// The part about e itself: out [view_self_columns(p)]. Here and below `mirror`: TeamIo::mirror of its team.
GIGA_HD void write_view_self(const Parameters auto& p, const World auto& w, int e, float mirror, float* out) {
  out[0] = 2 * w.x[e] * p.inv_limit_x - 1;
  out[1] = mirror * (2 * w.y[e] * p.inv_limit_y - 1);
  out[2] = w.dir_x[e];
  out[3] = mirror * w.dir_y[e];
  out[4] = w.z[e] * (1.0f / kAltitudeLimit);
  out[5] = w.v[e] * 0.2f;
  out[6] = w.health[e];
  write_view_kind(p, e, out + kViewSelf);
}

/// Nearness of the first wall in each direction: out [kViewRays]. A line serves two opposite ones; those from `first`
/// to `end` are written.
constexpr int kViewLines = kViewRays / 2;
GIGA_HD void write_view_walls(const Parameters auto& p, const World auto& w, int e, float mirror, int first, int end,
                              float* out) {
  static_assert(kViewLines == 6);
  constexpr float kCos30 = 0.86602540378443864676f;
  const float sin30 = 0.5f * mirror;
  const Box* boxes = p.maps.boxes + static_cast<int64_t>(*w.map) * p.n_boxes;
  float dx = w.dir_x[e], dy = w.dir_y[e];
  GIGA_ROLLED
  for (int k = 0; k < end; ++k) {
    if (k >= first) {
      const FreeWay way = free_way(p, boxes, w.x[e], w.y[e], w.z[e], dx, dy);
      out[k] = nearness(way.ahead);
      out[k + kViewLines] = nearness(way.behind);
    }
    const float turned = dx * kCos30 - dy * sin30;
    dy = dy * kCos30 + dx * sin30;
    dx = turned;
  }
}

/// Nearness and bearing of a place relative to e: out [3].
GIGA_HD void write_view_place(const World auto& w, int e, float mirror, float dx, float dy, float* out) {
  const float distance = std::sqrt(dx * dx + dy * dy);
  const float inverse = distance > 0 ? 1.0f / distance : 0.0f;
  out[kViewNearness] = nearness(distance);
  out[kViewAhead] = distance > 0 ? (dx * w.dir_x[e] + dy * w.dir_y[e]) * inverse : 1.0f;
  out[kViewLeft] = (dy * w.dir_x[e] - dx * w.dir_y[e]) * (inverse * mirror);
}

/// The waypoint's centre: out [kViewWaypoint].
GIGA_HD void write_view_waypoint(const World auto& w, int e, float mirror, float* out) {
  const float x = 0.5f * (w.waypoint[0] + w.waypoint[2]), y = 0.5f * (w.waypoint[1] + w.waypoint[3]);
  write_view_place(w, e, mirror, x - w.x[e], y - w.y[e], out);
}

/// Agent a as e sees it: out [view_agent_columns(p)].
GIGA_HD void write_view_agent(const Parameters auto& p, const World auto& w, int e, float mirror, int a, float* out) {
  write_view_place(w, e, mirror, w.x[a] - w.x[e], w.y[a] - w.y[e], out);
  out[kViewCourseAhead] = w.dir_x[a] * w.dir_x[e] + w.dir_y[a] * w.dir_y[e];
  out[kViewCourseLeft] = mirror * (w.dir_y[a] * w.dir_x[e] - w.dir_x[a] * w.dir_y[e]);
  out[kViewClimb] = (w.z[a] - w.z[e]) * (1.0f / kAltitudeLimit);
  out[kViewOvertakes] = (w.v[a] - w.v[e]) * 0.2f;
  out[kViewHealth] = w.health[a];
  write_view_kind(p, a, out + kViewAgent);
}

GIGA_HD void write_nothing(int size, float* out) {
  for (int k = 0; k < size; ++k) out[k] = 0;
}

GIGA_HD bool view_is_empty(const Parameters auto& p, const World auto& w, int e) {
  return w.neighbors[static_cast<int64_t>(e) * p.n_neighbors] == kNobody;
}

/// What e sees of itself and of the waypoint; `view`: the whole row.
GIGA_HD void write_view_ends(const Parameters auto& p, const World auto& w, int e, float mirror, float* view) {
  write_view_self(p, w, e, mirror, view);
  if (!p.waypoints) return;
  float* out = view + view_self_columns(p) + kViewRays;
  if (waypoint_shown(p, w))
    write_view_waypoint(w, e, mirror, out);
  else
    write_nothing(kViewWaypoint, out);
}

/// All of e's egocentric view but the other agents, after gather_nearest of all agents.
GIGA_HD void write_view_surroundings(const Parameters auto& p, const World auto& w, int e, float mirror, float* view) {
  if (view_is_empty(p, w, e)) return write_nothing(view_agents_at(p), view);
  write_view_ends(p, w, e, mirror, view);
  write_view_walls(p, w, e, mirror, 0, kViewLines, view + view_self_columns(p));
}

/// The rest: agent number `item` of e's egocentric view.
GIGA_HD void write_view_agent_item(const Parameters auto& p, const World auto& w, int e, float mirror, int item,
                                   float* view) {
  const auto a = w.nearest_agents[e * kNearestAgents + item];
  float* out = view + view_agents_at(p) + item * view_agent_columns(p);
  if (a == kNobody || view_is_empty(p, w, e)) return write_nothing(view_agent_columns(p), out);
  write_view_agent(p, w, e, mirror, a, out);
}

/// What is around an agent along its own heading; [view_size(p)].
struct EgocentricView {
  static constexpr Observation id = Observation::egocentric;
  static constexpr const char* name = "egocentric";
  static constexpr ObservationOf of = ObservationOf::agent;
  using Element = float;
  static constexpr ElementType type = ElementType::f32;

  GIGA_HD static bool offered(const Parameters auto& p) { return p.egocentric_view; }
  GIGA_HD static ObservationShape shape(const Parameters auto& p) { return view_size(p); }
  GIGA_HD static void prepare(const Parameters auto& p, World auto& w, int e) { gather_nearest(p, w, e); }

  template <class Lanes, class Rows>
  GIGA_HD static void write(const Lanes& lanes, const Parameters auto& p, const World auto& w, int n, Rows&& rows) {
    using P = std::remove_cvref_t<decltype(p)>;
    if constexpr (!Lanes::kSerial && staged<P>()) return send_rows(lanes, p, w, n, rows);
    lanes.each(n, [&](int e) {
      float* row = rows(e);
      if (row) write_view_surroundings(p, w, e, rows.mirror(p.team_of(e)), row);
    });
    const int items = view_agents(p);
    lanes.each(n * items, [&](int k) {
      const int e = k / items, item = k - e * items;
      float* row = rows(e);
      if (row) write_view_agent_item(p, w, e, rows.mirror(p.team_of(e)), item, row);
    });
  }

 private:
  /// Whether rows pass through shared memory. Teams of 2 and of 20 would lose 5 and 1 % of their rate without the view,
  /// because a thread of theirs has no registers left for this (H200: 2 vs 2 4.66 and 4.44 G agent-steps/s).
  template <class P>
  static constexpr bool staged() {
    if constexpr ((P::kAgents == 10 || P::kAgents == 20) && P::kAgents == 2 * P::kTeam)
      return (kMostNumbers + 7) / 8 * 8 + 4 <= kStageRow<P>;  // else rows tell of too few agents
    else
      return false;
  }

  /// Numbers of a row with the zeros behind it, as RowLayout has them; from one staged row to the next there are four
  /// more, so that the same number of several rows lies in several banks.
  GIGA_HD static int padded_size(const Parameters auto& p) { return (view_size(p) + 7) / 8 * 8; }
  static constexpr int kMostNumbers = kViewSelf + kViewRays + kViewWaypoint + kNearestAgents * kViewAgent +
                                      (1 + kNearestAgents) * kViewKind;  // of any scenario

  /// As VectorObservation::send_rows: so many rows at a time are put together in shared memory, each by some workers,
  /// and sent from there while the next are made. A row is one stretch of memory, beside what else its agent sees.
  template <class Lanes, Parameters P>
  GIGA_HD static void send_rows(const Lanes& lanes, const P& p, const World auto& w, int n, const auto& of_world) {
    static_assert(P::kTeam % kStageRows<P> == 0);
    constexpr int kRows = kStageRows<P>, kWorkers = P::n_agents / kRows;  // of a row
    constexpr int kLines = (kViewLines + kWorkers - 1) / kWorkers;        // that one of them sees to
    const int items = view_agents(p), columns = view_size(p), padded = padded_size(p), pitch = padded + 4;
    GIGA_ROLLED
    for (int first = 0; first < P::n_agents; first += kRows) {
      const int team = p.team_of(first);
      TeamRows rows = of_world.of_team(team);
      const float mirror = of_world.mirror(team);
      if (rows) rows.first = rows.row(first - p.first_of(team));
      lanes.each_agent(n, [&](int) { lanes.wait_sent(); });  // of these rows or others: the stage is the same
      lanes.each_agent(n, [&](int i) {
        if (!rows) return;
        const int slot = i % kRows, part = i / kRows, e = first + slot;
        float* row = w.stage + slot * pitch;
        if (view_is_empty(p, w, e)) {
          for (int k = part; k < padded; k += kWorkers) row[k] = 0;
        } else {
          const int line = part * kLines, end = line + kLines < kViewLines ? line + kLines : kViewLines;
          write_view_walls(p, w, e, mirror, line, end, row + view_self_columns(p));
          for (int item = part; item < items; item += kWorkers) write_view_agent_item(p, w, e, mirror, item, row);
          if (part == kWorkers - 1) {
            write_view_ends(p, w, e, mirror, row);
            for (int k = columns; k < padded; ++k) row[k] = 0;
          }
        }
        lanes.before_sending();
      });
      if (rows.aligned(sizeof(FourNumbers))) {
        const int sent = rows.room >= padded ? padded : columns / 4 * 4;
        lanes.each_agent(n, [&](int i) {
          if (!rows || i >= kRows) return;
          lanes.send(rows.row(i), w.stage + i * pitch, sent);
          for (int k = sent; k < columns; ++k) rows.row(i)[k] = w.stage[i * pitch + k];
        });
      } else {
        lanes.each(n > 0 && rows ? columns : 0, [&](int k) {
          for (int slot = 0; slot < kRows; ++slot) rows.row(slot)[k] = w.stage[slot * pitch + k];
        });
      }
    }
  }
};

}  // namespace giga
