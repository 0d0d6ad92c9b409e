// Settings of evolution strategies, and their rows in the list of algorithms.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "config/fields.hpp"
#include "learn/algorithm.hpp"
#include "policy/config.hpp"

namespace giga {

enum class EsNoiseKind : uint8_t { full, low_rank };
constexpr std::array<const char*, 2> enum_names(EsNoiseKind) { return {"full", "low_rank"}; }

enum class FitnessShaping : uint8_t { centered_ranks, z_score, raw };
constexpr std::array<const char*, 3> enum_names(FitnessShaping) { return {"centered_ranks", "z_score", "raw"}; }

enum class MeanOptimizer : uint8_t { adam, momentum, clip_up };
constexpr std::array<const char*, 3> enum_names(MeanOptimizer) { return {"adam", "momentum", "clip_up"}; }

/// What fitness measures.
enum class Objective : uint8_t {
  automatic,  ///< score where the game is won by waypoints, else mean_return
  mean_return,
  win_rate,
  score,
};
constexpr std::array<const char*, 4> enum_names(Objective) { return {"auto", "return", "win_rate", "score"}; }

enum class Turns : uint8_t { together, alternating };
constexpr std::array<const char*, 2> enum_names(Turns) { return {"together", "alternating"}; }

/// How fitness is transformed before a strategy learns from it.
struct ShapingConfig {
  FitnessShaping kind = FitnessShaping::centered_ranks;
  float weight_decay = 0;
};
template <class V>
void visit_fields(V& v, ShapingConfig& c) {
  v("kind", c.kind, "centered_ranks: ranks from -0.5 to 0.5; z_score: mean 0 and deviation 1; raw: unchanged");
  v("weight_decay", c.weight_decay,
    "a member then loses this times the mean square of its parameters; snes and des see only the ranks "
    "that result",
    at_least(0));
}

constexpr int kMostMembers = 1'000'000;

/// A team's population and what it plays.
struct PopulationConfig {
  int population_size = 512;
  float sigma_init = 0.05f;
  bool antithetic = true;
  EsNoiseKind noise = EsNoiseKind::full;
  int noise_rank = 1;
  int episodes_per_member = 16;
  std::optional<int> parallel_episodes = std::nullopt;
  std::optional<int> max_steps = std::nullopt;
  Objective objective = Objective::automatic;
  bool common_random_numbers = true;
  bool greedy = true;
  Turns turns = Turns::together;
  int generations_per_turn = 1;
  ShapingConfig shaping;
  ActorConfig actor;

  /// Worlds of a member, and the episodes that each of them plays.
  int n_worlds() const { return parallel_episodes.value_or(episodes_per_member); }
  int n_rounds() const { return episodes_per_member / n_worlds(); }
};
template <class V>
void visit_fields(V& v, PopulationConfig& c) {
  v("population_size", c.population_size, "members of a team's population", range(2, kMostMembers));
  v.removed("mirror", "members whose games were seen in a mirror won no more", "false");
  v.removed("generations", "a run ends after train.total_agent_steps, whatever its algorithm");
  v("sigma_init", c.sigma_init, "standard deviation of the perturbations at the start", greater_than(0));
  v("antithetic", c.antithetic, "members come in pairs with opposite perturbations; needs an even population_size");
  v("noise", c.noise, "full: a number per parameter; low_rank: A B^T / sqrt(noise_rank) per weight matrix");
  v("noise_rank", c.noise_rank, "noise low_rank: columns of A and B, at most the smaller side of the largest matrix",
    range(1, 16384));
  v("episodes_per_member", c.episodes_per_member, "episodes that each member plays in a generation", range(1, 65536));
  v("parallel_episodes", c.parallel_episodes,
    "how many of these are played at the same time. Each has a world with one opponent, in which episodes "
    "follow each other; must divide episodes_per_member; none = all",
    range(1, 65536));
  v("max_steps", c.max_steps,
    "steps after which a training episode is cut off; nobody then wins by surviving (win.at_time_limit); "
    "none = as the scenario says",
    range(1, 1'000'000));
  v("objective", c.objective,
    "a member's fitness, a mean over its episodes. return: of the team; win_rate: 1 for a win (as the "
    "scenario says), 0.5 for a tie; score: waypoints collected; auto: score where the game is won by waypoints "
    "(win.by), else return");
  v("common_random_numbers", c.common_random_numbers,
    "all members of a team meet the same starts and the same luck: only their parameters differ");
  v("greedy", c.greedy, "policies take their most likely action instead of drawing one, in training and evaluation");
  v("turns", c.turns, "whether both teams evolve in every generation, or take turns");
  v("generations_per_turn", c.generations_per_turn, "turns alternating: generations of one team before the other's",
    range(1, 1'000'000));
  v.group("shaping", c.shaping, "how fitness is transformed");
  v.group("actor", c.actor, "the policy networks");
}

/// OpenAI-ES (Salimans et al. 2017).
struct OpenAiEsConfig {
  MeanOptimizer optimizer = MeanOptimizer::adam;
  float learning_rate = 0.01f;
  float learning_rate_decay = 1.0f;
  float learning_rate_min = 0.001f;
  float momentum = 0.9f;
  float clip_up_max_speed = 0.15f;
  float weight_decay = 0.0f;
  float sigma_decay = 1.0f;
  float sigma_min = 0.01f;
};
template <class V>
void visit_fields(V& v, OpenAiEsConfig& c) {
  v("optimizer", c.optimizer, "what turns the gradient into a step: Adam, momentum, or ClipUp (Toklu et al. 2020)");
  v("learning_rate", c.learning_rate, "step size of the mean", greater_than(0));
  v("learning_rate_decay", c.learning_rate_decay, "factor of the step size per generation", range(0, 1));
  v("learning_rate_min", c.learning_rate_min, "lower limit of the step size", at_least(0));
  v("momentum", c.momentum, "optimizers momentum and clip_up: share of the velocity kept", range(0, 1).below(1));
  v("clip_up_max_speed", c.clip_up_max_speed, "optimizer clip_up: the longest step", greater_than(0));
  v("weight_decay", c.weight_decay, "share of the mean that is subtracted from the gradient", at_least(0));
  v("sigma_decay", c.sigma_decay, "factor of sigma per generation", range(0, 1));
  v("sigma_min", c.sigma_min, "lower limit of sigma", greater_than(0));
}

/// SNES (Wierstra et al. 2014).
struct SnesConfig {
  std::optional<float> learning_rate_mean = 1.0f;
  std::optional<float> learning_rate_sigma = std::nullopt;
};
template <class V>
void visit_fields(V& v, SnesConfig& c) {
  v("learning_rate_mean", c.learning_rate_mean, "step size of the mean; none = (3 + ln d) / (5 sqrt d)",
    greater_than(0));
  v("learning_rate_sigma", c.learning_rate_sigma,
    "step size of the logarithm of sigma; none = (3 + ln d) / (5 sqrt d) for d parameters", greater_than(0));
}

/// Discovered ES (Lange et al. 2023).
struct DesConfig {
  float temperature = 12.5f;
  float learning_rate_mean = 1.0f;
  float learning_rate_sigma = 0.1f;
};
template <class V>
void visit_fields(V& v, DesConfig& c) {
  v("temperature", c.temperature, "steepness of the sigmoid over the ranks", greater_than(0));
  v("learning_rate_mean", c.learning_rate_mean, "how far the mean moves towards the weighted mean", range(0, 1));
  v("learning_rate_sigma", c.learning_rate_sigma, "how far sigma moves towards the weighted deviation", range(0, 1));
}

/// Their groups of a run config.
struct EvolutionSettings {
  PopulationConfig population;
  OpenAiEsConfig openai_es;
  SnesConfig snes;
  DesConfig des;
  static ResumeRules resume_rules();
};
template <class V>
void visit_fields(V& v, EvolutionSettings& c) {
  v.group("population", c.population, "algorithms openai_es, snes and des: each team's population");
  v.group("openai_es", c.openai_es, "algorithm openai_es (Salimans et al. 2017, arXiv 1703.03864)");
  v.group("snes", c.snes, "algorithm snes (Wierstra et al. 2014, JMLR 15)");
  v.group("des", c.des, "algorithm des, Discovered ES (Lange et al. 2023, arXiv 2211.11260)");
}

/// Populations that play at the same time.
int populations_at_a_time(const RunConfig& config);

struct OpenAiEsAlgorithm {
  using Settings = EvolutionSettings;
  static const Algorithm kAlgorithm;
  static std::unique_ptr<Learner> make(const LoadedRun& run, Device device, Ranks* ranks);
};
struct SnesAlgorithm {
  using Settings = EvolutionSettings;
  static const Algorithm kAlgorithm;
  static std::unique_ptr<Learner> make(const LoadedRun& run, Device device, Ranks* ranks);
};
struct DesAlgorithm {
  using Settings = EvolutionSettings;
  static const Algorithm kAlgorithm;
  static std::unique_ptr<Learner> make(const LoadedRun& run, Device device, Ranks* ranks);
};

}  // namespace giga
