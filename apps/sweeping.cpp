#include "apps/sweeping.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <list>
#include <map>
#include <thread>

#include "apps/run_process.hpp"
#include "apps/stop_request.hpp"
#include "apps/stopwatch.hpp"
#include "apps/training.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/files.hpp"
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

using SweepClock = std::chrono::steady_clock;

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
  double wanted_agent_steps;
  RunProcess process;
  RunTail tail;
  RunReading first;  ///< when this process began
  Stopwatch watch;
  bool is_forgiven = false;  ///< it may fail once: there were too many

  ActiveRun(const SweepFolder& folder, const SweepRun& of, int64_t number, int n, std::vector<std::string> arguments)
      : run(of),
        id(number),
        at_once(n),
        wanted_agent_steps(static_cast<double>(folder.agent_steps(of.trial, of.rung))),
        process(arguments, folder.log_of(of)),
        tail(folder.spec(), folder.wanted(of).folder) {
    tail.look();
    first = reading();
  }
  RunReading reading() const {
    return {id, tail.agent_steps(), tail.update_seconds(), tail.agent_steps() != first.agent_steps};
  }
};

/// The runs of a sweep, as many at once as it says: starts, watches, stops them and takes in their results.
class Sweeping {
 public:
  Sweeping(SweepFolder& folder, bool quiet)
      : folder_(folder), quiet_(quiet), has_panel_(!quiet && stderr_is_terminal()) {
    if (!folder.spec().parallel.is_auto()) return;
    auto_.emplace(folder.spec(), load_run_config((folder.path() / "config.yaml").string(), {}).config);
  }

  /// Until all is done, or it is asked to stop, or its time is over; then the runs that go on are saved. The exit code
  /// of train_sweep.
  int run() {
    const StopRequest signals;
    folder_.reopen_failed();
    for (const SweepRun& run : folder_.progress().open()) wait(run);
    left_at_start_ = outlook().left;
    const int code = go_on();
    if (has_panel_) {
      draw();
      live_.leave();
    }
    if (code != 0)
      say(cat("stopped (", code == kOutOfTime ? "max_wall_time is over" : signal_name(code - 128), "), all runs ",
              unsaved_ > 0 ? cat("but ", unsaved_, " are saved (logs/ says why)") : "are saved",
              "; the same command goes on"));
    return code != 0 ? code : tell_failures();
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
    return limit && watch_.seconds() >= limit->seconds ? kOutOfTime : 0;
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
      // A run of a sweep that was killed may be saving still, or somebody resumes it by hand: others go first.
      const auto is_free = [this](const SweepRun& run) { return !lock_owner(folder_.wanted(run).folder); };
      auto free = std::find_if(waiting_.begin(), waiting_.end(), is_free);
      if (free == waiting_.end()) {
        const std::optional<SweepJob> job = folder_.progress().next();
        if (!job) return tell_locked();
        folder_.begin(*job);
        for (const uint64_t seed : folder_.spec().seeds) wait({job->trial, job->rung, seed});
        continue;
      }
      const SweepRun run = *free;
      const WantedRun wanted = folder_.wanted(run);
      waiting_.erase(free);
      clear_beginning(wanted);
      std::vector<std::string> arguments = arguments_for(wanted);
      if (auto_ && auto_->sets_threads) arguments.insert(arguments.end(), {"--set", auto_->threads()});
      active_.emplace_back(folder_, run, ++last_id_, at_once(), std::move(arguments));
    }
  }

  /// Once, where nothing else goes on meanwhile.
  void tell_locked() {
    if (told_locked_ || waiting_.empty() || !active_.empty()) return;
    const fs::path folder = folder_.wanted(waiting_.front()).folder;
    const auto owner = lock_owner(folder);
    if (!owner) return;
    told_locked_ = true;
    say(cat("waiting for ", folder.string(), ", which process ", *owner, " uses"));
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
    // Not by its settings (2) and not by what it learned (3).
    if (!auto_ || (code != SweepResult::kFailed && code < 128)) return false;
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
    if (!there && stops) ++unsaved_;
    SweepResult result{std::nullopt, there ? 0 : code, active.watch.seconds(), steps};
    if (there) {
      const int64_t end = folder_.agent_steps(run.trial, run.rung);  // somebody may have trained it further
      result.value = metric_of_run(folder_.spec(), wanted.folder, end);
      result.agent_steps = agent_steps_of_run(wanted.folder, end);
      // Of all processes that took it here from the rung before.
      result.seconds = seconds_of_run(wanted.folder, end);
      for (int rung = 0; rung < run.rung; ++rung)
        if (const SweepResult* before = folder_.progress().result({run.trial, rung, run.seed}))
          result.seconds -= before->seconds;
    }
    folder_.finish(run, result);
    open_steps_.erase(run);
    tell_result(run, result);
  }

  /// What is left of failures when all is done, and the exit code that says so.
  int tell_failures() {
    const int code = folder_.progress().failure_code();
    if (code == 0) return 0;
    say(cat(counted(folder_.progress().n_failed(), "runs"), " failed",
            code == SweepResult::kDiverged ? ": training diverged with all settings"
                                           : "; the same command tries again those that did not diverge"));
    return code;
  }

  void tell_result(const SweepRun& run, const SweepResult& result) {
    if (result.has_failed())
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
    SweepPanelState s = panel_state_of(name_of_folder(folder_.path()), folder_.spec(), folder_.progress(), rungs);
    s.folder = folder_.path().string();
    s.runs_at_once = cat(at_once(), auto_ ? (auto_->search.is_settled() ? " (auto)" : " (auto, measuring)") : "");
    const SweepOutlook ahead = outlook();
    s.share_done = ahead.all > 0 ? 1 - ahead.left / ahead.all : 0;
    s.seconds = watch_.seconds();
    if (ahead.left < left_at_start_) s.seconds_left = s.seconds * ahead.left / (left_at_start_ - ahead.left);
    for (const ActiveRun& active : active_) {
      s.agent_steps_per_second += active.tail.speed();
      s.runs.push_back({active.run.trial, active.run.seed, active.tail.agent_steps(), active.wanted_agent_steps,
                        active.tail.metric()});
    }
    return s;
  }

  SweepFolder& folder_;
  const bool quiet_, has_panel_;
  const TerminalStyle style_ = terminal_style();
  LiveLines live_{STDERR_FILENO};
  std::optional<AutoParallel> auto_;  // parallel: auto
  const Stopwatch watch_;
  SweepClock::time_point next_look_ = SweepClock::now();
  double left_at_start_ = 0;               // agent-steps
  std::map<SweepRun, double> open_steps_;  // agent-steps of the runs that have no result yet
  int64_t last_id_ = 0;
  std::list<SweepRun> waiting_;
  bool told_locked_ = false;
  int unsaved_ = 0;  // runs that failed while they were stopped
  std::list<ActiveRun> active_;
};

}  // namespace

int train_sweep(SweepFolder& folder, bool quiet) { return Sweeping(folder, quiet).run(); }

}  // namespace giga
