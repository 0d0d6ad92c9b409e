// LeagueRecord: how a team did in an update against past policies and against scripts, and the metrics of that.
#pragma once

#include <vector>

#include "learn/learner.hpp"

namespace giga {

/// Games of a team that ended.
struct GameCount {
  double episodes = 0, wins = 0, ties = 0;

  GameCount& operator+=(const GameCount& other) {
    episodes += other.episodes;
    wins += other.wins;
    ties += other.ties;
    return *this;
  }
  /// A tie is half a win.
  double points() const { return wins + 0.5 * ties; }
  double losses() const { return episodes - wins - ties; }
  /// Whether more wins than losses are hardly luck: of many fair coins one in twenty does so when it is asked once
  /// (1.65 deviations), of few up to one in eight (three of three), and more the oftener it is asked.
  bool is_evidence() const;
  /// NaN where no game has ended.
  double win_rate() const { return wins / episodes; }
};

struct LeagueRecord {
  GameCount pool, scripts;

  /// Adds pool_win_rate_T and scripted_win_rate_T.
  void add_metrics(int team, Metrics& out) const;
};

/// Adds the figures of the record that a run with such opponents has.
void add_league_headline(const OpponentsConfig& config, std::vector<HeadlineFigure>& figures);

}  // namespace giga
