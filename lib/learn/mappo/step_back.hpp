// StepBack: keeps of each team what it was when it won most against scripts, and says when it has fallen so far below
// that it is to become that again.
#pragma once

#include <array>
#include <string>

#include "core/named_array.hpp"
#include "learn/opponents/record.hpp"

namespace giga {

class StepBack {
 public:
  /// `drop`: how far the share of wins may fall below the best one; `window`: updates over which games are counted.
  StepBack(double drop, int window) : drop_(drop), window_(window) {}

  enum class Verdict : uint8_t { goes_on, judged, fallen };
  /// Counts the games of a team against scripts in update number `updates_done`. At the end of a window that has games
  /// enough, which is when the next one is to begin: whether the team has fallen, by more than `drop` and by more than
  /// luck: two standard deviations of the difference. Otherwise the window goes on.
  Verdict note(int team, const GameCount& games, int64_t updates_done);
  /// A window begins, in which the team is at first `now`: if it becomes the best one, this is what is kept.
  void begin(int team, NamedArrays now);

  /// What the team was at the beginning of its best window; there is one where it has fallen.
  const NamedArrays& best(int team) const { return team_[static_cast<size_t>(team)].snapshot; }
  /// Teams meet other scripts from now on: what was best against those before says nothing.
  void forget();
  /// Adds stepped_back_T: how often so far.
  void add_metrics(Metrics& out) const;

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  struct Team {
    GameCount games;       // of the window
    GameCount best_games;  // of the best one; 0 episodes: none yet
    double times = 0;      // that it went back
    NamedArrays begun;     // what it was when the window began; empty: in the first one
    NamedArrays snapshot;  // and when the best one did
  };
  Team& of(int team) { return team_[static_cast<size_t>(team)]; }

  const double drop_;
  const int window_;
  std::array<Team, kNTeams> team_;
};

}  // namespace giga
