#include "eval/round_robin.hpp"

#include <set>

#include "core/error.hpp"

namespace giga {
namespace {

/// FNV-1a over both names, the end of the first one told.
uint64_t pair_seed(uint64_t seed, const std::string& side0, const std::string& side1) {
  uint64_t hash = 0xcbf29ce484222325;
  const auto add = [&hash](unsigned char byte) { hash = (hash ^ byte) * 0x100000001b3; };
  for (const char c : side0) add(static_cast<unsigned char>(c));
  add(0);
  for (const char c : side1) add(static_cast<unsigned char>(c));
  return seed ^ hash;
}

}  // namespace

GameTable play_table(std::vector<Contestant>& contestants, const SimSpec& spec, const MatchOptions& options) {
  GameTable table;
  std::set<std::string> names;
  for (const Contestant& c : contestants) {
    if (!names.insert(c.name()).second) throw InputError(cat("'", c.name(), "' takes part twice"));
    table.players.push_back(c.name());
  }
  for (Contestant& a : contestants) {
    for (Contestant& b : contestants) {
      Games games;
      if (a.can_play(0) && b.can_play(1)) {
        MatchOptions pair = options;
        pair.seed = pair_seed(options.seed, a.name(), b.name());
        const MatchResult r = play_match(spec, a.player(0, spec), b.player(1, spec), pair);
        games = {r.wins[0], r.wins[1], r.ties};
      }
      table.games.push_back(games);
    }
  }
  return table;
}

}  // namespace giga
