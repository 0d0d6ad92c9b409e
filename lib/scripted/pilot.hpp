// Pilot: flies where a script wants to go without hitting walls, obstacles or other agents, as far as an agent's own
// observation tells. What a script wants is in tactics.hpp.
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "scripted/observation_reader.hpp"
#include "sim/movement.hpp"

namespace giga {

/// A direction in the plane, of any length.
struct Direction {
  float x, y;
};

/// What a script wants of a step. Scripts only say it and the pilot flies it at one place: threads of a GPU whose
/// scripts want different things would else take turns to fly.
struct Course {
  Direction where;  ///< as a place relative to the agent
  float dive, throttle;
  bool detours;  ///< round walls and obstacles that are in the way
};
/// Flies towards a place, round walls and obstacles that are in the way.
GIGA_HD Course fly_to(Direction where, float dive, float throttle) { return {where, dive, throttle, true}; }
/// Turns towards it, as far as walls and obstacles allow.
GIGA_HD Course point_at(Direction where, float dive, float throttle) { return {where, dive, throttle, false}; }

/// A step's turn and climb at full control (sim/movement.hpp), and the circle of an agent that turns as hard as it can:
/// a polygon with sides speed x kDt and corners of kFullTurn has the circumradius speed x kDt / (2 sin(kFullTurn / 2)).
constexpr float kFullTurn = 0.4f;
constexpr float kTurnRadius = 0.2517f;  ///< times the speed

class Pilot {
 public:
  /// `discrete`: only full control or none is to be had.
  GIGA_HD Pilot(const ObservationReader& obs, bool discrete)
      : obs_(obs), discrete_(discrete), own_(obs.own()), dir_(sin_cos(own_.heading)) {}

  GIGA_HD const OwnState& own() const { return own_; }
  GIGA_HD Direction ahead() const { return {dir_.cos, dir_.sin}; }

  /// Flies the course, but climbs or dives where another agent is about to be hit, and does not dive where there is
  /// little room.
  GIGA_HD Controls fly(Course course) const {
    const Turn turn = safe_turn(turn_towards(course.detours ? detour(course.where) : course.where));
    const float dive = turn.room < kRoomToDive ? max_of(course.dive, 0.0f) : course.dive;
    return {turn.control, keep_apart(dive), course.throttle};
  }

  /// Whether a point inside the circle of the hardest turn towards it is meant: turning there would be going round it
  /// for ever.
  GIGA_HD bool turns_around(Direction where) const {
    const float side = dir_.cos * where.y - dir_.sin * where.x < 0 ? -1.0f : 1.0f;
    const float radius = kTurnRadius * own_.speed;
    const float cx = where.x + side * radius * dir_.sin, cy = where.y - side * radius * dir_.cos;
    return cx * cx + cy * cy < radius * radius;
  }

 private:
  static constexpr float kMargin = 0.25f;      // units between the circle that is kept free and what is hard
  static constexpr float kLookAhead = 2.0f;    // units that are looked ahead for a way round something
  static constexpr float kPathMargin = 0.4f;   // and how far that way keeps from it
  static constexpr float kBeyond = 2.01f;      // further off nothing is met within kLookAhead, however that is rounded
  static constexpr int kWays = 16;             // directions all around that are tried
  static constexpr float kRoomToDive = 0.5f;   // a dive adds up to 1.3 units a second: a circle wider by 0.33
  static constexpr float kKeepApart = 1.6f;    // others nearer than this in the plane ...
  static constexpr float kAltitudeGap = 1.2f;  // ... are kept this far away in altitude

  /// Control that turns towards a direction: the angle is told by its sine, which near 0 is the angle itself.
  GIGA_HD float turn_towards(Direction where) const {
    const float length = std::sqrt(where.x * where.x + where.y * where.y);
    if (!(length > 0)) return 0;
    const float sine = (dir_.cos * where.y - dir_.sin * where.x) / length;
    const bool in_front = dir_.cos * where.x + dir_.sin * where.y > 0;
    const float turn = in_front ? clamp(sine / kFullTurn, -1.0f, 1.0f) : (sine < 0 ? -1.0f : 1.0f);
    return discrete_ ? full_or_none(turn) : turn;
  }

  GIGA_HD static float full_or_none(float control) { return control > 0.5f ? 1.0f : (control < -0.5f ? -1.0f : 0.0f); }

  /// How far the agent can fly in directions of length 1 until it is `margin` before a wall or an obstacle; at most
  /// kLookAhead. All of them at once, obstacle by obstacle: none of these divisions waits for another.
  template <int kN>
  GIGA_HD void free_paths(const Direction (&d)[kN], float margin, float (&path)[kN]) const {
    const SimParams& p = obs_.rules();
    const float right = p.limit_x - margin - own_.x, left = own_.x - margin;
    const float above = p.limit_y - margin - own_.y, below = own_.y - margin;
    GIGA_UNROLL
    for (int k = 0; k < kN; ++k) {
      path[k] = kLookAhead;
      const auto until = [&](float distance, float speed) {
        if (speed > 0 && distance < kBeyond) path[k] = min_of(path[k], distance / speed);
      };
      until(right, d[k].x);
      until(left, -d[k].x);
      until(above, d[k].y);
      until(below, -d[k].y);
    }
    for (int b = 0; b < obs_.n_boxes(); ++b) {
      const SeenBox box = obs_.box(b);
      if (!box.exists()) continue;
      const float x1 = box.x1 - margin - own_.x, x2 = box.x2 + margin - own_.x;
      const float y1 = box.y1 - margin - own_.y, y2 = box.y2 + margin - own_.y;
      if (x1 > kBeyond || x2 < -kBeyond || y1 > kBeyond || y2 < -kBeyond) continue;
      GIGA_UNROLL
      for (int k = 0; k < kN; ++k) {
        float enter = 0, leave = kLookAhead;
        clip(x1, x2, d[k].x, enter, leave);
        clip(y1, y2, d[k].y, enter, leave);
        if (enter < leave) path[k] = min_of(path[k], enter);
      }
    }
    GIGA_UNROLL
    for (int k = 0; k < kN; ++k) path[k] = max_of(path[k], 0.0f);
  }

  /// Narrows the part [enter, leave] of a ray to that between lo and hi on one axis.
  GIGA_HD static void clip(float lo, float hi, float speed, float& enter, float& leave) {
    if (speed == 0) {
      if (lo >= 0 || hi <= 0) leave = enter;
      return;
    }
    const float a = lo / speed, b = hi / speed;
    enter = max_of(enter, min_of(a, b));
    leave = min_of(leave, max_of(a, b));
  }

  /// `where` if the way there is free. Else the best of sixteen directions all around: free, close to `where`, and
  /// rather ahead than behind, so that the agent stays on the side that it has chosen.
  GIGA_HD Direction detour(Direction where) const {
    constexpr float kCos = 0.92387953f, kSin = 0.38268343f;  // of a sixteenth of the circle
    const float length = std::sqrt(where.x * where.x + where.y * where.y);
    if (!(length > 0)) return where;
    const Direction straight{where.x / length, where.y / length};
    const float margin = min_of(kPathMargin, 0.9f * gap(own_.x, own_.y, 0));
    const Direction ahead[1] = {straight};
    float free[1];
    free_paths(ahead, margin, free);
    if (free[0] >= min_of(length - kPathMargin, kLookAhead)) return where;
    Direction ways[kWays] = {straight};
    GIGA_UNROLL
    for (int k = 1; k < kWays; ++k)
      ways[k] = {ways[k - 1].x * kCos - ways[k - 1].y * kSin, ways[k - 1].x * kSin + ways[k - 1].y * kCos};
    float paths[kWays];
    free_paths(ways, margin, paths);
    Direction best = straight;
    float most = -1e9f;
    GIGA_UNROLL
    for (int k = 0; k < kWays; ++k) {
      const Direction d = ways[k];
      const float score =
          d.x * straight.x + d.y * straight.y + 0.5f * (d.x * dir_.cos + d.y * dir_.sin) + 4.0f * paths[k] / kLookAhead;
      if (score > most) {
        most = score;
        best = d;
      }
    }
    return best;
  }

  /// Distance from a circle to the nearest wall or obstacle; negative where it cuts one.
  GIGA_HD float gap(float x, float y, float radius) const {
    const SimParams& p = obs_.rules();
    float nearest2 = INFINITY;  // to an obstacle; one root of the smallest instead of one for each
    for (int b = 0; b < obs_.n_boxes(); ++b) {
      const SeenBox box = obs_.box(b);
      if (!box.exists()) continue;
      const float dx = max_of(max_of(box.x1 - x, x - box.x2), 0.0f);
      const float dy = max_of(max_of(box.y1 - y, y - box.y2), 0.0f);
      nearest2 = min_of(nearest2, dx * dx + dy * dy);
    }
    const float wall = min_of(min_of(x, p.limit_x - x), min_of(y, p.limit_y - y));
    return min_of(wall, std::sqrt(nearest2)) - radius;
  }

  /// Room that a turn leaves: after it the agent can still go round on a circle to its left or to its right. An agent
  /// that always keeps one of the two circles free never has to hit anything.
  GIGA_HD float room(float turn) const {
    const SinCos dir = sin_cos(own_.heading + kFullTurn * turn);
    const float x = own_.x + kDt * own_.speed * dir.cos, y = own_.y + kDt * own_.speed * dir.sin;
    const float radius = kTurnRadius * own_.speed;
    const float left = gap(x - radius * dir.sin, y + radius * dir.cos, radius);
    const float right = gap(x + radius * dir.sin, y - radius * dir.cos, radius);
    return max_of(left, right) - kMargin;
  }

  /// A control, and the room that it leaves.
  struct Turn {
    float control, room;
  };
  /// `wanted` where it leaves room, else the turn that leaves most.
  GIGA_HD Turn safe_turn(float wanted) const {
    Turn best{wanted, room(wanted)};
    if (best.room >= 0) return best;
    for (int turn = -1; turn <= 1; ++turn) {
      const float left = room(static_cast<float>(turn));
      if (left > best.room) best = {static_cast<float>(turn), left};
    }
    return best;
  }

  /// Climbs or dives away from the nearest agent that is close in the plane and in altitude. Both of a pair decide
  /// alike: the higher climbs; at equal altitude the one further to the right on the map, which sees the other at
  /// negative dx.
  GIGA_HD float keep_apart(float dive) const {
    if (!(obs_.rules().collision_range2 > 0)) return dive;
    for (int k = 0; k < obs_.n_others(); ++k) {
      const SeenAgent a = obs_.other(k);
      if (!a.seen || a.distance() > kKeepApart) break;
      if ((a.dz < 0 ? -a.dz : a.dz) > kAltitudeGap) continue;
      const float above = a.dz != 0 ? a.dz : (a.dx != 0 ? a.dx : a.dy);
      return above < 0 ? 1.0f : -1.0f;
    }
    return dive;
  }

  const ObservationReader& obs_;
  bool discrete_;
  OwnState own_;
  SinCos dir_;
};

}  // namespace giga
