// Movement: kinematics, bounds, collisions between agents and with obstacles (rules 4.1 and 4.3).
#pragma once

#include "core/geometry.hpp"
#include "sim/physics.hpp"
#include "sim/world.hpp"

namespace giga {

/// Heading, dive and throttle, each in [-1, 1]. Positive dive climbs.
struct Controls {
  float heading, dive, throttle;
};

/// Discrete action 9 (throttle + 1) + 3 (heading + 1) + (dive + 1); out of range is clamped to 0..26.
GIGA_HD Controls discrete_controls(int action) {
  const int a = action < 0 ? 0 : (action >= kNDiscreteActions ? kNDiscreteActions - 1 : action);
  const int throttle = a / 9, heading = a / 3 % 3, dive = a % 3;
  return {static_cast<float>(heading - 1), static_cast<float>(dive - 1), static_cast<float>(throttle - 1)};
}

/// The discrete action nearest to some controls: the inverse of discrete_controls.
GIGA_HD int32_t discrete_action(Controls c) {
  const auto third = [](float control) { return control > 0.5f ? 2 : (control < -0.5f ? 0 : 1); };
  return 9 * third(c.throttle) + 3 * third(c.heading) + third(c.dive);
}

/// Within [-1, 1]; what is not a number is -1, so that places and speeds stay numbers.
GIGA_HD float bounded_control(float c) { return c >= -1.0f ? (c > 1.0f ? 1.0f : c) : -1.0f; }

/// The controls of an agent from its team's action buffer, `row` = row of the agent there.
GIGA_HD Controls read_controls(const Parameters auto& p, const TeamIo& team, int64_t world, int64_t row) {
  Controls controls;
  if (p.actions == ActionKind::discrete) {
    controls = discrete_controls(static_cast<const int32_t*>(team.action)[row]);
  } else {
    const float* c = static_cast<const float*>(team.action) + row * kActionSize;
    controls = {bounded_control(c[0]), bounded_control(c[1]), bounded_control(c[2])};
  }
  controls.heading *= team.mirror(world);
  return controls;
}

/// How an agent flies.
struct Flight {
  float x, y, z, v, heading;
  SinCos dir;  ///< of the heading; of a flight that was flown
};

/// What move reads of an agent.
GIGA_HD Flight flight_of(const World auto& w, int i) { return {w.x[i], w.y[i], w.z[i], w.v[i], w.heading[i], {}}; }

/// Rules 4.1: new heading, position, altitude and speed. `thrust`: of the agent's type.
GIGA_HD Flight flown(const Parameters auto& p, const Flight& from, bool lives, Controls c, float thrust) {
  const float a = lives ? 1.0f : 0.0f;
  Flight to;
  const float turned = from.heading + kDt * c.heading * Physics::turn_rate * a;
  to.heading = p.original() ? wrap_original(turned) : wrap_angle(turned);
  to.dir = sin_cos(to.heading);

  const float pushed = from.v + kDt * c.throttle * Physics::thrust * a * thrust;
  const float speed = pushed - Physics::drag * (pushed * pushed) * a;

  to.x = from.x + kDt * (speed * to.dir.cos) * a;
  to.y = from.y + kDt * (speed * to.dir.sin) * a;
  to.z = clamp(from.z + kDt * (Physics::climb_rate * c.dive) * a, 0.0f, kAltitudeLimit);
  to.v = std::sqrt(
      max_of(speed * speed + Physics::half_gravity * (from.z - to.z), Physics::min_speed * Physics::min_speed));
  return to;
}

GIGA_HD void take_flight(World auto& w, const Flight& to, int i) {
  w.x[i] = to.x;
  w.y[i] = to.y;
  w.v[i] = to.v;
  w.z[i] = to.z;
  w.heading[i] = to.heading;
  w.dir_x[i] = to.dir.cos;
  w.dir_y[i] = to.dir.sin;
}

/// The unit vector of a heading, kept for sight.
GIGA_HD void face(World auto& w, int i) {
  const SinCos dir = sin_cos(w.heading[i]);
  w.dir_x[i] = dir.cos;
  w.dir_y[i] = dir.sin;
}

/// Rules 4.3.1: beyond the limits, which themselves are inside.
GIGA_HD void check_bounds(const Parameters auto& p, World auto& w, const Flight& at, int i) {
  if (!(at.x < 0 || at.x > p.limit_x || at.y < 0 || at.y > p.limit_y)) return;
  w.flags[i] |= kOutOfBounds;
  w.alive[i] = 0;
}

GIGA_HD float planar_distance2(const World auto& w, int i, int j) {
  const float dx = w.x[i] - w.x[j], dy = w.y[i] - w.y[j];
  return dx * dx + dy * dy;
}

/// Rules 4.3.2: touching another living agent of any team. Only flags, since others still look at `alive`.
GIGA_HD void check_agents(const Parameters auto& p, World auto& w, int i) {
  if (!w.alive[i] || !(p.collision_range2 > 0)) return;
  bool hit = false;
  for (int team = 0; team < kNTeams; ++team)
    for_team(p, team, [&](int j, int) {
      const float dz = w.z[i] - w.z[j];
      const bool near = (planar_distance2(w, i, j) < p.collision_range2) & ((dz < 0 ? -dz : dz) < p.collision_altitude);
      hit |= near & (j != i) & (w.alive[j] != 0);
    });
  if (hit) w.flags[i] |= kHitAgent;
}

/// Strictly inside a box of the world's map, each grown by `margin` on every side.
GIGA_HD bool inside_obstacle(const Parameters auto& p, const World auto& w, float x, float y, float z, float margin) {
  const Box* boxes = p.maps.boxes + static_cast<int64_t>(*w.map) * p.n_boxes;
  bool inside = false;
  [[maybe_unused]] constexpr int kAtOnce = kBoxesAtOnce<decltype(p)>;
  GIGA_UNROLL_BY(kAtOnce)
  for (int b = 0; b < p.n_boxes; ++b) {  // all of them, so that a GPU need not wait for one before it asks for the next
    const Box box = table_box(boxes + b);
    const bool planar = (box.x1 - margin < x) & (x < box.x2 + margin) & (box.y1 - margin < y) & (y < box.y2 + margin);
    inside |= planar & (!p.obstacle_heights || (box.z1 - margin <= z && z <= box.z2 + margin));
  }
  return inside;
}

/// Rules 4.3.2 applied, then 4.3.3: inside an obstacle.
GIGA_HD void check_obstacles(const Parameters auto& p, World auto& w, int i) {
  if (w.flags[i] & kHitAgent) w.alive[i] = 0;
  if (inside_obstacle(p, w, w.x[i], w.y[i], w.z[i], 0.0f)) {
    w.flags[i] |= kHitObstacle;
    w.alive[i] = 0;
  }
}

}  // namespace giga
