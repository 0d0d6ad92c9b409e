// Collector: plays a number of steps in all worlds and keeps what learning needs, all on the device.
#pragma once

#include <torch/types.h>

#include <array>
#include <atomic>
#include <string>

#include "core/named_array.hpp"
#include "game/game.hpp"
#include "rollout/kept_images.hpp"

namespace giga {

/// What one team saw, did and got. T = horizon, W = worlds, n = agents of the team, D = padded observation size. The
/// simulator and the policy write straight into these. A team that learns nowhere has its actions alone, and the last
/// observations if its controller looks; its other buffers are undefined. In worlds in which a team does not learn,
/// `pre_tanh_action` and `log_prob` mean nothing.
struct TeamRollout {
  at::Tensor obs;              // [T + 1, W, n, D] slot t: before step t; [1, W, n, D] of a team that does not learn. 0
                               // where nobody reads them; undefined where nobody reads numbers
  at::Tensor alive;            // [T + 1, W, n] uint8, at `obs`
  at::Tensor action;           // [T, W, n] int32 or [T, W, n, 3] float
  at::Tensor pre_tanh_action;  // [T, W, n, 3] float, continuous actions only
  at::Tensor log_prob;         // [T, W, n]
  at::Tensor reward;           // [T, W, n]
  at::Tensor final_obs;        // [W, n, D] where an episode of the rollout was truncated: its last observation
  at::Tensor final_alive;      // [W, n] uint8
  at::Tensor state = {};       // [W, n, S] what a policy with memory remembers before step 0; else undefined
};

struct Rollout {
  TeamRollout team[kNTeams];
  at::Tensor done;              // [T, W] uint8, Done
  at::Tensor true_state;        // [T + 1, W, G] true state; only with `with_state`
  at::Tensor final_true_state;  // [W, G]
  KeptImages images;            // where a learning team's networks read them

  /// [T + 1, W] bool, at each slot: an episode begins there. What was remembered before the rollout has been forgotten
  /// by then where its first step begins one.
  at::Tensor beginnings() const;
};

struct CollectorOptions {
  int horizon = 16;
  bool with_state = false;     ///< keep the true state for a critic
  bool desynchronize = false;  ///< first episodes start at a random age, so that worlds do not reset in step
  ObservationSet keep = {};    ///< observations of learning teams that are kept besides those that controllers read
  std::array<bool, kNTeams> learns = {true, true};  ///< of the others actions alone are kept, though policies play them
  bool mirror = false;                              ///< Game::mirror_half
  bool with_final_images = false;  ///< keep those of truncated episodes, for a critic that reads images
};

class Collector final : GameObserver {
 public:
  /// The simulator and `parallel_for` must outlive the collector.
  Collector(Simulator& sim, const ParallelFor& parallel_for, const CollectorOptions& options, const BothSides& sides);
  Collector(const Collector&) = delete;
  Collector& operator=(const Collector&) = delete;

  /// Starts all worlds and fills slot T, from which the next rollout goes on.
  void start();
  /// Fills slot T from the simulator's state, after loading one.
  void resume() { game_.resume(); }
  /// Lets an observer see the games. What the collector keeps, it finds in the rollout's slots.
  void watch(GameObserver& observer) { game_.watch(observer); }
  /// Plays `horizon` steps; slot 0 is the previous slot T.
  void collect() { game_.play(options_.horizon); }
  const std::string& refusal() const { return game_.refusal(); }

  /// Steps of the rollout that goes on, as far as they are queued; another thread may ask.
  int64_t steps_done() const { return steps_done_; }

  const Rollout& rollout() const { return rollout_; }
  int horizon() const { return options_.horizon; }

  /// Who moves a team in these worlds is another from here on, and remembers nothing.
  void forget(int team, const ShardRange& worlds);
  /// What policies with memory remember.
  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  void before_play(int64_t n_steps) override;
  void before_step(int64_t t, GameStep& step) override;
  bool repeats_plays() const override { return true; }

  const CollectorOptions options_;
  at::Tensor memory_[kNTeams];  // [W, n, S] what the policies remember now; undefined without memory
  Rollout rollout_;
  std::atomic<int64_t> steps_done_ = 0;
  Game game_;
};

}  // namespace giga
