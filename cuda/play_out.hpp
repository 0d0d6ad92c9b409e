// Games that a GPU plays to their end in one launch: who moves all agents, without the host and without other kernels in
// between. What comes out is what steps one by one come to, bit for bit.
#pragma once

#include <cstdint>

#include "cuda/population_policy.hpp"
#include "scripted/actions.hpp"
#include "sim/world_range.hpp"

namespace giga {

template <class P>
struct LaunchOf;  // cuda/executor.hpp

/// Who moves an agent: a network, a script, or nobody.
struct Mover {
  int64_t network = -1;  ///< number in its part's `networks`; below 0: none
  Scripted script = Scripted::noop;
  bool scripted = false;
};

/// Who moves a team in some worlds.
struct MoverPart {
  /// What decides about the world d, counted from the first of the part.
  enum class By : uint8_t {
    one,        ///< nothing: `id` moves all of them
    quotient,   ///< network d / divisor
    remainder,  ///< ids[d % divisor]
  };
  int team = 0;
  WorldRange worlds;
  By by = By::one;
  int64_t divisor = 1;
  const int32_t* ids = nullptr;  // [divisor] a network, or below 0 a script (network_of_script), in device memory
  int32_t id = 0;                // likewise
  const uint16_t* networks = nullptr;  // [.., PackedMlp::size] in device memory
  bool greedy = false;                 ///< networks take the most likely action instead of a drawn one

  GIGA_HD bool has(int which, int64_t world) const {
    return team == which && world >= worlds.first && world - worlds.first < worlds.count;
  }
  GIGA_HD Mover mover(int64_t world) const {
    const int64_t d = world - worlds.first;
    if (by == By::quotient) return {.network = quotient(d, divisor)};
    const int32_t number = by == By::one ? id : ids[left_over(d, divisor)];
    if (number >= 0) return {.network = number};
    return {.script = script_of_network(number), .scripted = true};
  }
};

/// Who moves both teams in all worlds, each agent's team and world in exactly one part.
struct PlayOut {
  static constexpr int kMaxParts = 16;
  static constexpr int kMaxWidth = 64;  ///< of all layers but the input
  /// Of a team, all worlds.
  struct Team {
    const float* obs = nullptr;  // [W, n, obs_stride]
    int64_t obs_stride = 0;      // a multiple of 2
    PopulationAct act{};
    ScriptedActions script{};  // of any kind
  };
  PackedMlp packed;  ///< of all networks
  int first_input = 0;  ///< of a row of observations that networks read; a multiple of 2
  bool has_networks = false;
  Team team[kNTeams];
  MoverPart part[kMaxParts];
  int n_parts = 0;

  /// Adds a part; false where there are too many.
  bool add(const MoverPart& p) {
    if (n_parts == kMaxParts) return false;
    part[n_parts++] = p;
    return true;
  }
  /// Networks of this shape move agents, which read rows from number `first` on; false where the kernel has no room
  /// for them, or others have another shape.
  bool take(const PackedMlp& shape, int first) {
    if (has_networks) return shape.mlp == packed.mlp && first == first_input;
    packed = shape;
    first_input = first;
    has_networks = true;
    return shape.mlp.widest() <= kMaxWidth;
  }
};

/// Queues at most `n_steps` steps of every world (OnDone::freeze, one episode each), from the observations that k.io
/// and the plan point to; a world whose episode ends waits from then on. Writes the buffers that steps write, and
/// `n_taken`, a word of its own. Needs population_policy_runs, and worlds that tiles hold (LaunchShape).
void launch_play_out(const LaunchOf<SimParams>& k, const PlayOut& plan, int64_t n_steps, int32_t* n_taken, void* stream);

}  // namespace giga
