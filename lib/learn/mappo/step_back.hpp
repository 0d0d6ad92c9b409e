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

  enum class Verdict : uint8_t { none, best, fallen };
  /// Counts the games of a team against scripts in update number `updates_done`. At the end of a window that has games
  /// enough: whether the team was never so good, or has fallen. Otherwise none, and the window goes on.
  Verdict note(int team, const GameCount& games, int64_t updates_done);

  /// What the team was at its best; empty before it was judged. Who calls `note` fills it at `best` and loads it at
  /// `fallen`.
  NamedArrays& snapshot(int team) { return of(team).snapshot; }
  /// Teams meet other scripts from now on: what was best against those before says nothing.
  void forget();
  /// Adds stepped_back_T: how often so far.
  void add_metrics(Metrics& out) const;

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  struct Team {
    GameCount games;   // of the window
    double best = -1;  // share of wins; -1: none yet
    double times = 0;  // that it went back
    NamedArrays snapshot;
  };
  Team& of(int team) { return team_[static_cast<size_t>(team)]; }

  const double drop_;
  const int window_;
  std::array<Team, kNTeams> team_;
};

}  // namespace giga
