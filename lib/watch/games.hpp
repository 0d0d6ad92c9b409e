// What pictures and films ask of a replay: places in map units, who lives, which colour.
#pragma once

#include <cmath>
#include <numbers>

#include "io/replay.hpp"

namespace giga {

constexpr const char* kTeamColours[2] = {"#0072b2", "#d55e00"};  // of Okabe and Ito (2008)

struct AgentPlace {
  double x, y, z, heading;
};

/// One episode of a replay; both must outlive this.
class GameView {
 public:
  GameView(const Replay& replay, const ReplayEpisode& episode)
      : replay_(replay), episode_(episode), unit_(static_cast<double>(replay.place_unit())) {}

  const Replay& replay() const { return replay_; }
  const ReplayEpisode& episode() const { return episode_; }
  int states() const { return episode_.steps + 1; }
  int team(int agent) const { return replay_.agents[static_cast<size_t>(agent)].team; }
  bool alive(int agent, int state) const {
    const int died = episode_.died[static_cast<size_t>(agent)];
    return died < 0 || state < died;
  }
  /// The last state in which an agent moved.
  int last(int agent) const {
    const int died = episode_.died[static_cast<size_t>(agent)];
    return died < 0 ? episode_.steps : died;
  }
  AgentPlace place(int agent, int state) const {
    const auto at = static_cast<size_t>(int64_t{agent} * states() + state);
    return {unit_ * episode_.x[at], unit_ * episode_.y[at], static_cast<double>(kReplayAltitude) * episode_.z[at],
            2 * std::numbers::pi / static_cast<double>(kReplayTurn) * episode_.heading[at]};
  }
  /// Whether `shooter` has had the target in its weapon's cone for longer than does no harm.
  bool hits(int shooter, int target, int state) const {
    const ReplayPairs pairs(replay_);
    const int64_t row = (states() + 7) / 8, pair = target == shooter ? 0 : pairs.opponents(target, shooter);
    for (int back = 0; back <= replay_.rules.min_tracking_time; ++back) {
      const int at = state - back;
      if (at < 0 || !(episode_.fires[static_cast<size_t>(pair * row + at / 8)] >> (at & 7) & 1)) return false;
    }
    return true;
  }
  const std::vector<std::array<float, 6>>& boxes() const {
    return replay_.maps[static_cast<size_t>(episode_.map)].boxes;
  }

 private:
  const Replay& replay_;
  const ReplayEpisode& episode_;
  double unit_;
};

}  // namespace giga
