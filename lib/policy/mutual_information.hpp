// The mutual information of observations and actions: how much what a policy does depends on what it sees
// and, if it has a memory, remembers.
#pragma once

#include <ATen/core/Tensor.h>

#include "policy/policy.hpp"
#include "policy/sum_over_ranks.hpp"

namespace giga {

/// Sums over rows of observations. Discrete actions are one group of choices; continuous ones have a group for each of
/// their three dimensions, of nine equal bins of (-1, 1).
struct InformationSums {
  at::Tensor rows;       // [] how many
  at::Tensor policy;     // [groups, choices] probabilities
  at::Tensor entropies;  // [groups] nats
};

/// Those of rows with weight 1 [R], of the heads that `policy` gives them (Policy::forward). `greedy`: it is certain
/// of its likeliest action.
InformationSums information_sums(const Policy& policy, const at::Tensor& head, const at::Tensor& weight,
                                 bool greedy = false);

/// I(observation; action) in nats [1]: the entropy of the mean policy minus the mean entropy, summed over the groups.
at::Tensor mutual_information(const InformationSums& sums);

/// That of such rows, of all ranks.
at::Tensor mutual_information(const Policy& policy, const at::Tensor& head, const at::Tensor& weight,
                              const SumOverRanks& sum = {});

}  // namespace giga
