// Where readers of a replay expect an agent next: its states are kept as what they differ from that. The formulas are
// part of the format (docs/replays.md), in double precision, and stay as they are when the simulator changes; while
// they are also its own (rules 4.1), hardly anything differs.
#pragma once

#include <array>
#include <cstdint>

#include "io/replay.hpp"

namespace giga {

/// What is expected of an agent: x, y, z, heading and speed, in the order of ReplayEpisode::start.
class ExpectedFlight {
 public:
  static constexpr int kNumbers = 5;
  using Numbers = std::array<int16_t, kNumbers>;  ///< in the units of a replay's columns

  /// `start`: its first state.
  ExpectedFlight(const Replay& replay, const ReplayAgent& agent, const std::array<float, kNumbers>& start);

  Numbers numbers() const;
  /// A step with the controls heading, dive and throttle, in [-1, 1].
  void step(const std::array<float, kReplayControls>& controls);
  /// What was expected, and differs by more than a rounding, becomes what is so.
  void correct(const Numbers& expected, const Numbers& actual);

 private:
  double place_, seconds_, turn_rate_, climb_rate_, thrust_, drag_, half_gravity_, least_, highest_;
  double x_, y_, z_, heading_, speed_;
};

/// The controls of a discrete action (rules 3.2).
std::array<float, kReplayControls> replay_controls(uint8_t action);

}  // namespace giga
