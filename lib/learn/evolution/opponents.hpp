// Whom the members of a population meet: the other team's mean, its past means, and scripts.
#pragma once

#include <cstdint>
#include <vector>

#include "learn/evolution/config.hpp"
#include "learn/opponents/pool.hpp"
#include "learn/run_config.hpp"

namespace giga {

/// The opponent in each of a member's `n_worlds` worlds: a row of the other team's pool, or a script. First the
/// scripts' share, in turn, on from where the team's last generation ended (it has had `turn` of them); then that of
/// the pool, drawn with its `weights` (none while it is empty); the rest meets the mean. Shares are rounded to whole
/// worlds.
std::vector<int32_t> assign_opponents(const OpponentsConfig& config, int64_t n_worlds,
                                      const std::vector<double>& weights, const PoolKey& key, int64_t turn);

/// How many of a run's `generations` so far, in which both teams evolve, were a team's own: all of them, or those of
/// its turns.
int64_t generations_of(const PopulationConfig& config, int team, int64_t generations);

}  // namespace giga
