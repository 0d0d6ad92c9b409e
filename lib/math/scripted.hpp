// Scripted opponents: actions without learning (SPEC section 13).
#pragma once

#include <array>

#include "math/rows.hpp"
#include "sim/params.hpp"

namespace giga {

enum class Scripted : uint8_t {
  random,          ///< uniform over the 27 actions, or over [-1, 1)^3
  noop,            ///< straight on
  circle,          ///< turns left for ever: a stable orbit
  reverse_circle,  ///< turns right
  circle_random,   ///< left or right, drawn per agent and episode
};
constexpr std::array<const char*, 5> enum_names(Scripted) {
  return {"random", "noop", "circle", "reverse_circle", "circle_random"};
}

/// Writes the actions of a scripted team.
struct ScriptedActions {
  Scripted kind;
  ActionKind actions;
  RowDraws draws;
  const int32_t* episode_length;  // [W] of the simulator's state
  void* action;                   // [R] int32 or [R, 3] float

  GIGA_HD void operator()(int64_t row) const {
    float turn = 0;
    if (kind == Scripted::circle) turn = 1;
    if (kind == Scripted::reverse_circle) turn = -1;
    if (kind == Scripted::circle_random) {
      // The step at which the episode began stands for the episode.
      const uint32_t age = static_cast<uint32_t>(episode_length[draws.world(row)]);
      DrawKey key = draws.key(row, age);
      turn = key.uniform(Draw::opponent, draws.agent(row), 4) < 0.5f ? 1.0f : -1.0f;
    }
    DrawKey key = draws.key(row);
    if (actions == ActionKind::discrete) {
      int32_t chosen = 13 + 3 * static_cast<int32_t>(turn);
      if (kind == Scripted::random) {
        const float u = key.uniform(Draw::opponent, draws.agent(row), 0);
        chosen = static_cast<int32_t>(u * kNDiscreteActions);
      }
      static_cast<int32_t*>(action)[row] = chosen;
      return;
    }
    float* out = static_cast<float*>(action) + row * kActionSize;
    for (int k = 0; k < kActionSize; ++k) {
      out[k] = k == 0 ? turn : 0.0f;
      if (kind == Scripted::random)
        out[k] = 2.0f * key.uniform(Draw::opponent, draws.agent(row), static_cast<uint32_t>(k)) - 1.0f;
    }
  }
};

}  // namespace giga
