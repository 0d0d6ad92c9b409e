// WorldShares: in which worlds of mappo a team meets past policies or scripts, and in which both teams learn.
#pragma once

#include <cstdint>

#include "learn/run_config.hpp"
#include "sim/world_range.hpp"

namespace giga {

/// The most past policies that a team plays at the same time.
constexpr int64_t kMostGroups = 64;

/// `whole` times a share, to the nearest whole number, at most `most`.
int64_t share_of(float share, int64_t whole, int64_t most);

/// The worlds in their order: team 0 learns against scripts; team 0 learns against past policies of team 1; both learn;
/// team 1 learns against past policies of team 0; team 1 learns against scripts. So each team's learning worlds are one
/// range, and both teams have equally many.
struct WorldShares {
  int64_t n_worlds = 0;
  int64_t scripted = 0;                ///< worlds of a team against scripts
  int64_t groups = 0, group_size = 0;  ///< and against the pool: groups of worlds with one opponent each

  int64_t pooled() const { return groups * group_size; }
  int64_t side() const { return scripted + pooled(); }  ///< worlds in which only one given team learns
  WorldRange self_play() const { return {side(), n_worlds - 2 * side()}; }
  /// Where `team` learns: all these worlds, those against the pool, and those against scripts.
  WorldRange learning(int team) const { return {team == 0 ? 0 : side(), n_worlds - side()}; }
  WorldRange pool(int team) const { return {team == 0 ? scripted : n_worlds - side(), pooled()}; }
  WorldRange scripts(int team) const { return {team == 0 ? 0 : n_worlds - scripted, scripted}; }
};

/// The shares of `n_worlds` worlds, each team getting half of a share: scripts first, then the pool as far as there is
/// room. Worlds of the pool's share that do not make up whole groups go to self-play.
WorldShares world_shares(const OpponentsConfig& config, int64_t n_worlds);

/// Part k of n parts of a range that differ by one world at most.
WorldRange part_of(const WorldRange& range, int64_t k, int64_t n);

}  // namespace giga
