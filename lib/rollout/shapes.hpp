// Shapes of the buffers that playing games needs: what the collector and matches allocate, and the memory plan counts.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "sim/params.hpp"

namespace giga {

enum class ElementType : uint8_t { f32, i32, u8 };

/// An array; without sides it is not allocated.
struct BufferShape {
  ElementType type = ElementType::f32;
  std::vector<int64_t> sides;

  bool exists() const { return !sides.empty(); }
  int64_t elements() const {
    int64_t count = exists() ? 1 : 0;
    for (const int64_t side : sides) count *= side;
    return count;
  }
  int64_t bytes() const { return elements() * (type == ElementType::u8 ? 1 : 4); }
};

/// Of the buffers of the same names in TeamRollout (rollout/collector.hpp), which explains them.
struct TeamRolloutShapes {
  BufferShape obs, alive, action, raw, log_prob, reward, final_obs, final_alive;
};
struct RolloutShapes {
  TeamRolloutShapes team[kNTeams];
  BufferShape done, global, final_global;
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

/// Buffers of one team in a match of `episodes` worlds.
struct MatchShapes {
  BufferShape action;  ///< [W, n, 3] three floats hold either kind of action
  BufferShape obs;     ///< [W, n, D] of a player that looks
};
MatchShapes match_shapes(const SimSpec& spec, int team, int64_t episodes, bool looks);

}  // namespace giga
