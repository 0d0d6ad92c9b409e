#include "learn/evolution/opponents.hpp"

#include "learn/opponents/world_shares.hpp"
#include "scripted/script.hpp"

namespace giga {

std::vector<int32_t> assign_opponents(const OpponentsConfig& config, int64_t n_worlds,
                                      const std::vector<double>& weights, const PoolKey& key) {
  const int64_t scripted = config.scripted.empty() ? 0 : share_of(config.scripted_share, n_worlds, n_worlds);
  const int64_t pooled = weights.empty() ? 0 : share_of(config.pool_share, n_worlds, n_worlds - scripted);
  std::vector<int32_t> opponents(static_cast<size_t>(n_worlds), 0);
  // Where a member plays fewer such episodes than there are scripts, the others have their turn in the next generation.
  const int64_t first = scripted * key.update;
  for (int64_t e = 0; e < scripted + pooled; ++e)
    opponents[static_cast<size_t>(e)] =
        e < scripted ? network_of_script(config.scripted[static_cast<size_t>(first + e) % config.scripted.size()])
                     : draw_opponent(weights, key, static_cast<uint32_t>(e));
  return opponents;
}

}  // namespace giga
