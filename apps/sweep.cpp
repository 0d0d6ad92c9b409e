// gigastep sweep: trains a config with many settings, several at once, and says which are best.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "apps/program_info.hpp"
#include "apps/run_process.hpp"
#include "apps/sweep_folder.hpp"
#include "apps/sweeping.hpp"
#include "apps/training.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "io/number.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

struct SweepOptions {
  std::string file, out, json;
  std::optional<std::string> tell;
  bool ask = false, quiet = false;
};

fs::path sweep_path(const SweepOptions& o) {
  return o.out.empty() ? fs::path("sweeps") / fs::path(o.file).stem() : fs::path(o.out);
}

/// The next trial, for a program that trains it itself.
Json ask(SweepFolder& folder) {
  const std::optional<SweepJob> job = folder.progress().next();
  if (!job) return {{"trial", nullptr}, {"open", folder.progress().open().size()}};
  folder.begin(*job);
  Json settings = Json::object();
  for (const auto& [key, value] : folder.settings(job->trial))
    settings[key] = json_of(parse_yaml_text(value, key).root);
  Json commands = Json::array();
  for (const uint64_t seed : folder.spec().seeds) {
    std::string line = program_command();
    for (const std::string& word : arguments_for(folder.wanted({job->trial, job->rung, seed})))
      line += " " + shell_word(word);
    commands.push_back(line);
  }
  return {{"trial", job->trial},
          {"rung", job->rung},
          {"agent_steps", folder.agent_steps(job->trial, job->rung)},
          {"seeds", folder.spec().seeds},
          {"settings", settings},
          {"commands", commands}};
}

const Json& needed_in(const Json& told, const char* key) {
  if (!told.contains(key)) throw InputError(cat("--tell: \"", key, "\" is missing"));
  return told.at(key);
}

int number_in(const Json& told, const char* key) {
  if (!told.is_number_integer() || told < 0 || told > std::numeric_limits<int>::max())
    throw InputError(cat("--tell: \"", key, "\" is a whole number from 0 on, not ", told.dump()));
  return told.get<int>();
}

/// A result of a trial that was asked for, or settings that somebody else chose: they are tried after the file's own.
Json tell(SweepFolder& folder, const std::string& text) {
  const Json told = Json::parse(text, nullptr, false);
  if (told.is_discarded())
    throw InputError(
        "--tell: expected a JSON object; this is not JSON, which has no NaN and no Infinity (null says "
        "that a trial failed)");
  if (!told.is_object())
    throw InputError("--tell: expected a JSON object, as {\"trial\": 3, \"rung\": 0, \"value\": 0.8}");
  for (const auto& [key, value] : told.items()) {
    const std::vector<std::string> known = told.contains("settings")
                                               ? std::vector<std::string>{"settings"}
                                               : std::vector<std::string>{"trial", "rung", "seed", "value"};
    if (std::find(known.begin(), known.end(), key) == known.end())
      throw InputError(cat("--tell: unknown key \"", key, "\"; allowed: ", join(known),
                           told.contains("settings") ? " alone" : ", or settings alone"));
  }
  if (told.contains("settings")) {
    TrialSettings settings;
    const std::map<std::string, ParameterSpec>& parameters = folder.spec().parameters;
    std::vector<std::string> names;
    for (const auto& [key, parameter] : parameters) names.push_back(key);
    if (!told.at("settings").is_object())
      throw InputError(cat("--tell: \"settings\" is an object with values of some of: ", join(names), "; not ",
                           told.at("settings").dump()));
    for (const auto& [key, value] : told.at("settings").items()) {
      if (!parameters.contains(key))
        throw InputError(cat("--tell: ", key, " is no parameter of this sweep; allowed: ", join(names)));
      settings.emplace_back(key, value.is_string() ? value.get<std::string>() : value.dump());
    }
    return {{"trial", folder.add(settings)}};
  }
  const Json& value = needed_in(told, "value");
  if (!(value.is_number() || value.is_null())) throw InputError("--tell: \"value\" is a number or null (it failed)");
  const int trial = number_in(needed_in(told, "trial"), "trial"), rung = number_in(told.value("rung", Json(0)), "rung");
  std::vector<uint64_t> seeds = folder.spec().seeds;  // one value may stand for all
  if (told.contains("seed")) {
    if (!told.at("seed").is_number_unsigned())
      throw InputError(cat("--tell: \"seed\" is one of the sweep's seeds, not ", told.at("seed").dump()));
    seeds = {told.at("seed").get<uint64_t>()};
  }
  // All or none: what is refused has changed nothing.
  const std::vector<SweepRun> open = folder.progress().open();
  for (const uint64_t seed : seeds)
    if (std::find(open.begin(), open.end(), SweepRun{trial, rung, seed}) == open.end())
      throw InputError(cat("--tell: trial ", trial, ", rung ", rung, ", seed ", seed,
                           folder.progress().result({trial, rung, seed})
                               ? " has a result already (`gigastep sweep` trains what was asked for and not told)"
                               : " was not asked for"));
  SweepResult result;
  if (value.is_number()) {
    result.value = value.get<double>();
    result.agent_steps = static_cast<double>(folder.agent_steps(trial, rung));
  }
  for (const uint64_t seed : seeds) folder.finish({trial, rung, seed}, result);
  return {{"trial", trial}, {"open", folder.progress().open().size()}};
}

int sweep(const SweepOptions& o) {
  SweepFolder folder(o.file, sweep_path(o));
  if (o.ask || o.tell) {
    write_json(o.ask ? ask(folder) : tell(folder, *o.tell), o.json.empty() ? "-" : o.json);
    return 0;
  }
  const int code = train_sweep(folder, o.quiet);
  const SweepOutcome outcome = folder.outcome();
  folder.write_outcome(outcome);
  if (!o.json.empty()) write_json(outcome_json(outcome), o.json);
  if (o.json == "-") return code;
  std::cout << outcome_text(outcome) << "table:  " << (folder.path() / "trials.csv").string();
  // There is nothing to report of runs that have done nothing yet.
  std::error_code error;
  const fs::path report = folder.path() / "report.html";
  if (fs::exists(report, error)) std::cout << "\nreport: " << report.string();
  std::cout << std::endl;
  return code;
}

}  // namespace

void add_sweep_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("sweep", "train a config with many settings and find the best");
  auto options = std::make_shared<SweepOptions>();
  command->add_option("SWEEP", options->file, "YAML file of the sweep")->required()->type_name("");
  command
      ->add_option("--out", options->out,
                   "folder of the sweep; default: sweeps/NAME of the file. A sweep that is there goes on")
      ->check(output(Output::folder))
      ->type_name("DIR");
  add_json_option(*command, options->json);
  CLI::Option* ask_option = command->add_flag("--ask", options->ask,
                                              "only print the next trial as JSON, for a program that trains it itself");
  command
      ->add_option(
          "--tell", options->tell,
          "only note a result, as '{\"trial\": 3, \"rung\": 0, \"value\": 0.8}', or settings to be tried too, as "
          "'{\"settings\": {\"mappo.gamma\": 0.99}}'")
      ->check(some_name("expected a JSON object"))
      ->type_name("JSON")
      ->excludes(ask_option);
  command->add_flag("--quiet", options->quiet, "no panel, and no line for each run that ends");
  command->footer(
      "A sweep that was stopped or killed goes on with the same command; nothing is lost or trained twice. Each trial\n"
      "is trained once with each seed, in a run folder of its own, by a process of its own. docs/sweep.md explains "
      "the\n"
      "file:\n"
      "  config: quickstart\n"
      "  set: [train.total_agent_steps=2000000]\n"
      "  parameters:\n"
      "    mappo.learning_rate: {log_uniform: [1e-4, 1e-2]}\n"
      "    mappo.gamma: {choices: [0.98, 0.99, 0.995]}\n"
      "  method: sobol\n"
      "  trials: 16\n"
      "  seeds: [1, 2, 3]\n"
      "  metric: [win_rate_0_vs_circle, win_rate_1_vs_circle]\n"
      "Exit codes: 0 all is done; 1 all is done, but runs failed: the same command tries them again, except\n"
      "those that diverged; 3 every run diverged; 2 the file or a value is wrong; 124 max_wall_time is over;\n"
      "130, 143, 138 or 129 stopped (SIGINT, SIGTERM, SIGUSR1, SIGHUP).\n"
      "Examples:\n"
      "  gigastep sweep rates.yaml\n"
      "  gigastep sweep rates.yaml --out /data/rates --json result.json");
  command->callback(
      [options, &dispatch] { dispatch.run = [options, &dispatch] { dispatch.exit_code = sweep(*options); }; });
}

}  // namespace giga
