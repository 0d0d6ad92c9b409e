// Layers: a multilayer perceptron, and one whose agents exchange the mean features of their team.
#pragma once

#include <ATen/core/Tensor.h>

#include <optional>
#include <string>
#include <vector>

#include "core/parallel_for.hpp"
#include "cuda/population_policy.hpp"
#include "policy/config.hpp"
#include "policy/inputs.hpp"
#include "policy/parameters.hpp"

namespace giga {

/// y = x W^T + b in the given precision; fp32 in and out of the network, bf16 inside where asked for.
at::Tensor linear(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& bias);

at::Tensor activate(const at::Tensor& x, Activation activation);

/// The nearest numbers of half precision, as fp32. Beyond 65,504 they are infinite, below 2^-25 zero.
at::Tensor rounded_to_half(const at::Tensor& x);
/// Whether a layer rounds what it multiplies and its bias to half precision.
enum class Rounding : bool { none, to_half };

/// What a network reads of x [..., row]; a view.
at::Tensor columns_of(const InputColumns& columns, const at::Tensor& x);

/// input -> hidden ... -> output, with the activation after every hidden layer.
class Mlp {
 public:
  Mlp() = default;
  /// `output` 0 = no output layer: the last hidden features are the result.
  Mlp(ParameterSet& parameters, const std::string& name, int64_t input, const MlpConfig& config, int64_t output,
      float output_gain);
  at::Tensor forward(const ParameterSet& p, at::Tensor x,
                     Rounding rounding = Rounding::none) const;  // [R, input] -> [R, output]
  /// Each member of a population [M, P] on rows of its own, one batched product a layer: x [M, R, input] ->
  /// [M, R, output].
  at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, at::Tensor x,
                             Rounding rounding = Rounding::none) const;
  /// The layout for the fused kernel; none where that has no room for it (layer normalisation, many or wide layers).
  std::optional<SmallMlp> small(const ParameterSet& p) const;

  const MlpConfig& config() const { return config_; }

 private:
  friend class TeamMlp;
  struct Layer {
    int weight, bias, norm_weight = -1, norm_bias = -1;
    bool hidden;
  };
  at::Tensor finish(const ParameterSet& p, const Layer& layer, at::Tensor x) const;

  std::vector<Layer> layers_;
  MlpConfig config_;
};

/// An Mlp over the agents of a team: from the second layer on, each layer also gets the mean of the features of the
/// team's living agents through weights of its own. The value V_i(s_i) of each agent so becomes part of a composed
/// V(S) = f(V_1(s_1), ..., V_n(s_n)), whatever the order of the agents.
class TeamMlp {
 public:
  TeamMlp() = default;
  TeamMlp(ParameterSet& parameters, const std::string& name, int64_t input, const MlpConfig& config, int64_t output,
          float output_gain);
  /// x [B, n, input], alive [B, n] fp32 of 0 and 1 -> [B, n, output].
  at::Tensor forward(const ParameterSet& p, const ParallelFor& rows, at::Tensor x, const at::Tensor& alive) const;

 private:
  Mlp own_;
  std::vector<int> team_weights_;  // by layer; -1 for the first
};

/// Mean over the agents with alive = 1, zero where none is: x [B, n, H], alive [B, n] fp32 -> [B, H]. Differentiable in
/// x.
at::Tensor living_mean(const ParallelFor& rows, const at::Tensor& x, const at::Tensor& alive);

}  // namespace giga
