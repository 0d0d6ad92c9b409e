// Fitness into weights: ranks, shaping, and the weights by rank of each strategy. Larger fitness is better.
#pragma once

#include <torch/types.h>

#include "learn/evolution/config.hpp"

namespace giga {

/// Members [1] whose fitness is not finite, float.
at::Tensor count_not_finite(const at::Tensor& fitness);

/// Shaped fitness [M]; what is not finite counts as worst. centered_ranks: 0.5 for the best to -0.5 for the worst
/// (Salimans et al. 2017), ties at the middle of their ranks; z_score: mean 0, deviation 1; raw: unchanged.
at::Tensor shape_fitness(const at::Tensor& fitness, FitnessShaping shaping);

/// Weights by rank. Members of equal fitness share theirs: with few episodes many are equal, and the order of the
/// members must not decide.
class RankWeights {
 public:
  /// `weights` [M], best first.
  RankWeights(const at::Tensor& weights, at::Device device);
  /// fitness [M] -> weights [M], float. What is not finite counts as worst.
  at::Tensor of(const at::Tensor& fitness) const;

 private:
  at::Tensor sums_;  // [M + 1] double: of the first k weights
};

/// Weights [M], best first, on the CPU.
/// SNES (Wierstra et al. 2014, section 3.1): max(0, ln(M / 2 + 1) - ln k) for k = 1 .. M, normalised to sum 1, less 1 /
/// M.
at::Tensor snes_utilities(int64_t n_members);
/// Discovered ES (Lange et al. 2023, equation 9): softmax(-20 sigmoid(temperature r)), r from -0.5 to 0.5.
at::Tensor des_weights(int64_t n_members, double temperature);

}  // namespace giga
