// The body view: what is around an agent, told along its own heading (SPEC has no such thing: it is ours, off by
// default). It says nothing that the observation before it does not; what a pilot needs is just easier to read off it.
// It says less: nothing of agents beyond the nearest kBodyOpponents and kBodyTeamMates, nor how long the waypoint will
// stay, nor of obstacles more than where the twelve directions meet them. Kinds of agents are told where a team mixes
// them; elsewhere the team tells the kind.
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/movement.hpp"

namespace giga {

/// Numbers of the block, in this order: the agent itself, how near walls are in each direction, the waypoint, then the
/// nearest opponents and the nearest team mates that it sees. All are 0 where the agent sees not even itself.
constexpr int kBodySelf = 7;      ///< x and y in [-1, 1], cosine and sine of the heading, z / 10, speed / 5, health
constexpr int kBodyRays = 12;     ///< directions, counterclockwise from straight ahead
constexpr int kBodyWaypoint = 3;  ///< nearness, ahead, left
constexpr int kBodyAgent = 8;     ///< see BodyFeature
constexpr int kBodyKind = 3;  ///< behind the numbers of an agent, itself included, in mixed teams: bits of its sprite
constexpr int kBodyOpponents = 3;  ///< at most
constexpr int kBodyTeamMates = 2;  ///< at most
static_assert(kBodyCompany == kBodyOpponents + kBodyTeamMates);
enum BodyFeature : int {
  kBodyNearness,  ///< 1 / (1 + distance); 0 = nobody
  kBodyAhead,     ///< cosine and sine of the bearing: where it is
  kBodyLeft,
  kBodyCourseAhead,  ///< cosine and sine of its heading relative to the agent's: where it flies
  kBodyCourseLeft,
  kBodyClimb,      ///< z / 10, relative
  kBodyOvertakes,  ///< speed / 5, relative
  kBodyHealth
};

GIGA_HD int body_opponents(const SimParams& p) {
  const int most = p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1];
  return most < kBodyOpponents ? most : kBodyOpponents;
}
GIGA_HD int body_team_mates(const SimParams& p) {
  const int most = (p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1]) - 1;
  return most < kBodyTeamMates ? most : kBodyTeamMates;
}
GIGA_HD int body_agents(const SimParams& p) { return body_opponents(p) + body_team_mates(p); }
GIGA_HD int body_kind_columns(const SimParams& p) { return p.mixed_teams ? kBodyKind : 0; }
GIGA_HD int body_self_columns(const SimParams& p) { return kBodySelf + body_kind_columns(p); }
GIGA_HD int body_agent_columns(const SimParams& p) { return kBodyAgent + body_kind_columns(p); }
/// First number about other agents.
GIGA_HD int body_agents_at(const SimParams& p) {
  return body_self_columns(p) + kBodyRays + (p.waypoints ? kBodyWaypoint : 0);
}
GIGA_HD int body_columns(const SimParams& p) {
  return p.body_view ? body_agents_at(p) + body_agents(p) * body_agent_columns(p) : 0;
}
/// Where the block starts behind `before` numbers: at a multiple of 8, so that a network can read it alone. Zeros fill
/// the gap.
GIGA_HD int body_at(int before) { return (before + 7) / 8 * 8; }

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
GIGA_HD FreeWay free_way(const SimParams& p, const Box* boxes, float x, float y, float z, float dx, float dy) {
  // A line that runs along an axis never meets what lies across the other one.
  constexpr float kFar = 1e9f;
  const float inv_x = dx != 0 ? 1.0f / dx : 0.0f, inv_y = dy != 0 ? 1.0f / dy : 0.0f;
  const float x0 = -x * inv_x, x1 = (p.limit_x - x) * inv_x, y0 = -y * inv_y, y1 = (p.limit_y - y) * inv_y;
  const float ahead_x = dx != 0 ? max_of(x0, x1) : kFar, ahead_y = dy != 0 ? max_of(y0, y1) : kFar;
  const float behind_x = dx != 0 ? -min_of(x0, x1) : kFar, behind_y = dy != 0 ? -min_of(y0, y1) : kFar;
  FreeWay way{max_of(min_of(ahead_x, ahead_y), 0.0f), max_of(min_of(behind_x, behind_y), 0.0f)};
  // Selections rather than branches, so that the numbers of a box are read at the same time.
  for (int b = 0; b < p.n_boxes; ++b) {
    const Box box = table_box(boxes + b);
    const bool some = box.x1 < box.x2 && box.y1 < box.y2;  // else padding
    const bool at_height = !p.obstacle_heights || !(z < box.z1 || z > box.z2);
    const bool beside = (dx == 0 && (x <= box.x1 || x >= box.x2)) || (dy == 0 && (y <= box.y1 || y >= box.y2));
    const float a = (box.x1 - x) * inv_x, c = (box.x2 - x) * inv_x;
    const float e = (box.y1 - y) * inv_y, f = (box.y2 - y) * inv_y;
    way.block(some && at_height && !beside, max_of(dx != 0 ? min_of(a, c) : -kFar, dy != 0 ? min_of(e, f) : -kFar),
              min_of(dx != 0 ? max_of(a, c) : kFar, dy != 0 ? max_of(e, f) : kFar));
  }
  return way;
}

/// After rank_neighbors: the nearest opponents and team mates among e's rows, and the direction in which e flies.
GIGA_HD void gather_company(const SimParams& p, WorldView& w, int e) {
  uint16_t* company = w.company + e * kBodyCompany;
  for (int k = 0; k < kBodyCompany; ++k) company[k] = kNobody;
  const int most[2] = {body_opponents(p), body_team_mates(p)};
  int found[2] = {0, 0};
  const uint16_t* rows = w.neighbors + static_cast<int64_t>(e) * p.n_neighbors;
  for (int k = 1; k < p.n_neighbors && rows[k] != kNobody; ++k) {
    const int mate = p.team_of(rows[k]) == p.team_of(e) ? 1 : 0;
    if (found[mate] == most[mate]) continue;
    company[(mate ? most[0] : 0) + found[mate]++] = rows[k];
  }
  face(w, e);
}

/// The kind of agent a: its sprite's bits, each as 0 or 1; out [body_kind_columns(p)].
GIGA_HD void write_body_kind(const SimParams& p, int a, float* out) {
  if (!p.mixed_teams) return;
  const int sprite = table_value(p.agents.sprite + a);
  for (int bit = 0; bit < kBodyKind; ++bit) out[bit] = static_cast<float>(sprite >> bit & 1);
}

/// The part about e itself: out [body_self_columns(p)].
GIGA_HD void write_body_self(const SimParams& p, const WorldView& w, int e, float* out) {
  out[0] = 2 * w.x[e] * p.inv_limit_x - 1;
  out[1] = 2 * w.y[e] * p.inv_limit_y - 1;
  out[2] = w.dir_x[e];
  out[3] = w.dir_y[e];
  out[4] = w.z[e] * (1.0f / kAltitudeLimit);
  out[5] = w.v[e] * 0.2f;
  out[6] = w.health[e];
  write_body_kind(p, e, out + kBodySelf);
}

/// Nearness of the first wall in each direction: out [kBodyRays]. A line serves two opposite ones.
GIGA_HD void write_body_walls(const SimParams& p, const WorldView& w, int e, float* out) {
  constexpr int kLines = kBodyRays / 2;
  static_assert(kLines == 6);
  constexpr float kCos30 = 0.86602540378443864676f, kSin30 = 0.5f;
  const Box* boxes = p.maps.boxes + static_cast<int64_t>(*w.map) * p.n_boxes;
  float dx = w.dir_x[e], dy = w.dir_y[e];
  GIGA_ROLLED
  for (int k = 0; k < kLines; ++k) {
    const FreeWay way = free_way(p, boxes, w.x[e], w.y[e], w.z[e], dx, dy);
    out[k] = nearness(way.ahead);
    out[k + kLines] = nearness(way.behind);
    const float turned = dx * kCos30 - dy * kSin30;
    dy = dy * kCos30 + dx * kSin30;
    dx = turned;
  }
}

/// Nearness and bearing of a place relative to e: out [3].
GIGA_HD void write_body_place(const WorldView& w, int e, float dx, float dy, float* out) {
  const float distance = std::sqrt(dx * dx + dy * dy);
  const float inverse = distance > 0 ? 1.0f / distance : 0.0f;
  out[kBodyNearness] = nearness(distance);
  out[kBodyAhead] = distance > 0 ? (dx * w.dir_x[e] + dy * w.dir_y[e]) * inverse : 1.0f;
  out[kBodyLeft] = (dy * w.dir_x[e] - dx * w.dir_y[e]) * inverse;
}

/// The waypoint's centre: out [kBodyWaypoint].
GIGA_HD void write_body_waypoint(const WorldView& w, int e, float* out) {
  const float x = 0.5f * (w.waypoint[0] + w.waypoint[2]), y = 0.5f * (w.waypoint[1] + w.waypoint[3]);
  write_body_place(w, e, x - w.x[e], y - w.y[e], out);
}

/// Agent a as e sees it: out [body_agent_columns(p)].
GIGA_HD void write_body_agent(const SimParams& p, const WorldView& w, int e, int a, float* out) {
  write_body_place(w, e, w.x[a] - w.x[e], w.y[a] - w.y[e], out);
  out[kBodyCourseAhead] = w.dir_x[a] * w.dir_x[e] + w.dir_y[a] * w.dir_y[e];
  out[kBodyCourseLeft] = w.dir_y[a] * w.dir_x[e] - w.dir_x[a] * w.dir_y[e];
  out[kBodyClimb] = (w.z[a] - w.z[e]) * (1.0f / kAltitudeLimit);
  out[kBodyOvertakes] = (w.v[a] - w.v[e]) * 0.2f;
  out[kBodyHealth] = w.health[a];
  write_body_kind(p, a, out + kBodyAgent);
}

GIGA_HD void write_nothing(int size, float* out) {
  for (int k = 0; k < size; ++k) out[k] = 0;
}

/// All of e's body view but the other agents, after gather_company of all agents.
GIGA_HD void write_body_surroundings(const SimParams& p, const WorldView& w, int e, float* out) {
  const bool sees = w.neighbors[static_cast<int64_t>(e) * p.n_neighbors] != kNobody;
  if (!sees) return write_nothing(body_agents_at(p), out);
  write_body_self(p, w, e, out);
  out += body_self_columns(p);
  write_body_walls(p, w, e, out);
  if (!p.waypoints) return;
  if (*w.waypoint_time > 0)
    write_body_waypoint(w, e, out + kBodyRays);
  else
    write_nothing(kBodyWaypoint, out + kBodyRays);
}

/// The rest: agent number `item` of e's body view.
GIGA_HD void write_body_company(const SimParams& p, const WorldView& w, int e, int item, float* out) {
  const uint16_t a = w.company[e * kBodyCompany + item];
  const bool sees = w.neighbors[static_cast<int64_t>(e) * p.n_neighbors] != kNobody;
  out += body_agents_at(p) + item * body_agent_columns(p);
  if (a == kNobody || !sees) return write_nothing(body_agent_columns(p), out);
  write_body_agent(p, w, e, a, out);
}

}  // namespace giga
