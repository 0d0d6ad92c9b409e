// Collector: plays a number of steps in all worlds and keeps what learning needs, all on the device.
#pragma once

#include <torch/types.h>

#include <array>
#include <string>
#include <vector>

#include "core/named_array.hpp"
#include "policy/network_state.hpp"
#include "rollout/player.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// What one team saw, did and got. T = horizon, W = worlds, n = agents of the team, D = padded observation size. The
/// simulator and the policy write straight into these; buffers of a team that learns nowhere, which nobody reads, are
/// undefined, and where it looks at observations, it has the last ones only. In worlds in which a team does not learn,
/// `raw` and `log_prob` mean nothing.
struct TeamRollout {
  at::Tensor obs;          // [T + 1, W, n, D] slot t: before step t; [1, W, n, D] of a team that does not learn
  at::Tensor alive;        // [T + 1, W, n] uint8, at `obs`
  at::Tensor action;       // [T, W, n] int32 or [T, W, n, 3] float
  at::Tensor raw;          // [T, W, n, 3] float, continuous actions only
  at::Tensor log_prob;     // [T, W, n]
  at::Tensor reward;       // [T, W, n]
  at::Tensor final_obs;    // [W, n, D] where an episode of the rollout was truncated: its last observation
  at::Tensor final_alive;  // [W, n] uint8
  at::Tensor state = {};   // [W, n, S] what a policy with memory remembers before step 0; else undefined
};

struct Rollout {
  TeamRollout team[kNTeams];
  at::Tensor done;          // [T, W] uint8, Done
  at::Tensor global;        // [T + 1, W, G] true state; only with `with_state`
  at::Tensor final_global;  // [W, G]
};

struct CollectorOptions {
  int horizon = 16;
  bool with_state = false;     ///< keep the true state for a critic
  bool desynchronize = false;  ///< first episodes start at a random age, so that worlds do not reset in step
};

/// Who moves a team in which worlds; together the parts are all worlds.
struct SidePart {
  Player player;
  WorldRange worlds;
};
using Side = std::vector<SidePart>;

class Collector {
 public:
  /// The simulator must outlive the collector. Sides by team.
  Collector(Simulator& sim, const RowRunner& rows, const CollectorOptions& options, std::array<Side, kNTeams> sides);
  /// One player for each team.
  Collector(Simulator& sim, const RowRunner& rows, const CollectorOptions& options, const Player& side0,
            const Player& side1)
      : Collector(sim, rows, options, {Side{{side0, {0, sim.n_worlds()}}}, Side{{side1, {0, sim.n_worlds()}}}}) {}

  /// Starts all worlds and fills slot T, from which the next rollout goes on.
  void start();
  /// Fills slot T from the simulator's state, after loading one.
  void resume();
  /// Plays `horizon` steps; slot 0 is the previous slot T.
  void collect();

  const Rollout& rollout() const { return rollout_; }
  int horizon() const { return options_.horizon; }

  /// What policies with memory remember.
  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  void act_with_memory(const SidePart& part, int team, ActIo io);
  StepIo io(int t) const;  // step t: reads actions t, writes slot t + 1

  Simulator& sim_;
  const RowRunner& rows_;
  CollectorOptions options_;
  const std::array<Side, kNTeams> side_;
  std::array<at::Tensor, kNTeams> memory_;  // [W, n, S] what the policies remember now; undefined without memory
  Rollout rollout_;
};

}  // namespace giga
