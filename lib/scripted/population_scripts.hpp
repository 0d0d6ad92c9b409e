// Actions of the scripts among the networks that a population meets.
#pragma once

#include <cstdint>

#include "core/quotient.hpp"
#include "scripted/actions.hpp"
#include "sim/state.hpp"

namespace giga {

/// The actions of the agents that scripts move, in worlds that play. They come by episode, then by member: so threads
/// side by side have one script, and those of two would take turns.
struct PopulationScripts {
  ScriptedActions script;   // of any kind
  const Phase* phase;       // [M, E]
  const int32_t* network;   // [E]
  const int32_t* episodes;  // those whose opponents are scripts
  int64_t n_worlds;         // E
  int64_t n_members;        // M
  int64_t n_agents;         // of a team

  GIGA_HD void operator()(int64_t k) const {
    const int64_t agents = n_members * n_agents, at = quotient(k, agents);
    const int64_t member = quotient(k - at * agents, n_agents), agent = k - at * agents - member * n_agents;
    const int64_t episode = episodes[at], world = member * n_worlds + episode;
    if (phase[world] == Phase::plays) script.act(script_of_network(network[episode]), world * n_agents + agent);
  }
};

/// The same for up to two populations, one after the other.
struct PopulationScriptsOfAll {
  PopulationScripts part[2];
  int64_t end[2] = {0, 0};  // agents up to there
  int n_parts = 0;

  void add(const PopulationScripts& scripts, int64_t n_episodes) {
    part[n_parts] = scripts;
    end[n_parts] = agents() + n_episodes * scripts.n_members * scripts.n_agents;
    ++n_parts;
  }
  GIGA_HD int64_t agents() const { return n_parts > 0 ? end[n_parts - 1] : 0; }
  GIGA_HD void operator()(int64_t at) const {
    const int k = at < end[0] ? 0 : 1;
    part[k](k == 0 ? at : at - end[0]);
  }
};

}  // namespace giga
