#include "learn/opponents/world_shares.hpp"

#include <algorithm>
#include <cmath>

namespace giga {

int64_t share_of(float share, int64_t whole, int64_t most) {
  return std::min<int64_t>(std::llround(static_cast<double>(share) * static_cast<double>(whole)), most);
}

EpisodeShares episode_shares(const OpponentsConfig& config, int64_t n_episodes, bool has_past) {
  EpisodeShares shares;
  if (!config.scripted.empty()) shares.scripted = share_of(config.scripted_share, n_episodes, n_episodes);
  if (has_past) shares.pooled = share_of(config.pool_share, n_episodes, n_episodes - shares.scripted);
  return shares;
}

WorldShares world_shares(const OpponentsConfig& config, int64_t n_worlds, int64_t n_shards) {
  WorldShares shares;
  shares.shard_size = n_worlds / n_shards;
  shares.n_shards = n_shards;
  const int64_t half = shares.shard_size / 2;
  shares.scripted = share_of(config.scripted_share, half, half);
  const int64_t pooled = config.pool_size > 0 ? share_of(config.pool_share, half, half - shares.scripted) : 0;
  if (pooled == 0) return shares;
  shares.groups = std::min({static_cast<int64_t>(config.pool_size), kMostGroups, pooled});
  shares.group_size = pooled / shares.groups;
  return shares;
}

}  // namespace giga
