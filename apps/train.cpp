// gigastep train: reads a config, makes a learner and a run folder, and trains in it.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/follow.hpp"
#include "apps/idle_settings.hpp"
#include "apps/joined_ranks.hpp"
#include "apps/load_player.hpp"
#include "apps/option_value.hpp"
#include "apps/plan.hpp"
#include "apps/start_ranks.hpp"
#include "apps/training.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

struct TrainOptions {
  std::string config, run_dir, name, device;
  std::vector<std::string> overrides;
  std::optional<uint64_t> seed;
  bool quiet = false, no_color = false, plan = false;
  RankOptions ranks;
};

std::vector<std::string> all_overrides(const TrainOptions& o) {
  std::vector<std::string> all = o.overrides;
  if (!o.device.empty()) all.push_back("device=" + o.device);
  if (o.seed) all.push_back(cat("seed=", *o.seed));
  return all;
}

/// "lr3e-4" for mappo.learning_rate=3e-4; a name behind a name needs a line between: "opponent_circle".
std::string part_of_name(const std::string& assignment) {
  const size_t equals = std::min(assignment.find('='), assignment.size() - 1);
  const std::string key = assignment.substr(0, equals);
  std::string name = key.substr(key.rfind('.') + 1), value = assignment.substr(equals + 1);
  if (name == "learning_rate") name = "lr";
  constexpr size_t kMost = 24;
  std::string plain;
  for (const char c : value.substr(0, kMost)) {
    const bool usable = std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '+' || c == '_';
    if (usable) plain += c;
    if (!usable && !plain.empty() && plain.back() != '_') plain += '_';
  }
  while (plain.ends_with('_')) plain.pop_back();
  return name + (plain.empty() || std::isdigit(static_cast<unsigned char>(plain[0])) ? "" : "_") + plain;
}

/// What the config's file tells beside scenario and algorithm: "mappo-quickstart", "mappo_league", "mappo". A file of
/// the name of either tells nothing more, nor does config.yaml, which every run folder has.
std::string algorithm_and_config(const std::string& config, const std::string& scenario, const std::string& algorithm) {
  const std::string name = folder_name_of(config);
  if (name == scenario || name == "config") return algorithm;
  return name.starts_with(algorithm) ? name : cat(algorithm, "-", name);
}

/// The scenario, the algorithm, the config, what --set changes, the seed:
/// "duel-mappo-quickstart-lr3e-4-seed2". What has a place of its own, or no part in what is learned, is left out, and
/// what is more than a name can hold.
std::string run_name(const TrainOptions& o, const RunConfig& c) {
  static const std::set<std::string> kLeftOut = {
      "scenario",        "train.algorithm",         "seed",
      "device",          "train.n_threads",         "train.max_wall_time",
      "train.precision", "train.total_agent_steps", "train.stop_at_agent_steps"};
  constexpr size_t kLongest = 100;
  const std::string scenario = folder_name_of(c.scenario);
  std::string name = cat(scenario, "-", algorithm_and_config(o.config, scenario, c.train.algorithm));
  for (const std::string& assignment : o.overrides) {
    const std::string key = assignment.substr(0, assignment.find('='));
    if (kLeftOut.contains(key) || key.starts_with("checkpoint.") || key.starts_with("eval.")) continue;
    const std::string part = part_of_name(assignment);
    if (name.size() + part.size() < kLongest) name += "-" + part;
  }
  return cat(name, "-seed", c.seed);
}

/// For CLI::Option::check. Without these a variable of a script that is not set, as in --name "$name", would go
/// unnoticed.
std::string refuse_no_name(const std::string& name) {
  return name.empty() ? "a name is missing; allowed is the name of a folder in runs/, without a slash" : "";
}
std::string refuse_no_folder(const std::string& folder) {
  return folder.empty() ? "a folder is missing; without --run-dir one is made in runs/" : "";
}

/// The folder that was asked for; empty: one is made by what the run is.
std::string folder_of(const TrainOptions& o) {
  if (o.name.empty()) return o.run_dir;
  if (o.name.find('/') != std::string::npos || o.name.starts_with('.'))
    throw InputError(
        cat("--name ", o.name, " is a path; a name is that of a folder in runs/ (--run-dir takes a path)"));
  return (fs::path("runs") / o.name).string();
}

/// Lines of --help: what the algorithms are.
std::string algorithms_help() {
  std::string text;
  for (const Algorithm* a : algorithms())
    text += cat("  ", a->name, std::string(28 - std::strlen(a->name), ' '), a->about, '\n');
  return text;
}

/// Lines of --help: the figures of the algorithms, those that are the same once.
std::string figures_help() {
  std::vector<std::pair<std::string, std::string>> paragraphs;  // names, figures
  for (const Algorithm* a : algorithms()) {
    const bool same = !paragraphs.empty() && paragraphs.back().second == a->figures;
    same ? paragraphs.back().first += cat(", ", a->name) : paragraphs.emplace_back(a->name, a->figures).first;
  }
  std::string text;
  for (const auto& [names, figures] : paragraphs) {
    text += cat("    ", names, std::string(26 - std::min<size_t>(names.size(), 25), ' '));
    for (const char c : figures) text += c == '\n' ? c + std::string(30, ' ') : std::string(1, c);
    text += '\n';
  }
  return text;
}

int train(const TrainOptions& o, Dispatch& dispatch) {
  // Whatever is wrong with the input shows before anything is created.
  const std::string run_dir = folder_of(o);
  const JoinedRanks joined = join_others(o.ranks, dispatch);
  TrainingSetup setup;
  std::vector<std::string> overrides = all_overrides(o);
  setup.run = load_run_config(find_config(o.config), overrides);
  const int n_ranks = std::max(joined.size(), o.ranks.to_start());
  if (const std::string more = setting_for_ranks(setup.run.config, overrides, n_ranks); !more.empty()) {
    overrides.push_back(more);
    setup.run = load_run_config(find_config(o.config), overrides);
  }
  setup.device = device_of_rank(setup.run.config.device, joined);
  dispatch.size_key = algorithm_of(setup.run.config).size(setup.run.config).key;
  setup.quiet = o.quiet;
  setup.color = !o.no_color;
  if (o.plan) {
    if (joined.ranks || o.ranks.to_start() > 1) throw InputError("--plan measures one process; leave the ranks out");
    print_plan(setup.run, setup.device);
    return 0;
  }
  expect_devices(o.ranks, setup.run.config.device, setup.device);  // told once, not by every rank
  if (o.ranks.to_start() > 1) {
    algorithm_of(setup.run.config).expect_divides(setup.run.config, n_ranks);
    return start_ranks(n_ranks);
  }
  expect_same(joined.ranks.get(), "program or config", described(setup.run));
  check_memory(setup.run, setup.device, n_ranks);
  setup.learner = make_learner(setup.run, setup.device, joined.ranks.get());
  setup.ranks = joined.ranks;
  if (!joined.leads()) return finish(joined, follow(std::move(setup)));
  warn_of_opponents(setup.run);
  warn_of_idle(o.overrides, setup.run);

  const RunFolder folder = RunFolder::create(run_dir, run_name(o, setup.run.config));
  const RunConfig config = for_run_folder(setup.run.config);
  folder.describe(print_yaml(config, true), print_scenario(setup.run.scenario), run_info(setup.run, setup.device),
                  is_path(config.scenario) ? config.scenario : "");
  dispatch.advice = [path = folder.path()] { return advice_to_resume(path); };
  return finish(joined, train_in(folder, std::move(setup)));
}

}  // namespace

void add_train_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("train", "train the teams of a scenario");
  auto options = std::make_shared<TrainOptions>();
  command->add_option("CONFIG", options->config, "YAML file, or the name of one that comes with gigastep (quickstart)")
      ->required()
      ->type_name("");
  add_set_option(*command, options->overrides);
  CLI::Option* run_dir =
      command
          ->add_option("--run-dir", options->run_dir,
                       "folder of this run: new, empty, or of one that was ended before its first checkpoint; default: "
                       "runs/SCENARIO-ALGORITHM-CONFIG-CHANGES-seedN, as "
                       "runs/duel-mappo-quickstart-lr3e-4-seed2, and a number behind it where that is taken")
          ->type_name("DIR")
          ->check(refuse_no_folder);
  command->add_option("--name", options->name, "name of this run: its folder is runs/NAME, which must be new or empty")
      ->type_name("NAME")
      ->check(refuse_no_name)
      ->excludes(run_dir);
  add_device_option(*command, options->device);
  command->add_option("--seed", options->seed, "seed of everything random, as --set seed=N")
      ->transform(value_of<uint64_t>(anything()))
      ->type_name("N");
  add_display_options(*command, options->quiet, options->no_color);
  add_rank_options(*command, options->ranks);
  command->add_flag("--plan", options->plan,
                    "only measure how much memory the run takes, and how many worlds or members would fit");
  command->footer(
      "The run folder holds config.yaml and scenario.yaml (all keys, with comments), run.json (seed, versions, "
      "hardware,\n"
      "command line), log.txt, checkpoints/, events for TensorBoard, report.html (at the end) and metrics.csv with one "
      "row per\n"
      "update, which is a generation of an evolution strategy:\n"
      "  update, agent_steps         done so far; agent-steps: of mappo worlds x agents x steps, of evolution those "
      "of\n"
      "                              all episodes\n"
      "  seconds                     of training so far; update_, rollout_, learning_, evaluation_ and\n"
      "                              checkpoint_seconds: of this row (a checkpoint is written after its row and\n"
      "                              counts in the next)\n"
      "  agent_steps_per_second      of this update, without evaluation\n"
      "  figures of the learner      those of a team end in its number, as return_0; of the episodes that ended:\n"
      "                              episodes, episode_length, return, score, win_rate, tie_rate, reward_TERM;\n"
      "                              pool_win_rate, scripted_win_rate: against the pool and against\n"
      "                              opponents.scripted (mappo: the other figures are of the worlds in which\n"
      "                              both teams learn)\n" +
      figures_help() +
      "  win_rate_T_vs_O, loss_rate_T_vs_O, mean_return_T_vs_O\n"
      "                              team T on its side against script O; filled where an evaluation took place\n"
      "Algorithms (train.algorithm):\n" +
      algorithms_help() +
      "SIGINT (Ctrl-C), SIGTERM, SIGUSR1, SIGHUP and train.max_wall_time end a run after its update, with its state "
      "saved;\n"
      "gigastep resume goes on. A second Ctrl-C ends it at once, with what was saved last.\n"
      "Examples:\n"
      "  gigastep train quickstart\n"
      "  gigastep train mappo --set scenario=hide_and_seek_5_vs_5 --set train.total_agent_steps=1e9 --device cuda:1\n"
      "  gigastep train my.yaml --name second --seed 2\n"
      "All keys of a config: gigastep config quickstart");
  command->callback([options, &dispatch] {
    dispatch.run = [options, &dispatch] { dispatch.exit_code = train(*options, dispatch); };
  });
}

}  // namespace giga
