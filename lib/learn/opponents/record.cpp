#include "learn/opponents/record.hpp"

#include <cmath>

#include "core/error.hpp"

namespace giga {

bool GameCount::is_evidence() const {
  constexpr double kDeviations = 1.65;
  const double decided = wins + losses();
  return decided > 0 && wins - losses() >= kDeviations * std::sqrt(decided);
}

void LeagueRecord::add_metrics(int team, Metrics& out) const {
  out.emplace_back(cat("pool_win_rate_", team), pool.win_rate());
  out.emplace_back(cat("scripted_win_rate_", team), scripts.win_rate());
}

void add_league_headline(const OpponentsConfig& config, std::vector<HeadlineFigure>& figures) {
  if (config.pool_size > 0 && config.pool_share > 0)
    figures.push_back({"wins vs pool", "wins vs pool", "pool_win_rate"});
  if (config.scripted_share > 0) figures.push_back({"wins vs scripts", nullptr, "scripted_win_rate"});
}

}  // namespace giga
