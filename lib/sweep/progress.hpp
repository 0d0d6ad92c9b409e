// SweepProgress: which trials have come how far, and what comes next.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "sweep/spec.hpp"

namespace giga {

/// A trial with a seed, up to a rung.
struct SweepRun {
  int trial = 0, rung = 0;
  uint64_t seed = 0;

  auto operator<=>(const SweepRun&) const = default;
};

/// What a trial does next, with all its seeds.
struct SweepJob {
  int trial = 0, rung = 0;
};

/// What came of a run. A run that failed has no value.
struct SweepResult {
  static constexpr int kFailed = 1, kDiverged = 3;  ///< exit codes, as of a run: see ErrorKind

  std::optional<double> value;
  int exit_code = 0;
  double seconds = 0, agent_steps = 0;

  /// Its process did; somebody else's trial that was told without a value has no exit code.
  bool has_failed() const { return !value && exit_code != 0; }
};

class SweepProgress {
 public:
  /// `n_trials` settings, each trained with all seeds to the rungs 0 to n_rungs - 1.
  SweepProgress(const SweepSpec& spec, int n_trials, int n_rungs);

  /// One trial more, which somebody else chose; its number.
  int add_trial();
  int n_trials() const { return n_trials_; }

  /// The trial that should go on, to the rung above its last, or a new one. The best of a rung go on as soon as there
  /// are enough there (ASHA); none: everything has begun that may, so far.
  std::optional<SweepJob> next() const;
  /// That runs of a trial to a rung have begun.
  void begin(int trial, int rung);
  void finish(const SweepRun& run, const SweepResult& result);

  /// Makes runs that failed open again, but for those that diverged: these would once more.
  void reopen_failed();
  /// Runs that failed; the exit code for all together: kDiverged where all runs diverged, kFailed where some failed
  /// otherwise, else 0: that some settings diverge is what a sweep finds out.
  int n_failed() const;
  int failure_code() const;

  /// Runs that have begun and have no result: what a sweep that was killed goes on with.
  std::vector<SweepRun> open() const;
  /// Whether nothing is open and nothing comes next.
  bool complete() const { return open().empty() && !next(); }

  /// The rung that a trial has reached with all seeds; -1 = none.
  int reached(int trial) const;
  /// Results of the seeds at a rung, those that have a value.
  std::vector<double> values(int trial, int rung) const;
  const SweepResult* result(const SweepRun& run) const;
  /// Their mean; none where a seed is missing or has failed.
  std::optional<double> value(int trial, int rung) const;
  /// Whether a is better than b by the sweep's goal.
  bool better(double a, double b) const { return goal_ == SweepGoal::maximize ? a > b : a < b; }
  /// Trials by how far they came, then by their value there; those without a value, as where a run failed, last.
  std::vector<int> ranking() const;
  /// The first of them with its value, and how many trials were compared, with halving for the first time at least.
  std::optional<std::pair<int, double>> best() const;
  int n_compared() const;

 private:
  bool is_settled(int rung) const;
  std::vector<int> standing(int rung) const;

  std::vector<uint64_t> seeds_;
  SweepGoal goal_;
  int factor_;
  int n_trials_, n_rungs_;
  std::map<int, int> begun_;  // trial -> its last rung
  std::map<SweepRun, SweepResult> results_;
};

}  // namespace giga
