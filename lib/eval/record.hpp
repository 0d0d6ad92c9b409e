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

class Player;
class ValueFunction;

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

/// Games of the teams of a run as they play now, one against the other, or against whom they learn to beat.
class TeamRecording {
 public:
  /// `options`: of the matches that are played beside them. The run must outlive it, and the learner the games.
  TeamRecording(const LoadedRun& run, Learner& learner, int episodes, const MatchOptions& options);
  ~TeamRecording();

  /// What play_matches is to play.
  const WatchedPair& games() const { return games_; }
  /// When they were played: asks the networks, and keeps nothing of theirs on the device.
  void finish();
  /// Before that, for who measures memory: as if the games had been as long as they can be. There is no replay then.
  void fill();
  /// Then. No more than the host's work, which may go on beside what else it does.
  Replay replay(const std::string& version);

 private:
  const LoadedRun& run_;
  const uint64_t seed_;
  std::unique_ptr<ValueFunction> values_[kNTeams];
  std::unique_ptr<Player> script_;  // who does not learn, unless it is the learner's opponent
  std::array<std::string, kNTeams> names_;
  std::unique_ptr<Recorder> recorder_;
  WatchedPair games_;
};

/// Plays the recorded actions again from the recorded seed, and compares all states bit for bit, and what else the
/// replay says of the games. Returns what differs first; empty: nothing does. Throws InputError where the scenario
/// cannot be read any more.
std::string verify_replay(const Replay& replay, Device device);

}  // namespace giga
