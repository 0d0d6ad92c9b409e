// MetricsFiles: metrics.csv and the TensorBoard events of a run, row by row.
#pragma once

#include "apps/evaluation.hpp"
#include "io/run_folder.hpp"
#include "io/tensorboard.hpp"
#include "learn/run_config.hpp"

namespace giga {

class MetricsFiles {
 public:
  /// Of a new run: its configuration and scenario stand in front of the events.
  MetricsFiles(const RunFolder& folder, const LoadedRun& run);
  /// Of a run that goes on: what was written behind the cursor is removed.
  MetricsFiles(const RunFolder& folder, const RunCursor& cursor);
  /// Throws InputError where such a run cannot go on, and changes nothing.
  static void expect(const RunFolder& folder, const RunCursor& cursor);

  /// The row of an update; `win_rates`: of its evaluation, empty where there was none.
  void write(int64_t updates, int64_t agent_steps, const MetricsRow& row, const MetricsRow& win_rates);
  /// The run is complete.
  void end();
  void flush_to_disk();
  /// Notes how far they are written.
  void note_sizes(RunCursor& cursor) const;

 private:
  MetricsCsv csv_;
  TensorBoardEvents events_;
};

}  // namespace giga
