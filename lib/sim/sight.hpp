// Sight and damage: who detects whom, who fires, tracking counters, health (rules 4.4 and 4.5).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/draws.hpp"
#include "sim/segment_box.hpp"
#include "sim/world.hpp"

namespace giga {

/// Whether the segment from agent i to agent j passes through an obstacle (an option beyond the original, rules 16.2).
GIGA_HD bool sight_blocked(const Parameters auto& p, const World auto& w, int i, int j) {
  const Box* boxes = p.maps.boxes + static_cast<int64_t>(*w.map) * p.n_boxes;
  const float from[3] = {w.x[i], w.y[i], w.z[i]};
  const float delta[3] = {w.x[j] - w.x[i], w.y[j] - w.y[i], w.z[j] - w.z[i]};
  for (int b = 0; b < p.n_boxes; ++b) {
    const float lo[3] = {boxes[b].x1, boxes[b].y1, boxes[b].z1}, hi[3] = {boxes[b].x2, boxes[b].y2, boxes[b].z2};
    if (!(lo[0] < hi[0] && lo[1] < hi[1])) continue;  // padding
    if (segment_meets_box(from, delta, lo, hi, p.obstacle_heights ? 3 : 2)) return true;
  }
  return false;
}

struct Sighting {
  bool detected, in_weapon_range;
};

/// Target a as seen from observer b.
struct Gap {
  float dx, dy;
  float d2;  ///< squared distance
};
GIGA_HD Gap gap_to(const Parameters auto& p, const World auto& w, int a, int b) {
  const float dx = w.x[a] - w.x[b], dy = w.y[a] - w.y[b];
  float d2 = dx * dx + dy * dy;
  if (p.sight_3d) d2 += (w.z[a] - w.z[b]) * (w.z[a] - w.z[b]);
  return {dx, dy, d2};
}

GIGA_HD bool within(float d2, float limit2) { return limit2 > 0 && d2 <= limit2; }
/// The squared depth of b's cone of sight.
GIGA_HD float sight_depth2(const Parameters auto& p, int b) { return p.cone_depth2 * table_value(p.agents.range + b); }
/// Whether b may see at that distance. Most pairs are too far, whatever the direction.
GIGA_HD bool in_sight_range(const Parameters auto& p, float d2, int b) {
  return (d2 < p.very_close_depth2) | within(d2, sight_depth2(p, b));
}

/// Does observer b detect target a, and is a within b's weapon cone? Both alive and of different teams.
///
/// The original compares an angle with the half angle of a cone; here the cosine is compared, since
/// |angle| < limit <=> d cos(angle) > d cos(limit), and d cos(angle) is a dot product. At d = 0 the direction does not
/// matter: such a pair is close, and a squared distance of 0 passes `<= [inside]` either way (Q3). And it compares a
/// quotient, d2 / limit, with 1; rounded correctly, that is <= 1 exactly where d2 <= limit, for a limit above 0.
///
/// `draw()` is asked where chance decides.
template <class Draw>
GIGA_HD Sighting sight(const Parameters auto& p, const World auto& w, int a, int b, Draw&& draw) {
  const auto [dx, dy, d2] = gap_to(p, w, a, b);
  if (!in_sight_range(p, d2, b)) return {false, false};

  const bool close = d2 < p.very_close_depth2;
  const float d = square_root(d2);
  const float ahead = dx * w.dir_x[b] + dy * w.dir_y[b];
  const bool in_cone = p.cone_is_full || ahead > p.cone_cos * d;
  const bool in_damage_cone = p.damage_cone_is_full || ahead > p.damage_cone_cos * d;
  bool see = close || d2 <= 0 || (p.stochastic_detection ? in_damage_cone : in_cone);
  // Outside the cone no draw suffices, so none is needed.
  if (!see && p.stochastic_detection && in_cone) see = divide(d2, sight_depth2(p, b)) < draw();
  if (see && p.obstacles_block_sight && sight_blocked(p, w, a, b)) see = false;
  const float weapon_depth2 = p.damage_cone_depth2 * table_value(p.agents.damage_range + b);
  return {see, within(d2, weapon_depth2) && (in_damage_cone || d2 <= 0)};
}

/// Damage units of a tracking counter: 0 up to the minimum, then growing by 1 a step.
GIGA_HD int damage_units(const Parameters auto& p, int tracked) {
  const int t = tracked < p.min_tracking_time ? p.min_tracking_time
                                              : (tracked > p.max_tracking_time ? p.max_tracking_time : tracked);
  return t - p.min_tracking_time;
}

/// Teams of a constant size from which on the opponents near an agent are listed before they are looked at. All others
/// are looked at without a branch.
constexpr int kListsNear = 10;

/// Everything that is done to target a: who detects it, who fires at it and for how long, what it takes.
template <class Draws>
GIGA_HD void detect_and_track(const Parameters auto& p, World auto& w, Draws& draws, int a) {
  uint8_t* tracked = w.tracked + static_cast<int64_t>(a) * p.n_agents;  // of its own team the counters stay 0
  uint32_t* detected = w.detected + static_cast<int64_t>(a) * words_for(p.n_agents);
  const bool alive = w.alive[a] != 0;
  const int team = 1 - p.team_of(a);
  int taken = 0;
  const auto track = [&](int b, Sighting s) {
    const int before = tracked[b];
    const int now = s.detected && s.in_weapon_range ? (before < 255 ? before + 1 : 255) : 0;
    tracked[b] = static_cast<uint8_t>(now);
    taken += damage_units(p, now);
    return s.detected;
  };
  if constexpr (std::remove_cvref_t<decltype(p)>::kTeam >= kListsNear) {
    uint32_t near = 0, sighted = 0;
    for_team(p, team, [&](int b, int k) {
      const bool some = alive & (w.alive[b] != 0) & in_sight_range(p, gap_to(p, w, a, b).d2, b);
      near |= some ? 1u << k : 0u;
      if (!some) tracked[b] = 0;
    });
    for (; near; near &= near - 1) {
      const int k = lowest_bit(near), b = p.first_of(team) + k;
      if (track(b, sight(p, w, a, b, [&] { return draws.detect(a, b); }))) sighted |= 1u << k;
    }
    write_team_bits(p, team, detected, sighted);
  } else {
    with_detect_draws(p, draws, a, [&](auto&& draw) {
      write_team_bits(p, team, detected, [&](int b, int k) {
        Sighting s{false, false};
        if (alive && w.alive[b]) s = sight(p, w, a, b, [&] { return draw(b, k); });
        return track(b, s);
      });
    });
  }
  w.taken[a] = static_cast<float>(taken);
  if (taken > 0) w.flags[a] |= kTookDamage;
}

/// Detection without fire, for the first observation of an episode.
template <class Draws>
GIGA_HD void detect_only(const Parameters auto& p, World auto& w, Draws& draws, int a) {
  write_team_bits(p, 1 - p.team_of(a), w.detected + static_cast<int64_t>(a) * words_for(p.n_agents),
                  [&](int b, int) { return sight(p, w, a, b, [&] { return draws.detect(a, b); }).detected; });
}

/// Rules 4.5: damage, healing and the waypoint's refill. `lives`: it has not collided.
GIGA_HD float health_after(const Parameters auto& p, float health, float taken, float limit, uint8_t flags,
                           bool lives) {
  const float refill = (flags & kHitWaypoint) ? limit : 0.0f;
  const float after = health - taken * p.damage_per_second * kDt + p.healing_per_second * kDt + refill;
  return lives ? clamp(after, 0.0f, limit) : 0.0f;
}

/// The same of agent i; death at zero health.
GIGA_HD void update_health(const Parameters auto& p, World auto& w, int i) {
  const float limit = table_value(p.agents.max_health + i);
  w.health[i] = health_after(p, w.health[i], w.taken[i], limit, w.flags[i], w.alive[i] != 0);
  if (!(w.health[i] > 0)) w.alive[i] = 0;
}

/// What an agent died of in this step.
GIGA_HD Death death_by(uint8_t flags) {
  return (flags & kOutOfBounds)   ? Death::out_of_bounds
         : (flags & kHitAgent)    ? Death::agent
         : (flags & kHitObstacle) ? Death::obstacle
                                  : Death::damage;
}

/// What agent i died of, if it did in this step; after update_health.
GIGA_HD void note_death(World auto& w, int i) {
  if (w.was_alive[i] && !w.alive[i]) w.death[i] = death_by(w.flags[i]);
}

}  // namespace giga
