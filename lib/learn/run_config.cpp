// Reading of run configs: the file, the scenario that it names, and what must hold between them.
#include "learn/run_config.hpp"

#include <algorithm>

#include "core/error.hpp"
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

  void minibatches_divide() {
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
    const bool limit_known = !is_wrong("max_episode_length", scenario.where, errors_);
    const int limit = scenario.max_episode_length.value_or(0);
    if (limit > 0 && c_.mappo.horizon > limit && limit_known && known({"mappo.horizon"}))
      fail("mappo.horizon", cat(c_.mappo.horizon, " is longer than an episode of scenario '", c_.scenario,
                                "' (max_episode_length ", limit, ")"));
  }

 private:
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
  check.minibatches_divide();
  if (scenario) {
    run.scenario = std::move(*scenario);
    if (run.config.rules) run.scenario.rules = *run.config.rules;
    check.horizon_fits(run.scenario);
    run.spec = compile(run.scenario, errors);
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
