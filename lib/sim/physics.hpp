// Physics: the numbers of flight and of waypoints that no scenario changes (rules 4.1 and 4.2).
#pragma once

namespace giga {

/// Controls lie in [-1, 1]; lengths in map units, angles in radians, times in seconds.
struct Physics {
  static constexpr float turn_rate = 4.0f;       ///< radians a second at full heading control
  static constexpr float climb_rate = 5.0f;      ///< altitude a second at full dive control
  static constexpr float thrust = 1.5f;          ///< speed a second at full throttle, times the agent type's factor
  static constexpr float drag = 0.04f;           ///< speed lost in a step, times speed^2
  static constexpr float half_gravity = 4.905f;  ///< of altitude lost, what is gained in speed^2
  static constexpr float min_speed = 1.3f;       ///< nobody flies slower

  static constexpr float waypoint_chance = 0.05f;    ///< a step, that one appears where there is none
  static constexpr float waypoint_min_time = 5.0f;   ///< it stays so long, and up to
  static constexpr float waypoint_more_time = 5.0f;  ///< so much longer, drawn uniformly
};

}  // namespace giga
