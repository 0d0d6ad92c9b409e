// gigastep sweep: trains a config with many settings, several at once, and says which are best.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <iostream>
#include <list>
#include <nlohmann/json.hpp>
#include <thread>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/output.hpp"
#include "apps/program_info.hpp"
#include "apps/run_process.hpp"
#include "apps/stop_request.hpp"
#include "apps/sweep_folder.hpp"
#include "apps/training.hpp"
#include "core/error.hpp"
#include "io/number.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

struct SweepOptions {
  std::string file, out, json, tell;
  bool ask = false, quiet = false;
};

using SweepClock = std::chrono::steady_clock;

double seconds_since(SweepClock::time_point start) {
  return std::chrono::duration<double>(SweepClock::now() - start).count();
}

/// A run of a trial that goes on in a process.
struct ActiveRun {
  SweepRun run;
  RunProcess process;
  SweepClock::time_point start = SweepClock::now();
  double steps_before = 0;

  ActiveRun(const SweepFolder& folder, const SweepRun& of)
      : run(of),
        process(arguments_for(folder.wanted(of)), folder.log_of(of)),
        steps_before(agent_steps_of_run(folder.wanted(of).folder)) {}
};

class Sweeping {
 public:
  Sweeping(SweepFolder& folder, bool quiet) : folder_(folder), quiet_(quiet) {}

  /// Until all is done (0), or it is asked to stop, or its time is over; then the runs that go on are saved.
  int run() {
    const StopRequest signals;
    for (const SweepRun& run : folder_.progress().open()) waiting_.push_back(run);
    while (true) {
      collect();
      const int code = stop_code();
      if (code != 0) return stop(code);
      start_runs();
      if (active_.empty() && waiting_.empty() && folder_.progress().complete()) return 0;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

 private:
  int stop_code() const {
    if (const int signal = StopRequest::signal()) return 128 + signal;
    const auto& limit = folder_.spec().max_wall_time;
    return limit && seconds_since(start_) >= limit->seconds ? kOutOfTime : 0;
  }

  int stop(int code) {
    for (const ActiveRun& active : active_) active.process.stop();
    while (!active_.empty()) {
      collect();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    std::cerr << "stopped (" << (code == kOutOfTime ? "max_wall_time is over" : signal_name(code - 128))
              << "), all runs are saved; the same command goes on" << std::endl;
    return code;
  }

  void start_runs() {
    while (static_cast<int>(active_.size()) < folder_.spec().parallel) {
      if (waiting_.empty()) {
        const std::optional<SweepJob> job = folder_.progress().next();
        if (!job) return;
        folder_.begin(*job);
        for (const uint64_t seed : folder_.spec().seeds) waiting_.push_back({job->trial, job->rung, seed});
      }
      // A run of a sweep that was killed may be saving still.
      const SweepRun run = waiting_.front();
      if (lock_owner(folder_.wanted(run).folder)) return;
      waiting_.pop_front();
      active_.emplace_back(folder_, run);
    }
  }

  /// Takes in the runs that have ended.
  void collect() {
    for (auto at = active_.begin(); at != active_.end();) {
      const std::optional<int> code = at->process.ended();
      if (!code) {
        ++at;
        continue;
      }
      settle(*at, *code);
      at = active_.erase(at);
    }
  }

  void settle(const ActiveRun& active, int code) {
    const SweepRun& run = active.run;
    const WantedRun wanted = folder_.wanted(run);
    const double steps = agent_steps_of_run(wanted.folder);
    const bool there =
        code == 0 || (code == kOutOfTime && wanted.stop_at && steps >= static_cast<double>(*wanted.stop_at));
    if (!there && (code == kOutOfTime || code >= 128)) {
      // Stopped before its end, its state being saved: it goes on later, if it gets anywhere.
      if (steps > active.steps_before || StopRequest::signal() != 0 || stop_code() != 0) return waiting_.push_back(run);
    }
    SweepResult result{std::nullopt, code, seconds_since(active.start), steps};
    if (there) {
      result.value = metric_of_run(folder_.spec(), wanted.folder);
      // Of all processes that took it here from the rung before.
      result.seconds = seconds_of_run(wanted.folder);
      for (int rung = 0; rung < run.rung; ++rung)
        if (const SweepResult* before = folder_.progress().result({run.trial, rung, run.seed}))
          result.seconds -= before->seconds;
    }
    folder_.finish(run, result);
    tell_result(run, result);
  }

  void tell_result(const SweepRun& run, const SweepResult& result) const {
    if (!result.value && result.exit_code != 0)
      std::cerr << "trial " << run.trial << ", seed " << run.seed << " failed (exit code " << result.exit_code
                << "), see " << folder_.log_of(run).string() << "\n"
                << tail_of(folder_.log_of(run)) << std::endl;
    if (quiet_) return;
    const SweepProgress& progress = folder_.progress();
    int done = 0;
    for (int trial = 0; trial < progress.n_trials(); ++trial) done += progress.reached(trial) >= 0 ? 1 : 0;
    const int best = progress.ranking().front();
    const int rung = progress.reached(best);
    const auto value = rung >= 0 ? progress.value(best, rung) : std::nullopt;
    std::cerr << "trial " << run.trial << ", seed " << run.seed << ", " << print_short(result.agent_steps)
              << " agent-steps: " << (result.value ? print_number(*result.value) : "no value") << "; " << done << " of "
              << progress.n_trials() << " trials"
              << (value ? cat(", best: trial ", best, " with ", print_number(*value)) : std::string()) << std::endl;
  }

  SweepFolder& folder_;
  const bool quiet_;
  const SweepClock::time_point start_ = SweepClock::now();
  std::list<SweepRun> waiting_;
  std::list<ActiveRun> active_;
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
          {"agent_steps", folder.rungs().at(static_cast<size_t>(job->rung))},
          {"seeds", folder.spec().seeds},
          {"settings", settings},
          {"commands", commands}};
}

const Json& needed_in(const Json& told, const char* key) {
  if (!told.contains(key)) throw InputError(cat("--tell: \"", key, "\" is missing"));
  return told.at(key);
}

/// A result of a trial that was asked for, or settings that somebody else chose: they are tried next.
Json tell(SweepFolder& folder, const std::string& text) {
  const Json told = Json::parse(text, nullptr, false);
  if (!told.is_object())
    throw InputError("--tell: expected a JSON object, as {\"trial\": 3, \"rung\": 0, \"value\": 0.8}");
  if (told.contains("settings")) {
    TrialSettings settings;
    for (const auto& [key, value] : told.at("settings").items()) {
      if (!folder.spec().parameters.contains(key))
        throw InputError(cat("--tell: ", key, " is no parameter of this sweep"));
      settings.emplace_back(key, value.is_string() ? value.get<std::string>() : value.dump());
    }
    return {{"trial", folder.add(settings)}};
  }
  const Json &trial = needed_in(told, "trial"), &value = needed_in(told, "value");
  const Json rung = told.value("rung", Json(0));
  if (!trial.is_number_integer() || !rung.is_number_integer() || !(value.is_number() || value.is_null()))
    throw InputError("--tell: \"trial\" and \"rung\" are whole numbers, \"value\" is a number or null (it failed)");
  std::vector<uint64_t> seeds = folder.spec().seeds;  // one value may stand for all
  if (told.contains("seed")) seeds = {told.at("seed").get<uint64_t>()};
  for (const uint64_t seed : seeds) {
    const SweepRun run{trial, rung, seed};
    const std::vector<SweepRun> open = folder.progress().open();
    if (std::find(open.begin(), open.end(), run) == open.end())
      throw InputError(cat("--tell: nobody waits for trial ", run.trial, ", rung ", run.rung, ", seed ", seed));
    SweepResult result;
    if (value.is_number()) result.value = value.get<double>();
    result.agent_steps = static_cast<double>(folder.rungs().at(static_cast<size_t>(run.rung)));
    folder.finish(run, result);
  }
  return {{"trial", trial}, {"open", folder.progress().open().size()}};
}

int sweep(const SweepOptions& o) {
  SweepFolder folder(o.file, sweep_path(o));
  if (o.ask) {
    write_json(ask(folder), "-");
    return 0;
  }
  if (!o.tell.empty()) {
    write_json(tell(folder, o.tell), "-");
    return 0;
  }
  const int code = Sweeping(folder, o.quiet).run();
  const SweepOutcome outcome = folder.outcome();
  folder.write_outcome(outcome);
  if (!o.json.empty()) write_json(outcome_json(outcome), o.json);
  if (o.json != "-")
    std::cout << outcome_text(outcome) << "table:  " << (folder.path() / "trials.csv").string()
              << "\nreport: " << (folder.path() / "report.html").string() << std::endl;
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
          "only note a result, as '{\"trial\": 3, \"rung\": 0, \"value\": 0.8}', or settings to be tried next, as "
          "'{\"settings\": {\"mappo.gamma\": 0.99}}'")
      ->type_name("JSON")
      ->excludes(ask_option);
  command->add_flag("--quiet", options->quiet, "no line for each run that ends");
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
      "Exit codes: 0 all is done; 124 max_wall_time is over; 130 or 143 stopped.\n"
      "Examples:\n"
      "  gigastep sweep rates.yaml\n"
      "  gigastep sweep rates.yaml --out /data/rates --json result.json");
  command->callback(
      [options, &dispatch] { dispatch.run = [options, &dispatch] { dispatch.exit_code = sweep(*options); }; });
}

}  // namespace giga
