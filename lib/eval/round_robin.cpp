#include "eval/round_robin.hpp"

#include <algorithm>
#include <set>

#include "core/error.hpp"
#include "core/seeds.hpp"

namespace giga {
namespace {

/// The stretch of a pair is FNV-1a over both names, the end of the first one told.
uint64_t pair_seed(uint64_t seed, const std::string& side0, const std::string& side1) {
  uint64_t hash = 0xcbf29ce484222325;
  const auto add = [&hash](unsigned char byte) { hash = (hash ^ byte) * 0x100000001b3; };
  for (const char c : side0) add(static_cast<unsigned char>(c));
  add(0);
  for (const char c : side1) add(static_cast<unsigned char>(c));
  return seed_of(seed, Purpose::rate, hash);
}

}  // namespace

GameTable play_table(std::vector<Player>& players, const SimSpec& spec, const MatchOptions& options,
                     const RoundRobinProgress& progress) {
  GameTable table;
  std::set<std::string> names;
  for (const Player& player : players) {
    if (!names.insert(player.name()).second) throw InputError(cat("'", player.name(), "' takes part twice"));
    table.players.push_back(player.name());
  }
  const auto count = [&](int side) {
    return std::count_if(players.begin(), players.end(),
                         [side](const Player& player) { return player.can_play(side); });
  };
  const int all = static_cast<int>(count(0) * count(1));
  int done = 0;
  for (Player& a : players) {
    for (Player& b : players) {
      Games& games = table.games.emplace_back();
      if (!a.can_play(0) || !b.can_play(1)) continue;
      if (progress) progress(done++, all, a, b);
      MatchOptions pair = options;
      pair.seed = pair_seed(options.seed, a.name(), b.name());
      const MatchResult r = play_match(spec, a.controller(0, spec), b.controller(1, spec), pair);
      games = {r.wins[0], r.wins[1], r.ties};
    }
  }
  return table;
}

}  // namespace giga
