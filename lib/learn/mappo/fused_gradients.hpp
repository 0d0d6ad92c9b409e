// FusedGradients: the gradients of a team's losses by the fused kernels (cuda/ppo_gradients.hpp), in the place of
// LibTorch's passes through the networks.
#pragma once

#include <torch/types.h>

#include <memory>
#include <string>

#include "cuda/ppo_gradients.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"

namespace giga {

/// Why the fused kernels do not serve these networks there, for the log; empty where they do. Actor and critic go
/// together.
std::string fused_gradients_refusal(const Actor& actor, const Critic& critic, int n_agents, Device device);

class FusedGradients {
 public:
  /// Networks that the kernels serve; both must outlive this. `n`: agents of the team.
  FusedGradients(const Actor& actor, const Critic& critic, int n, Device device, void* stream);

  /// The rows of these states [S] (undefined: all) of obs [states, n, D] and alive [states, n]; what follows takes
  /// these.
  void choose(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& states);
  /// Their values, where `values` [states, n] has them.
  void write_values(const at::Tensor& values);
  /// The moments of the chosen rows, which both gradients need.
  void take_moments(const at::Tensor& advantage);
  /// The gradient takes the place of the one that the network's parameters have. -> sums [kFusedSums] over the chosen
  /// rows: PolicyDiagnostic; the loss. They hold until the next call.
  const at::Tensor& actor_gradient(const FusedPolicyLoss& loss);
  const at::Tensor& critic_gradient(const FusedValueLoss& loss);

 private:
  FusedRows rows_of(const InputColumns& inputs) const;

  const Actor& actor_;
  const Critic& critic_;
  const FusedMlp actor_mlp_, critic_mlp_;
  const int index_;
  void* const stream_;
  FusedRows rows_;      // with whole observations
  at::Tensor states_;   // keeps what rows_ points to
  at::Tensor moments_;  // [kMomentParts, kMoments] fp64
  at::Tensor partial_;  // [blocks, parameters + kFusedSums] of the larger network
  at::Tensor sums_;     // [kFusedSums]
};

}  // namespace giga
