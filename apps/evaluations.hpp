// Evaluations: the matches by which a training run is judged, and the games that it keeps of them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/evaluation.hpp"
#include "apps/run_replays.hpp"
#include "io/logger.hpp"

namespace giga {

class Evaluations {
 public:
  /// All must outlive this. What is told of how matches are played, and why no games are kept, goes to the log.
  Evaluations(const LoadedRun& run, Device device, const RunFolder& folder, Logger& log)
      : run_(run), device_(device), log_(log), replays_(folder) {}

  /// The matches of the teams as they play now, and beside them the games that are kept.
  void play(Learner& learner);
  const std::vector<TeamResult>& results() const { return results_; }  ///< of the latest; empty before the first
  /// The kept games, which are written while the run goes on.
  ReplayWriter& replays() { return replays_; }

 private:
  const LoadedRun& run_;
  const Device device_;
  Logger& log_;
  ReplayWriter replays_;
  std::vector<TeamResult> results_;
  std::optional<std::string> no_room_for_games_;  // why; none: not looked yet
  std::string note_;                              // the latest that was told of how matches are played
};

}  // namespace giga
