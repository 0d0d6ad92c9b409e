#include "learn/run_config.hpp"

#include "core/error.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace {

/// Mistakes that show only in the combination of keys and with the scenario.
void check_together(const RunConfig& c, const SimSpec& spec, const KeyPositions& given, Errors& errors) {
  const auto at = [&given](const std::string& key) {
    const auto found = given.find(key);
    return found == given.end() ? Position{std::make_shared<const std::string>("default of " + key), 0, 0}
                                : found->second;
  };
  const int64_t states = static_cast<int64_t>(c.train.n_worlds) * c.mappo.horizon;
  if (states % c.mappo.n_minibatches != 0)
    errors.add(at("mappo.n_minibatches"), cat("mappo.n_minibatches: ", c.mappo.n_minibatches,
                                              " does not divide train.n_worlds x mappo.horizon = ", c.train.n_worlds,
                                              " x ", c.mappo.horizon, " = ", states));
  const int limit = spec.params.max_episode_length;
  if (limit > 0 && c.mappo.horizon > limit)
    errors.add(at("mappo.horizon"), cat("mappo.horizon: ", c.mappo.horizon, " is longer than an episode of scenario '",
                                        c.scenario, "' (max_episode_length ", limit, ")"));
}

LoadedRun finish(RunConfig config, Scenario scenario, const KeyPositions& given) {
  LoadedRun run;
  if (config.rules) scenario.rules = *config.rules;
  run.config = std::move(config);
  run.scenario = std::move(scenario);
  run.spec = compile(run.scenario);
  Errors errors;
  check_together(run.config, run.spec, given, errors);
  errors.throw_if_any();
  return run;
}

}  // namespace

LoadedRun load_run_config(const std::string& path, const std::vector<std::string>& overrides) {
  RunConfig config;
  KeyPositions given;
  read_config_file(path, overrides, config, &given);
  const Node* changes = config.environment.is_map() ? &config.environment : nullptr;
  Scenario scenario = load_scenario(config.scenario, data_dirs(), changes, "environment");
  return finish(std::move(config), std::move(scenario), given);
}

LoadedRun load_run_config_text(const std::string& config_yaml, const std::string& scenario_yaml) {
  RunConfig config;
  Errors errors;
  const Document document = parse_yaml_text(config_yaml, "config of the checkpoint", errors);
  read_fields(document.root, config, errors);
  errors.throw_if_any();
  Scenario scenario = parse_scenario(scenario_yaml, "scenario of the checkpoint", data_dirs());
  return finish(std::move(config), std::move(scenario), {});
}

}  // namespace giga
