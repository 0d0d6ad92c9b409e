// What pictures and films ask of a replay: places in map units, who lives, which colour.
#pragma once

#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

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
  /// Who does damage to whom: shooter and target, which has been in its weapon's cone for longer than does no harm.
  std::vector<std::pair<int, int>> hits(int state) const {
    std::vector<std::pair<int, int>> all;
    for (const ReplayFire& f : episode_.fire)
      if (f.from + replay_.rules.min_tracking_time <= state && state <= f.to) all.emplace_back(f.shooter, f.target);
    if (replay_.is_crowd()) return all;
    for (int target = 0; target < replay_.n_agents(); ++target)
      for (int shooter = 0; shooter < replay_.n_agents(); ++shooter)
        if (team(target) != team(shooter) && hits(shooter, target, state)) all.emplace_back(shooter, target);
    return all;
  }
  const std::vector<std::array<float, 6>>& boxes() const {
    return replay_.maps[static_cast<size_t>(episode_.map)].boxes;
  }

 private:
  bool hits(int shooter, int target, int state) const {
    const ReplayPairs pairs(replay_);
    const int64_t row = (states() + 7) / 8, pair = pairs.opponents(target, shooter);
    for (int back = 0; back <= replay_.rules.min_tracking_time; ++back) {
      const int at = state - back;
      if (at < 0 || !(episode_.fires[static_cast<size_t>(pair * row + at / 8)] >> (at & 7) & 1)) return false;
    }
    return true;
  }

  const Replay& replay_;
  const ReplayEpisode& episode_;
  double unit_;
};

}  // namespace giga
