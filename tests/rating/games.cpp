#include "games.hpp"

#include <algorithm>
#include <cmath>

#include "core/error.hpp"

namespace giga::test {
namespace {

size_t index_of(const GameTable& table, const std::string& name) {
  const auto found = std::find(table.players.begin(), table.players.end(), name);
  GIGA_CHECK(found != table.players.end(), "no player ", name);
  return static_cast<size_t>(found - table.players.begin());
}

double uniform(std::mt19937_64& generator) { return static_cast<double>(generator() >> 11) * 0x1p-53; }

}  // namespace

GameTable table_of(const std::vector<std::string>& players) {
  return {players, std::vector<Games>(players.size() * players.size())};
}

void add(GameTable& table, const std::string& side_0, const std::string& side_1, Games games) {
  Games& g = table.games[index_of(table, side_0) * table.players.size() + index_of(table, side_1)];
  g = {g.wins + games.wins, g.losses + games.losses, g.ties + games.ties};
}

GameTable play_known(const KnownStrengths& truth, int n, bool diagonal, std::mt19937_64& generator) {
  std::vector<std::string> names;
  for (size_t k = 0; k < truth.side_0.size(); ++k) names.push_back(cat("p", k));
  GameTable table = table_of(names);
  for (size_t i = 0; i < names.size(); ++i) {
    for (size_t j = 0; j < names.size(); ++j) {
      if (i == j && !diagonal) continue;
      const double p = 1 / (1 + std::pow(10, (truth.side_1[j] - truth.side_0[i] - truth.advantage) / 400));
      Games& g = table.games[i * names.size() + j];
      for (int game = 0; game < n; ++game) {
        if (uniform(generator) < truth.tie_rate) {
          ++g.ties;
        } else {
          ++(uniform(generator) < p ? g.wins : g.losses);
        }
      }
    }
  }
  return table;
}

}  // namespace giga::test
