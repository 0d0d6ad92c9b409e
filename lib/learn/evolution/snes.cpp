// SNES: separable natural evolution strategy (Wierstra et al. 2014, algorithm 6).
#include <cmath>

#include "learn/evolution/evolution.hpp"
#include "learn/evolution/fitness.hpp"
#include "learn/evolution/strategy.hpp"

namespace giga {
namespace {

class Snes final : public EvolutionStrategy {
 public:
  Snes(const PopulationConfig& population, const SnesConfig& config, const PopulationPlace& place,
       const at::Tensor& mean, const ParallelFor& parallel_for)
      : EvolutionStrategy(population, place, mean, parallel_for),
        utilities_(snes_utilities(population.population_size), mean.device()) {
    const auto d = static_cast<double>(mean.size(0));
    const auto standard = static_cast<float>((3 + std::log(d)) / (5 * std::sqrt(d)));
    rate_mean_ = config.learning_rate_mean.value_or(standard);
    rate_sigma_ = config.learning_rate_sigma.value_or(standard);
  }

 private:
  // mean += eta_mean sigma sum(u e); sigma *= exp(eta_sigma / 2 sum(u (e^2 - 1))), and utilities sum to zero.
  void learn(const at::Tensor& shaped) override {
    const Moments sums = moments(utilities_.of(shaped));
    mean_.add_(sigma_ * sums.first, rate_mean_);
    sigma_.mul_((sums.second * (rate_sigma_ / 2)).exp());
  }

  const RankWeights utilities_;
  float rate_mean_ = 1, rate_sigma_ = 1;
};

}  // namespace

std::unique_ptr<EvolutionStrategy> make_snes(const PopulationConfig& population, const SnesConfig& config,
                                             const PopulationPlace& place, const at::Tensor& mean,
                                             const ParallelFor& parallel_for) {
  return std::make_unique<Snes>(population, config, place, mean, parallel_for);
}

std::unique_ptr<Learner> SnesAlgorithm::make(const LoadedRun& run, Device device, Ranks* ranks) {
  return make_evolution(run, device, ranks, [](const RunConfig& c, const auto&... rest) {
    return make_snes(c.population, c.snes, rest...);
  });
}

}  // namespace giga
