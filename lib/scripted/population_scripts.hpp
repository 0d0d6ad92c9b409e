// Actions of the scripts among the networks that a population meets.
#pragma once

#include <cstdint>

#include "scripted/actions.hpp"
#include "sim/state.hpp"

namespace giga {

/// The actions of the rows that scripts move, in worlds that play.
struct PopulationScripts {
  ScriptedActions script;  // of any kind
  const Phase* phase;      // [W]
  const int32_t* network;  // [E]
  int64_t n_worlds;

  GIGA_HD void operator()(int64_t row) const {
    const int64_t world = script.draws.world(row);
    const int32_t id = network[left_over(world, n_worlds)];
    if (id >= 0 || phase[world] != Phase::plays) return;
    script.act(script_of_network(id), row);
  }
};

/// The same for up to two populations, one after the other.
struct PopulationScriptsOfAll {
  PopulationScripts part[2];
  int64_t end[2] = {0, 0};  // rows up to there
  int n_parts = 0;

  void add(const PopulationScripts& scripts, int64_t n_rows) {
    part[n_parts] = scripts;
    end[n_parts] = rows() + n_rows;
    ++n_parts;
  }
  GIGA_HD int64_t rows() const { return n_parts > 0 ? end[n_parts - 1] : 0; }
  GIGA_HD void operator()(int64_t row) const {
    const int k = row < end[0] ? 0 : 1;
    part[k](k == 0 ? row : row - end[0]);
  }
};

}  // namespace giga
