// SweepFolder: the folder of a sweep, from which it goes on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "apps/metric_check.hpp"
#include "apps/run_process.hpp"
#include "io/run_lock.hpp"
#include "learn/run_config.hpp"
#include "sweep/journal.hpp"
#include "sweep/outcome.hpp"

namespace giga {

/// sweep.yaml      the sweep; config.yaml, scenario.yaml: the run config that its trials change
/// sweep.jsonl     what happened (SweepJournal)
/// trials/         a run folder for each trial and seed; logs/: what their processes printed
/// trials.csv, report.html, sweep.json   the outcome so far
class SweepFolder {
 public:
  /// Begins the sweep of a file in a folder, or opens it to go on. Throws InputError where something is wrong with the
  /// file, a setting of a trial, or the metric; where another sweep is there; where a process works in it.
  SweepFolder(const std::filesystem::path& file, const std::filesystem::path& folder);

  const std::filesystem::path& path() const { return path_; }
  const SweepSpec& spec() const { return spec_; }
  const SweepProgress& progress() const { return *progress_; }
  const std::vector<int64_t>& rungs() const { return rungs_; }
  const TrialSettings& settings(int trial) const { return trials_.at(static_cast<size_t>(trial)); }

  /// Notes that a trial begins or goes on.
  void begin(const SweepJob& job);
  void finish(const SweepRun& run, const SweepResult& result);
  /// Runs that failed in an earlier call are tried again (SweepProgress::reopen_failed). The journal keeps what came of
  /// them: the last result of a run counts.
  void reopen_failed() { progress_->reopen_failed(); }
  /// Adds a trial that somebody else chose, after its settings were checked; its number.
  int add(const TrialSettings& settings);

  /// Agent-steps of a run of a trial to a rung; a trial may set train.total_agent_steps itself.
  int64_t agent_steps(int trial, int rung) const;
  WantedRun wanted(const SweepRun& run) const;
  std::filesystem::path log_of(const SweepRun& run) const;
  SweepOutcome outcome() const { return outcome_of(spec_, trials_, *progress_, path_); }
  /// Writes trials.csv, sweep.json and report.html.
  void write_outcome(const SweepOutcome& outcome) const;

 private:
  LoadedRun check_base(const std::filesystem::path& file, const KeyPositions& given) const;
  void create(const LoadedRun& run, const KeyPositions& given);
  void replay(const Json& event);
  /// The config of a trial. Throws InputError where the sweep's does not allow its settings, or its run would lack the
  /// metric.
  RunConfig check_settings(const TrialSettings& settings, const KeyPositions& given, MetricCheck& check) const;
  void check_ends(const KeyPositions& given) const;
  void refuse_unread(const std::set<std::string>& algorithms, const KeyPositions& given) const;
  [[noreturn]] void refuse_metric(const std::string& missing, const TrialSettings& settings, const KeyPositions& given,
                                  MetricCheck& check) const;

  const std::filesystem::path path_;
  SweepSpec spec_;
  std::vector<TrialSettings> trials_;
  std::vector<int64_t> rungs_;
  int threads_ = 0;  // of each run that does not set them itself; 0: as its config says
  std::optional<RunLock> lock_;
  std::optional<SweepJournal> journal_;
  std::optional<SweepProgress> progress_;
};

}  // namespace giga
