#include "apps/idle_settings.hpp"

#include <algorithm>
#include <iostream>
#include <string_view>

#include "core/error.hpp"
#include "learn/registry.hpp"

namespace giga {
namespace {

struct Switched {
  std::string_view key;
  const char* unless;  ///< what switches it on
  bool (*is_on)(const RunConfig&, const SimSpec&);
};

bool shaping_fades(const RunConfig& c, const SimSpec&) {
  return c.mappo.shaping_final_factor != 1 || c.mappo.shaping_final_factors.any();
}

constexpr Switched kSwitched[] = {
    {"mappo.final_learning_rate_factor", "mappo.schedule is linear or cosine",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.schedule != Schedule::constant; }},
    {"mappo.value_clip_coef", "mappo.value_loss is clipped",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.value_loss == ValueLossKind::clipped; }},
    {"mappo.huber_delta", "mappo.value_loss is huber",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.value_loss == ValueLossKind::huber; }},
    {"mappo.value_norm_beta", "mappo.value_norm is true",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.value_norm; }},
    {"mappo.entropy_rate", "mappo.entropy_target is set",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.entropy_target.has_value(); }},
    {"mappo.actor.memory_size", "mappo.actor.memory is gru or lstm",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.actor.remembers(); }},
    {"mappo.critic.memory_size", "mappo.critic.memory is gru or lstm",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.critic.remembers(); }},
    {"mappo.critic.inputs", "mappo.critic.kind is composed or independent",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.critic.kind != CriticKind::state; }},
    {"mappo.actor.impala_width", "mappo.actor.encoder is impala",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.actor.encoder == EncoderKind::impala; }},
    {"mappo.critic.impala_width", "mappo.critic.encoder is impala",
     [](const RunConfig& c, const SimSpec&) { return c.mappo.critic.encoder == EncoderKind::impala; }},
    {"population.actor.memory_size", "population.actor.memory is gru or lstm",
     [](const RunConfig& c, const SimSpec&) { return c.population.actor.remembers(); }},
    {"population.noise_rank", "population.noise is low_rank",
     [](const RunConfig& c, const SimSpec&) { return c.population.noise == EsNoiseKind::low_rank; }},
    {"population.generations_per_turn", "population.turns is alternating",
     [](const RunConfig& c, const SimSpec&) { return c.population.turns == Turns::alternating; }},
    {"openai_es.momentum", "openai_es.optimizer is momentum or clip_up",
     [](const RunConfig& c, const SimSpec&) { return c.openai_es.optimizer != MeanOptimizer::adam; }},
    {"openai_es.clip_up_max_speed", "openai_es.optimizer is clip_up",
     [](const RunConfig& c, const SimSpec&) { return c.openai_es.optimizer == MeanOptimizer::clip_up; }},
    {"openai_es.learning_rate_min", "openai_es.learning_rate_decay is below 1",
     [](const RunConfig& c, const SimSpec&) { return c.openai_es.learning_rate_decay < 1; }},
    {"openai_es.sigma_min", "openai_es.sigma_decay is below 1",
     [](const RunConfig& c, const SimSpec&) { return c.openai_es.sigma_decay < 1; }},
    {"population.shaping.kind", "train.algorithm is openai_es, or population.shaping.weight_decay is above 0",
     [](const RunConfig& c, const SimSpec&) {
       const ShapingConfig& shaping = c.population.shaping;
       return c.train.algorithm == "openai_es" || shaping.weight_decay > 0;
     }},
    {"mappo.shaping_fade_start", "mappo.shaping_final_factor or one of shaping_final_factors is not 1", shaping_fades},
    {"mappo.shaping_fade_end", "mappo.shaping_final_factor or one of shaping_final_factors is not 1", shaping_fades},
    {"mappo.mirror", "both teams learn, or one against a script",
     [](const RunConfig& c, const SimSpec&) { return !c.train.opponent.is_path(); }},
    {"mappo.one_policy", "both teams learn and have the same agents, and none wins at the time limit",
     [](const RunConfig& c, const SimSpec& spec) { return !c.mappo.one_policy || has_one_policy(c, spec); }},
    {"opponents.pool_hardness", "opponents.pool_draw is pfsp",
     [](const RunConfig& c, const SimSpec&) { return c.opponents.pool_draw == PoolDraw::pfsp; }},
    {"opponents.pool_draw", "opponents.pool_size is above 0",
     [](const RunConfig& c, const SimSpec&) { return c.opponents.pool_size > 0; }},
    {"opponents.pool_promotion", "opponents.pool_size is above 0",
     [](const RunConfig& c, const SimSpec&) { return c.opponents.pool_size > 0; }},
    {"opponents.scripted", "opponents.scripted_share is above 0",
     [](const RunConfig& c, const SimSpec&) { return c.opponents.scripted_share > 0; }},
    {"opponents.pool_share", "opponents.pool_size is above 0",
     [](const RunConfig& c, const SimSpec&) { return c.opponents.pool_size > 0; }},
};

/// Why a setting does nothing, as "with train.algorithm snes" or "unless mappo.value_loss is huber"; empty: no reason
/// is known.
std::string why_idle(const LoadedRun& run, std::string_view key) {
  const RunConfig& config = run.config;
  if (!reads_setting(config.train.algorithm, key)) return cat("with train.algorithm ", config.train.algorithm);
  const auto found =
      std::find_if(std::begin(kSwitched), std::end(kSwitched), [key](const Switched& s) { return s.key == key; });
  return found == std::end(kSwitched) || found->is_on(config, run.spec) ? "" : cat("unless ", found->unless);
}

}  // namespace

void warn_of_idle(const std::vector<std::string>& overrides, const LoadedRun& run) {
  for (const std::string& assignment : overrides) {
    const std::string key = assignment.substr(0, assignment.find('='));
    if (const std::string why = why_idle(run, key); !why.empty())
      std::cerr << "warning: --set " << key << ": this means nothing " << why << '\n';
  }
}

}  // namespace giga
