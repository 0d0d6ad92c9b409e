#include "learn/mappo/step_back.hpp"

#include <algorithm>

#include "core/error.hpp"

namespace giga {
namespace {

/// Games below which a share of wins says too little: its deviation is 0.025 at most.
constexpr double kLeastGames = 400;

std::string place_of(const std::string& prefix, size_t team) { return cat(prefix, "team_", team, "/"); }

}  // namespace

StepBack::Verdict StepBack::note(int team, const GameCount& games, int64_t updates_done) {
  Team& t = of(team);
  t.games += games;
  if (updates_done % window_ != 0 || t.games.episodes < kLeastGames) return Verdict::none;
  const double rate = t.games.win_rate();
  t.games = {};
  if (rate >= t.best) {
    t.best = rate;
    return Verdict::best;
  }
  if (rate >= t.best - drop_) return Verdict::none;
  ++t.times;
  return Verdict::fallen;
}

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
    out.push_back(
        make_array<double>(place + "record", {t.games.episodes, t.games.wins, t.games.ties, t.best, t.times}));
    for (NamedArray array : t.snapshot) {
      array.name = place + "snapshot/" + array.name;
      out.push_back(std::move(array));
    }
  }
}

void StepBack::load(const std::string& prefix, const NamedArrays& in) {
  for (size_t team = 0; team < kNTeams; ++team) {
    Team& t = team_[team];
    const std::string place = place_of(prefix, team), below = place + "snapshot/";
    const std::vector<double> record = array_values<double>(find_array(in, place + "record"));
    if (record.size() != 5)
      throw InputError(cat("array '", place, "record' has ", record.size(), " numbers, expected 5"));
    t.games = {record[0], record[1], record[2]};
    t.best = record[3];
    t.times = record[4];
    t.snapshot.clear();
    for (const NamedArray& array : in) {
      if (!array.name.starts_with(below)) continue;
      t.snapshot.push_back(array);
      t.snapshot.back().name = array.name.substr(below.size());
    }
    if (t.best >= 0 && t.snapshot.empty()) throw InputError(cat("there are no arrays '", below, "...'"));
  }
}

}  // namespace giga
