// Reading of run configs: the file, the scenario that it names, and what must hold between them.
#include "learn/run_config.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "learn/opponents/world_shares.hpp"
#include "math/small_mlp.hpp"
#include "policy/inputs.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace {

/// Mistakes that show only in the combination of keys and with the scenario.
class CombinationCheck {
 public:
  CombinationCheck(const RunConfig& config, const KeyPositions& given, Errors& errors)
      : c_(config), given_(given), errors_(errors) {}

  void device() {
    const std::string& name = c_.device;
    const std::string number = name.starts_with("cuda:") ? name.substr(5) : "x";
    const bool numbered =
        !number.empty() && number.size() <= 3 && number.find_first_not_of("0123456789") == std::string::npos;
    if (name != "auto" && name != "cpu" && name != "cuda" && !numbered)
      fail("device", cat("'", name, "' is not auto, cpu, cuda or cuda:<number of the GPU>"));
  }

  /// Settings that mean nothing to the algorithm, where they were changed.
  void belongs_to_algorithm() {
    if (!is_evolution(c_.train)) return;
    const RunConfig defaults;
    const TrainConfig &a = c_.train, &b = defaults.train;
    const std::string& name = c_.train.algorithm;
    not_for(name, "train.total_agent_steps", a.total_agent_steps != b.total_agent_steps,
            "a run ends after population.generations");
    not_for(name, "train.n_worlds", a.n_worlds != b.n_worlds,
            "worlds are population.population_size x population.episodes_per_member (or parallel_episodes), for each "
            "team that evolves");
    not_for(name, "train.desynchronize", a.desynchronize != b.desynchronize, "episodes of a generation start together");
  }

  /// fp16 is for populations, whose games the fused kernel plays: it must have room for their networks.
  void precision_fits() {
    if (c_.train.precision != Precision::fp16 || !known({"train.precision", "train.algorithm"})) return;
    const auto refuse = [this](const std::string& reason) {
      fail("train.precision", cat("fp16 ", reason, "; allowed there: fp32, tf32, bf16"));
    };
    if (!is_evolution(c_.train))
      return refuse("is for the populations of openai_es, snes and des, and train.algorithm is " + c_.train.algorithm);
    const ActorConfig& actor = c_.population.actor;
    if (known({"population.actor.layer_norm"}) && actor.layer_norm)
      refuse("has no layer normalisation, and population.actor.layer_norm is true");
    if (known({"population.actor.hidden"}) && !SmallMlp::has_room_for(actor.hidden))
      refuse(cat("takes at most ", SmallMlp::kMaxLayers - 1, " hidden layers of at most ", SmallMlp::kMaxWidth,
                 ", and population.actor.hidden is ", FieldCodec<std::vector<int>>::print(actor.hidden)));
  }

  void opponents_fit() {
    const OpponentsConfig& p = c_.opponents;
    if (c_.train.opponent != Opponent::self_play && known({"train.opponent"})) {
      const std::string instead = "the other team plays that script everywhere; self_play makes both learn";
      const std::string opponent = enum_names(Opponent{})[static_cast<size_t>(c_.train.opponent)];
      const auto refuse = [&](const char* key, bool given) {
        if (given && known({key})) fail(key, cat("this means nothing with train.opponent ", opponent, ": ", instead));
      };
      refuse("opponents.pool_size", p.pool_size > 0);
      refuse("opponents.scripted_share", p.scripted_share > 0);
      return;
    }
    if (known({"opponents.pool_size", "opponents.pool_share", "opponents.scripted_share"}) && p.pool_size > 0 &&
        p.pool_share + p.scripted_share > 1) {
      fail("opponents.pool_share",
           cat(p.pool_share, " and opponents.scripted_share ", p.scripted_share, " are more than 1 together"));
      return;
    }
    if (!is_evolution(c_.train)) worlds_suffice();
  }

  void population_fits() {
    const PopulationConfig& p = c_.population;
    if (!is_evolution(c_.train)) return;
    if (known({"population.population_size", "population.antithetic"}) && p.antithetic && p.population_size % 2 != 0)
      fail("population.population_size", cat(p.population_size, " is odd, and with antithetic: true members come in ",
                                             "pairs; nearest: ", p.population_size - 1, ", ", p.population_size + 1));
    if (known({"opponents.pool_size", "population.generations"}) && c_.opponents.pool_size > p.generations)
      fail("opponents.pool_size", cat(c_.opponents.pool_size, " past means can never be there in a run of ",
                                      p.generations, " generations (population.generations)"));
    if (!known({"population.episodes_per_member", "population.parallel_episodes"})) return;
    if (p.parallel_episodes && p.episodes_per_member % *p.parallel_episodes != 0)
      return fail("population.parallel_episodes",
                  cat(*p.parallel_episodes, " does not divide population.episodes_per_member ", p.episodes_per_member));
    if (known({"population.population_size"}) &&
        2 * static_cast<int64_t>(p.population_size) * p.n_worlds() > kMostWorlds)
      fail("population.population_size",
           cat(p.population_size, " x population.", p.parallel_episodes ? "parallel_episodes " : "episodes_per_member ",
               p.n_worlds(), " for two teams are more than ", kMostWorlds, " worlds"));
  }

  void noise_rank_fits(const SimSpec& spec) {
    const PopulationConfig& p = c_.population;
    if (!is_evolution(c_.train) || p.noise != EsNoiseKind::low_rank) return;
    if (!known({"population.noise_rank", "population.actor.hidden", "population.actor.inputs"})) return;
    auto input = static_cast<int>(input_columns(p.actor.inputs, spec).size), most = 0;
    for (const int size : p.actor.hidden) {
      most = std::max(most, std::min(input, size));
      input = size;
    }
    if (p.noise_rank > most)
      fail("population.noise_rank", cat(p.noise_rank, " is more than the smaller side of any weight matrix; at most ",
                                        most, " for population.actor.hidden"));
  }

  void inputs_are_there(const SimSpec& spec) {
    if (spec.params.body_view) return;
    const auto check = [this](const char* key, NetworkInputs inputs) {
      if (inputs == NetworkInputs::body && known({key}))
        fail(key, "'body' needs environment.observation.body_view: true; allowed without it: all");
    };
    check("mappo.actor.inputs", c_.mappo.actor.inputs);
    check("mappo.critic.inputs", c_.mappo.critic.inputs);
    check("population.actor.inputs", c_.population.actor.inputs);
  }

  void minibatches_divide() {
    if (is_evolution(c_.train)) return;
    if (!known({"train.n_worlds", "mappo.horizon", "mappo.n_minibatches"})) return;
    const int64_t states = static_cast<int64_t>(c_.train.n_worlds) * c_.mappo.horizon;
    if (states % c_.mappo.n_minibatches == 0) return;
    // The divisors around it, which are what is allowed.
    int64_t below = std::min<int64_t>(c_.mappo.n_minibatches, states), above = below;
    while (states % below != 0) --below;
    while (above <= states && states % above != 0) ++above;
    const std::string nearest =
        above > c_.mappo.n_minibatches && above <= states ? cat(below, ", ", above) : cat(below);
    fail("mappo.n_minibatches", cat(c_.mappo.n_minibatches, " does not divide train.n_worlds x mappo.horizon = ",
                                    c_.train.n_worlds, " x ", c_.mappo.horizon, " = ", states, "; nearest: ", nearest));
  }

  void horizon_fits(const Scenario& scenario) {
    if (is_evolution(c_.train)) return;
    const bool limit_known = !is_wrong("max_episode_length", scenario.where, errors_);
    const int limit = scenario.max_episode_length.value_or(0);
    if (limit > 0 && c_.mappo.horizon > limit && limit_known && known({"mappo.horizon"}))
      fail("mappo.horizon", cat(c_.mappo.horizon, " is longer than an episode of scenario '", c_.scenario,
                                "' (max_episode_length ", limit, ")"));
  }

 private:
  /// mappo: shares that come to no world.
  void worlds_suffice() {
    const OpponentsConfig& p = c_.opponents;
    const WorldShares shares = world_shares(p, c_.train.n_worlds);
    const auto too_few = [&](const char* key, float share, int64_t worlds, int64_t needed, const char* what) {
      if (worlds < needed && known({key, "train.n_worlds"}))
        fail(key, cat(share, " of train.n_worlds ", c_.train.n_worlds, " leaves each team ", worlds, " worlds against ",
                      what, "; it needs at least ", needed));
    };
    const auto n_scripts = static_cast<int64_t>(p.scripted.size());
    if (p.pool_size > 0 && p.pool_share > 0)
      too_few("opponents.pool_share", p.pool_share, shares.pooled(), 1, "the pool");
    if (p.scripted_share > 0 && known({"opponents.scripted"}))
      too_few("opponents.scripted_share", p.scripted_share, shares.scripted, n_scripts, "scripts (opponents.scripted)");
    const int64_t states = shares.learning(0).count * c_.mappo.horizon;
    if (states < c_.mappo.n_minibatches && known({"train.n_worlds", "mappo.horizon", "mappo.n_minibatches"}))
      fail("mappo.n_minibatches", cat(c_.mappo.n_minibatches, " minibatches for ", states,
                                      " states of the worlds in which a team learns (opponents)"));
  }
  void not_for(const std::string& algorithm, const std::string& key, bool changed, const std::string& instead) {
    if (changed && known({key})) fail(key, cat("this means nothing to train.algorithm ", algorithm, ": ", instead));
  }
  bool known(const std::vector<std::string>& keys) const {
    return std::none_of(keys.begin(), keys.end(), [&](const std::string& k) { return is_wrong(k, given_, errors_); });
  }
  void fail(const std::string& key, const std::string& message) {
    const auto found = given_.find(key);
    const Position by_default{std::make_shared<const std::string>("default of " + key)};
    errors_.add(found == given_.end() ? by_default : found->second, cat(key, ": ", message));
  }

  const RunConfig& c_;
  const KeyPositions& given_;
  Errors& errors_;
};

/// Puts together what was read, as far as it was; throws with all mistakes.
LoadedRun finish(RunConfig config, std::optional<Scenario> scenario, const KeyPositions& given, Errors& errors) {
  LoadedRun run;
  run.config = std::move(config);
  CombinationCheck check(run.config, given, errors);
  check.device();
  check.belongs_to_algorithm();
  check.precision_fits();
  check.opponents_fit();
  check.minibatches_divide();
  check.population_fits();
  if (scenario) {
    run.scenario = std::move(*scenario);
    if (run.config.rules) run.scenario.rules = *run.config.rules;
    check.horizon_fits(run.scenario);
    run.spec = compile(run.scenario, errors);
    if (errors.empty()) check.inputs_are_there(run.spec);
    check.noise_rank_fits(run.spec);
  }
  errors.throw_if_any();
  return run;
}

}  // namespace

LoadedRun load_run_config(const std::string& path, const std::vector<std::string>& overrides) {
  RunConfig config;
  KeyPositions given;
  Errors errors;
  const bool readable = read_config_file(path, overrides, config, errors, &given);
  if (!readable) errors.throw_if_any();
  const Node* changes = config.environment.is_map() ? &config.environment : nullptr;
  std::optional<Scenario> scenario;
  if (!is_wrong("scenario", given, errors))
    scenario = load_scenario({config.scenario, given["scenario"], changes, "environment"}, data_dirs(), errors);
  return finish(std::move(config), std::move(scenario), given, errors);
}

LoadedRun load_run_config_text(const std::string& config_yaml, const std::string& scenario_yaml) {
  RunConfig config;
  KeyPositions given;
  Errors errors;
  const Document document = parse_yaml_text(config_yaml, "config of the checkpoint", errors);
  if (errors.empty() || document.root.is_map()) read_fields(document.root, config, errors, &given);
  std::optional<Scenario> scenario = parse_scenario(scenario_yaml, "scenario of the checkpoint", data_dirs(), errors);
  return finish(std::move(config), std::move(scenario), given, errors);
}

}  // namespace giga
