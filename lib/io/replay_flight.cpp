#include "io/replay_flight.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace giga {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr int kHeadings = 1024, kHeadingStep = 65536 / kHeadings;  // of a turn; between two of them
constexpr double kMostNumber = 1e9;                                // what a damaged file may lead to is no number

int16_t rounded(double number) {
  if (!(std::abs(number) < kMostNumber)) return 0;
  return static_cast<int16_t>(std::clamp(std::round(number), -32768.0, 32767.0));
}

}  // namespace

ExpectedFlight::ExpectedFlight(const Replay& replay, const ReplayAgent& agent, const std::array<float, kNumbers>& start)
    : place_(replay.place_unit()),
      seconds_(replay.rules.seconds_per_step),
      turn_rate_(replay.flight.turn_rate),
      climb_rate_(replay.flight.climb_rate),
      thrust_(double{replay.flight.thrust} * double{agent.thrust}),
      drag_(replay.flight.drag),
      half_gravity_(replay.flight.half_gravity),
      least_(replay.flight.min_speed),
      highest_(replay.rules.limit_z),
      x_(start[0]),
      y_(start[1]),
      z_(start[2]),
      heading_(start[3]),
      speed_(start[4]) {}

ExpectedFlight::Numbers ExpectedFlight::numbers() const {
  int16_t heading = 0;
  if (std::abs(heading_) < kMostNumber)
    heading = static_cast<int16_t>(static_cast<uint16_t>(std::llround(heading_ / kTurn * kHeadings) * kHeadingStep));
  return {rounded(x_ / place_), rounded(y_ / place_), rounded(z_ / double{kReplayAltitude}), heading,
          rounded(speed_ / double{kReplaySpeed})};
}

void ExpectedFlight::step(const std::array<float, kReplayControls>& controls) {
  const auto& [turn, dive, throttle] = controls;
  heading_ += seconds_ * turn_rate_ * double{turn};
  const double pushed = speed_ + seconds_ * thrust_ * double{throttle}, speed = pushed - drag_ * pushed * pushed;
  x_ += seconds_ * speed * std::cos(heading_);
  y_ += seconds_ * speed * std::sin(heading_);
  const double z = std::min(std::max(z_ + seconds_ * climb_rate_ * double{dive}, 0.0), highest_);
  speed_ = std::sqrt(std::max(speed * speed + half_gravity_ * (z_ - z), least_ * least_));
  z_ = z;
}

void ExpectedFlight::correct(const Numbers& expected, const Numbers& actual) {
  const auto differs = [&](size_t k, int rounding) {
    const auto apart = static_cast<int16_t>(static_cast<uint16_t>(actual[k]) - static_cast<uint16_t>(expected[k]));
    return std::abs(int{apart}) > rounding;
  };
  if (differs(0, 1)) x_ = actual[0] * place_;
  if (differs(1, 1)) y_ = actual[1] * place_;
  if (differs(2, 1)) z_ = actual[2] * double{kReplayAltitude};
  if (differs(3, kHeadingStep)) heading_ = actual[3] / double{kReplayTurn} * kTurn;
  if (differs(4, 1)) speed_ = actual[4] * double{kReplaySpeed};
}

std::array<float, kReplayControls> replay_controls(uint8_t action) {
  const int throttle = action / 9, heading = action / 3 % 3, dive = action % 3;
  return {static_cast<float>(heading - 1), static_cast<float>(dive - 1), static_cast<float>(throttle - 1)};
}

}  // namespace giga
