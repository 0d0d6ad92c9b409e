#include "learn/mappo/step_back.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/error.hpp"

namespace giga {
namespace {

/// Games below which a share of wins says too little: its deviation is 0.025 at most.
constexpr double kLeastGames = 400;
/// Standard deviations of a difference below which it may be luck. The best of many windows was lucky itself: a team
/// that stays as it is, at 0.5 with 400 games a window and a drop of 0.05, goes back once in a hundred windows.
constexpr double kSure = 2;

double variance(const GameCount& games) { return games.win_rate() * (1 - games.win_rate()) / games.episodes; }

std::string place_of(const std::string& prefix, size_t team) { return cat(prefix, "team_", team, "/"); }

/// Those whose names begin with `below`, without it.
NamedArrays arrays_below(const std::string& below, const NamedArrays& in) {
  NamedArrays out;
  for (const NamedArray& array : in) {
    if (!array.name.starts_with(below)) continue;
    out.push_back(array);
    out.back().name = array.name.substr(below.size());
  }
  return out;
}
void add_below(const std::string& below, const NamedArrays& arrays, NamedArrays& out) {
  for (NamedArray array : arrays) {
    array.name = below + array.name;
    out.push_back(std::move(array));
  }
}

}  // namespace

StepBack::Verdict StepBack::note(int team, const GameCount& games, int64_t updates_done) {
  Team& t = of(team);
  t.games += games;
  if (updates_done % window_ != 0 || t.games.episodes < kLeastGames) return Verdict::goes_on;
  const GameCount now = std::exchange(t.games, {});
  if (t.begun.empty()) return Verdict::judged;  // nobody knows what it was when the first window began
  const bool first = t.best_games.episodes == 0;
  if (first || now.win_rate() >= t.best_games.win_rate()) {
    t.best_games = now;
    t.snapshot = t.begun;
    return Verdict::judged;
  }
  const double luck = kSure * std::sqrt(variance(now) + variance(t.best_games));
  if (now.win_rate() >= t.best_games.win_rate() - drop_ - luck) return Verdict::judged;
  ++t.times;
  return Verdict::fallen;
}

void StepBack::begin(int team, NamedArrays now) { of(team).begun = std::move(now); }

void StepBack::forget() {
  for (Team& t : team_) {
    const double times = t.times;
    t = {};
    t.times = times;
  }
}

void StepBack::add_metrics(Metrics& out) const {
  for (size_t team = 0; team < kNTeams; ++team) out.emplace_back(cat("stepped_back_", team), team_[team].times);
}

void StepBack::save(const std::string& prefix, NamedArrays& out) const {
  for (size_t team = 0; team < kNTeams; ++team) {
    const Team& t = team_[team];
    const std::string place = place_of(prefix, team);
    out.push_back(make_array<double>(place + "record", {t.games.episodes, t.games.wins, t.games.ties, t.times,
                                                        t.best_games.episodes, t.best_games.wins, t.best_games.ties}));
    add_below(place + "begun/", t.begun, out);
    add_below(place + "snapshot/", t.snapshot, out);
  }
}

void StepBack::load(const std::string& prefix, const NamedArrays& in) {
  for (size_t team = 0; team < kNTeams; ++team) {
    Team& t = team_[team];
    const std::string place = place_of(prefix, team), below = place + "snapshot/";
    const std::vector<double> record = array_values<double>(find_array(in, place + "record"));
    if (record.size() != 7)
      throw InputError(cat("array '", place, "record' has ", record.size(), " numbers, expected 7"));
    t.games = {record[0], record[1], record[2]};
    t.times = record[3];
    t.best_games = {record[4], record[5], record[6]};
    t.begun = arrays_below(place + "begun/", in);
    t.snapshot = arrays_below(below, in);
    if (t.best_games.episodes > 0 && t.snapshot.empty()) throw InputError(cat("there are no arrays '", below, "...'"));
  }
}

}  // namespace giga
