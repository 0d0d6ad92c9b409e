// Actions of a team in the worlds of a population, where each world has a network of its own.
#pragma once

#include <cmath>
#include <cstdint>

#include "math/distributions.hpp"
#include "math/rows.hpp"
#include "sim/params.hpp"

namespace giga {

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
      int32_t& chosen = static_cast<int32_t*>(action)[row];
      if (greedy) {
        chosen = l.largest();
        return;
      }
      float p[Logits::kNumbers];
      softmax(l, p);
      chosen = Logits::draw(p, Logits::uniform(draws, row));
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
  const int32_t* network;  // [E] row of parameters, below 0 a script, by world; null = each member's own
  int64_t n_worlds;        // E

  GIGA_HD void operator()(int64_t row) const {
    const int64_t world = act.draws.world(row);
    const int64_t id = network ? network[left_over(world, n_worlds)] : quotient(world, n_worlds);
    if (id >= 0) act(row, head + row * head_size, parameters + id * n_parameters + log_std);
  }
};

}  // namespace giga
