// Settings of MAPPO, self-play proximal policy optimisation with a centralized critic per team (Yu et al. 2022, arXiv
// 2103.01955), and its row in the list of algorithms.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "config/fields.hpp"
#include "learn/algorithm.hpp"
#include "policy/config.hpp"
#include "sim/spec.hpp"

namespace giga {

enum class Schedule : uint8_t { constant, linear, cosine };
constexpr std::array<const char*, 3> enum_names(Schedule) { return {"constant", "linear", "cosine"}; }

enum class AdvantageNorm : uint8_t { none, minibatch, batch };
constexpr std::array<const char*, 3> enum_names(AdvantageNorm) { return {"none", "minibatch", "batch"}; }

enum class ValueLossKind : uint8_t { squared, clipped, huber };
constexpr std::array<const char*, 3> enum_names(ValueLossKind) { return {"squared", "clipped", "huber"}; }

/// mappo.shaping_final_factors, by RewardTerm; that of game_won is unused, it does not fade.
struct ShapingFactors {
  std::array<std::optional<float>, kNRewardTerms> of_term;

  const std::optional<float>& operator[](RewardTerm term) const { return of_term[static_cast<size_t>(term)]; }
  /// Whether a reward has one of its own.
  bool any() const;
};
template <class V>
void visit_fields(V& v, ShapingFactors& c) {
  for (size_t t = 0; t < kNRewardTerms; ++t) {
    const std::string name = kRewardTermNames[t];
    const RewardTerm term = static_cast<RewardTerm>(t);
    if (term != RewardTerm::game_won)
      v(name, c.of_term[t], term == RewardTerm::idle_reward ? "of agent types with idle_reward" : "of rewards." + name,
        range(0, 1));
  }
}

struct MappoConfig {
  int horizon = 16;
  int n_epochs = 4;
  int n_minibatches = 8;
  int shards = 1;
  float learning_rate = 1e-3f;
  float critic_learning_rate = 1e-3f;
  Schedule schedule = Schedule::linear;
  float final_learning_rate_factor = 0.0f;
  float gamma = 0.99f;
  std::optional<float> final_gamma = std::nullopt;
  float gae_lambda = 0.95f;
  float clip_coef = 0.2f;
  std::optional<float> final_clip_coef = std::nullopt;
  float entropy_coef = 0.003f;
  std::optional<float> final_entropy_coef = std::nullopt;
  std::optional<float> entropy_target = std::nullopt;
  float entropy_rate = 0.02f;
  float value_coef = 0.5f;
  ValueLossKind value_loss = ValueLossKind::squared;
  float value_clip_coef = 0.2f;
  float huber_delta = 10.0f;
  float view_coef = 0.0f;
  float max_grad_norm = 0.5f;
  AdvantageNorm advantage_norm = AdvantageNorm::minibatch;
  std::optional<float> target_kl = std::nullopt;
  float adam_epsilon = 1e-5f;
  bool value_norm = true;
  float value_norm_beta = 0.99f;
  bool obs_norm = false;
  bool mirror = false;
  bool one_policy = false;
  float team_reward_share = 0.0f;
  float shaping_final_factor = 1.0f;
  ShapingFactors shaping_final_factors = {};
  float shaping_fade_start = 0.0f;
  float shaping_fade_end = 1.0f;
  std::array<float, 2> team_learning_rate_factors = {1.0f, 1.0f};
  std::optional<float> freeze_lead = std::nullopt;
  std::optional<float> step_back = std::nullopt;
  bool fused = true;
  bool graphs = true;
  ActorConfig actor;
  CriticConfig critic;
};
template <class V>
void visit_fields(V& v, MappoConfig& c) {
  v("horizon", c.horizon, "steps of a rollout; at most the scenario's max_episode_length", range(1, 65536));
  v("n_epochs", c.n_epochs, "passes over a rollout per update", range(1, 1000));
  v("n_minibatches", c.n_minibatches,
    "minibatches per epoch; must divide n_worlds x horizon, with memory n_worlds, in each shard", range(1, 1'000'000));
  v("shards", c.shards,
    "parts of the worlds that are shuffled into minibatches each by itself, and have each their share of opponents, so "
    "that several ranks can take them (states that opponents leave over there are left out, others in each epoch); a "
    "multiple of the number of ranks; 1: one for each rank that begins a run. The result depends on it, and not on the "
    "ranks but for rounding",
    range(1, 65536));
  v("learning_rate", c.learning_rate, "Adam step size of the actors", greater_than(0));
  v("critic_learning_rate", c.critic_learning_rate, "Adam step size of the critics", greater_than(0));
  v("schedule", c.schedule, "how both step sizes change over the run");
  v("final_learning_rate_factor", c.final_learning_rate_factor, "share of the step sizes left at the end", range(0, 1));
  v("gamma", c.gamma, "discount of one step", range(0, 1));
  v("final_gamma", c.final_gamma, "what gamma is at the end of the run, evenly from update to update; none = it stays",
    range(0, 1));
  v("gae_lambda", c.gae_lambda, "decay of generalised advantage estimation", range(0, 1));
  v("clip_coef", c.clip_coef, "how far the probability ratio may move from 1", greater_than(0));
  v("final_clip_coef", c.final_clip_coef, "clip_coef at the end of the run, likewise", greater_than(0));
  v("entropy_coef", c.entropy_coef, "weight of the entropy bonus", at_least(0));
  v("final_entropy_coef", c.final_entropy_coef, "entropy_coef at the end of the run, likewise", at_least(0));
  v("entropy_target", c.entropy_target,
    "entropy that a policy is held at (nats; 27 actions at random have 3.30, continuous ones 2.08): the weight of the "
    "bonus begins at "
    "entropy_coef, falls while the entropy is above and grows while it is below, from a hundredth to ten times "
    "entropy_coef; none = the weight stays",
    at_least(0));
  v("entropy_rate", c.entropy_rate,
    "entropy_target: the share by which an update changes the weight, for each nat that is missing", greater_than(0));
  v("value_coef", c.value_coef, "weight of the value loss", at_least(0));
  v("value_loss", c.value_loss, "squared error, squared error clipped around the old value, or Huber");
  v("value_clip_coef", c.value_clip_coef, "value_loss clipped: how far a value may move, in normalised units",
    greater_than(0));
  v("huber_delta", c.huber_delta, "value_loss huber: where the loss becomes linear, in normalised units",
    greater_than(0));
  v("view_coef", c.view_coef,
    "weight of an auxiliary loss, by which an actor's encoder of images learns to tell the egocentric view "
    "(observation.egocentric_view): the mean squared error of its numbers, as a linear layer reads them from the "
    "features (after Lample and Chaplot 2017). Training alone looks at them: what plays sees the image",
    at_least(0));
  v("max_grad_norm", c.max_grad_norm, "gradients are scaled down to this norm, per network; 0 = never", at_least(0));
  v("advantage_norm", c.advantage_norm,
    "over what advantages are brought to mean 0 and deviation 1; none = they are not");
  v("target_kl", c.target_kl,
    "once approx_kl, asked before each step, passes this, a team takes no other step in the update", at_least(0));
  v("adam_epsilon", c.adam_epsilon, "Adam's epsilon", greater_than(0));
  v("value_norm", c.value_norm, "critics predict returns normalised by running moments");
  v("value_norm_beta", c.value_norm_beta, "share of the old moments that an update keeps", range(0, 1).below(1));
  v("obs_norm", c.obs_norm, "normalise observations by running moments");
  v("mirror", c.mirror,
    "in half of the worlds of a team its networks see the game in a mirror, with left and right exchanged, and turn "
    "accordingly: what is learned on one side is known on the other. In training alone. Networks read the egocentric "
    "view then and nothing else (critics may read the state); a policy as train.opponent is not mirrored, nor is the "
    "team that learns against it (those of opponents.policies are, as all in the pool)");
  v("one_policy", c.one_policy,
    "in self-play of teams with the same agents, of which none wins at the time limit, both play by one policy, which "
    "learns from what either of them meets; each has a critic of its own. Elsewhere it changes nothing");
  v("team_reward_share", c.team_reward_share,
    "share of the team's mean reward in that of each agent. With it an agent that dies leaves behind what its living "
    "team mates expect, so that a sacrifice can pay",
    range(0, 1));
  v("shaping_final_factor", c.shaping_final_factor,
    "what is left at last of all rewards but game_won; 1 = they do not fade", range(0, 1));
  v.group("shaping_final_factors", c.shaping_final_factors,
          "what is left at last of single rewards, in the same time; none = shaping_final_factor");
  v("shaping_fade_start", c.shaping_fade_start, "share of the run after which they begin to fade", range(0, 1));
  v("shaping_fade_end", c.shaping_fade_end, "share of the run after which they fade no more", range(0, 1));
  v("team_learning_rate_factors", c.team_learning_rate_factors, "of both step sizes, for team 0 and team 1",
    at_least(0));
  v("freeze_lead", c.freeze_lead,
    "while a team wins more games than the other by this share of all (self-play, mean of about ten updates), its "
    "policy rests; none = never",
    range(0, 1));
  v("step_back", c.step_back,
    "a team whose share of wins against opponents.scripted falls below its best by this much more than luck explains "
    "(two standard deviations) becomes again what it was when that began; counted in training, over "
    "opponents.pool_every_updates updates and at least 400 games; none = never",
    greater_than(0).at_most(1));
  v("fused", c.fused,
    "learn by fused kernels where these serve the networks (docs/architecture.md says which), on a GPU act by them "
    "too; false: always by LibTorch");
  v("graphs", c.graphs,
    "where LibTorch learns on one GPU: queue a minibatch as one CUDA graph, recorded in the second update, and not "
    "kernel by kernel. The result is the same");
  v.group("actor", c.actor, "the policy networks");
  v.group("critic", c.critic, "the value networks");
}

/// Steps that stay together in a minibatch: with memory the rollout.
inline int64_t steps_together(const MappoConfig& c) {
  return c.actor.remembers() || c.critic.remembers() ? c.horizon : 1;
}

/// Its group of a run config.
struct MappoSettings {
  MappoConfig mappo;
  static ResumeRules resume_rules();
};
template <class V>
void visit_fields(V& v, MappoSettings& c) {
  v.group("mappo", c.mappo, "algorithm mappo (Yu et al. 2022, arXiv 2103.01955)");
}

/// Agent-steps of an update in a scenario with `n_agents` agents.
int64_t agent_steps_per_update(const RunConfig& config, int n_agents);

/// Whether both teams play by one policy: mappo.one_policy, in a game where that is so.
bool has_one_policy(const RunConfig& config, const SimSpec& spec);

struct MappoAlgorithm {
  using Settings = MappoSettings;
  static const Algorithm kAlgorithm;
  static std::unique_ptr<Learner> make(const LoadedRun& run, Device device, Ranks* ranks);
};

}  // namespace giga
