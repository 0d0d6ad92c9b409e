#include "rating/game_table.hpp"

#include <algorithm>

namespace giga {

GameTable pooled(const GameTable& table, const std::vector<std::string>& names) {
  GameTable result;
  std::vector<size_t> place;  // [P] in the result
  for (const std::string& name : names) {
    const auto found = std::find(result.players.begin(), result.players.end(), name);
    place.push_back(static_cast<size_t>(found - result.players.begin()));
    if (found == result.players.end()) result.players.push_back(name);
  }
  const size_t n = names.size(), m = result.players.size();
  result.games.resize(m * m);
  for (size_t i = 0; i < n; ++i) {
    for (size_t j = 0; j < n; ++j) {
      const Games& from = table.games[i * n + j];
      Games& to = result.games[place[i] * m + place[j]];
      to.wins += from.wins;
      to.losses += from.losses;
      to.ties += from.ties;
    }
  }
  return result;
}

}  // namespace giga
