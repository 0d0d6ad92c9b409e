// The training loop.
#include "apps/training.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <exception>
#include <filesystem>
#include <functional>
#include <iostream>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

#include "apps/evaluations.hpp"
#include "apps/follow.hpp"
#include "apps/joined_ranks.hpp"
#include "apps/metrics_files.hpp"
#include "apps/program_info.hpp"
#include "apps/stop_request.hpp"
#include "apps/watcher.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "cuda/sensors.hpp"
#include "io/host_info.hpp"
#include "io/number.hpp"
#include "io/progress.hpp"
#include "io/state_hash.hpp"
#include "report/report.hpp"

namespace giga {
namespace {

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

double value_of(const Metrics& metrics, const std::string& name) {
  for (const auto& [key, value] : metrics)
    if (key == name) return value;
  return std::numeric_limits<double>::quiet_NaN();
}

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
  void go_on(const Checkpoint& from);
  /// All updates that are left; returns the exit code.
  int run();

 private:
  void update();
  void work(const std::function<void()>& f);
  void look();
  std::string stage_text() const;
  std::string time_left() const;
  bool complete() const { return learner_->agent_steps_done() >= config_.train.total_agent_steps; }
  bool at_stop() const { return stops_at(config_.train, learner_->agent_steps_done()); }
  /// " of 50" where the number of updates is known.
  std::string of_updates() const { return n_updates_ ? cat(" of ", *n_updates_) : ""; }
  void print_end() const;
  MetricsRow row(double seconds, double evaluation_seconds, const Metrics& metrics, bool evaluated) const;
  void write_row(const MetricsRow& row, bool evaluated);
  void save(bool is_best);
  void show(const Metrics& metrics);
  [[noreturn]] void fail_diverged(const Divergence& what);
  int exit_code_of_stop() const {
    return agreed_stop(ranks_.get(), stop_code(config_.train, learner_->agent_steps_done(), watch_.seconds()));
  }
  int stop_early(int code);
  void write_final_report();
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
  ProgressState state_;
  std::optional<GpuSensors> sensors_;  // of a GPU
  std::optional<MetricsFiles> metrics_files_;

  RunCursor cursor_;               // seconds: of earlier processes
  int64_t first_update_ = 0;       // that this process does, less one
  int64_t first_agent_steps_ = 0;  // done before it
  int64_t saved_update_ = -1;      // of the newest checkpoint
  std::string refusal_;            // why games are not recorded, as it was told last
  Evaluations evaluations_;
  double update_seconds_ = 0, checkpoint_seconds_ = 0;
  double speed_ = 0;  // agent-steps per second of the latest update
  // While the main thread works on an update or an evaluation, the watcher may write messages.
  std::mutex messages_;
  std::unique_lock<std::mutex> our_turn_{messages_};
  double work_began_ = 0, learning_began_ = 0;  // seconds
  int64_t working_on_ = 0;                      // number of the update
  bool evaluates_ = false, answered_ = false;   // now; the request to stop
  double sensors_read_at_ = -1;
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
      evaluations_(run_, device_, folder_, log_) {
  state_.title = cat(config_.scenario, ", ", config_.train.algorithm, ", seed ", config_.seed, ", ", device_.name());
  if (device_.is_cuda()) {
    sensors_.emplace(device_.index);
    state_.title += cat(" (", cuda_device_info(device_.index).name, ")");
  }
  state_.folder = folder_.path().string();
  state_.n_updates = n_updates_.value_or(0);
  state_.total_agent_steps = config_.train.total_agent_steps;
  if (const auto per_update = algorithm_of(config_).agent_steps_per_update)
    state_.total_agent_steps = *n_updates_ * per_update(config_, run_.spec.params.n_agents);
  if (folder_.lock().stale_owner())
    log_.info("took over the run folder from " + *folder_.lock().stale_owner() + ", which is gone");
}

void Training::start() {
  metrics_files_.emplace(folder_, run_);
  const std::string length = n_updates_
                                 ? cat(*n_updates_, " ", algorithm_of(config_).updates)
                                 : print_short(static_cast<double>(config_.train.total_agent_steps)) + " agent-steps";
  log_.info(cat("training ", config_.scenario, " with ", config_.train.algorithm, " on ", device_.name(), ": ", length,
                ", results in ", folder_.path().string()));
  if (ranks_) log_.info(cat("shared by ", ranks_->size(), " ranks"));
  save(false);
}

void Training::go_on(const Checkpoint& from) {
  cursor_ = from.cursor;
  first_update_ = saved_update_ = from.updates;
  first_agent_steps_ = from.agent_steps;
  metrics_files_.emplace(folder_, cursor_);
  log_.info(cat("going on after update ", from.updates, of_updates(), " on ", device_.name(), ", state ",
                state_sha256(from.arrays).substr(0, 16), "..., results in ", folder_.path().string()));
  if (ranks_) log_.info(cat("shared by ", ranks_->size(), " ranks"));
}

int Training::run() {
  const StopRequest signals;
  if (const std::string ways = learner_->ways(); !ways.empty()) log_.info(ways);
  if (const std::string way = learner_->step_way(); !way.empty()) log_.info("worlds step by " + way);
  const Watcher watcher([this] { look(); });
  while (!complete()) {
    if (const int code = exit_code_of_stop()) return stop_early(code);
    update();
  }
  progress_.finish();
  log_.note(cat("done after ", total_seconds(), " s"));
  metrics_files_->end();
  write_final_report();
  print_end();
  return 0;
}

/// Where everything is, and what to do with it next; not the evaluation, whose result stands here.
void Training::print_end() const {
  const std::string run = shell_word(folder_.path().string()), program = program_command();
  std::error_code code;
  std::cout << results_table(evaluations_.results()) << "report:      " << folder_.report_file().string()
            << "\ncheckpoints: " << folder_.checkpoint_file(learner_->updates_done()).string() << " (the last)";
  if (std::filesystem::exists(folder_.best_file(), code))
    std::cout << ", " << folder_.best_file().string() << " (the best, after " << cursor_.best_updates << " "
              << algorithm_of(config_).updates << ")";
  if (std::filesystem::exists(folder_.replays_page(), code))
    std::cout << "\ngames:       " << folder_.replays_page().string();
  std::cout << "\nnext:        " << program << " rate " << run << "      Elo of its checkpoints and the scripts"
            << "\n             " << program << " record " << run
            << " --vs circle --out game      games to watch: game.html"
            << "\n             " << program << " report " << run << " OTHER_RUN --out compare.html"
            << "\n             " << program << " export " << run << " --team 0 --format onnx --out policy" << std::endl;
}

/// Work that takes long, during which the watcher may speak.
void Training::work(const std::function<void()>& f) {
  work_began_ = watch_.seconds();
  learning_began_ = -1;
  working_on_ = learner_->updates_done() + 1;
  struct OthersTurn {
    std::unique_lock<std::mutex>& ours;
    explicit OthersTurn(std::unique_lock<std::mutex>& lock) : ours(lock) { ours.unlock(); }
    ~OthersTurn() { ours.lock(); }
  };
  const OthersTurn turn(our_turn_);
  f();
}

/// "playing, step 12 of 32".
std::string Training::stage_text() const {
  const UpdateStage stage = learner_->stage();
  return stage.of > 0 ? cat(stage.doing, " ", stage.done, " of ", stage.of) : stage.doing;
}

/// ", about 20 s": what the last update took, less what this one has; of a first one what its stage says.
std::string Training::time_left() const {
  const double now = watch_.seconds();
  const auto text = [](double seconds, const char* behind) {
    const double whole = std::max(1.0, std::round(seconds));
    return cat(", about ", whole < 60 ? cat(whole, " s") : print_duration(whole), behind);
  };
  if (update_seconds_ > 0) return text(update_seconds_ - (now - work_began_), "");
  const UpdateStage stage = learner_->stage();
  const double began = learning_began_ >= 0 ? learning_began_ : work_began_;
  if (stage.of == 0 || stage.done == 0) return cat(" (", stage_text(), ")");
  const double left = (now - began) * static_cast<double>(stage.of - stage.done) / static_cast<double>(stage.done);
  return text(left, learning_began_ >= 0 ? "" : " and the learning behind it");
}

/// The watcher's: answers a request to stop, and shows how the first update of this process goes on.
void Training::look() {
  const std::unique_lock turn(messages_, std::try_to_lock);
  if (!turn) return;
  if (learning_began_ < 0 && std::string_view(learner_->stage().doing).starts_with("learning"))
    learning_began_ = watch_.seconds();
  if (const int signal = StopRequest::signal(); signal != 0 && !answered_) {
    answered_ = true;
    const std::string what =
        evaluates_ ? "finishing the evaluation" : cat("finishing update ", working_on_, time_left());
    log_.answer(what + (signal == SIGINT ? "; Ctrl-C again ends without saving" : ""));
  }
  constexpr double kPatience = 1;
  if (working_on_ != first_update_ + 1 || evaluates_ || watch_.seconds() - work_began_ < kPatience) return;
  progress_.wait_line(cat("update ", working_on_, of_updates(), ": ", stage_text(), ", for ",
                          print_duration(watch_.seconds() - work_began_)));
}

void Training::update() {
  Metrics metrics;
  const int64_t steps_before = learner_->agent_steps_done();
  const double seconds = timed([&] { work([&] { metrics = learner_->update(); }); });
  update_seconds_ = seconds;
  speed_ = static_cast<double>(learner_->agent_steps_done() - steps_before) / update_seconds_;
  if (const auto divergence = learner_->divergence()) fail_diverged(*divergence);

  // All below is diagnostics: nothing here changes what is learned.
  if (const std::string refusal = learner_->refusal(); std::exchange(refusal_, refusal) != refusal)
    log_.note("the GPU takes no recorded steps, so training queues them one by one: " + refusal);
  if (learner_->updates_done() == first_update_ + 1)
    log_.note(cat("first update done ", watch_.seconds(), " s after the start"));
  const bool evaluates = is_due(config_.eval.every_updates);
  double evaluation_seconds = 0;
  if (evaluates) {
    evaluates_ = true;
    evaluation_seconds = timed([&] { work([&] { evaluations_.play(*learner_); }); });
    evaluates_ = false;
  }
  write_row(row(total_seconds(), evaluation_seconds, metrics, evaluates), evaluates);
  if (evaluates)
    log_.note(cat("evaluation after update ", learner_->updates_done(), ":\n", results_table(evaluations_.results())));

  const double score = evaluates ? evaluation_score(evaluations_.results()) : -1;
  const bool is_best = config_.checkpoint.keep_best && score > cursor_.best_score;
  if (is_best) {
    cursor_.best_score = score;
    cursor_.best_updates = learner_->updates_done();
  }
  checkpoint_seconds_ = 0;
  const bool saves = is_best || is_due(config_.checkpoint.every_updates);
  if (as_rank_0_says(ranks_.get(), saves)) checkpoint_seconds_ = timed([&] { save(is_best); });

  const UpdateTimes times = learner_->times();
  state_.time.rollout += times.rollout;
  state_.time.update += times.learning;
  state_.time.evaluation += evaluation_seconds;
  state_.time.rest = watch_.seconds() - state_.time.rollout - state_.time.update - state_.time.evaluation;
  show(metrics);
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

void Training::show(const Metrics& metrics) {
  ProgressState& s = state_;
  s.agent_steps_per_second = s.agent_steps_per_second > 0 ? 0.9 * s.agent_steps_per_second + 0.1 * speed_ : speed_;
  s.update = learner_->updates_done();
  s.agent_steps = learner_->agent_steps_done();
  s.seconds = total_seconds();
  const int64_t done = s.agent_steps - first_agent_steps_;
  s.seconds_left = watch_.seconds() / static_cast<double>(done) *
                   static_cast<double>(std::max<int64_t>(0, s.total_agent_steps - s.agent_steps));
  for (int team = 0; team < kNTeams; ++team) {
    const auto figure = [&](const char* name) { return value_of(metrics, cat(name, "_", team)); };
    TeamProgress& t = s.team[team];
    t.learns = learner_->actor(team) != nullptr;
    t.mean_return = figure("return");
    t.figures.clear();
    for (const HeadlineFigure& f : learner_->headline())
      t.figures.push_back({f.label, f.short_label ? f.short_label : "", figure(f.metric)});
    t.win_rates.clear();
    for (const TeamResult& r : evaluations_.results())
      if (r.team == team) t.win_rates.emplace_back(r.opponent, r.share(r.wins()));
  }
  if (sensors_ && (sensors_read_at_ < 0 || watch_.seconds() - sensors_read_at_ > 1)) {
    const GpuReading gpu = sensors_->read();
    s.memory_used = gpu.memory_used;
    s.memory_total = gpu.memory_total;
    s.gpu_temperature = gpu.temperature;
    sensors_read_at_ = watch_.seconds();
  }
  progress_.show(s);
}

void Training::fail_diverged(const Divergence& what) {
  progress_.finish();
  Checkpoint dump = checkpoint();
  learner_->save_batch(dump.arrays);
  const std::filesystem::path file = folder_.path() / cat("diverged_update_", what.update, "_team_", what.team, ".h5");
  write_checkpoint(file, dump);
  const std::string when = what.minibatch > 0 ? cat(", minibatch ", what.minibatch) : "";
  const std::string reason =
      cat("training diverged: the ", what.tensor, " of team ", what.team, " held a NaN or an infinity at update ",
          what.update, when, "; the batch is in ", file.string(), ", the last good checkpoint is ",
          folder_.checkpoint_file(saved_update_).string());
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

void Training::write_final_report() {
  evaluations_.replays().wait();
  if (learner_->updates_done() == 0) return;  // no figures yet
  write_replays_page(folder_, learner_->updates_done());
  write_report({folder_.path()}, folder_.report_file(), list_fields<RunConfig>());
}

}  // namespace

int stop_code(const TrainConfig& train, int64_t agent_steps, double seconds) {
  if (const int signal = StopRequest::signal()) return 128 + signal;
  if (stops_at(train, agent_steps)) return kOutOfTime;
  return train.max_wall_time && seconds >= train.max_wall_time->seconds ? kOutOfTime : 0;
}

int train_in(const RunFolder& folder, TrainingSetup setup) {
  const Checkpoint* from = setup.from;
  Training training(folder, std::move(setup));
  from ? training.go_on(*from) : training.start();
  return training.run();
}

std::vector<std::string> training_columns() { return {kColumns.begin(), kColumns.end()}; }

std::string advice_to_resume(const std::filesystem::path& folder) {
  const std::vector<std::filesystem::path> saved = list_checkpoints(folder);
  if (saved.empty()) return "";
  return cat("what was done until ", saved.back().string(), " is saved; to go on from there: ", program_command(),
             " resume ", shell_word(folder.string()));
}

Json run_info(const LoadedRun& run, Device device) {
  return {{"scenario", run.config.scenario},  {"algorithm", run.config.train.algorithm},
          {"seed", run.config.seed},          {"started", utc_now()},
          {"command_line", command_line()},   {"versions", version_info()},
          {"hardware", hardware_info(device)}};
}

}  // namespace giga
