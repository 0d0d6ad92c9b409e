// Reading of run configs: the file, the scenario that it names, and what must hold between them.
#include "learn/run_config.hpp"

#include <algorithm>
#include <filesystem>
#include <set>

#include "config/names.hpp"
#include "config/settings.hpp"
#include "core/error.hpp"
#include "learn/config_check.hpp"
#include "learn/mixed_team.hpp"
#include "learn/registry.hpp"
#include "learn/run_config_file.hpp"
#include "learn/yaml_kind.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace {

std::vector<std::string> opponent_names() {
  std::vector<std::string> names = {Opponent{}.name};
  for (const std::string& name : FieldCodec<Scripted>::names()) names.push_back(name);
  return names;
}

void check_device(ConfigCheck& check) {
  const std::string& name = check.config.device;
  const std::string number = name.starts_with("cuda:") ? name.substr(5) : "x";
  const bool numbered =
      !number.empty() && number.size() <= 3 && number.find_first_not_of("0123456789") == std::string::npos;
  if (name != "auto" && name != "cpu" && name != "cuda" && !numbered)
    check.fail("device", cat("'", name, "' is not auto, cpu, cuda or cuda:<number of the GPU>"));
}

/// fp16 is for the fused kernel, which plays the games of populations.
void check_precision(ConfigCheck& check) {
  if (algorithm_of(check.config).has_populations || !check.wants_fp16()) return;
  std::vector<std::string> names;
  for (const Algorithm* a : algorithms())
    if (a->has_populations) names.emplace_back(a->name);
  const std::string last = names.back();
  names.pop_back();
  check.refuse_fp16(cat("is for the populations of ", join(names), " and ", last, ", and train.algorithm is ",
                        check.config.train.algorithm));
}

void check_pairs(ConfigCheck& check) {
  if (check.config.train.pairs == Pairs::by_place && check.spec && check.spec->params.resolution > 0 &&
      check.known({"train.pairs", "scenario"}))
    check.fail("train.pairs", cat("by_place: agents of '", check.config.scenario,
                                  "' are given images, which need tables; allowed: auto, tables"));
}

void check_opponents(ConfigCheck& check) {
  const OpponentsConfig& p = check.config.opponents;
  const Opponent& opponent = check.config.train.opponent;
  if (!check.has_begun && opponent.is_self_play() && check.config.train.learning_team != 0 &&
      check.known({"train.opponent", "train.learning_team"}))
    check.fail("train.learning_team", cat(check.config.train.learning_team,
                                          ": this means nothing with train.opponent self_play, where both "
                                          "teams learn; a script or the path of a policy lets one learn"));
  if (!opponent.is_self_play() && check.known({"train.opponent"})) {
    const std::string instead = cat("the other team plays that ", opponent.is_path() ? "policy" : "script",
                                    " everywhere; self_play makes both learn");
    const auto refuse = [&](const char* key, bool given) {
      if (given && check.known({key}))
        check.fail(key, cat("this means nothing with train.opponent ", opponent.name, ": ", instead));
    };
    refuse("opponents.pool_size", p.pool_size > 0);
    refuse("opponents.scripted_share", p.scripted_share > 0);
    refuse("opponents.policies", !p.policies.empty());
  } else if (check.known({"opponents.pool_size", "opponents.pool_share", "opponents.scripted_share"}) &&
             p.pool_size > 0 && p.pool_share + p.scripted_share > 1) {
    check.fail("opponents.pool_share",
               cat(p.pool_share, " and opponents.scripted_share ", p.scripted_share, " are more than 1 together"));
  } else if (!p.policies.empty() &&
             check.known({"opponents.policies", "opponents.pool_size", "opponents.pool_share"})) {
    if (p.pool_size == 0)
      check.fail("opponents.policies", "they join the pool, and opponents.pool_size is 0; needed: 1 or more");
    if (p.pool_share == 0)
      check.fail("opponents.policies", "they are met with the pool, and opponents.pool_share is 0; needed: more");
  }
}

/// Each has a column in metrics.csv.
void check_evaluations(ConfigCheck& check) {
  std::set<Scripted> seen;
  for (const Scripted script : check.config.eval.opponents)
    if (!seen.insert(script).second && check.known({"eval.opponents"}))
      return check.fail("eval.opponents", cat(name_of(script), " is there twice; allowed: each once"));
}

/// The place of a policy, so that the run's own config names it from anywhere.
void find_policy(std::string& name, const char* kinds, const std::string& key, const Position& at, Errors& errors) {
  std::error_code code;
  const std::filesystem::path path = std::filesystem::weakly_canonical(name, code);
  if (code || !std::filesystem::exists(path, code)) return errors.add(at, cat(key, ": there is no ", kinds, " ", name));
  name = path.string();
}

/// Puts together what was read, as far as it was; throws with all mistakes.
LoadedRun finish(RunConfig config, std::optional<Scenario> scenario, const KeyPositions& given, Errors& errors,
                 bool has_begun) {
  LoadedRun run;
  run.config = std::move(config);
  ConfigCheck check(run.config, given, errors);
  check.has_begun = has_begun;
  check_device(check);
  check_precision(check);
  check_opponents(check);
  check_evaluations(check);
  if (scenario) {
    run.scenario = std::move(*scenario);
    if (run.config.rules) run.scenario.rules = *run.config.rules;
    run.spec = compile(run.scenario, errors);
    check.scenario = &run.scenario;
    check.spec = &run.spec;
    check_pairs(check);
  }
  algorithm_of(run.config).check(check);
  errors.throw_if_any();
  if (const auto found = given.find("train.opponent"); found != given.end()) run.opponent_at = found->second;
  if (const auto found = given.find("opponents.policies"); found != given.end()) run.policies_at = found->second;
  if (const auto found = given.find("scenario"); found != given.end() && found->second.source)
    run.scenario_at = found->second;
  return run;
}

}  // namespace

Scripted Opponent::script() const {
  const std::vector<std::string> names = FieldCodec<Scripted>::names();
  const auto found = std::find(names.begin(), names.end(), name);
  GIGA_CHECK(found != names.end(), "'", name, "' is no script");
  return static_cast<Scripted>(found - names.begin());
}

bool FieldCodec<Opponent>::read(const Node& node, Opponent& value, const Allowed&, const ReadSite& site) {
  if (node.is_scalar() && Opponent{node.text}.is_path()) {
    value.name = node.text;
    return true;
  }
  const std::vector<std::string> names = opponent_names();
  std::error_code code;
  if (node.is_scalar() && !node.text.empty() && std::find(names.begin(), names.end(), node.text) == names.end() &&
      std::filesystem::exists(node.text, code)) {
    site.errors.add(node.at, cat(site.path, ": '", node.text,
                                 "' is no script; the path of a policy has a slash or a dot, as ./", node.text));
    return false;
  }
  const int index = read_choice(node, names, site);
  if (index >= 0) value.name = names[static_cast<size_t>(index)];
  return index >= 0;
}

std::string FieldCodec<Opponent>::expected(const Allowed&) {
  return expected_choice(opponent_names()) + "; or a path, with a slash or a dot in it";
}

ValueShape FieldCodec<Opponent>::shape(const Allowed&) {
  Allowed path;
  path.pattern = "[/.]";
  return {ValueShape::Kind::either,
          {},
          {{ValueShape::Kind::text, one_of(opponent_names())}, {ValueShape::Kind::text, path}}};
}

bool ConfigCheck::known(const std::vector<std::string>& keys) const {
  return std::none_of(keys.begin(), keys.end(), [&](const std::string& k) { return is_wrong(k, given_, errors_); });
}

bool ConfigCheck::scenario_knows(const std::string& key) const { return !is_wrong(key, scenario->where, errors_); }

void ConfigCheck::fail(const std::string& key, const std::string& message) {
  const auto found = given_.find(key);
  const Position by_default{std::make_shared<const std::string>("default of " + key)};
  errors_.add(found == given_.end() ? by_default : found->second, cat(key, ": ", message));
}

void ConfigCheck::means_nothing(const std::string& key, bool changed, const std::string& instead) {
  if (changed && known({key}))
    fail(key, cat("this means nothing to train.algorithm ", config.train.algorithm, ": ", instead));
}

bool ConfigCheck::wants_fp16() const {
  return config.train.precision == Precision::fp16 && known({"train.precision", "train.algorithm"});
}

void ConfigCheck::refuse_fp16(const std::string& reason) {
  fail("train.precision", cat("fp16 ", reason, "; allowed there: fp32, tf32, bf16"));
}

void ConfigCheck::log_std_fits(const std::string& group, const ActorConfig& actor) {
  const std::string lowest = group + ".log_std_min", start = group + ".log_std_init", highest = group + ".log_std_max";
  if (has_begun || !known({lowest, start, highest})) return;
  if (actor.log_std_init < actor.log_std_min || actor.log_std_init > actor.log_std_max)
    fail(start, cat(actor.log_std_init, " is outside of its bounds; allowed: from ", lowest, " ", actor.log_std_min,
                    " to ", highest, " ", actor.log_std_max));
}

void ConfigCheck::inputs_are_there(const std::string& group, const NetworkConfig& network) {
  if (!spec) return;
  if (!network.reads_image() && spec->params.images_only) {
    if (known({"scenario", group + ".encoder"}) && scenario_knows("observation.type"))
      fail("scenario",
           cat("agents of '", config.scenario, "' are given images alone (observation.type: rgb), and ", group,
               ".encoder ", FieldCodec<EncoderKind>::print(network.encoder),
               " reads numbers; nature, impala and compact read images, and environment.observation.type: rgb_vector "
               "gives both"));
    return;
  }
  if (!errors_.empty()) return;
  if (network.reads_image()) return image_is_there(group, network);
  if (!spec->params.egocentric_view && network.inputs == NetworkInputs::egocentric)
    fail(group + ".inputs",
         "'egocentric' needs environment.observation.egocentric_view: true; allowed without it: all");
}

void ConfigCheck::image_is_there(const std::string& group, const NetworkConfig& network) {
  const std::string key = group + ".encoder", name = FieldCodec<EncoderKind>::print(network.encoder);
  const int side = spec->params.resolution;
  if (side == 0)
    return fail(key,
                cat("'", name, "' reads images, and agents of '", config.scenario,
                    "' are given none; environment.observation.type: rgb or rgb_vector gives them; allowed without "
                    "images: mlp"));
  if (network.encoder == EncoderKind::nature && side < kNatureSide)
    fail(key, cat("'nature' needs images of at least ", kNatureSide, " x ", kNatureSide,
                  " pixels, and environment.observation.resolution is ", side, "; allowed with it: impala, compact"));
  if (network.inputs != NetworkInputs::all)
    fail(group + ".inputs", cat("these are numbers, and the encoder ", name, " reads the image; allowed with it: all"));
}

void find_opponent(RunConfig& config, const KeyPositions& given, Errors& errors) {
  Opponent& opponent = config.train.opponent;
  if (!opponent.is_path() || is_wrong("train.opponent", given, errors)) return;
  find_policy(opponent.name, "run, checkpoint, exported policy or mixed team", "train.opponent",
              given.at("train.opponent"), errors);
  if (errors.has(given.at("train.opponent")) || !names_mixed_team(opponent.name)) return;
  if (!is_wrong("train.algorithm", given, errors) && algorithm_of(config).has_populations)
    return errors.add(given.at("train.opponent"), cat("train.opponent: ", opponent.name,
                                                      " is a mixed team, of which each member of a population "
                                                      "would meet another part; allowed with train.algorithm ",
                                                      config.train.algorithm, ": one policy, or a script"));
  try {
    const size_t n = read_mixed_team(opponent.name).policies.size();
    const int64_t worlds = config.train.n_worlds / config.mappo.shards;
    if (worlds < static_cast<int64_t>(n) && !is_wrong("train.n_worlds", given, errors) &&
        !is_wrong("mappo.shards", given, errors))
      errors.add(given.at("train.opponent"),
                 cat("train.opponent: ", n, " policies play in ", opponent.name, ", and only ", worlds,
                     " worlds are to be shared by them (train.n_worlds over mappo.shards)"));
  } catch (const InputError& e) {
    errors.add(given.at("train.opponent"), cat("train.opponent: ", e.what()));
  }
}

void find_policies(RunConfig& config, const Position& at, Errors& errors) {
  const std::vector<std::string> scripts = FieldCodec<Scripted>::names();
  for (std::string& name : config.opponents.policies) {
    if (std::find(scripts.begin(), scripts.end(), name) != scripts.end())
      errors.add(at, cat("opponents.policies: ", name, " is a script: opponents.scripted takes scripts"));
    else
      find_policy(name, "run or checkpoint", "opponents.policies", at, errors);
  }
}

std::optional<int64_t> total_updates(const RunConfig& c, int n_agents) {
  const auto per_update = algorithm_of(c).agent_steps_per_update;
  if (!per_update) return std::nullopt;
  return (c.train.total_agent_steps + per_update(c, n_agents) - 1) / per_update(c, n_agents);
}

namespace {

/// The config of a run names a scenario that comes with gigastep, which may be another game by now: the one that was
/// played, by the rules of the config, stands beside it.
void expect_the_runs_game(const std::string& config_file, const RunConfig& config, Scenario scenario,
                          const std::vector<std::string>& overrides, const KeyPositions& given, Errors& errors) {
  const std::filesystem::path file = config_file, beside = file.parent_path() / "scenario.yaml";
  std::error_code code;
  const auto changes_the_game = [](const std::string& assignment) {
    const std::string key = assignment.substr(0, assignment.find('='));
    return paths_overlap(key, "scenario") || paths_overlap(key, "environment") || paths_overlap(key, "rules");
  };
  if (file.filename() != "config.yaml" || !std::filesystem::exists(beside, code) || is_path(config.scenario) ||
      !given.contains("scenario") || std::any_of(overrides.begin(), overrides.end(), changes_the_game))
    return;
  Errors of_scenario;  // are none of the config
  const std::string name = beside.string();
  const std::optional<Scenario> played = load_scenario({name, {}, nullptr, ""}, data_dirs(), of_scenario);
  if (!played) return;
  if (config.rules) scenario.rules = *config.rules;
  const auto settings = [](const Scenario& s) {
    return game_settings(parse_yaml_text(print_scenario(s), "game").root);
  };
  const std::vector<SettingChange> changes = compare_settings(settings(*played), settings(scenario));
  if (changes.empty()) return;
  const SettingChange& first = changes.front();
  const std::string more = changes.size() > 1 ? cat(" and ", changes.size() - 1, " more") : "";
  errors.add(given.at("scenario"),
             cat("scenario: '", config.scenario, "' is another game by now than the one of this run (", first.path,
                 ": ", first.before, " there, ", first.after, " now", more,
                 "); that one is played with --set scenario=", beside.string()));
}

}  // namespace

LoadedRun load_run_config(const std::string& path, const std::vector<std::string>& overrides,
                          const std::function<void(RunConfig&)>& change) {
  RunConfigFile file;
  KeyPositions given;
  Errors errors;
  Document document = read_run_config_file(path, data_dirs(), errors);
  const bool has_errors = !errors.empty();
  const bool readable =
      read_config_document(std::move(document), has_errors, overrides, fields_of(file), errors, &given);
  RunConfig config = std::move(file.config);
  if (file.base) errors.add(given["base"], "only a file says what it starts from");
  if (errors.size() > 0)
    if (const std::string other = not_asked_for(path, YamlKind::config); !other.empty()) throw InputError(other);
  if (!readable) errors.throw_if_any();
  find_opponent(config, given, errors);
  if (!is_wrong("opponents.policies", given, errors)) find_policies(config, given["opponents.policies"], errors);
  const Node* changes = config.environment.is_map() ? &config.environment : nullptr;
  std::optional<Scenario> scenario;
  if (!is_wrong("scenario", given, errors))
    scenario = load_scenario({config.scenario, given["scenario"], changes, "environment"}, data_dirs(), errors);
  if (scenario && errors.empty()) expect_the_runs_game(path, config, *scenario, overrides, given, errors);
  if (change) change(config);
  return finish(std::move(config), std::move(scenario), given, errors, false);
}

RunConfig for_run_folder(RunConfig config) {
  const bool named = name_files(config.environment);
  if (is_path(config.scenario))
    config.scenario = std::filesystem::path(config.scenario).filename().string();
  else if (named)
    config.scenario += ".yaml";
  if (config.scenario == "config.yaml") config.scenario = "scenario.yaml";  // that name is taken
  return config;
}

LoadedRun load_run_config_text(const std::string& config_yaml, const std::string& scenario_yaml) {
  RunConfig config;
  KeyPositions given;
  Errors errors;
  const Document document = parse_yaml_text(config_yaml, "config of the checkpoint", errors);
  if (errors.empty() || document.root.is_map()) read_fields(document.root, config, errors, &given);
  std::optional<Scenario> scenario = parse_scenario(scenario_yaml, "scenario of the checkpoint", data_dirs(), errors);
  return finish(std::move(config), std::move(scenario), given, errors, true);
}

}  // namespace giga
