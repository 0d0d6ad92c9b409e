#include "policy/mutual_information.hpp"

#include <torch/types.h>

#include <cmath>

namespace giga {
namespace {

/// The probabilities of rows [R, groups, choices].
at::Tensor choices_of(const Policy& policy, const at::Tensor& head, bool greedy) {
  if (policy.actions() == ActionKind::discrete) {
    const at::Tensor logits = head.slice(-1, 0, kNDiscreteActions);
    const at::Tensor p = greedy ? at::arange(kNDiscreteActions, logits.device()).eq(logits.argmax(-1, true)).to(logits)
                                : at::softmax(logits, -1);
    return p.unsqueeze(1);
  }
  constexpr int kBins = 9;
  const at::Tensor edges =
      at::linspace(-1, 1, kBins + 1, head.options()).slice(0, 1, kBins).atanh();  // before squashing
  const at::Tensor beyond = edges - head.unsqueeze(-1);
  const at::Tensor below = greedy ? (beyond > 0).to(head)
                                  : 0.5 * (1 + at::erf(beyond / policy.log_std().exp().unsqueeze(-1) / std::sqrt(2.0)));
  const at::Tensor zero = at::zeros_like(below.slice(-1, 0, 1));
  return at::cat({below, zero + 1}, -1) - at::cat({zero, below}, -1);
}

at::Tensor entropy(const at::Tensor& p) { return -(p * (p + 1e-12).log()).sum(-1); }

}  // namespace

InformationSums information_sums(const Policy& policy, const at::Tensor& head, const at::Tensor& weight, bool greedy) {
  at::NoGradGuard no_grad;
  const at::Tensor p = choices_of(policy, head, greedy);
  return {weight.sum(), (p * weight.view({-1, 1, 1})).sum(0), (entropy(p) * weight.unsqueeze(-1)).sum(0)};
}

at::Tensor mutual_information(const InformationSums& sums) {
  const at::Tensor count = sums.rows.clamp_min(1);
  // Rounding may leave less than nothing.
  return (entropy(sums.policy / count) - sums.entropies / count).sum().clamp_min(0).reshape({1});
}

at::Tensor mutual_information(const Policy& policy, const at::Tensor& head, const at::Tensor& weight,
                              const SumOverRanks& sum) {
  at::NoGradGuard no_grad;
  const InformationSums sums = information_sums(policy, head, weight);
  sum.together({sums.rows, sums.policy, sums.entropies});
  return mutual_information(sums);
}

}  // namespace giga
