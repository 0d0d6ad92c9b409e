// SweepOutcome: what came of a sweep so far, as a table, as JSON and as a section of a report.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "io/json.hpp"
#include "sweep/progress.hpp"
#include "sweep/space.hpp"

namespace giga {

/// Where the run of a trial with a seed lies in the folder of a sweep: "trials/007-seed2".
std::filesystem::path trial_folder(const std::filesystem::path& sweep, int trial, uint64_t seed);

/// The metric by the known values of its columns, in the order of the spec's; none where a column has no value yet.
std::optional<double> metric_of_values(const SweepSpec& spec, const std::vector<std::vector<double>>& known);
// Of a run by its metrics.csv: of all its rows, or of those up to the first with `stop` agent-steps, where trials are
// compared, although somebody has trained this one further.

/// The metric, as the spec says; none where a column has no value yet. Throws InputError where there is no such file or
/// column.
std::optional<double> metric_of_run(const SweepSpec& spec, const std::filesystem::path& run,
                                    std::optional<int64_t> stop = {});
/// Agent-steps that it has done; 0 where there is no row.
double agent_steps_of_run(const std::filesystem::path& run, std::optional<int64_t> stop = {});
/// And how long it has trained, from its beginning.
double seconds_of_run(const std::filesystem::path& run, std::optional<int64_t> stop = {});

struct SweepOutcome {
  struct Trial {
    int number = 0;
    TrialSettings settings;
    int rung = -1;                     ///< that all seeds have reached; -1: none
    double agent_steps = 0;            ///< done by then, of its runs that which did most
    std::vector<double> values;        ///< of those that have one
    std::optional<double> value;       ///< their mean, where no seed failed
    double seconds = 0;                ///< of its runs together
    std::vector<std::string> folders;  ///< of its runs
  };
  struct Parameter {
    std::string key;
    double share = 0;        ///< of the spread of values at the first rung that it explains; NaN: not known
    double correlation = 0;  ///< of its rank with that of the value; NaN where it is no number
  };
  struct Curve {
    int trial = 0;
    std::vector<double> agent_steps, middle, low, high;  ///< interquartile mean over the seeds, bootstrap band
  };
  SweepSpec spec;
  std::vector<Trial> trials;          ///< the best first
  std::vector<Parameter> parameters;  ///< those that explain most first
  int compared = 0;                   ///< trials that have a value at the first rung
  std::vector<Curve> curves;          ///< of the best trials
};

/// Reads the run folders of the best trials for their curves.
SweepOutcome outcome_of(const SweepSpec& spec, const std::vector<TrialSettings>& trials, const SweepProgress& progress,
                        const std::filesystem::path& folder);

/// A row per trial: number, rung, agent-steps, value with its interval, seeds, seconds, settings.
std::string outcome_csv(const SweepOutcome& outcome);
Json outcome_json(const SweepOutcome& outcome);
/// For people: the best trials and the parameters.
std::string outcome_text(const SweepOutcome& outcome);
/// A section of the report: importance, best settings, curves.
std::string outcome_section(const SweepOutcome& outcome);

}  // namespace giga
