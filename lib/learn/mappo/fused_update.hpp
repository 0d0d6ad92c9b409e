// FusedUpdate: how a team learns from a minibatch by the fused kernels (cuda/ppo_gradients.hpp), or on a CPU by what
// does the same block by block (policy/cpu_kernels.hpp), in the place of LibTorch's passes through the networks and of
// its optimizer. FusedActorGradient: the actor's half of it, beside a critic that LibTorch computes.
#pragma once

#include <torch/types.h>

#include <memory>
#include <string>
#include <vector>

#include "core/parallel_for.hpp"
#include "cuda/ppo_gradients.hpp"
#include "cuda/side_stream.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"

namespace giga {

/// Why they do not serve these networks there, for the log; empty where they do.
std::string fused_actor_refusal(const Actor& actor, int n_agents, Device device);
std::string fused_update_refusal(const Actor& actor, const Critic& critic, int n_agents, Device device);

/// The chosen states of obs [.., n, D] and alive [.., n], which lie without gaps, with whole observations, normalised
/// as those of the actor. `states`: null = all.
FusedRows fused_rows(const Actor& actor, int n, const at::Tensor& obs, const at::Tensor& alive,
                     const at::Tensor& states = {});

/// The same of what a critic reads, and that alone: its part of the observations, or the true states [.., G].
FusedRows fused_critic_rows(const Critic& critic, const Actor& actor, int n, const at::Tensor& seen,
                            const at::Tensor& alive, const at::Tensor& states = {});

/// The critic's `values` [states, n] of fused_critic_rows(), by the kernel of its loss. `net`: Critic::fused_mlp.
/// `work`: int32 words, WideLayers::words_for_values() or more, where the network is wide and on a GPU.
void write_fused_values(const Critic& critic, const FusedMlp& net, const FusedRows& rows,
                        const ParallelFor& parallel_for, const at::Tensor& values, const at::Tensor& work = {});

/// What networks learn from: of each state obs [n, D] and, if the critic reads it, the true state [G].
struct FusedInputs {
  at::Tensor obs, true_state;
};

class FusedUpdate {
 public:
  /// Networks that they serve; all three must outlive this. `n`: agents of the team. On a GPU epochs are learned from
  /// on a stream beside that of `parallel_for`, so that the teams fill each other's gaps; `sum`, over all ranks, is
  /// queued there too. `twin`: one with the same actor, which steps it in turns with this one.
  FusedUpdate(const Actor& actor, const Critic& critic, int n, const ParallelFor& parallel_for,
              const SumOverRanks& sum = {}, FusedUpdate* twin = nullptr);
  ~FusedUpdate();
  FusedUpdate(const FusedUpdate&) = delete;
  FusedUpdate& operator=(const FusedUpdate&) = delete;

  /// Values [states, n] of the chosen states [S] (undefined: all) of obs [states, n, D], or true states [states, G],
  /// and alive [states, n].
  void write_values(const at::Tensor& seen, const at::Tensor& alive, const at::Tensor& states,
                    const at::Tensor& values);

  /// The minibatches of an epoch: states [S] of the rollout, cut into pieces as at::tensor_split does.
  void begin_epoch(const FusedInputs& inputs, const at::Tensor& alive, const at::Tensor& states, int n_minibatches,
                   const at::Tensor& advantage);
  /// After the epoch's last step, and of twins that of both: what is queued on the main stream from now on waits for
  /// it.
  void end_epoch();
  /// Both gradients of minibatch k, in parts that step() adds up.
  void compute_gradients(int k, const FusedPolicyLoss& policy, const FusedValueLoss& value);
  /// Adds them up and steps. `step` has the note, the gates, what Adam works on, and where the norms and the loss go.
  void step(FusedStep step);
  /// The first half of it: the gradients are where `step` says, and no step is taken.
  void add_up(FusedStep step);
  /// Of the latest minibatch: [2, kFusedSums] the actor's sums (PolicyDiagnostic), and the critic's (its loss).
  const at::Tensor& sums() const { return sums_; }
  /// Of the latest minibatch, before ranks are added up, behind end_epoch(): [P] fp64.
  at::Tensor own_actor_gradient() const { return own_gradient(actor_partial_, actor_mlp_); }
  at::Tensor own_critic_gradient() const { return own_gradient(critic_partial_, critic_mlp_); }

 private:
  /// The stream of this one, and places there that its twin waits for.
  struct Beside {
    Beside(int index, void* main) : stream(index, main), actor_turn(index), actor_step(index) {}
    SideStream stream;
    StreamMark actor_turn, actor_step;  // of the latest minibatch: where its turn begins, and where it has stepped
  };

  int index() const { return parallel_for_.device().index; }
  void* stream() const { return beside_->stream.stream(); }
  void launch_gradients(const FusedActor& actor, const FusedCritic& critic);
  static at::Tensor own_gradient(const at::Tensor& partial, const FusedMlp& net);
  void complete(FusedStep& step) const;
  void add_ranks(FusedStep& step);

  const Actor& actor_;
  const Critic& critic_;
  const FusedMlp actor_mlp_, critic_mlp_;
  const int n_;
  const ParallelFor& parallel_for_;
  const SumOverRanks sum_;
  const int blocks_;                           // that share a minibatch
  FusedUpdate* twin_ = nullptr;                // null: the actor is this one's alone
  std::unique_ptr<Beside> beside_;             // null on a CPU
  FusedRows rows_, critic_rows_;               // of the epoch: what the actor reads; what the critic reads
  MinibatchPieces pieces_{0, 1};               // of the epoch
  at::Tensor states_;                          // keeps what rows_ points to
  at::Tensor moments_;                         // [pieces, kMomentParts, kMoments] fp64
  at::Tensor actor_partial_, critic_partial_;  // [partial_rows(), parameters + kFusedSums]
  at::Tensor kept_states_;                     // of the critic (kept_words()); undefined where it needs none
  at::Tensor wide_;                            // work memory of wide networks, which take turns; undefined: none is
  at::Tensor over_ranks_;                      // [both networks' parameters + kFusedSums]; undefined with one rank
  at::Tensor sums_;                            // [2, kFusedSums]
  at::Tensor squares_;                         // [fused_step_blocks()] fp64
  at::Tensor finished_;                        // [1]
};

/// Queues on the stream of `parallel_for`, and reads and writes memory that stays where it is from the largest
/// minibatch on: a graph may hold it then.
class FusedActorGradient {
 public:
  /// An actor that they serve; all three must outlive this. `n`: agents of the team.
  FusedActorGradient(const Actor& actor, int n, const ParallelFor& parallel_for, const SumOverRanks& sum = {});

  /// The gradient of the loss over these states [S] of obs [.., n, D] and alive [.., n], into the actor's, and its sums
  /// [kFusedSums] (PolicyDiagnostic); both of this rank. Advantages have the moments of all ranks.
  const at::Tensor& compute(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& states,
                            const FusedPolicyLoss& policy);

 private:
  const Actor& actor_;
  const FusedMlp mlp_;
  const int n_;
  const ParallelFor& parallel_for_;
  const SumOverRanks sum_;
  const int blocks_;    // that share a minibatch
  at::Tensor moments_;  // [1, kMomentParts, kMoments] fp64
  at::Tensor partial_;  // [partial_rows(), parameters + kFusedSums]
  at::Tensor wide_;     // as of FusedUpdate
  at::Tensor sums_;     // [kFusedSums]
};

}  // namespace giga
