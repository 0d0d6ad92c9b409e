// RateMeter: agent-steps per second of several runs together, from the rows of their metrics.csv.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace giga {

/// How far a run is by its last row.
struct RunReading {
  int64_t id = 0;             ///< of the process, another for each
  double agent_steps = 0;     ///< of the run
  double update_seconds = 0;  ///< of all its updates so far, without evaluations and checkpoints
  bool has_new_rows = false;  ///< whether this process has written a row yet
};

/// Counts whole updates that were done while a given number of runs went on, all of them past their first row, so that
/// neither the time of loading nor an update that began before is in it. How the runs share these updates does not
/// matter, and runs may end and others begin meanwhile: the rate of all is that of one run on average, times their
/// number.
class RateMeter {
 public:
  /// A rate is known after so much time of updates and so many readings per run, on average.
  explicit RateMeter(double seconds = 20, int readings = 3) : seconds_(seconds), readings_(readings) {}

  /// Forgets all; from here on so many runs are measured.
  void begin(int runs);
  /// All runs that go on.
  void look(const std::vector<RunReading>& going);
  /// A run that began after begin() has ended; of one too short to be seen between two rows all its updates count.
  void ended(const RunReading& first, const RunReading& last);
  /// Agent-steps per second of all together; none: not known yet.
  std::optional<double> rate() const;

 private:
  struct Seen {
    RunReading row;
    bool is_whole = false;  // what follows this row lies within the time that counts
    bool has_counted = false;
  };
  void count(const RunReading& from, const RunReading& to);

  double seconds_;
  int readings_, runs_ = 1;
  std::map<int64_t, Seen> seen_;
  double sum_steps_ = 0, sum_seconds_ = 0;
  int sum_readings_ = 0;
};

}  // namespace giga
