// Actions of a team in the worlds of a population, where each world has a network, or a script, of its own.
#pragma once

#include "math/distributions.hpp"
#include "math/scripted.hpp"
#include "sim/state.hpp"

namespace giga {

/// A script among the networks that move a team: -1 - its number.
GIGA_HD Scripted script_of_network(int32_t network) { return static_cast<Scripted>(-1 - network); }
constexpr int32_t network_of_script(Scripted script) { return -1 - static_cast<int32_t>(script); }

/// How a network's head becomes the action of a row.
struct PopulationAct {
  ActionKind actions;
  bool greedy;  ///< the most likely action instead of a drawn one
  RowDraws draws;
  void* action;  // [R] int32 or [R, 3] float

  /// `head`: 27 logits of kLogitStride numbers, aligned to 16 bytes, or 3 means. `log_std` [3]: continuous actions
  /// only.
  GIGA_HD void operator()(int64_t row, const float* head, const float* log_std) const {
    if (actions == ActionKind::discrete) {
      const Logits l(head);
      static_cast<int32_t*>(action)[row] = greedy ? l.largest() : l.draw(l.log_sum_exp(), draws, row);
      return;
    }
    DrawKey key = draws.key(row);
    float* out = static_cast<float*>(action) + row * kActionSize;
    for (int k = 0; k < kActionSize; ++k)
      out[k] = std::tanh(head[k] + (greedy ? 0.0f : std::exp(log_std[k]) * action_normal(key, draws, row, k)));
  }
};

/// The actions of the rows that networks move, from heads that have been computed: world w is world w % E of member
/// w / E.
struct PopulationActions {
  PopulationAct act;
  const float* head;  // [R, head_size]
  int head_size;
  const float* parameters;  // [networks, n_parameters]
  int64_t n_parameters;
  int64_t log_std;         // first of the three in a row of parameters; continuous actions only
  const int32_t* network;  // [E] row of parameters or a script, by world; null = each member's own
  int64_t n_worlds;        // E

  GIGA_HD void operator()(int64_t row) const {
    const int64_t world = act.draws.world(row);
    const int64_t id = network ? network[world % n_worlds] : world / n_worlds;
    if (id >= 0) act(row, head + row * head_size, parameters + id * n_parameters + log_std);
  }
};

/// The actions of the rows that scripts move, in worlds that play.
struct PopulationScripts {
  ScriptedActions script;  // of any kind
  const Phase* phase;      // [W]
  const int32_t* network;  // [E]
  int64_t n_worlds;

  GIGA_HD void operator()(int64_t row) const {
    const int64_t world = script.draws.world(row);
    const int32_t id = network[world % n_worlds];
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
