// Seeds by purpose: from the seed that the user gives, each purpose has stretches of draws of its own. Without this,
// evaluating a run with its own seed would play the very episodes that it was trained in.
#pragma once

#include <cstdint>

#include "core/philox.hpp"

namespace giga {

/// What a stretch of draws is for. What is drawn inside one stretch is told apart by `Draw`.
enum class Purpose : uint32_t {
  training,     ///< episodes, actions, noise and opponents of a run
  permutation,  ///< the order of the states in an epoch of learning; index: update x 2^16 + epoch
  network,      ///< how a network starts; see network_seed
  evaluation,   ///< of a run while it trains; index: updates done, so that each evaluation plays new episodes
  eval,         ///< the command of that name
  rate,         ///< likewise; index: a hash of who plays whom
  bench,        ///< of the simulators of bench sim and closed-loop; bench train and es train as a run does
};

/// The seed of stretch `index` of a purpose. Philox maps counters one to one, and `Draw` stays below the 0xFF here: no
/// draw that takes the user's seed as it is has the same counter.
inline uint64_t seed_of(uint64_t seed, Purpose purpose, uint64_t index = 0) {
  const Philox4 bits = philox4x32(static_cast<uint32_t>(index), static_cast<uint32_t>(index >> 32),
                                  0xFF000000u | static_cast<uint32_t>(purpose), 0, seed);
  return static_cast<uint64_t>(bits.word[0]) << 32 | bits.word[1];
}

}  // namespace giga
