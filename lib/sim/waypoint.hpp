// Waypoints: who reaches the present one, and when the next appears (rules 4.2).
#pragma once

#include "core/geometry.hpp"
#include "sim/physics.hpp"
#include "sim/world.hpp"

namespace giga {

/// Flags an agent inside the present waypoint; altitude is ignored. The original lets the dead collect too (Q10).
GIGA_HD void touch_waypoint(const Parameters auto& p, World auto& w, int i) {
  const float* at = w.waypoint;
  const bool inside = at[0] <= w.x[i] && w.x[i] <= at[2] && at[1] <= w.y[i] && w.y[i] <= at[3];
  if (*w.waypoint_time > 0 && inside && (p.original() || w.was_alive[i])) w.flags[i] |= kHitWaypoint;
}

/// Whether agents are shown the present waypoint (rules 16.7).
GIGA_HD bool waypoint_shown(const Parameters auto& p, const World auto& w) {
  return *w.waypoint_time > p.waypoint_unseen_time;
}

/// Ages the waypoint, removes a collected one, which counts once for each team that had a living agent in it, and lets
/// a new one appear where there is none.
template <class Draws>
GIGA_HD void update_waypoint(const Parameters auto& p, World auto& w, Draws& draws) {
  float time = *w.waypoint_time - kDt;
  bool collected[kNTeams] = {false, false};
  for (int i = 0; i < p.n_agents; ++i) {
    if (!(w.flags[i] & kHitWaypoint)) continue;
    time = 0;
    if (w.was_alive[i]) collected[p.team_of(i)] = true;
  }
  for (int team = 0; team < kNTeams; ++team)
    if (collected[team]) w.score[team] += 1;
  const bool appears = time <= 0 && draws.waypoint_appears() < Physics::waypoint_chance;
  time = max_of(time, 0.0f);
  if (appears) {
    w.waypoint[0] = draws.waypoint_location(0) * (p.limit_x - p.waypoint_size);
    w.waypoint[1] = draws.waypoint_location(1) * (p.limit_y - p.waypoint_size);
    w.waypoint[2] = w.waypoint[0] + p.waypoint_size;
    w.waypoint[3] = w.waypoint[1] + p.waypoint_size;
    const float more = p.waypoint_unseen_time > 0 ? 1.0f : draws.waypoint_time();
    time += Physics::waypoint_min_time + Physics::waypoint_more_time * more;
  }
  *w.waypoint_time = time;
}

}  // namespace giga
