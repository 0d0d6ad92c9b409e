// Training: a run from its next update to its end, with all that is kept of it: figures, messages, checkpoints.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "io/run_folder.hpp"
#include "learn/learner.hpp"
#include "ranks/ranks.hpp"

namespace giga {

/// Exit codes of a run that was stopped before its end with its state saved: 128 + the signal, or this one when
/// train.max_wall_time was over or train.stop_at_agent_steps were done.
constexpr int kOutOfTime = 124;

struct TrainingSetup {
  LoadedRun run;
  Device device;
  std::unique_ptr<Learner> learner;        ///< new, or with the state of `from`
  const Checkpoint* from = nullptr;        ///< null: a new run
  bool quiet = false, color = true;        ///< of what is shown on the terminal
  std::shared_ptr<Ranks> ranks = nullptr;  ///< which train together; null: this process alone
  /// `from` was of other settings: it is written again before the run goes on, so that a kill does not bring them back.
  bool settings_changed = false;
};

/// Why a run stops before its end: the signal that came (128 + its number) or kOutOfTime; 0: it does not. `seconds`: of
/// this process.
int stop_code(const TrainConfig& train, int64_t agent_steps, double seconds);

/// Trains until the run is complete (returns 0) or is asked to stop. Throws Error of kind `diverged` where a number was
/// not finite, and any other Error where a file could not be written; the last checkpoint is whole then.
int train_in(const RunFolder& folder, TrainingSetup setup);

/// For people, after a failure: how to go on from what was saved; empty where nothing was.
std::string advice_to_resume(const std::filesystem::path& folder);

/// The columns of metrics.csv that every run has, before those of its learner.
std::vector<std::string> training_columns();

/// What run.json and resume_NNN.json hold.
Json run_info(const LoadedRun& run, Device device);

}  // namespace giga
