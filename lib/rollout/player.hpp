// Player: who moves a team (a policy, several policies or a script), and how its actions are made on the device.
#pragma once

#include <cstdint>

#include "cuda/rows.hpp"
#include "math/rows.hpp"
#include "math/scripted.hpp"
#include "rollout/world_range.hpp"
#include "sim/simulator.hpp"

namespace giga {

class Actor;
class GroupPolicy;
class Policy;
struct NetworkState;

/// One side of a game: a policy or one for each group of worlds, which must outlive this, or a script where both are
/// null.
struct Player {
  const Policy* policy = nullptr;
  Scripted script = Scripted::random;
  bool greedy = false;  ///< the most likely action instead of a sampled one
  const GroupPolicy* groups = nullptr;

  /// Whether it must be given observations.
  bool looks() const { return policy || groups || uses_observation(script); }
};

/// A learned team, for code that does not know the LibTorch headers.
Player player_of(const Actor& actor);

/// Buffers of one team at one step, all worlds; null where optional and not wanted.
struct ActIo {
  const float* obs;               // [W, n, D] D = padded observation size; null for players that do not look
  void* action;                   // [W, n] int32 or [W, n, 3] float
  float* raw;                     // [W, n, 3] optional: continuous actions before squashing
  float* log_prob;                // [W, n] optional
  NetworkState* state = nullptr;  // of the rows that a policy with memory moves; it replaces them
};
// Networks in groups leave `raw` and `log_prob` alone: nobody learns from them.

/// Queues the actions of a team in some worlds of a simulator, which are what they are whoever moves the others.
void act(const Player& player, const Simulator& sim, const RowRunner& rows, int team, const ActIo& io,
         const WorldRange& worlds);
/// The same in all worlds.
inline void act(const Player& player, const Simulator& sim, const RowRunner& rows, int team, const ActIo& io) {
  act(player, sim, rows, team, io, {0, sim.n_worlds()});
}

}  // namespace giga
