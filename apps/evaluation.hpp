// Learned teams against scripted ones, each team on its own side, and the result as figures and as a table.
#pragma once

#include <string>
#include <vector>

#include "eval/match.hpp"
#include "io/metrics_csv.hpp"
#include "learn/learner.hpp"

namespace giga {

/// A match, seen from the learned team.
struct TeamResult {
  int team = 0;  ///< also the side
  std::string opponent;
  MatchResult match;

  int wins() const { return match.wins[team]; }
  int losses() const { return match.wins[1 - team]; }
  double share(int count) const { return static_cast<double>(count) / match.episodes; }
};

/// Of an evaluation. The episodes depend on the seed of the run and on how many updates are done, so that each plays
/// new ones.
MatchOptions evaluation_options(const LoadedRun& run, Device device, const Learner& learner);

/// All learning teams of a run against all of its `eval.opponents`; beside them the games that are recorded, if any.
std::vector<TeamResult> evaluate(const LoadedRun& run, const MatchOptions& options, Learner& learner,
                                 const WatchedPair* recorded = nullptr);

/// The weaker team's mean win rate over the opponents; -1 where nobody was evaluated.
double evaluation_score(const std::vector<TeamResult>& results);

/// win_rate_T_vs_O, loss_rate_T_vs_O and mean_return_T_vs_O for teams T and opponents O; NaN for what has no result,
/// so that the names are the same at each update.
MetricsRow evaluation_metrics(const RunConfig& config, const std::vector<TeamResult>& results);

/// For people: one line per result.
std::string results_table(const std::vector<TeamResult>& results);

}  // namespace giga
