// Actor: the policy of a team, from an agent's observation to the parameters of its action distribution.
#pragma once

#include <ATen/core/Tensor.h>

#include <optional>
#include <string>

#include "math/distributions.hpp"
#include "policy/inputs.hpp"
#include "policy/layers.hpp"
#include "policy/normalizer.hpp"
#include "policy/parameters.hpp"
#include "policy/policy.hpp"
#include "sim/params.hpp"

namespace giga {

class Actor final : public Policy {
 public:
  Actor() = default;
  /// `inputs`: what it reads of observations, whose rows are whole. `normalize`: they pass a running normaliser first
  /// (see RunningNorm).
  Actor(const ActorConfig& config, const InputColumns& inputs, ActionKind actions, bool normalize, Precision precision,
        at::Device device, uint64_t seed);

  /// Number of parameters of such an actor; nothing is allocated.
  static int64_t count_parameters(const ActorConfig& config, const InputColumns& inputs, ActionKind actions);

  at::Tensor forward(const at::Tensor& obs) const override;
  /// Likewise for each member of a population [M, P] of parameters: obs [M, R, D] -> [M, R, head size]. The normaliser
  /// is common to all.
  at::Tensor forward_members(const at::Tensor& members, const at::Tensor& obs) const;

  /// The layout for the fused kernel (cuda/population_policy.hpp), which is for precision fp16; none where it has no
  /// room.
  std::optional<SmallMlp> small_mlp() const;
  /// That of an actor without a normaliser; nothing is allocated.
  static std::optional<SmallMlp> small_mlp(const ActorConfig& config, const InputColumns& inputs, ActionKind actions,
                                           Precision precision);
  /// First of the three numbers of log_std among the parameters; continuous actions only.
  int64_t log_std_offset() const { return parameters_.offset(log_std_); }

  ActionKind actions() const override { return actions_; }
  int64_t head_size() const { return head_size(actions_); }
  static int64_t head_size(ActionKind actions) { return actions == ActionKind::discrete ? kLogitStride : kActionSize; }
  at::Tensor log_std() const override;
  Precision precision() const { return precision_; }
  const ParameterSet& parameters() const { return parameters_; }
  const MlpConfig& network() const { return mlp_.config(); }
  const InputColumns& inputs() const { return inputs_; }
  bool normalizes() const { return normalize_; }
  RunningNorm& normalizer() { return normalizer_; }
  const RunningNorm& normalizer() const { return normalizer_; }

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  Rounding rounding() const { return precision_ == Precision::fp16 ? Rounding::to_half : Rounding::none; }
  at::Tensor input_of(const at::Tensor& obs) const;
  static Actor unallocated(const ActorConfig& config, const InputColumns& inputs, ActionKind actions);
  void add_parameters(const ActorConfig& config, const InputColumns& inputs);

  ActionKind actions_ = ActionKind::discrete;
  InputColumns inputs_;
  bool normalize_ = false;
  Precision precision_ = Precision::fp32;
  ParameterSet parameters_;
  Mlp mlp_;
  int log_std_ = -1;
  RunningNorm normalizer_;
};

/// I(observation; action) in nats: entropy of the mean policy minus the mean entropy, over rows with weight 1. Shows
/// how much a policy depends on what it sees. Continuous actions: each dimension in nine equal bins of (-1, 1), summed.
at::Tensor policy_information(const Actor& actor, const at::Tensor& head, const at::Tensor& weight);

}  // namespace giga
