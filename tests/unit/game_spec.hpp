// The small games that the tests of Game play: three against two in seven worlds, 30 steps an episode.
#pragma once

#include "core/parallel_for.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {

constexpr int kWorlds = 7;

inline SimSpec game_spec(bool egocentric_view = false) {
  SimSpec spec = plain_spec(3, 2);
  spec.params.actions = ActionKind::discrete;
  spec.params.egocentric_view = egocentric_view;
  spec.params.max_episode_length = 30;
  spec.finish();
  return spec;
}

inline const ParallelFor& parallel_for() {
  static const ParallelFor loop(Device{}, 1);
  return loop;
}

}  // namespace giga::test
