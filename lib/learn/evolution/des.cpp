// Discovered ES: the closed form of a strategy that was found by meta-learning (Lange et al. 2023, section 5.3).
#include "learn/evolution/evolution.hpp"
#include "learn/evolution/fitness.hpp"
#include "learn/evolution/strategy.hpp"

namespace giga {
namespace {

class Des final : public EvolutionStrategy {
 public:
  Des(const PopulationConfig& population, const DesConfig& config, const PopulationPlace& place, const at::Tensor& mean,
      const ParallelFor& parallel_for)
      : EvolutionStrategy(population, place, mean, parallel_for),
        weights_(des_weights(population.population_size, static_cast<double>(config.temperature)), mean.device()),
        rate_mean_(config.learning_rate_mean),
        rate_sigma_(config.learning_rate_sigma) {}

 private:
  // The members are mean + sigma e: their weighted mean is mean + sigma sum(w e), their weighted deviation from the old
  // mean sigma sqrt(sum(w e^2)).
  void learn(const at::Tensor& shaped) override {
    const Moments sums = moments(weights_.of(shaped));
    mean_.add_(sigma_ * sums.first, rate_mean_);
    sigma_.add_(sigma_ * (sums.second.sqrt() - 1), rate_sigma_);
  }

  const RankWeights weights_;
  const float rate_mean_, rate_sigma_;
};

}  // namespace

std::unique_ptr<EvolutionStrategy> make_des(const PopulationConfig& population, const DesConfig& config,
                                            const PopulationPlace& place, const at::Tensor& mean,
                                            const ParallelFor& parallel_for) {
  return std::make_unique<Des>(population, config, place, mean, parallel_for);
}

std::unique_ptr<Learner> DesAlgorithm::make(const LoadedRun& run, Device device, Ranks* ranks) {
  return make_evolution(run, device, ranks,
                        [](const RunConfig& c, const auto&... rest) { return make_des(c.population, c.des, rest...); });
}

}  // namespace giga
