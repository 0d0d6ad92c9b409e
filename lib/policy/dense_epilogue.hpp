// The end of a dense layer of a wide network, as one differentiable function: bias, activation, and what a team shares.
#pragma once

#include <ATen/core/Tensor.h>

#include "math/activation.hpp"

namespace giga {

/// What the n rows of a state, one behind the other, give each other.
struct SharedByTeam {
  int64_t n = 1;
  at::Tensor of_team = {};  // [states, columns] added to each of its rows; undefined = nothing
  at::Tensor alive = {};    // [states, n] fp32, whose mean features are wanted; undefined = none are
};
struct LayerFeatures {
  at::Tensor features;  // [..., columns] as the sums
  at::Tensor mean;      // [states, columns] over the living rows; undefined where not wanted
};

/// Whether the kernels serve layers with such a bias: bfloat16 on a GPU, columns a multiple of 8, and states of at most
/// 64 rows, which one thread reads.
bool dense_epilogue_serves(const at::Tensor& bias, int64_t n = 1);

/// activation(sums + bias + of_team) of sums [..., columns] = x W^T and bias [columns] in bfloat16, and its means; one
/// pass over the features each way, bias gradient and sums over teams with it. LibTorch would take one for each. Sums
/// are rounded before the bias is added, and tanh is within 2^-11 on a GPU; a population's batched products are not.
LayerFeatures dense_epilogue(const at::Tensor& sums, const at::Tensor& bias, Activation activation,
                             const SharedByTeam& team = {});

}  // namespace giga
