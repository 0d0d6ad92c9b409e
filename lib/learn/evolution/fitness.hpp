// Fitness into weights: ranks, shaping, and the weights by rank of each strategy. Fitness is the larger the better.
#pragma once

#include <torch/types.h>

#include "learn/evolution/config.hpp"

namespace giga {

/// Ranks [M] of fitness [M], int64: 0 is the best. A number that is not finite counts as worst; among equal ones the
/// member with the smaller number is better, so that ranks are a permutation on every device.
at::Tensor fitness_ranks(const at::Tensor& fitness);

/// Members [1] whose fitness is not finite, float.
at::Tensor count_not_finite(const at::Tensor& fitness);

/// Shaped fitness [M]; what is not finite counts as the worst that is. centered_ranks: 0.5 for the best to -0.5 for the
/// worst (Salimans et al. 2017); z_score: mean 0, deviation 1; raw: as it is.
at::Tensor shape_fitness(const at::Tensor& fitness, FitnessShaping shaping);

/// Weights [M] by rank, best first, on the CPU.
/// SNES (Wierstra et al. 2014, section 3.1): max(0, ln(M / 2 + 1) - ln k) for k = 1 .. M, normalised to sum 1, less 1 /
/// M.
at::Tensor snes_utilities(int64_t n_members);
/// Discovered ES (Lange et al. 2023, equation 9): softmax(-20 sigmoid(temperature r)), r from -0.5 to 0.5.
at::Tensor des_weights(int64_t n_members, double temperature);

}  // namespace giga
