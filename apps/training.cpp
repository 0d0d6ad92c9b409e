// The training loop.
#include "apps/training.hpp"

#include <array>
#include <chrono>
#include <exception>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <utility>

#include "apps/evaluations.hpp"
#include "apps/follow.hpp"
#include "apps/joined_ranks.hpp"
#include "apps/long_work.hpp"
#include "apps/metrics_files.hpp"
#include "apps/program_info.hpp"
#include "apps/stop_request.hpp"
#include "apps/stopwatch.hpp"
#include "apps/training_progress.hpp"
#include "apps/watcher.hpp"
#include "core/error.hpp"
#include "io/host_info.hpp"
#include "io/number.hpp"
#include "io/progress.hpp"
#include "io/state_hash.hpp"
#include "report/report.hpp"

namespace giga {
namespace {

constexpr std::chrono::seconds kTextCadence{10};

constexpr std::array kColumns = {"update",
                                 "agent_steps",
                                 "seconds",
                                 "update_seconds",
                                 "rollout_seconds",
                                 "learning_seconds",
                                 "evaluation_seconds",
                                 "checkpoint_seconds",
                                 "agent_steps_per_second"};

TerminalStyle style_of(bool color) {
  TerminalStyle style = terminal_style();
  style.color = style.color && color;
  return style;
}

/// Whether train.stop_at_agent_steps are done.
bool stops_at(const TrainConfig& train, int64_t agent_steps) {
  return train.stop_at_agent_steps && agent_steps >= *train.stop_at_agent_steps;
}

class Training {
 public:
  Training(const RunFolder& folder, TrainingSetup setup);

  /// A new run: opens its files and keeps its state before the first update.
  void start();
  /// Goes on from a checkpoint: removes later updates from the files.
  void go_on(const Checkpoint& from, bool settings_changed);
  /// All updates that are left; returns the exit code.
  int run();

 private:
  void update();
  bool complete() const { return learner_->agent_steps_done() >= config_.train.total_agent_steps; }
  bool at_stop() const { return stops_at(config_.train, learner_->agent_steps_done()); }
  /// " of 50" where the number of updates is known.
  std::string of_updates() const { return n_updates_ ? cat(" of ", *n_updates_) : ""; }
  void print_end(bool has_report) const;
  MetricsRow row(double seconds, double evaluation_seconds, const Metrics& metrics, bool evaluated) const;
  void write_row(const MetricsRow& row, bool evaluated);
  void save(bool is_best);
  [[noreturn]] void fail_diverged(const Divergence& what);
  int exit_code_of_stop() const {
    return agreed_stop(ranks_.get(), stop_code(config_.train, learner_->agent_steps_done(), watch_.seconds()));
  }
  int stop_early(int code);
  bool write_final_report();
  Checkpoint checkpoint() const;
  double total_seconds() const { return cursor_.seconds + watch_.seconds(); }
  bool is_due(int every) const {
    const int64_t update = learner_->updates_done();
    return complete() || at_stop() || (every > 0 && update % every == 0);
  }

  const Stopwatch watch_;  // of this process
  const LoadedRun run_;
  const RunConfig& config_;
  const Device device_;
  const RunFolder& folder_;
  const std::shared_ptr<Ranks> ranks_;  // null: no others
  const std::unique_ptr<Learner> learner_;
  const std::optional<int64_t> n_updates_;  // none: known only afterwards
  Logger log_;
  Progress progress_;
  TrainingProgress shown_;
  LongWork work_;
  std::optional<MetricsFiles> metrics_files_;

  RunCursor cursor_;               // seconds: of earlier processes
  int64_t first_update_ = 0;       // that this process does, less one
  int64_t first_agent_steps_ = 0;  // done before it
  int64_t saved_update_ = -1;      // of the newest checkpoint
  std::string refusal_;            // why games are not recorded, as it was told last
  Evaluations evaluations_;
  double update_seconds_ = 0, checkpoint_seconds_ = 0;
  double speed_ = 0;  // agent-steps per second of the latest update
};

Training::Training(const RunFolder& folder, TrainingSetup setup)
    : run_(std::move(setup.run)),
      config_(run_.config),
      device_(setup.device),
      folder_(folder),
      ranks_(std::move(setup.ranks)),
      learner_(std::move(setup.learner)),
      n_updates_(total_updates(config_, run_.spec.params.n_agents)),
      log_(folder.log_file(), setup.quiet ? Logger::Console::quiet : Logger::Console::all),
      progress_(log_, progress_mode(setup.quiet), kTextCadence, style_of(setup.color)),
      shown_(run_, device_, folder_, n_updates_, progress_),
      work_(*learner_, of_updates(), log_, progress_),
      evaluations_(run_, device_, folder_, log_) {
  if (folder_.lock().stale_owner())
    log_.info("took over the run folder from " + *folder_.lock().stale_owner() + ", which is gone");
  if (folder_.begins_anew())
    log_.info("the run in " + folder_.path().string() + " was ended before its first checkpoint: it begins anew");
}

void Training::start() {
  metrics_files_.emplace(folder_, run_);
  const std::string length = n_updates_
                                 ? counted(*n_updates_, algorithm_of(config_).updates)
                                 : print_short(static_cast<double>(config_.train.total_agent_steps)) + " agent-steps";
  log_.info(cat("training ", config_.scenario, " with ", config_.train.algorithm, " on ", device_.name(), ": ", length,
                ", results in ", folder_.path().string()));
  if (ranks_) log_.info(cat("shared by ", ranks_->size(), " ranks"));
  save(false);
}

void Training::go_on(const Checkpoint& from, bool settings_changed) {
  cursor_ = from.cursor;
  first_update_ = saved_update_ = from.updates;
  first_agent_steps_ = from.agent_steps;
  metrics_files_.emplace(folder_, cursor_);
  log_.info(cat("going on after update ", from.updates, of_updates(), " on ", device_.name(), ", state ",
                state_sha256(from.arrays).substr(0, 16), "..., results in ", folder_.path().string()));
  if (ranks_) log_.info(cat("shared by ", ranks_->size(), " ranks"));
  if (settings_changed) save(false);
}

int Training::run() {
  const StopRequest signals;
  if (const std::string ways = learner_->ways(); !ways.empty()) log_.info(ways);
  if (const std::string way = learner_->step_way(); !way.empty()) log_.info("worlds step by " + way);
  const Watcher watcher([this] { work_.look(); });
  while (!complete()) {
    if (const int code = exit_code_of_stop()) return stop_early(code);
    update();
  }
  progress_.finish();
  log_.note(cat("done after ", total_seconds(), " s"));
  metrics_files_->end();
  print_end(write_final_report());
  return 0;
}

/// Where everything is, and what to do with it next; not the evaluation, whose result stands here.
void Training::print_end(bool has_report) const {
  const std::string run = shell_word(folder_.path().string()), program = program_command();
  std::error_code code;
  const int team = learner_->actor(0) ? 0 : 1;  // that has learned
  const std::string game = team == 0 ? cat(run, " --vs circle") : cat("circle --vs ", run);
  std::cout << results_table(evaluations_.results());
  if (has_report) std::cout << "report:      " << folder_.report_file().string() << '\n';
  std::cout << "checkpoints: " << folder_.checkpoint_file(learner_->updates_done()).string() << " (the last)";
  if (std::filesystem::exists(folder_.best_file(), code))
    std::cout << ", " << folder_.best_file().string() << " (the best, after "
              << counted(cursor_.best_updates, algorithm_of(config_).updates) << ")";
  if (std::filesystem::exists(folder_.replays_page(), code))
    std::cout << "\ngames:       " << folder_.replays_page().string();
  std::cout << "\nnext:        " << program << " rate " << run << "      Elo of its checkpoints and the scripts"
            << "\n             " << program << " record " << game << " --out game      games to watch: game.html"
            << "\n             " << program << " report " << run << " OTHER_RUN --out compare.html"
            << "\n             " << program << " export " << run << " --team " << team << " --format onnx --out policy"
            << std::endl;
}

void Training::update() {
  Metrics metrics;
  const int64_t steps_before = learner_->agent_steps_done();
  update_seconds_ = work_.update([&] { metrics = learner_->update(); });
  speed_ = static_cast<double>(learner_->agent_steps_done() - steps_before) / update_seconds_;
  if (const auto divergence = learner_->divergence()) fail_diverged(*divergence);

  // All below is diagnostics: nothing here changes what is learned.
  if (const std::string refusal = learner_->refusal(); std::exchange(refusal_, refusal) != refusal)
    log_.note("the GPU takes no recorded steps, so training queues them one by one: " + refusal);
  if (learner_->updates_done() == first_update_ + 1)
    log_.note(cat("first update done ", watch_.seconds(), " s after the start"));
  const bool evaluates = is_due(config_.eval.every_updates);
  const double evaluation_seconds = evaluates ? work_.evaluation([&] { evaluations_.play(*learner_); }) : 0;
  write_row(row(total_seconds(), evaluation_seconds, metrics, evaluates), evaluates);
  if (evaluates)
    log_.note(cat("evaluation after update ", learner_->updates_done(), ":\n", results_table(evaluations_.results())));

  // Of equal ones the newest that is saved anyway: it has learned longest, and often all games are won.
  const bool is_saved = is_due(config_.checkpoint.every_updates);
  const double score = evaluates ? evaluation_score(evaluations_.results()) : -1;
  const bool is_best = config_.checkpoint.keep_best && score >= 0 &&
                       (score > cursor_.best_score || (is_saved && score == cursor_.best_score));
  if (is_best) {
    cursor_.best_score = score;
    cursor_.best_updates = learner_->updates_done();
  }
  checkpoint_seconds_ = 0;
  if (as_rank_0_says(ranks_.get(), is_best || is_saved)) checkpoint_seconds_ = timed([&] { save(is_best); });

  shown_.show(*learner_,
              {.metrics = metrics,
               .results = evaluations_.results(),
               .agent_steps_per_second = speed_,
               .evaluation_seconds = evaluation_seconds,
               .seconds = total_seconds()},
              first_agent_steps_);
}

MetricsRow Training::row(double seconds, double evaluation_seconds, const Metrics& metrics, bool evaluated) const {
  const UpdateTimes times = learner_->times();
  const std::array<double, kColumns.size()> values = {static_cast<double>(learner_->updates_done()),
                                                      static_cast<double>(learner_->agent_steps_done()),
                                                      seconds,
                                                      update_seconds_,
                                                      times.rollout,
                                                      times.learning,
                                                      evaluation_seconds,
                                                      checkpoint_seconds_,
                                                      speed_};
  MetricsRow row;
  for (size_t k = 0; k < kColumns.size(); ++k) row.emplace_back(kColumns[k], values[k]);
  row.insert(row.end(), metrics.begin(), metrics.end());
  const MetricsRow evaluation =
      evaluation_metrics(config_, evaluated ? evaluations_.results() : std::vector<TeamResult>());
  row.insert(row.end(), evaluation.begin(), evaluation.end());
  return row;
}

void Training::write_row(const MetricsRow& row, bool evaluated) {
  MetricsRow rates;
  if (evaluated)
    for (const auto& figure : evaluation_metrics(config_, evaluations_.results()))
      if (figure.first.starts_with("win_rate")) rates.push_back(figure);
  metrics_files_->write(learner_->updates_done(), learner_->agent_steps_done(), row, rates);
}

Checkpoint Training::checkpoint() const {
  Checkpoint c;
  c.gigastep_version = program_version();
  c.scenario_name = config_.scenario;
  c.config_yaml = print_yaml(config_, true);
  c.scenario_yaml = print_scenario(run_.scenario);
  c.updates = learner_->updates_done();
  c.agent_steps = learner_->agent_steps_done();
  c.seed = config_.seed;
  c.cursor = cursor_;
  c.cursor.seconds = total_seconds();
  metrics_files_->note_sizes(c.cursor);
  learner_->save(c.arrays);
  return c;
}

void Training::save(bool is_best) {
  // First what the checkpoint counts on: the rows and the games up to here.
  metrics_files_->flush_to_disk();
  const Checkpoint now = checkpoint();
  const std::exception_ptr lost = evaluations_.replays().ended();
  expect_same_state(ranks_.get(), now.arrays);
  folder_.save(now, config_.checkpoint.keep, is_best);
  saved_update_ = learner_->updates_done();
  if (lost) std::rethrow_exception(lost);
}

void Training::fail_diverged(const Divergence& what) {
  progress_.finish();
  Checkpoint dump = checkpoint();
  learner_->save_batch(dump.arrays);
  const std::filesystem::path file = folder_.path() / cat("diverged_update_", what.update, "_team_", what.team, ".h5");
  write_checkpoint(file, dump);
  const std::string whose = what.ranks.empty() ? "" : cat(" of rank ", what.ranks.front());
  const std::string reason = cat(told(what, ranks_.get()), "; the batch", whose, " is in ", file.string(),
                                 ", the last good checkpoint is ", folder_.checkpoint_file(saved_update_).string());
  log_.error(reason);
  throw Error(reason, ErrorKind::diverged);
}

int Training::stop_early(int code) {
  progress_.finish();
  if (saved_update_ != learner_->updates_done()) save(false);
  const bool out_of_time = code == kOutOfTime;
  const std::string reason = !out_of_time ? signal_name(code - 128)
                             : at_stop()  ? "train.stop_at_agent_steps are done"
                                          : "train.max_wall_time is over";
  std::string how;  // resume keeps what stopped the run
  if (out_of_time && at_stop()) how = " --set train.stop_at_agent_steps=none";
  if (out_of_time && !at_stop())
    how = cat(", for another ", FieldCodec<Duration>::print(*config_.train.max_wall_time),
              "; with --set train.max_wall_time=none to the end");
  log_.info(cat("stopped after update ", learner_->updates_done(), of_updates(), " (", reason,
                "), the state is saved; to go on: ", program_command(), " resume ", shell_word(folder_.path().string()),
                how));
  write_final_report();
  return code;
}

bool Training::write_final_report() {
  evaluations_.replays().wait();
  if (learner_->updates_done() == 0) return false;  // no figures yet
  write_replays_page(folder_, learner_->updates_done());
  RunCursor written;
  metrics_files_->note_sizes(written);
  if (written.metrics_bytes == 0) return false;  // begun anew, and stopped before the first row
  // What others left in the folder must not make a training fail that is done.
  try {
    write_report({folder_.path()}, folder_.report_file(), list_fields<RunConfig>());
    return true;
  } catch (const InputError& e) {
    log_.warn(cat("the report was not written: ", e.what()));
    return false;
  }
}

}  // namespace

int stop_code(const TrainConfig& train, int64_t agent_steps, double seconds) {
  if (const int signal = StopRequest::signal()) return 128 + signal;
  if (stops_at(train, agent_steps)) return kOutOfTime;
  return train.max_wall_time && seconds >= train.max_wall_time->seconds ? kOutOfTime : 0;
}

int train_in(const RunFolder& folder, TrainingSetup setup) {
  const Checkpoint* from = setup.from;
  const bool settings_changed = setup.settings_changed;
  Training training(folder, std::move(setup));
  from ? training.go_on(*from, settings_changed) : training.start();
  return training.run();
}

std::vector<std::string> training_columns() { return {kColumns.begin(), kColumns.end()}; }

std::string advice_to_resume(const std::filesystem::path& folder) {
  if (!has_checkpoint(folder)) return "";
  return cat("what was done until ", newest_checkpoint(folder).string(),
             " is saved; to go on from there: ", program_command(), " resume ", shell_word(folder.string()));
}

Json run_info(const LoadedRun& run, Device device) {
  return {{"scenario", run.config.scenario},  {"algorithm", run.config.train.algorithm},
          {"seed", run.config.seed},          {"started", utc_now()},
          {"command_line", command_line()},   {"versions", version_info()},
          {"hardware", hardware_info(device)}};
}

}  // namespace giga
