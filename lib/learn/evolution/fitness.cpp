#include "learn/evolution/fitness.hpp"

#include <cmath>
#include <limits>

namespace giga {
namespace {

constexpr double kWorst = -std::numeric_limits<double>::infinity();

at::Tensor doubles() { return at::empty({0}, at::TensorOptions().dtype(at::kDouble)); }

/// The ranks, from 0 = best, of the members with the same fitness: `first` to one before `end`; int64 [M].
struct RankRange {
  at::Tensor first, end;
};
RankRange rank_ranges(const at::Tensor& fitness) {
  const at::Tensor clean = at::where(at::isfinite(fitness), fitness, kWorst);
  const at::Tensor sorted = std::get<0>(clean.sort());  // ascending
  const int64_t n = fitness.size(0);
  return {n - at::searchsorted(sorted, clean, false, /*right=*/true), n - at::searchsorted(sorted, clean)};
}

}  // namespace

at::Tensor count_not_finite(const at::Tensor& fitness) {
  return at::isfinite(fitness).logical_not().sum().to(at::kFloat).reshape({1});
}

at::Tensor shape_fitness(const at::Tensor& fitness, FitnessShaping shaping) {
  if (shaping == FitnessShaping::centered_ranks) {
    const RankRange ranks = rank_ranges(fitness);
    const at::Tensor middle = (ranks.first + ranks.end - 1).to(at::kFloat) / 2;
    return 0.5 - middle / static_cast<double>(fitness.size(0) - 1);
  }
  const at::Tensor finite = at::isfinite(fitness);
  const at::Tensor worst = at::where(finite, fitness, -kWorst).min();
  at::Tensor clean = at::where(finite, fitness, at::where(at::isfinite(worst), worst, 0.0));
  if (shaping == FitnessShaping::raw) return clean;
  const at::Tensor centered = clean - clean.mean();
  return centered / (centered.square().mean().sqrt() + 1e-8);
}

RankWeights::RankWeights(const at::Tensor& weights, at::Device device)
    : sums_(at::cat({at::zeros({1}, doubles().options()), weights.to(at::kDouble).cumsum(0)}).to(device)) {}

at::Tensor RankWeights::of(const at::Tensor& fitness) const {
  const RankRange ranks = rank_ranges(fitness);
  const at::Tensor sum = sums_.index_select(0, ranks.end) - sums_.index_select(0, ranks.first);
  return (sum / (ranks.end - ranks.first)).to(at::kFloat);
}

at::Tensor snes_utilities(int64_t n_members) {
  const auto n = static_cast<double>(n_members);
  const at::Tensor k = at::arange(1, n_members + 1, doubles().options());
  const at::Tensor raw = (std::log(n / 2 + 1) - k.log()).clamp_min(0);
  return (raw / raw.sum() - 1 / n).to(at::kFloat);
}

at::Tensor des_weights(int64_t n_members, double temperature) {
  const at::Tensor r = at::linspace(-0.5, 0.5, n_members, doubles().options());
  return at::softmax(-20 * at::sigmoid(temperature * r), 0).to(at::kFloat);
}

}  // namespace giga
