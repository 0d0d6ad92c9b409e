#include "learn/evolution/opponents.hpp"

#include <algorithm>

#include "learn/opponents/world_shares.hpp"
#include "scripted/script.hpp"

namespace giga {

std::vector<int32_t> assign_opponents(const OpponentsConfig& config, int64_t n_worlds,
                                      const std::vector<double>& weights, const PoolKey& key, int64_t turn) {
  const auto [scripted, pooled] = episode_shares(config, n_worlds, !weights.empty());
  std::vector<int32_t> opponents(static_cast<size_t>(n_worlds), 0);
  // Where a member plays fewer such episodes than there are scripts, the others come in the team's next generation.
  const int64_t first = scripted * turn;
  for (int64_t e = 0; e < scripted + pooled; ++e)
    opponents[static_cast<size_t>(e)] =
        e < scripted ? network_of_script(config.scripted[static_cast<size_t>(first + e) % config.scripted.size()])
                     : draw_opponent(weights, key, static_cast<uint32_t>(e));
  return opponents;
}

int64_t generations_of(const PopulationConfig& config, int team, int64_t generations) {
  if (config.turns == Turns::together) return generations;
  // Whole rounds of both teams' turns, and what is over of the round that is on.
  const int64_t in_a_turn = config.generations_per_turn, in_a_round = kNTeams * in_a_turn;
  return generations / in_a_round * in_a_turn +
         std::clamp<int64_t>(generations % in_a_round - team * in_a_turn, 0, in_a_turn);
}

}  // namespace giga
