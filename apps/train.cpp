// gigastep train: reads a config, makes simulator and learner, and updates until the run is complete.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <iostream>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/evaluation.hpp"
#include "apps/program_info.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/host_info.hpp"
#include "io/number.hpp"
#include "io/progress.hpp"
#include "io/run_folder.hpp"
#include "learn/learner.hpp"

namespace giga {
namespace {

struct TrainOptions {
  std::string config, run_dir, device;
  std::vector<std::string> overrides;
  std::optional<uint64_t> seed;
  bool quiet = false;
};

/// Seconds, by what they were spent on.
struct Times {
  double update = 0, evaluation = 0, checkpoint = 0;
};

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

/// Runs `f` and gives the seconds that it took.
template <class F>
double timed(F&& f) {
  const Stopwatch watch;
  f();
  return watch.seconds();
}

std::vector<std::string> all_overrides(const TrainOptions& o) {
  std::vector<std::string> all = o.overrides;
  if (!o.device.empty()) all.push_back("device=" + o.device);
  if (o.seed) all.push_back(cat("seed=", *o.seed));
  return all;
}

std::string run_name(const RunConfig& c) {
  return cat(folder_name_of(c.scenario), "-", c.train.algorithm, "-seed", c.seed);
}

Json run_info(const LoadedRun& run, Device device) {
  Json info = Json::object();
  info.set("scenario", run.config.scenario).set("algorithm", run.config.train.algorithm).set("seed", run.config.seed);
  info.set("started", utc_now()).set("command_line", command_line());
  info.set("versions", version_info()).set("hardware", hardware_info(device));
  return info;
}

/// Everything that evaluating or continuing the run takes.
Checkpoint make_checkpoint(const LoadedRun& run, const Learner& learner, double seconds) {
  Checkpoint c;
  c.gigastep_version = program_version();
  c.scenario_name = run.config.scenario;
  c.config_yaml = print_yaml(run.config, true);
  c.scenario_yaml = print_scenario(run.scenario);
  c.updates = learner.updates_done();
  c.agent_steps = learner.agent_steps_done();
  c.seed = run.config.seed;
  learner.save(c.arrays);
  c.arrays.push_back(make_array<double>("program/seconds", {seconds}));
  return c;
}

/// Throws where the losses of a learning team are no numbers any more.
void check_losses(const Metrics& metrics, Learner& learner, Logger& log) {
  for (int team = 0; team < kNTeams; ++team) {
    for (const auto& [name, value] : metrics) {
      if (!learner.actor(team) || !name.ends_with(cat("_loss_", team)) || std::isfinite(value)) continue;
      const std::string reason = cat("training diverged: ", name, " is ", value, " at update ", learner.updates_done());
      log.error(reason);
      throw Error(reason, ErrorKind::diverged);
    }
  }
}

MetricsRow metrics_row(const Learner& learner, double seconds, const Times& times, double speed, const Metrics& metrics,
                       const MetricsRow& evaluation) {
  MetricsRow row = {{"update", static_cast<double>(learner.updates_done())},
                    {"agent_steps", static_cast<double>(learner.agent_steps_done())},
                    {"seconds", seconds},
                    {"update_seconds", times.update},
                    {"evaluation_seconds", times.evaluation},
                    {"checkpoint_seconds", times.checkpoint},
                    {"agent_steps_per_second", speed}};
  row.insert(row.end(), metrics.begin(), metrics.end());
  row.insert(row.end(), evaluation.begin(), evaluation.end());
  return row;
}

/// For the progress line: "circle", "0.40/0.31".
std::vector<std::pair<std::string, std::string>> win_rates(const std::vector<TeamResult>& results) {
  std::vector<std::pair<std::string, std::string>> rates;
  for (const TeamResult& r : results) {
    const std::string rate = print_share(r.share(r.wins()));
    if (!rates.empty() && rates.back().first == r.opponent) {
      rates.back().second += "/" + rate;
    } else {
      rates.emplace_back(r.opponent, rate);
    }
  }
  return rates;
}

void train(const TrainOptions& o) {
  const Stopwatch watch;
  // Whatever is wrong with the input shows before anything is created.
  const LoadedRun run = load_run_config(find_config(o.config), all_overrides(o));
  const RunConfig& config = run.config;
  const Device device = parse_device(config.device);
  const std::unique_ptr<Learner> learner = make_learner(run, device);
  const int64_t n_updates = total_updates(config, run.spec.params.n_agents);
  const int64_t steps_per_update = agent_steps_per_update(config, run.spec.params.n_agents);

  const RunFolder folder = RunFolder::create(o.run_dir, run_name(config));
  folder.describe(print_yaml(config, true), print_scenario(run.scenario), run_info(run, device));
  Logger log(folder.log_file(), o.quiet ? Logger::Console::quiet : Logger::Console::all);
  MetricsCsv csv(folder.metrics_file());
  log.info(cat("training ", config.scenario, " with ", config.train.algorithm, " on ", device.name(), ": ", n_updates,
               " updates of ", print_short(static_cast<double>(steps_per_update)), " agent-steps, results in ",
               folder.path().string()));

  Progress progress(log, progress_mode(o.quiet));
  std::vector<TeamResult> results;  // of the latest evaluation
  double recent_speed = 0, checkpoint_seconds = 0;
  while (learner->updates_done() < n_updates) {
    Metrics metrics;
    Times times{timed([&] { metrics = learner->update(); }), 0, checkpoint_seconds};
    check_losses(metrics, *learner, log);

    // All below is diagnostics: nothing here changes what is learned.
    const int64_t update = learner->updates_done();
    const auto is_due = [&](int every) { return update == n_updates || (every > 0 && update % every == 0); };
    const double speed = static_cast<double>(steps_per_update) / times.update;
    recent_speed = recent_speed > 0 ? 0.9 * recent_speed + 0.1 * speed : speed;
    if (update == 1) log.note(cat("first update done ", watch.seconds(), " s after the start"));

    const bool evaluates = is_due(config.eval.every_updates);
    if (evaluates) times.evaluation = timed([&] { results = evaluate(run, device, *learner); });
    const MetricsRow evaluation = evaluation_metrics(config, evaluates ? results : std::vector<TeamResult>());
    csv.write(metrics_row(*learner, watch.seconds(), times, speed, metrics, evaluation));
    if (evaluates) log.note("evaluation after update " + std::to_string(update) + ":\n" + results_table(results));

    checkpoint_seconds = 0;
    if (is_due(config.checkpoint.every_updates))
      checkpoint_seconds =
          timed([&] { folder.save(make_checkpoint(run, *learner, watch.seconds()), config.checkpoint.keep); });
    progress.show({update, n_updates, learner->agent_steps_done(), n_updates * steps_per_update, watch.seconds(),
                   recent_speed, win_rates(results)});
  }
  progress.finish();

  log.note(cat("done after ", watch.seconds(), " s"));
  std::cout << results_table(results) << "evaluate it: " << program_command() << " eval "
            << shell_word(folder.path().string()) << " --vs circle" << std::endl;
}

}  // namespace

void add_train_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("train", "train the teams of a scenario");
  auto options = std::make_shared<TrainOptions>();
  command->add_option("CONFIG", options->config, "YAML file, or the name of one that comes with gigastep (quickstart)")
      ->required()
      ->type_name("");
  add_set_option(*command, options->overrides);
  command
      ->add_option("--run-dir", options->run_dir,
                   "folder of this run, new or empty; default: runs/SCENARIO-ALGORITHM-seedN-NNN")
      ->type_name("DIR");
  add_device_option(*command, options->device);
  command->add_option("--seed", options->seed, "seed of everything random, as --set seed=N")->type_name("N");
  command->add_flag("--quiet", options->quiet, "no progress; warnings, errors and the final table only");
  command->footer(
      "The run folder holds config.yaml and scenario.yaml (all keys, with comments), run.json (seed, versions, "
      "hardware,\n"
      "command line), log.txt, checkpoints/ and metrics.csv with one row per update:\n"
      "  update, agent_steps         done so far (worlds x agents x steps)\n"
      "  seconds                     since the start; update_, evaluation_ and checkpoint_seconds: of this row (a\n"
      "                              checkpoint is written after its row and counts in the next)\n"
      "  agent_steps_per_second      of this update, without evaluation\n"
      "  figures of the learner      team 0 or 1 is the last part of the name; losses, entropy (nats), approx_kl,\n"
      "                              explained_variance, information (nats), returns and shares of episodes that "
      "ended\n"
      "  win_rate_T_vs_O, loss_rate_T_vs_O, mean_return_T_vs_O\n"
      "                              team T on its side against script O; filled where an evaluation took place\n"
      "Examples:\n"
      "  gigastep train quickstart\n"
      "  gigastep train mappo --set scenario=hide_and_seek_5_vs_5 --set train.total_agent_steps=1e9 --device cuda:1\n"
      "  gigastep train my.yaml --run-dir runs/second --seed 2\n"
      "All keys of a config: gigastep config quickstart");
  command->callback([options, &dispatch] { dispatch.run = [options] { train(*options); }; });
}

}  // namespace giga
