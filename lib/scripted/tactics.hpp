// Tactics: what the scripted teams beyond the paper's want to do, from one agent's observation alone; the pilot flies
// it. docs/scripted_teams.md explains them to users.
#pragma once

#include "scripted/observation_reader.hpp"
#include "scripted/pilot.hpp"
#include "sim/movement.hpp"

namespace giga {

constexpr float kLevel = 0, kClimb = 1, kDive = -1;
constexpr float kSlow = -1, kFast = 1;
constexpr float kFar = 4;  ///< units: a direction as a place that is further away than a pilot looks ahead

/// Along a square ring round the middle of the map; `ring`: 0 = the middle, 1 = the walls. Of the two senses it takes
/// the one nearer to where the agent is flying. Half-way out an agent with the usual sight sees most of a 10 x 10 map.
GIGA_HD Direction along_ring(const ObservationReader& obs, const Pilot& pilot, float ring) {
  const SimParams& p = obs.rules();
  const float half_x = 0.5f * p.limit_x, half_y = 0.5f * p.limit_y;
  const float x = (pilot.own().x - half_x) / half_x, y = (pilot.own().y - half_y) / half_y;  // -1 to 1
  const float size_x = x < 0 ? -x : x, size_y = y < 0 ? -y : y;
  const bool beside = size_x > size_y;  // left or right of the middle, rather than above or below it
  const Direction out = beside ? Direction{x < 0 ? -1.0f : 1.0f, 0} : Direction{0, y < 0 ? -1.0f : 1.0f};
  const Direction ahead = pilot.ahead();
  const float sense = -out.y * ahead.x + out.x * ahead.y < 0 ? -1.0f : 1.0f;
  const float back = clamp(4.0f * (ring - max_of(size_x, size_y)), -1.0f, 1.0f);
  return {kFar * (back * out.x - sense * out.y), kFar * (back * out.y + sense * out.x)};
}
constexpr float kPatrolRing = 0.55f;

/// Climbs while it flies round the map: at the speed floor climbing costs nothing, and height is speed for later.
GIGA_HD Course search(const ObservationReader& obs, const Pilot& pilot) {
  return fly_to(along_ring(obs, pilot, kPatrolRing), kClimb, kFast);
}

/// Flies round the map for ever, level, and shoots what comes before it.
GIGA_HD Course patrol(const ObservationReader& obs, const Pilot& pilot) {
  return fly_to(along_ring(obs, pilot, kPatrolRing), kLevel, kFast);
}

/// Turns to the nearest enemy that is seen. Beyond the range of weapons it dives for speed; within it slows down and
/// climbs, which takes speed away too, so as to keep the enemy before it. Without an enemy it searches.
GIGA_HD Course pursue(const ObservationReader& obs, const Pilot& pilot) {
  const SeenAgent enemy = obs.nearest_enemy();
  if (!enemy.seen) return search(obs, pilot);
  const float weapon2 = obs.rules().damage_cone_depth2;
  const bool far = enemy.dx * enemy.dx + enemy.dy * enemy.dy > 0.8f * weapon2;
  const Direction to_enemy{enemy.dx, enemy.dy};
  return far ? fly_to(to_enemy, kDive, kFast) : point_at(to_enemy, kClimb, kSlow);
}

/// A place far away from all enemies that are seen, the nearer the more; false where none is seen.
GIGA_HD bool away_from_enemies(const ObservationReader& obs, Direction& away) {
  away = {0, 0};
  bool any = false;
  for (int k = 0; k < obs.n_others(); ++k) {
    const SeenAgent a = obs.other(k);
    if (!a.seen) break;
    if (a.same_team) continue;
    any = true;
    const float weight = 1.0f / (a.dx * a.dx + a.dy * a.dy + 0.01f);
    away.x -= weight * a.dx;
    away.y -= weight * a.dy;
  }
  const float length = std::sqrt(away.x * away.x + away.y * away.y) + 1e-6f;
  away = {kFar * away.x / length, kFar * away.y / length};
  return any;
}

/// Flies away from the enemies that are seen, diving for speed; climbs while none is.
GIGA_HD Course evade(const ObservationReader& obs, const Pilot& pilot) {
  Direction away;
  if (!away_from_enemies(obs, away)) return point_at({-pilot.ahead().y, pilot.ahead().x}, kClimb, kSlow);
  return fly_to(away, kDive, kFast);
}

/// Flies to the waypoint, round which it does not circle; without one it flies round the map.
GIGA_HD Course run_to_waypoint(const ObservationReader& obs, const Pilot& pilot) {
  const SeenWaypoint waypoint = obs.waypoint();
  if (!waypoint.active) return patrol(obs, pilot);
  const Direction to_it{waypoint.dx, waypoint.dy};
  if (pilot.turns_around(to_it)) return point_at(pilot.ahead(), kLevel, kSlow);
  return fly_to(to_it, kLevel, kFast);
}

/// The best hiding place, relative to the agent: near to it and far from `enemy`. The places are the corners of the map
/// and, for each obstacle, the side turned away from the enemy. Without an enemy (`seen` false) the middle of the map
/// stands for it and only nearness counts.
GIGA_HD Direction cover(const ObservationReader& obs, const Pilot& pilot, const SeenAgent& enemy) {
  constexpr float kInset = 1.0f;  // room to circle
  const SimParams& p = obs.rules();
  const OwnState& own = pilot.own();
  const Direction from =
      enemy.seen ? Direction{enemy.dx, enemy.dy} : Direction{0.5f * p.limit_x - own.x, 0.5f * p.limit_y - own.y};
  Direction best{0, 0};
  float least = 1e9f;
  const auto consider = [&](Direction place) {
    const float x = place.x - from.x, y = place.y - from.y;
    const float cost =
        std::sqrt(place.x * place.x + place.y * place.y) - (enemy.seen ? std::sqrt(x * x + y * y) : 0.0f);
    if (cost >= least) return;
    least = cost;
    best = place;
  };
  for (int corner = 0; corner < 4; ++corner)
    consider(
        {((corner & 1) ? p.limit_x - kInset : kInset) - own.x, ((corner & 2) ? p.limit_y - kInset : kInset) - own.y});
  for (int b = 0; b < obs.n_boxes(); ++b) {
    const SeenBox box = obs.box(b);
    if (!box.exists()) continue;
    const float x = 0.5f * (box.x1 + box.x2) - own.x, y = 0.5f * (box.y1 + box.y2) - own.y;
    const float away_x = x - from.x, away_y = y - from.y;
    const float length = std::sqrt(away_x * away_x + away_y * away_y) + 1e-3f;
    const float reach = 0.5f * max_of(box.x2 - box.x1, box.y2 - box.y1) + kInset;
    const Direction place{x + reach * away_x / length, y + reach * away_y / length};
    if (own.x + place.x > 0 && own.x + place.x < p.limit_x && own.y + place.y > 0 && own.y + place.y < p.limit_y)
      consider(place);
  }
  return best;
}

/// Flies to cover from the nearest enemy, diving for speed; while it sees none, circles slowly at the nearest cover.
GIGA_HD Course hide(const ObservationReader& obs, const Pilot& pilot) {
  const SeenAgent enemy = obs.nearest_enemy();
  const Direction place = cover(obs, pilot, enemy);
  if (enemy.seen) return fly_to(place, kDive, kFast);
  const bool there = place.x * place.x + place.y * place.y < 1;
  return fly_to(place, kLevel, there ? kSlow : kFast);
}

}  // namespace giga
