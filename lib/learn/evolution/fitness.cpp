#include "learn/evolution/fitness.hpp"

#include <cmath>
#include <limits>

namespace giga {
namespace {

constexpr double kWorst = -std::numeric_limits<double>::infinity();

at::Tensor doubles() { return at::empty({0}, at::TensorOptions().dtype(at::kDouble)); }

}  // namespace

at::Tensor fitness_ranks(const at::Tensor& fitness) {
  const at::Tensor clean = at::where(at::isfinite(fitness), fitness, kWorst);
  const at::Tensor order = at::argsort(clean, /*stable=*/true, /*dim=*/0, /*descending=*/true);
  const at::Tensor places = at::arange(fitness.size(0), order.options());
  return at::empty_like(order).index_copy_(0, order, places);
}

at::Tensor count_not_finite(const at::Tensor& fitness) {
  return at::isfinite(fitness).logical_not().sum().to(at::kFloat).reshape({1});
}

at::Tensor shape_fitness(const at::Tensor& fitness, FitnessShaping shaping) {
  const double last = static_cast<double>(fitness.size(0) - 1);
  if (shaping == FitnessShaping::centered_ranks) return 0.5 - fitness_ranks(fitness).to(at::kFloat) / last;
  const at::Tensor finite = at::isfinite(fitness);
  const at::Tensor worst = at::where(finite, fitness, -kWorst).min();
  at::Tensor clean = at::where(finite, fitness, at::where(at::isfinite(worst), worst, 0.0));
  if (shaping == FitnessShaping::raw) return clean;
  const at::Tensor centered = clean - clean.mean();
  return centered / (centered.square().mean().sqrt() + 1e-8);
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
