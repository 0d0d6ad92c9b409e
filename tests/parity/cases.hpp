// What the tests of both back ends have in common: variants of scenarios with every switch alone, and statistics.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "sim/simulator.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {

/// Variant 0 has every switch on, 1 none, then each one alone and each one missing; the rest of the scenario is random,
/// another one for each `family`; in each fifth one terms of the reward have factors. Not finished.
inline SimSpec variant_spec(int family, int n_team_0, int n_team_1, int variant) {
  SimSpec spec = random_spec(static_cast<uint64_t>(family * variant + 31 * n_team_0 + n_team_1), n_team_0, n_team_1);
  const unsigned all = kNSwitchMasks - 1;
  unsigned mask = variant == 0 ? all : 0;
  if (variant >= 2) mask = 1u << (static_cast<unsigned>(variant - 2) / 2 % kNSwitches);
  if (variant >= 2 && variant % 2) mask = all ^ mask;
  set_switches(spec, mask);
  spec.params.has_term_factors = variant % 5 == 3;
  spec.params.max_episode_length = variant % 5 == 4 ? 0 : 5 + variant % 9;
  return spec;
}

/// A third of the variants are worlds further on; each fourth one does not begin again where an episode ends.
inline SimOptions variant_options(uint64_t seed, int n_worlds, int variant) {
  SimOptions options;
  options.n_worlds = n_worlds;
  options.seed = seed + static_cast<uint64_t>(variant);
  options.first_world = variant % 3 == 2 ? 100000 : 0;
  options.on_done = variant % 4 == 3 ? (variant % 8 == 3 ? OnDone::freeze : OnDone::keep) : OnDone::reset;
  return options;
}

/// Counts of episodes are sums of whole numbers, hence exact; sums of returns are doubles added in another order.
inline void expect_same_stats(const EpisodeStats& a, const EpisodeStats& b) {
  for (size_t row = 0; row < a.rows.size(); ++row) {
    const double tolerance = row < static_cast<size_t>(EpisodeStat::return_0) ? 0 : 1e-9 * (1 + std::abs(a.rows[row]));
    EXPECT_NEAR(a.rows[row], b.rows[row], tolerance) << "statistics row " << row;
  }
}

}  // namespace giga::test
