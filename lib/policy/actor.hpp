// Actor: the policy of a team, from an agent's observation to the parameters of its action distribution.
#pragma once

#include <ATen/core/Tensor.h>

#include <optional>
#include <string>

#include "core/error.hpp"
#include "core/parallel_for.hpp"
#include "cuda/ppo_gradients.hpp"
#include "math/distributions.hpp"
#include "policy/inputs.hpp"
#include "policy/network.hpp"
#include "policy/normalizer.hpp"
#include "policy/parameters.hpp"
#include "policy/policy.hpp"
#include "sim/params.hpp"

namespace giga {

class Actor final : public Policy {
 public:
  Actor() = default;
  /// `inputs`: the columns that it reads of whole observations. `normalize`: observations pass a RunningNorm first.
  Actor(const ActorConfig& config, const InputColumns& inputs, ActionKind actions, bool normalize, Precision precision,
        at::Device device, uint64_t seed);

  using Policy::forward;
  at::Tensor forward(const at::Tensor& obs, NetworkState& state) const override;
  /// Steps in a row: obs [L R, D] -> [L R, head size], and its features [L R, F] in `kept`.
  at::Tensor forward_sequence(const at::Tensor& obs, const Sequence& sequence, at::Tensor* kept = nullptr) const;
  /// Its two parts, for a critic that shares the encoder: obs [..., D] -> features [..., F], before any memory, and
  /// features [L R, F] -> [L R, head size].
  at::Tensor features(const at::Tensor& obs) const;
  at::Tensor head(const at::Tensor& features, const Sequence& sequence) const;
  /// Each member of a population [M, P] of parameters: obs [M, R, D] -> [M, R, head size]. All share the normaliser.
  at::Tensor forward_members(const at::Tensor& members, const at::Tensor& obs, NetworkState& state) const;
  /// The same without memory.
  at::Tensor forward_members(const at::Tensor& members, const at::Tensor& obs) const {
    GIGA_CHECK(state_size() == 0, "nobody keeps what these networks remember");
    NetworkState state;
    return forward_members(members, obs, state);
  }
  /// What `forward` computes, for those who look at games: small networks by kernels of this program, so that LibTorch
  /// need not load its own for a few rows. With this and other changes of the same time the first evaluation of a run
  /// takes 7 ms longer than the second, where it took 55 ms longer. In fp32 whatever the precision. None where it is no
  /// chain of a few small dense layers.
  std::optional<at::Tensor> small_head(const at::Tensor& obs, const ParallelFor& parallel_for) const;
  int64_t state_size() const override { return network_.state_size(); }

  /// The layout for the fused kernel (cuda/population_policy.hpp), which computes in fp16; none if it has no room.
  std::optional<SmallMlp> small_mlp() const;
  /// The layout for the fused policy and the fused gradients (cuda/ppo_gradients.hpp), which round as TF32 does on a
  /// GPU; none where they have no room for the network.
  std::optional<FusedMlp> fused_mlp() const;
  /// Whether actions are computed by them where they serve; else always by LibTorch.
  void take_fused_kernels(bool taken) { takes_fused_kernels_ = taken; }
  bool takes_fused_kernels() const { return takes_fused_kernels_; }
  /// First of the three numbers of log_std among the parameters; continuous actions only.
  int64_t log_std_offset() const { return parameters_.offset(log_std_); }
  /// Of parameters of this layout [P], moves log_std into its bounds. Discrete actions have none.
  void bound_log_std(const at::Tensor& parameters) const;

  ObservationSet reads() const override { return inputs_.set; }
  ActionKind actions() const override { return actions_; }
  int64_t head_size() const { return head_size(actions_); }
  static int64_t head_size(ActionKind actions) { return actions == ActionKind::discrete ? kLogitStride : kActionSize; }
  at::Tensor log_std() const override;
  Precision precision() const { return precision_; }
  const ParameterSet& parameters() const { return parameters_; }
  const NetworkConfig& config() const { return config_; }
  const Network& network() const { return network_; }
  const InputColumns& inputs() const { return inputs_; }
  bool normalizes() const { return normalize_; }
  RunningNorm& normalizer() { return normalizer_; }
  const RunningNorm& normalizer() const { return normalizer_; }

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  Rounding rounding() const {
    if (precision_ == Precision::bf16) return Rounding::to_bfloat16;
    return precision_ == Precision::fp16 ? Rounding::to_half : Rounding::none;
  }
  at::Tensor input_of(const at::Tensor& obs) const;
  ReadParameters read_parameters() const { return {parameters_, precision_ == Precision::bf16}; }
  at::Tensor features(const ParameterSet& p, const at::Tensor& obs) const;
  at::Tensor head(const ParameterSet& p, const at::Tensor& features, const Sequence& sequence) const;

  NetworkConfig config_;
  float log_std_min_, log_std_max_;
  ActionKind actions_ = ActionKind::discrete;
  InputColumns inputs_;
  bool normalize_ = false;
  bool takes_fused_kernels_ = true;
  Precision precision_ = Precision::fp32;
  ParameterSet parameters_;
  Network network_;
  int log_std_ = -1;
  RunningNorm normalizer_;
};

}  // namespace giga
