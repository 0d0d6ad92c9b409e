// WorldShares: in which worlds of mappo a team meets past policies or scripts, and in which both teams learn.
#pragma once

#include <cstdint>

#include "learn/run_config.hpp"
#include "sim/world_range.hpp"

namespace giga {

/// Whether some worlds of mappo have frozen opponents besides train.opponent.
inline bool has_further_opponents(const OpponentsConfig& config) {
  return config.pool_size > 0 || config.scripted_share > 0;
}

/// The most past policies that a team plays at the same time.
constexpr int64_t kMostGroups = 64;

/// `whole` times a share, to the nearest whole number, at most `most`.
int64_t share_of(float share, int64_t whole, int64_t most);

/// Of the episodes that a member of a population plays at a time, so many meet scripts, and then past means.
struct EpisodeShares {
  int64_t scripted = 0, pooled = 0;
};
/// `has_past`: there is somebody in the pool.
EpisodeShares episode_shares(const OpponentsConfig& config, int64_t n_episodes, bool has_past);

/// The worlds of each shard in their order: team 0 learns against scripts; team 0 learns against past policies of team
/// 1; both learn; team 1 learns against past policies of team 0; team 1 learns against scripts. So each team's learning
/// worlds of a shard are one range, and both teams have equally many. All shards are alike, so that it does not matter
/// to a world which rank has it.
struct WorldShares {
  int64_t shard_size = 0, n_shards = 1;
  // Of a shard:
  int64_t scripted = 0;                ///< worlds of a team against scripts
  int64_t groups = 0, group_size = 0;  ///< and against the pool: groups of worlds with one opponent each

  int64_t n_worlds() const { return shard_size * n_shards; }
  int64_t pooled() const { return groups * group_size; }
  int64_t side() const { return scripted + pooled(); }  ///< worlds in which only one given team learns
  ShardRange self_play() const { return of_shards({side(), shard_size - 2 * side()}); }
  /// Where `team` learns: all these worlds, those against the pool, and those against scripts.
  ShardRange learning(int team) const { return of_shards({team == 0 ? 0 : side(), shard_size - side()}); }
  ShardRange pool(int team) const { return of_shards({team == 0 ? scripted : shard_size - side(), pooled()}); }
  ShardRange scripts(int team) const { return of_shards({team == 0 ? 0 : shard_size - scripted, scripted}); }

 private:
  ShardRange of_shards(const WorldRange& range) const { return {range, shard_size, n_shards}; }
};

/// The shares of `n_worlds` worlds, which are equally many for each shard, each team getting half of a share: scripts
/// first, then the pool as far as there is room. Worlds of the pool's share that do not make up whole groups go to
/// self-play.
WorldShares world_shares(const OpponentsConfig& config, int64_t n_worlds, int64_t n_shards = 1);

}  // namespace giga
