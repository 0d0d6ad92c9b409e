// OpenAI-ES: the gradient of the mean fitness under Gaussian perturbations (Salimans et al. 2017, algorithm 1), which
// an optimizer follows.
#include <algorithm>
#include <cmath>

#include "learn/evolution/evolution.hpp"
#include "learn/evolution/strategy.hpp"
#include "math/step_gate.hpp"
#include "policy/parameters.hpp"

namespace giga {
namespace {

constexpr double kEpsilon = 1e-8;  // of Adam

class OpenAiEs final : public EvolutionStrategy {
 public:
  OpenAiEs(const PopulationConfig& population, const OpenAiEsConfig& config, const PopulationPlace& place,
           const at::Tensor& mean, const ParallelFor& parallel_for)
      : EvolutionStrategy(population, place, mean, parallel_for),
        config_(config),
        sigma_init_(population.sigma_init),
        velocity_(at::zeros_like(mean)),
        square_(at::zeros_like(mean)),
        steps_(at::zeros({}, mean.options().dtype(at::kDouble))) {}

 private:
  std::vector<StateTensor> state() const override {
    std::vector<StateTensor> all = EvolutionStrategy::state();
    all.insert(all.end(), {{"velocity", velocity_}, {"square", square_}, {"steps", steps_}});
    return all;
  }

  /// A setting after some generations of decay; one that starts below its limit does not decay.
  static double decayed(float start, float decay, float least, double generations) {
    const double value = static_cast<double>(start) * std::pow(static_cast<double>(decay), generations);
    return std::max(value, static_cast<double>(std::min(least, start)));
  }

  // Gradient of the mean fitness: sum(F e) / (M sigma); weight decay pulls the mean to zero.
  void learn(const at::Tensor& shaped) override {
    const Moments sums = moments(shaped);
    const at::Tensor gradient =
        sums.first / (sigma_ * static_cast<double>(population_size())) - mean_ * config_.weight_decay;
    step(gradient, decayed(config_.learning_rate, config_.learning_rate_decay, config_.learning_rate_min, generation_));
    sigma_.fill_(decayed(sigma_init_, config_.sigma_decay, config_.sigma_min, generation_ + 1.0));
  }

  void step(const at::Tensor& gradient, double rate) {
    switch (config_.optimizer) {
      case MeanOptimizer::adam: {  // Kingma and Ba 2015
        steps_.add_(1);
        velocity_.mul_(kAdamBeta1).add_(gradient, 1 - kAdamBeta1);
        square_.mul_(kAdamBeta2).addcmul_(gradient, gradient, 1 - kAdamBeta2);
        const at::Tensor deviation = (square_ / (1 - at::pow(kAdamBeta2, steps_))).sqrt() + kEpsilon;
        mean_.add_(velocity_ / deviation * (rate / (1 - at::pow(kAdamBeta1, steps_))));
        return;
      }
      case MeanOptimizer::momentum:
        velocity_.mul_(config_.momentum).add_(gradient);
        mean_.add_(velocity_, rate);
        return;
      case MeanOptimizer::clip_up: {  // Toklu et al. 2020, algorithm 1: steps of one length, and a speed limit
        velocity_.mul_(config_.momentum).add_(gradient * (rate / (gradient.norm() + 1e-12)));
        velocity_.mul_((config_.clip_up_max_speed / (velocity_.norm() + 1e-12)).clamp_max(1.0));
        mean_.add_(velocity_);
        return;
      }
    }
  }

  const OpenAiEsConfig config_;
  const float sigma_init_;
  at::Tensor velocity_, square_;  // [P] of the optimizer
  at::Tensor steps_;              // [] Adam's count of steps; steps that were undone do not count
};

}  // namespace

std::unique_ptr<EvolutionStrategy> make_openai_es(const PopulationConfig& population, const OpenAiEsConfig& config,
                                                  const PopulationPlace& place, const at::Tensor& mean,
                                                  const ParallelFor& parallel_for) {
  return std::make_unique<OpenAiEs>(population, config, place, mean, parallel_for);
}

std::unique_ptr<Learner> OpenAiEsAlgorithm::make(const LoadedRun& run, Device device, Ranks* ranks) {
  return make_evolution(run, device, ranks, [](const RunConfig& c, const auto&... rest) {
    return make_openai_es(c.population, c.openai_es, rest...);
  });
}

}  // namespace giga
