// PpoTeam: the networks of one team, and how they learn from a rollout.
#pragma once

#include <torch/types.h>

#include <array>
#include <vector>

#include "core/parallel_for.hpp"
#include "learn/learner.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "policy/optimizer.hpp"
#include "rollout/collector.hpp"

namespace giga {

/// States per call of the critic outside of learning: bounds the memory.
constexpr int64_t kValueChunk = 1 << 18;

/// What an update tells, kept on the device until the figures are read; most are sums over the minibatches.
enum PpoFigure : int {
  kFigPolicyLoss,  // the first six: sums over living rows of all minibatches, see PolicyDiagnostic
  kFigEntropy,
  kFigKl,
  kFigClipped,
  kFigRatioError,
  kFigRows,
  kFigValueLoss,  // sum over living rows
  kFigActorNorm,  // sums over minibatches
  kFigCriticNorm,
  kFigSkipped,
  kFigFirstRatioError,  // mean of the first minibatch: 0 where rollout and update agree
  kFigExplained,        // explained variance of the values before the update
  kFigInformation,      // I(obs; action) on the first minibatch
  kFigLiving,           // share of rows with a living agent
  kFigLastKl,           // mean of the last minibatch
  kNPpoFigures
};

/// Tensors in which a NaN or an infinity is looked for, in the order in which one causes the next. The figure is 0
/// where all is finite; else 1, for a gradient the number of the minibatch, from 1.
enum PpoFault : int {
  kFaultObservations,
  kFaultLogProbs,
  kFaultRewards,
  kFaultValues,
  kFaultAdvantages,
  kFaultReturns,
  kFaultActorGradient,
  kFaultCriticGradient,
  kNFaults
};
constexpr std::array<const char*, kNFaults> kPpoFaultNames = {
    "observations",          "log-probabilities of actions", "rewards", "values", "advantages", "returns",
    "gradient of the actor", "gradient of the critic"};
/// The faults stand behind the figures.
constexpr int kFirstFault = kNPpoFigures, kNFigures = kFirstFault + kNFaults;

struct StepSizes {
  float actor, critic;
};

class PpoTeam {
 public:
  /// Learns from the worlds `worlds` of a rollout alone.
  PpoTeam(const LoadedRun& run, int team, Device device, const ParallelFor& rows, const WorldRange& worlds);

  Actor& actor() { return actor_; }
  bool needs_state() const { return critic_.needs_state(); }

  /// States of the team's worlds, numbered through step by step, as states of the T x W of the rollout; both int64.
  at::Tensor states(const at::Tensor& own) const;

  /// Values, advantages and returns of a rollout; clears the figures.
  void prepare(const Rollout& rollout);
  /// An order [S] of the states of the team's worlds, numbered as `states` has them, cut into the minibatches of an
  /// epoch: states of the rollout, each in one of them. They have equally many, but for one where that does not come
  /// out even.
  std::vector<at::Tensor> minibatches(const at::Tensor& order) const;
  /// One gradient step of actor and critic on the states `index` [B] of the T x W of the rollout, all of the team's
  /// worlds; the minibatches of an update are counted from 1.
  void learn(const Rollout& rollout, const at::Tensor& index, int minibatch, StepSizes step_sizes);
  /// Takes the rollout's observations into the normaliser.
  void finish(const Rollout& rollout);
  const at::Tensor& figures() const { return figures_; }  // [kNFigures]

  /// States [B] of the rollout with a number that is not finite, at most `most`.
  at::Tensor faulty_states(const Rollout& rollout, int64_t most) const;
  /// Everything that was learned from in those states.
  void save_batch(const Rollout& rollout, const at::Tensor& index, NamedArrays& out) const;

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  /// What the critic sees: obs [S, n, D], alive [S, n], and where it needs it the true state [S, G].
  struct Seen {
    at::Tensor obs, alive, state;
  };
  at::Tensor values_of(const Seen& seen, const at::Tensor& index) const;
  bool everywhere() const { return worlds_.count == n_worlds_; }
  /// The part of x [T, W, ...] in the team's worlds.
  at::Tensor own(const at::Tensor& x) const { return everywhere() ? x : x.narrow(1, worlds_.first, worlds_.count); }
  at::Tensor policy_gradient(const Rollout& rollout, const at::Tensor& head, const at::Tensor& index,
                             const at::Tensor& alive, const at::Tensor& inv_count, bool first);
  void note_policy(const at::Tensor& sums, const at::Tensor& head, const at::Tensor& alive, bool first);
  void note_faults(const TeamRollout& rollout);
  StepFlags step_flags(PpoFault fault, PpoFigure norm_sum, int minibatch) const;

  const MappoConfig config_;
  const int team_, n_;
  const int64_t n_worlds_;
  const WorldRange worlds_;
  const ParallelFor& rows_;
  Actor actor_;
  Critic critic_;
  Adam actor_adam_, critic_adam_;
  RunningNorm value_norm_;  // size 1; stays 0 and 1 where it is off

  at::Tensor slots_;  // [(T + 1) x own worlds] all states of the team's worlds; undefined where those are all worlds

  // Of the rollout at hand; T x W states, n agents. Of worlds in which the team does not learn they mean nothing.
  at::Tensor value_;                       // [T, W, n] as the critic says before the update, normalised
  at::Tensor advantage_, returns_;         // [T, W, n] in reward units
  at::Tensor batch_mean_, batch_inv_std_;  // [1] of the advantages
  at::Tensor zero_, one_;                  // [1]
  at::Tensor stop_;                        // [1] 1 once approx_kl has passed target_kl
  at::Tensor figures_;                     // [kNFigures]
};

}  // namespace giga
