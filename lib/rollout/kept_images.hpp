// KeptImages: the ego images of a rollout. What they are drawn from is kept, some 30 bytes an agent where an image of
// 84 x 84 has 21,168, and they are drawn again wherever somebody learns from them (sim/image_state.hpp).
#pragma once

#include <torch/types.h>

#include "sim/simulator.hpp"

namespace giga {

/// Images that are drawn for those who look at a rollout without learning: bounds the memory.
constexpr int64_t kImagesAtOnce = 8192;

struct KeptImages {
  Simulator* sim = nullptr;  ///< draws them
  at::Tensor states;         ///< [T + 1, W, S] int32 Observation::image_state, slot t: before step t; undefined: none
  at::Tensor final_states;   ///< [W, S] where an episode of the rollout was truncated: its last; where critics see

  /// Images [B, n, R R 3] of the agents of a team, in bytes, byte for byte those that were acted on. `from` [any, S]:
  /// image states, of which `rows` [B] int64 are drawn, or all where it is undefined.
  at::Tensor draw(int team, const at::Tensor& from, const at::Tensor& rows = {}) const;
};

}  // namespace giga
