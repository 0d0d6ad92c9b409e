// The state of a training run that the terminal's panel and the log's lines show.
#pragma once

#include <optional>
#include <vector>

#include "apps/evaluation.hpp"
#include "apps/stopwatch.hpp"
#include "cuda/sensors.hpp"
#include "io/progress.hpp"
#include "io/run_folder.hpp"
#include "learn/learner.hpp"

namespace giga {

/// What an update has left.
struct UpdateFigures {
  const Metrics& metrics;
  const std::vector<TeamResult>& results;  ///< of the latest evaluation
  double agent_steps_per_second = 0;
  double evaluation_seconds = 0;  ///< 0: there was none
  double seconds = 0;             ///< of the run, earlier processes included
};

class TrainingProgress {
 public:
  TrainingProgress(const LoadedRun& run, Device device, const RunFolder& folder, std::optional<int64_t> n_updates,
                   Progress& progress);

  /// After an update. `first_agent_steps`: what earlier processes of the run have done.
  void show(Learner& learner, const UpdateFigures& figures, int64_t first_agent_steps);

 private:
  void read_sensors();

  Progress& progress_;
  ProgressState state_;
  std::optional<GpuSensors> sensors_;  // of a GPU
  const Stopwatch watch_;              // of this process
  double sensors_read_at_ = -1;        // seconds
};

}  // namespace giga
