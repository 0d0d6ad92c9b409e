// Player: who moves a team (a policy or a script), and how its actions are made on the device.
#pragma once

#include <cstdint>

#include "cuda/rows.hpp"
#include "math/rows.hpp"
#include "math/scripted.hpp"
#include "sim/simulator.hpp"

namespace giga {

class Actor;
class Policy;

/// One side of a game: a policy, which must outlive this, or a script where it is null.
struct Player {
  const Policy* policy = nullptr;
  Scripted script = Scripted::random;
  bool greedy = false;  ///< the most likely action instead of a sampled one

  /// Whether it must be given observations.
  bool looks() const { return policy || uses_observation(script); }
};

/// A learned team, for code that does not know the LibTorch headers.
Player player_of(const Actor& actor);

/// Buffers of one team at one step; null where optional and not wanted.
struct ActIo {
  const float* obs;  // [W, n, D] D = padded observation size; null for players that do not look
  void* action;      // [W, n] int32 or [W, n, 3] float
  float* raw;        // [W, n, 3] optional: continuous actions before squashing
  float* log_prob;   // [W, n] optional
};

/// Queues the actions of a team in all worlds of a simulator.
void act(const Player& player, const Simulator& sim, const RowRunner& rows, int team, const ActIo& io);

}  // namespace giga
