// Records matches as replays, and plays replays again.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "core/memory.hpp"
#include "eval/match.hpp"
#include "eval/recorder.hpp"
#include "io/replay.hpp"
#include "learn/learner.hpp"
#include "scenario/scenario.hpp"

namespace giga {

/// A team of a match that is recorded.
struct RecordedTeam {
  std::shared_ptr<TeamController> controller;
  Mind mind;         ///< must outlive the call
  std::string name;  ///< as the user names it
  std::string origin = {};
};

struct RecordedMatch {
  Replay replay;
  MatchResult result;
};

/// A replay of a scenario without games, players and seed.
Replay replay_frame(const Scenario& scenario, const SimSpec& spec, const std::string& version);

/// Plays a match and keeps all of its episodes.
RecordedMatch record_match(const Scenario& scenario, const SimSpec& spec,
                           const std::array<RecordedTeam, kNTeams>& teams, const MatchOptions& options,
                           const std::string& version);

/// The same for the teams of a run as they play now, one against the other, or against its script.
RecordedMatch record_teams(const LoadedRun& run, Learner& learner, const MatchOptions& options,
                           const std::string& version);

/// Plays the recorded actions again from the recorded seed, and compares all states bit for bit, and what else the
/// replay says of the games. Returns what differs first; empty: nothing does. Throws InputError where the scenario
/// cannot be read any more.
std::string verify_replay(const Replay& replay, Device device);

}  // namespace giga
