// What evolution strategies allow in a config, and when a run goes on.
#include "learn/evolution/config.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "learn/config_check.hpp"
#include "learn/opponents/world_shares.hpp"
#include "math/small_mlp.hpp"
#include "policy/inputs.hpp"
#include "sim/row_layout.hpp"
#include "sim/simulator.hpp"

namespace giga {
namespace {

constexpr ResumeRule kEvolutionMayChange[] = {
    {"population.shaping.", "from here on, as all below"},
    {"population.objective", ""},
    {"population.max_steps", ""},
    {"population.turns", ""},
    {"population.generations_per_turn", ""},
    {"openai_es.", ""},
    {"snes.", ""},
    {"des.", ""},
};
constexpr ResumeRule kEvolutionMayNot[] = {
    {"population.actor.", "the saved parameters fit their networks only"},
    {"openai_es.optimizer", "the checkpoint holds the moments of this optimizer"},
    {"openai_es.sigma_decay", "it counts from the first generation, so that sigma would jump"},
    {"openai_es.learning_rate_decay", "it counts from the first generation, so that the step size would jump"},
    {"population.greedy", "the policies have been learned for the one or the other"},
    {"population.", "the draws of the rest of the run would no longer be those of one run"},
};

constexpr std::string_view kOpenAiEsUnread[] = {"mappo.", "snes.", "des.", "train.n_worlds", "train.desynchronize"};
constexpr std::string_view kSnesUnread[] = {"mappo.", "openai_es.", "des.", "train.n_worlds", "train.desynchronize"};
constexpr std::string_view kDesUnread[] = {"mappo.", "openai_es.", "snes.", "train.n_worlds", "train.desynchronize"};

/// Settings that mean nothing to evolution strategies, where they were changed.
void check_train(ConfigCheck& check) {
  const TrainConfig &a = check.config.train, b;
  check.means_nothing("train.n_worlds", a.n_worlds != b.n_worlds,
                      "worlds are population.population_size x population.episodes_per_member (or parallel_episodes), "
                      "for each team that evolves");
  check.means_nothing("train.desynchronize", a.desynchronize != b.desynchronize,
                      "episodes of a generation start together");
  check.means_nothing("opponents.pool_promotion", check.config.opponents.pool_promotion != PoolPromotion::always,
                      "past means join the pool at each turn");
  check.means_nothing("opponents.policies", !check.config.opponents.policies.empty(),
                      "populations meet past means and scripts");
}

/// The fused kernel must have room for the networks.
void check_fp16(ConfigCheck& check) {
  const ActorConfig& actor = check.config.population.actor;
  if (!check.wants_fp16()) return;
  if (check.known({"population.actor.memory"}) && actor.remembers())
    check.refuse_fp16(cat("is computed by one kernel, which knows no memory, and population.actor.memory is ",
                          FieldCodec<MemoryKind>::print(actor.memory)));
  if (check.known({"population.actor.layer_norm"}) && actor.layer_norm)
    check.refuse_fp16("has no layer normalisation, and population.actor.layer_norm is true");
  if (check.known({"population.actor.hidden"}) && !SmallMlp::has_room_for(actor.hidden))
    check.refuse_fp16(cat("takes at most ", SmallMlp::kMaxLayers - 1, " hidden layers of at most ", SmallMlp::kMaxWidth,
                          ", and population.actor.hidden is ", FieldCodec<std::vector<int>>::print(actor.hidden)));
}

void check_population(ConfigCheck& check) {
  const PopulationConfig& p = check.config.population;
  if (check.known({"population.population_size", "population.antithetic"}) && p.antithetic &&
      p.population_size % 2 != 0)
    check.fail("population.population_size",
               cat(p.population_size, " is odd, and with antithetic: true members come in pairs; nearest: ",
                   p.population_size - 1, ", ", p.population_size + 1));
  if (!check.known({"population.episodes_per_member", "population.parallel_episodes"})) return;
  if (p.parallel_episodes && p.episodes_per_member % *p.parallel_episodes != 0)
    return check.fail(
        "population.parallel_episodes",
        cat(*p.parallel_episodes, " does not divide population.episodes_per_member ", p.episodes_per_member));
  const int at_a_time = populations_at_a_time(check.config);
  if (check.known({"population.population_size"}) &&
      at_a_time * static_cast<int64_t>(p.population_size) * p.n_worlds() > kMostWorlds)
    check.fail(
        "population.population_size",
        cat(p.population_size, " x population.", p.parallel_episodes ? "parallel_episodes " : "episodes_per_member ",
            p.n_worlds(), at_a_time > 1 ? " for two teams" : "", " are more than ", kMostWorlds, " worlds"));
}

/// Shares of a member's episodes, of which there are few, that come to none or leave none for the other team.
void check_shares(ConfigCheck& check) {
  const OpponentsConfig& o = check.config.opponents;
  const PopulationConfig& p = check.config.population;
  if (check.has_begun || !check.config.train.opponent.is_self_play()) return;
  if (!check.known({"population.episodes_per_member", "population.parallel_episodes", "opponents.scripted",
                    "opponents.scripted_share", "opponents.pool_size", "opponents.pool_share"}))
    return;
  const int64_t all = p.n_worlds();
  const auto [scripted, pooled] = episode_shares(o, all, o.pool_size > 0);
  const float script_share = o.scripted.empty() ? 0 : o.scripted_share, pool_share = o.pool_size > 0 ? o.pool_share : 0;
  const std::string of_all = cat(" of the ", counted(all, "episodes"), " that a member plays at a time (population.",
                                 p.parallel_episodes ? "parallel_episodes" : "episodes_per_member", ")");
  if (script_share > 0 && scripted == 0)
    check.fail("opponents.scripted_share", cat(script_share, of_all, " is none"));
  else if (pool_share > 0 && pooled == 0)
    check.fail("opponents.pool_share", cat(pool_share, of_all, " is none", scripted == all ? " beside scripts" : ""));
  else if (scripted + pooled == all && script_share + pool_share < 1)
    check.fail(
        pool_share > 0 ? "opponents.pool_share" : "opponents.scripted_share",
        cat("scripts take ", scripted, " and the pool ", pooled, of_all, ", and the other team as it is now none"));
}

void check_objective(ConfigCheck& check) {
  if (check.has_begun || !check.spec || !check.known({"population.objective"})) return;
  if (check.config.population.objective == Objective::score && !check.spec->params.waypoints)
    check.fail("population.objective",
               "'score' counts waypoints, and this scenario has none; allowed here: auto, return, win_rate");
}

void check_noise_rank(ConfigCheck& check) {
  const PopulationConfig& p = check.config.population;
  if (!check.spec || p.noise != EsNoiseKind::low_rank) return;
  if (!check.known({"population.noise_rank", "population.actor.hidden", "population.actor.inputs",
                    "population.actor.memory", "population.actor.memory_size"}))
    return;
  if (p.actor.inputs == NetworkInputs::egocentric && !check.spec->params.egocentric_view) return;
  if (p.actor.reads_image() || check.spec->params.images_only) return;
  auto input = static_cast<int>(input_columns(p.actor.inputs, *check.spec).size), most = 0;
  for (const int size : p.actor.hidden) {
    most = std::max(most, std::min(input, size));
    input = size;
  }
  if (p.actor.remembers()) {
    // A cell's two matrices hold all its gates, one below the other: [gates x memory_size, features], and the same of
    // what it remembers.
    const int rows = (p.actor.memory == MemoryKind::gru ? 3 : 4) * p.actor.memory_size;
    most = std::max({most, std::min(rows, input), p.actor.memory_size});
  }
  if (p.noise_rank > most)
    check.fail("population.noise_rank",
               cat(p.noise_rank, " is more than the smaller side of any weight matrix; at most ", most,
                   " for population.actor.hidden"));
}

void check_evolution(ConfigCheck& check) {
  const ActorConfig& actor = check.config.population.actor;
  if (actor.reads_image() && check.known({"population.actor.encoder"}))
    check.fail("population.actor.encoder",
               cat("'", FieldCodec<EncoderKind>::print(actor.encoder),
                   "' is not offered to populations, whose networks read numbers; allowed there: mlp; train.algorithm "
                   "mappo has it"));
  check.inputs_are_there("population.actor", actor);
  check.log_std_fits("population.actor", actor);
  check_train(check);
  check_fp16(check);
  check_population(check);
  check_shares(check);
  check_objective(check);
  check_noise_rank(check);
}

RunSize population_size(const RunConfig& c) {
  const int64_t most = kMostWorlds / (populations_at_a_time(c) * static_cast<int64_t>(c.population.n_worlds()));
  return {"population.population_size",    "member", c.population.population_size,
          c.population.antithetic ? 2 : 1, 2,        std::min<int64_t>(most, kMostMembers)};
}

/// Each rank plays as many members.
void expect_members_divide(const RunConfig& c, int n) {
  const PopulationConfig& p = c.population;
  if (p.population_size % n != 0) {
    const int step = p.antithetic && n % 2 != 0 ? 2 * n : n, below = p.population_size / step * step;
    throw InputError(cat("population.population_size: ", p.population_size, " members cannot be divided among ", n,
                         " ranks; nearest: ", below > 0 ? cat(below, ", ") : "", below + step));
  }
  if (!p.common_random_numbers && populations_at_a_time(c) > 1)
    throw InputError(
        "population.common_random_numbers: false takes one rank, or population.turns: alternating: the worlds of the "
        "second population have no numbers in a row");
}

/// The state of the worlds, and their observations.
int64_t evolution_least_bytes(const LoadedRun& run) {
  const PopulationConfig& p = run.config.population;
  const int64_t n_worlds = static_cast<int64_t>(populations_at_a_time(run.config)) * p.population_size * p.n_worlds();
  const auto observation = static_cast<int64_t>(sizeof(float)) * observation_rows(run.spec).stride();
  return static_cast<int64_t>(state_bytes({run.spec, {.pairs = run.config.train.pairs}}, n_worlds)) +
         n_worlds * run.spec.params.n_agents * observation;
}

/// The row of a strategy.
constexpr Algorithm evolution_strategy(const char* name, const char* about, std::span<const std::string_view> unread) {
  return {
      .name = name,
      .about = about,
      .figures =
          "over the members of a team's population: fitness_mean, fitness_best,\n"
          "fitness_deviation, not_finite (members); of what is searched: sigma,\n"
          "parameter_norm, step_norm",
      .updates = "generations",
      .has_populations = true,
      .unread = unread,
      .charts = {},
      .policy =
          [](const RunConfig& c) {
            return PolicySettings{c.population.actor, c.population.greedy, false};
          },
      .agent_steps_per_update = nullptr,
      .check = check_evolution,
      .expect_divides = expect_members_divide,
      .size = population_size,
      .set_size = [](RunConfig& c, int64_t size) { c.population.population_size = static_cast<int>(size); },
      .shorten = [](RunConfig& c) { c.population.max_steps = 1; },
      .least_bytes = evolution_least_bytes,
  };
}

}  // namespace

int populations_at_a_time(const RunConfig& c) {
  return c.train.opponent.is_self_play() && c.population.turns == Turns::together ? 2 : 1;
}

ResumeRules EvolutionSettings::resume_rules() { return {kEvolutionMayChange, kEvolutionMayNot}; }

const Algorithm OpenAiEsAlgorithm::kAlgorithm = evolution_strategy(
    "openai_es", "evolution by OpenAI-ES: the gradient of the mean fitness, and an optimizer", kOpenAiEsUnread);
const Algorithm SnesAlgorithm::kAlgorithm =
    evolution_strategy("snes", "evolution by SNES: a natural gradient of mean and deviations", kSnesUnread);
const Algorithm DesAlgorithm::kAlgorithm =
    evolution_strategy("des", "evolution by Discovered ES: weights by rank that meta-learning found", kDesUnread);

}  // namespace giga
