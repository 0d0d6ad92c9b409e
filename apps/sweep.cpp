// gigastep sweep: trains a config with many settings, several at once, and says which are best.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <iostream>
#include <list>
#include <map>
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
#include "cuda/runtime.hpp"
#include "io/number.hpp"
#include "io/terminal/live_lines.hpp"
#include "sweep/outlook.hpp"
#include "sweep/parallel_search.hpp"
#include "sweep/rate_meter.hpp"
#include "sweep/run_tail.hpp"
#include "sweep/sweep_panel.hpp"

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

/// Of a folder, with or without a slash at its end.
std::string name_of_sweep(const fs::path& folder) {
  return (folder.has_filename() ? folder : folder.parent_path()).filename().string();
}

/// What `gigastep sweep` with parallel: auto knows of the machine, and what it has found.
struct AutoParallel {
  int cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  bool sets_threads;  ///< the config leaves the threads of a run open: they are its share of the cores
  bool shares_cores;  ///< and they do the work, so that a run gets its share only once others have ended
  ParallelSearch search;
  RateMeter meter;

  AutoParallel(const SweepSpec& spec, const RunConfig& config)
      : sets_threads(config.train.n_threads == 0 && !spec.parameters.contains("train.n_threads")),
        shares_cores(sets_threads && !parse_device(config.device).is_cuda()),
        search(most(config)) {
    meter.begin(search.runs());
  }
  /// What a run that begins now has of the cores.
  std::string threads() const {
    return cat("train.n_threads=", search.runs() == 1 ? 0 : std::max(1, cores / search.runs()));
  }

 private:
  /// A core for each process at least.
  int most(const RunConfig& config) const {
    const bool on_gpu = parse_device(config.device).is_cuda();
    return std::clamp(on_gpu ? cores : cores / std::max(1, config.train.n_threads), 1, 1024);
  }
};

/// A run of a trial that goes on in a process.
struct ActiveRun {
  SweepRun run;
  int64_t id;
  int at_once;  ///< it began as one of so many
  RunProcess process;
  RunTail tail;
  RunReading first;  ///< when this process began
  SweepClock::time_point start = SweepClock::now();
  bool is_forgiven = false;  ///< it may fail once: there were too many

  ActiveRun(const SweepFolder& folder, const SweepRun& of, int64_t number, int n, std::vector<std::string> arguments)
      : run(of),
        id(number),
        at_once(n),
        process(arguments, folder.log_of(of)),
        tail(folder.spec(), folder.wanted(of).folder) {
    tail.look();
    first = reading();
  }
  RunReading reading() const {
    return {id, tail.agent_steps(), tail.update_seconds(), tail.agent_steps() != first.agent_steps};
  }
};

class Sweeping {
 public:
  Sweeping(SweepFolder& folder, bool quiet)
      : folder_(folder), quiet_(quiet), has_panel_(!quiet && stderr_is_terminal()) {
    if (!folder.spec().parallel.is_auto()) return;
    auto_.emplace(folder.spec(), load_run_config((folder.path() / "config.yaml").string(), {}).config);
  }

  /// Until all is done (0), or it is asked to stop, or its time is over; then the runs that go on are saved.
  int run() {
    const StopRequest signals;
    for (const SweepRun& run : folder_.progress().open()) wait(run);
    left_at_start_ = outlook().left;
    const int code = go_on();
    if (has_panel_) {
      draw();
      live_.leave();
    }
    if (code != 0)
      say(cat("stopped (", code == kOutOfTime ? "max_wall_time is over" : signal_name(code - 128),
              "), all runs are saved; the same command goes on"));
    return code;
  }

 private:
  int go_on() {
    while (true) {
      collect();
      look();
      const int code = stop_code();
      if (code != 0) return stop(code);
      start_runs();
      if (active_.empty() && waiting_.empty() && folder_.progress().complete()) return 0;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

  /// A message: above the panel where there is one.
  void say(const std::string& text) {
    if (has_panel_) return live_.print(text + "\n");
    std::cerr << text << std::endl;
  }

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
    return code;
  }

  int at_once() const { return auto_ ? auto_->search.runs() : folder_.spec().parallel; }

  bool has_room() const {
    if (static_cast<int>(active_.size()) >= at_once()) return false;
    if (!auto_ || !auto_->shares_cores) return true;
    double taken = 1.0 / at_once();
    for (const ActiveRun& active : active_) taken += 1.0 / active.at_once;
    return taken < 1 + 1e-6;
  }

  void wait(const SweepRun& run) {
    waiting_.push_back(run);
    open_steps_[run] = agent_steps_of_run(folder_.wanted(run).folder);
  }

  void start_runs() {
    while (has_room()) {
      if (waiting_.empty()) {
        const std::optional<SweepJob> job = folder_.progress().next();
        if (!job) return;
        folder_.begin(*job);
        for (const uint64_t seed : folder_.spec().seeds) wait({job->trial, job->rung, seed});
      }
      // A run of a sweep that was killed may be saving still.
      const SweepRun run = waiting_.front();
      const WantedRun wanted = folder_.wanted(run);
      if (lock_owner(wanted.folder)) return;
      waiting_.pop_front();
      std::vector<std::string> arguments = arguments_for(wanted);
      if (auto_ && auto_->sets_threads) arguments.insert(arguments.end(), {"--set", auto_->threads()});
      active_.emplace_back(folder_, run, ++last_id_, at_once(), std::move(arguments));
    }
  }

  /// Now and then: how far the runs are, for the panel and for parallel: auto.
  void look() {
    const bool measures = auto_ && !auto_->search.is_settled();
    if ((!has_panel_ && !measures) || SweepClock::now() < next_look_) return;
    next_look_ = SweepClock::now() + std::chrono::milliseconds(500);
    for (ActiveRun& active : active_) active.tail.look();
    if (measures) measure();
    if (has_panel_) draw();
  }

  void measure() {
    ParallelSearch& search = auto_->search;
    std::vector<RunReading> readings;
    for (const ActiveRun& active : active_)
      if (!auto_->shares_cores || active.at_once == search.runs()) readings.push_back(active.reading());
    auto_->meter.look(readings);
    const std::optional<double> rate = auto_->meter.rate();
    if (!rate) return;
    note_decision(search.measured(*rate));
    auto_->meter.begin(search.runs());
  }

  void note_decision(const std::string& text) {
    if (!quiet_) say(text);
  }

  /// A run has failed by itself while one more than before was tried: there may be no room for so many. It, and those
  /// that went on beside it, are tried once more. Whether that holds for this run.
  bool is_forgiven(const ActiveRun& active, int code) {
    constexpr int kFailed = 1;  // not by its settings (2) and not by what it learned (3)
    if (!auto_ || (code != kFailed && code < 128)) return false;
    if (!auto_->search.is_settled() && auto_->search.runs() > 1) {
      note_decision(cat(auto_->search.failed(), "; see ", folder_.log_of(active.run).string()));
      for (ActiveRun& beside : active_) beside.is_forgiven = true;
    }
    return active.is_forgiven;
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

  void settle(ActiveRun& active, int code) {
    const SweepRun& run = active.run;
    const WantedRun wanted = folder_.wanted(run);
    const double steps = agent_steps_of_run(wanted.folder);
    const bool there =
        code == 0 || (code == kOutOfTime && wanted.stop_at && steps >= static_cast<double>(*wanted.stop_at));
    const bool stops = StopRequest::signal() != 0 || stop_code() != 0;
    if (!there && !stops && is_forgiven(active, code)) return wait(run);
    if (!there && (code == kOutOfTime || code >= 128)) {
      // Stopped before its end, its state being saved: it goes on later, if it gets anywhere.
      if (steps > active.first.agent_steps || stops) return wait(run);
    }
    if (there && auto_ && !auto_->search.is_settled() && active.at_once == auto_->search.runs()) {
      active.tail.look();
      auto_->meter.ended(active.first, active.reading());
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
    open_steps_.erase(run);
    tell_result(run, result);
  }

  void tell_result(const SweepRun& run, const SweepResult& result) {
    if (!result.value && result.exit_code != 0)
      say(cat("trial ", run.trial, ", seed ", run.seed, " failed (exit code ", result.exit_code, "), see ",
              folder_.log_of(run).string(), "\n", tail_of(folder_.log_of(run))));
    if (quiet_) return;
    const auto leader = folder_.progress().best();
    say(cat("trial ", run.trial, ", seed ", run.seed, ", ", print_short(result.agent_steps),
            " agent-steps: ", result.value ? print_number(*result.value) : "no value", "; ",
            folder_.progress().n_compared(), " of ", folder_.progress().n_trials(), " trials",
            leader ? cat(", best: trial ", leader->first, " with ", print_number(leader->second)) : std::string()));
  }

  SweepOutlook outlook() const { return outlook_of(folder_.spec(), folder_.progress(), folder_.rungs(), open_steps_); }

  void draw() {
    for (const ActiveRun& active : active_) open_steps_[active.run] = active.tail.agent_steps();
    live_.show(sweep_panel(panel_state(), live_.size(), style_), style_);
  }

  SweepPanelState panel_state() const {
    const std::vector<int64_t>& rungs = folder_.rungs();
    SweepPanelState s = panel_state_of(name_of_sweep(folder_.path()), folder_.spec(), folder_.progress(), rungs);
    s.folder = folder_.path().string();
    s.runs_at_once = cat(at_once(), auto_ ? (auto_->search.is_settled() ? " (auto)" : " (auto, measuring)") : "");
    const SweepOutlook ahead = outlook();
    s.share_done = ahead.all > 0 ? 1 - ahead.left / ahead.all : 0;
    s.seconds = seconds_since(start_);
    if (ahead.left < left_at_start_) s.seconds_left = s.seconds * ahead.left / (left_at_start_ - ahead.left);
    for (const ActiveRun& active : active_) {
      s.agent_steps_per_second += active.tail.speed();
      s.runs.push_back({active.run.trial, active.run.seed, active.tail.agent_steps(),
                        static_cast<double>(rungs.at(static_cast<size_t>(active.run.rung))), active.tail.metric()});
    }
    return s;
  }

  SweepFolder& folder_;
  const bool quiet_, has_panel_;
  const TerminalStyle style_ = terminal_style();
  LiveLines live_{STDERR_FILENO};
  std::optional<AutoParallel> auto_;  // parallel: auto
  const SweepClock::time_point start_ = SweepClock::now();
  SweepClock::time_point next_look_ = start_;
  double left_at_start_ = 0;               // agent-steps
  std::map<SweepRun, double> open_steps_;  // agent-steps of the runs that have no result yet
  int64_t last_id_ = 0;
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
          "only note a result, as '{\"trial\": 3, \"rung\": 0, \"value\": 0.8}', or settings to be tried next, as "
          "'{\"settings\": {\"mappo.gamma\": 0.99}}'")
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
      "Exit codes: 0 all is done; 124 max_wall_time is over; 130 or 143 stopped.\n"
      "Examples:\n"
      "  gigastep sweep rates.yaml\n"
      "  gigastep sweep rates.yaml --out /data/rates --json result.json");
  command->callback(
      [options, &dispatch] { dispatch.run = [options, &dispatch] { dispatch.exit_code = sweep(*options); }; });
}

}  // namespace giga
