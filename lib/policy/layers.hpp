// Layers: what networks are built from.
#pragma once

#include <ATen/core/Tensor.h>

#include <optional>
#include <string>

#include "core/parallel_for.hpp"
#include "policy/config.hpp"
#include "policy/inputs.hpp"
#include "policy/parameters.hpp"

namespace giga {

/// y = x W^T + b, in the type of x.
at::Tensor linear(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& bias);

at::Tensor activate(const at::Tensor& x, Activation activation);

/// The nearest numbers of half precision, as fp32. Beyond 65,504 they are infinite, below 2^-25 zero.
at::Tensor rounded_to_half(const at::Tensor& x);
/// How inputs, weights and biases are rounded: in each layer to half precision, or bytes to bfloat16 where they become
/// numbers. Layers behind compute in the type of what they read.
enum class Rounding : uint8_t { none, to_half, to_bfloat16 };

/// The columns of x [..., row] that a network reads, as a view.
at::Tensor columns_of(const InputColumns& columns, const at::Tensor& x);

struct DenseShape {
  int64_t input, output;
  float gain;                                 ///< of the orthogonal initialisation; the bias starts at 0
  std::optional<Activation> activation = {};  ///< none in an output layer
  bool layer_norm = false;
};

/// A dense layer, activation(norm(x W^T + b)), by the numbers of its parameters in a ParameterSet.
struct DenseLayer {
  int weight = -1, bias = -1;            // [output, input], [output]
  int norm_weight = -1, norm_bias = -1;  // [output] each; -1 without layer normalisation
  std::optional<Activation> activation;
};

/// Adds the parameters of a layer as `name`/weight, bias, and norm_weight, norm_bias where it normalises.
DenseLayer add_dense(ParameterSet& parameters, const std::string& name, const DenseShape& shape);

/// x [..., input] -> [..., output].
at::Tensor dense(const ParameterSet& p, const DenseLayer& layer, const at::Tensor& x, Rounding rounding);
/// Each member of a population [M, P] on rows of its own, in one batched product: x [M, R, input] -> [M, R, output].
at::Tensor dense_members(const ParameterSet& p, const at::Tensor& members, const DenseLayer& layer, const at::Tensor& x,
                         Rounding rounding);
/// Whether the end of a layer that reads x is one pass each way (policy/dense_epilogue.hpp), for n rows of a state.
bool has_fused_epilogue(const ParameterSet& p, const DenseLayer& layer, const at::Tensor& x, int64_t n = 1);
/// The end of `dense`: normalisation and activation of the sums x W^T + b.
at::Tensor finish_dense(const ParameterSet& p, const DenseLayer& layer, at::Tensor sums);

/// Mean over the agents with alive = 1, or 0 if there is none: x [B, n, H], alive [B, n] fp32 -> [B, H]. Differentiable
/// in x.
at::Tensor living_mean(const ParallelFor& parallel_for, const at::Tensor& x, const at::Tensor& alive);

}  // namespace giga
