// Settings of evolution strategies.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "config/fields.hpp"

namespace giga {

enum class EsNoiseKind : uint8_t { full, low_rank };
constexpr std::array<const char*, 2> enum_names(EsNoiseKind) { return {"full", "low_rank"}; }

enum class FitnessShaping : uint8_t { centered_ranks, z_score, raw };
constexpr std::array<const char*, 3> enum_names(FitnessShaping) { return {"centered_ranks", "z_score", "raw"}; }

enum class MeanOptimizer : uint8_t { adam, momentum, clip_up };
constexpr std::array<const char*, 3> enum_names(MeanOptimizer) { return {"adam", "momentum", "clip_up"}; }

/// What all strategies have.
struct PopulationConfig {
  int population_size = 512;
  float sigma_init = 0.1f;
  bool antithetic = true;
  EsNoiseKind noise = EsNoiseKind::full;
  int noise_rank = 1;
};
template <class V>
void visit_population_fields(V& v, PopulationConfig& c) {
  v("population_size", c.population_size, "members of a team's population", range(2, 1'000'000));
  v("sigma_init", c.sigma_init, "standard deviation of the perturbations at the start", greater_than(0));
  v("antithetic", c.antithetic, "members come in pairs with opposite perturbations; needs an even population_size");
  v("noise", c.noise, "full: a number for each parameter; low_rank: A B^T / sqrt(noise_rank) for each weight matrix");
  v("noise_rank", c.noise_rank, "noise low_rank: columns of A and B", range(1, 64));
}

struct OpenAiEsConfig : PopulationConfig {
  FitnessShaping shaping = FitnessShaping::centered_ranks;
  float weight_decay = 0.005f;
  MeanOptimizer optimizer = MeanOptimizer::adam;
  float learning_rate = 0.01f;
  float learning_rate_decay = 1.0f;
  float learning_rate_min = 0.001f;
  float momentum = 0.9f;
  float clip_up_max_speed = 0.15f;
  float sigma_decay = 1.0f;
  float sigma_min = 0.01f;
};
template <class V>
void visit_fields(V& v, OpenAiEsConfig& c) {
  visit_population_fields(v, c);
  v("shaping", c.shaping, "what is made of the fitness: ranks from -0.5 to 0.5, mean 0 and deviation 1, or as it is");
  v("weight_decay", c.weight_decay, "share of the mean that the gradient takes away", at_least(0));
  v("optimizer", c.optimizer, "what the gradient is handed to: Adam, momentum, or ClipUp (Toklu et al. 2020)");
  v("learning_rate", c.learning_rate, "step size of the mean", greater_than(0));
  v("learning_rate_decay", c.learning_rate_decay, "factor of the step size per generation", range(0, 1));
  v("learning_rate_min", c.learning_rate_min, "and its lower limit", at_least(0));
  v("momentum", c.momentum, "optimizers momentum and clip_up: share of the velocity kept", range(0, 1).below(1));
  v("clip_up_max_speed", c.clip_up_max_speed, "optimizer clip_up: the longest step", greater_than(0));
  v("sigma_decay", c.sigma_decay, "factor of sigma per generation", range(0, 1));
  v("sigma_min", c.sigma_min, "and its lower limit", greater_than(0));
}

struct SnesConfig : PopulationConfig {
  SnesConfig() { antithetic = false; }
  std::optional<float> learning_rate_mean = 1.0f;
  std::optional<float> learning_rate_sigma = std::nullopt;
};
template <class V>
void visit_fields(V& v, SnesConfig& c) {
  visit_population_fields(v, c);
  v("learning_rate_mean", c.learning_rate_mean, "step size of the mean; none = (3 + ln d) / (5 sqrt d)",
    greater_than(0));
  v("learning_rate_sigma", c.learning_rate_sigma,
    "step size of the logarithm of sigma; none = (3 + ln d) / (5 sqrt d) for d parameters", greater_than(0));
}

struct DesConfig : PopulationConfig {
  DesConfig() { antithetic = false; }
  float temperature = 12.5f;
  float learning_rate_mean = 1.0f;
  float learning_rate_sigma = 0.1f;
};
template <class V>
void visit_fields(V& v, DesConfig& c) {
  visit_population_fields(v, c);
  v("temperature", c.temperature, "steepness of the sigmoid over the ranks", greater_than(0));
  v("learning_rate_mean", c.learning_rate_mean, "how far the mean moves towards the weighted mean", range(0, 1));
  v("learning_rate_sigma", c.learning_rate_sigma, "how far sigma moves towards the weighted deviation", range(0, 1));
}

}  // namespace giga
