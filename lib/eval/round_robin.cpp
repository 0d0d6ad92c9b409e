// Playing round robins.
#include "eval/round_robin.hpp"

#include <algorithm>

namespace giga {

GameTable play_round_robin(const SimSpec& spec, const std::vector<Entrant>& entrants, const MatchOptions& options,
                           const RoundRobinProgress& progress) {
  const size_t n = entrants.size();
  GameTable table{{}, std::vector<Games>(n * n)};
  for (const Entrant& entrant : entrants) table.players.push_back(entrant.name);
  const auto all = std::count_if(entrants.begin(), entrants.end(), [](const Entrant& e) { return e.plays[0]; }) *
                   std::count_if(entrants.begin(), entrants.end(), [](const Entrant& e) { return e.plays[1]; });
  int done = 0;
  for (size_t i = 0; i < n; ++i) {
    for (size_t j = 0; j < n; ++j) {
      if (!entrants[i].plays[0] || !entrants[j].plays[1]) continue;
      if (progress) progress(done, static_cast<int>(all), entrants[i], entrants[j]);
      MatchOptions own = options;
      own.seed = options.seed * n * n + i * n + j;
      const MatchResult result = play_match(spec, entrants[i].side[0], entrants[j].side[1], own);
      table.games[i * n + j] = {result.wins[0], result.wins[1], result.ties};
      ++done;
    }
  }
  return table;
}

}  // namespace giga
