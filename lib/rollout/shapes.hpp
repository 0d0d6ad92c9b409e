// Shapes of the buffers of a rollout: what the collector allocates, and the memory plan counts.
#pragma once

#include <array>
#include <cstdint>

#include "game/shapes.hpp"

namespace giga {

/// Of the buffers of the same names in TeamRollout (rollout/collector.hpp), which explains them.
struct TeamRolloutShapes {
  BufferShape obs, alive, action, pre_tanh_action, log_prob, reward, final_obs, final_alive;
};
struct RolloutShapes {
  TeamRolloutShapes team[kNTeams];
  BufferShape done, true_state, final_true_state;
};

/// What of a team's game is kept: what learning needs, only the last observations (for a script that looks at them), or
/// only its actions.
enum class BufferSet : uint8_t { learning, observations, actions };

/// What a rollout depends on besides the scenario.
struct RolloutSize {
  int64_t n_worlds = 1;
  int64_t horizon = 16;
  bool with_state = false;                   ///< keep the true state for a critic
  std::array<BufferSet, kNTeams> team = {};  ///< by team
};
RolloutShapes rollout_shapes(const SimSpec& spec, const RolloutSize& size);

}  // namespace giga
