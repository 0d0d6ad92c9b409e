// The start of an episode: map, places, resampling of those who start too close (rules 9).
#pragma once

#include "sim/draws.hpp"
#include "sim/movement.hpp"
#include "sim/world.hpp"

namespace giga {

constexpr int kResampleRounds = 3;
constexpr float kStartMargin = 0.1f;  ///< added to the squared collision range, the altitude gap and every box

template <class Draws>
GIGA_HD void begin_episode(const Parameters auto& p, World auto& w, Draws& draws) {
  *w.map = draws.map(p.n_maps);
  for (int k = 0; k < 4; ++k) w.waypoint[k] = 0;
  *w.waypoint_time = 0;
  *w.episode_length = 0;
  *w.outcome = Outcome::open;
  *w.phase = Phase::plays;
}

GIGA_HD const StartArea& start_area(const Parameters auto& p, const World auto& w, int i) {
  return p.maps.start[*w.map * kNTeams + p.team_of(i)];
}

/// Start coordinates of agent i in a round of draws, into w.next.
template <class Draws>
GIGA_HD void draw_place(const Parameters auto& p, World auto& w, Draws& draws, int round, int i) {
  const StartArea& area = start_area(p, w, i);
  const int n = p.n_agents;
  w.next[i] = area.x1 + draws.start(i, round, StartDraw::x) * (area.x2 - area.x1);
  w.next[n + i] = area.y1 + draws.start(i, round, StartDraw::y) * (area.y2 - area.y1);
  w.next[2 * n + i] = area.z_lo + draws.start(i, round, StartDraw::z) * (area.z_hi - area.z_lo);
}

GIGA_HD void take_place(const Parameters auto& p, World auto& w, int i) {
  w.x[i] = w.next[i];
  w.y[i] = w.next[p.n_agents + i];
  w.z[i] = w.next[2 * p.n_agents + i];
}

/// Agent i as it starts. Health is 1 for everybody in the original, whatever the type's maximum (Q5); speed is 1,
/// below the floor that holds from the first step on (Q6).
template <class Draws>
GIGA_HD void place_agent(const Parameters auto& p, World auto& w, Draws& draws, int i) {
  const int64_t n = p.n_agents, words = words_for(p.n_agents);
  const StartArea& area = start_area(p, w, i);
  draw_place(p, w, draws, 0, i);
  take_place(p, w, i);
  w.v[i] = 1.0f;
  w.heading[i] = area.heading_lo + draws.start(i, 0, StartDraw::heading) * (area.heading_hi - area.heading_lo);
  w.health[i] = p.original() ? 1.0f : p.agents.max_health[i];
  w.alive[i] = 1;
  w.death[i] = Death::none;
  w.flags[i] = 0;
  for (int64_t b = 0; b < n; ++b) w.tracked[i * n + b] = 0;
  for (int64_t k = 0; k < words; ++k) w.detected[i * words + k] = 0;
  face(w, i);
}

/// Checks agent i against all positions and redraws it if it is too close. Both agents of a close pair move (Q24).
template <class Draws>
GIGA_HD void propose_place(const Parameters auto& p, World auto& w, Draws& draws, int round, int i) {
  bool crowded = inside_obstacle(p, w, w.x[i], w.y[i], w.z[i], kStartMargin);
  for (int j = 0; j < p.n_agents && !crowded; ++j) {
    const float dz = w.z[i] - w.z[j];
    crowded = j != i && planar_distance2(w, i, j) < p.collision_range2 + kStartMargin &&
              (dz < 0 ? -dz : dz) < p.collision_altitude + kStartMargin;
  }
  w.flags[i] = static_cast<uint8_t>(crowded ? w.flags[i] | kNeedsResample : w.flags[i] & ~kNeedsResample);
  if (crowded) draw_place(p, w, draws, round, i);
}

GIGA_HD void accept_place(const Parameters auto& p, World auto& w, int i) {
  if (w.flags[i] & kNeedsResample) take_place(p, w, i);
}

}  // namespace giga
