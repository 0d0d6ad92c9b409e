#include "eval/round_robin.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "core/error.hpp"
#include "core/fnv1a.hpp"
#include "core/seeds.hpp"

namespace giga {
namespace {

/// The stretch of a pair is FNV-1a over both names, the end of the first one told.
uint64_t pair_seed(uint64_t seed, const std::string& side0, const std::string& side1) {
  Fnv1a hash;
  hash.add_all(side0);
  hash.add(0);
  hash.add_all(side1);
  return seed_of(seed, Purpose::rate, hash.value());
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
  const size_t n = players.size();
  table.games.resize(n * n);
  std::vector<size_t> pairs;
  for (size_t k = 0; k < n * n; ++k)
    if (players[k / n].can_play(0) && players[k % n].can_play(1)) pairs.push_back(k);
  int done = 0;
  for (const size_t at : spread_order(pairs.size())) {
    Player &a = players[pairs[at] / n], &b = players[pairs[at] % n];
    if (progress) progress(done++, static_cast<int>(pairs.size()), a, b);
    MatchOptions pair = options;
    pair.seed = pair_seed(options.seed, a.name(), b.name());
    const MatchResult r = play_match(spec, a.controller(0, spec), b.controller(1, spec), pair);
    table.games[pairs[at]] = {r.wins[0], r.wins[1], r.ties};
  }
  return table;
}

std::vector<size_t> spread_order(size_t n) {
  // A step that has no factor in common with n comes to every number.
  auto step = static_cast<size_t>(std::lround(0.618034 * static_cast<double>(n)));
  while (std::gcd(step, n) != 1 && n > 0) ++step;
  std::vector<size_t> order;
  for (size_t k = 0; k < n; ++k) order.push_back(k * step % n);
  return order;
}

double expected_seconds(double first, double elapsed, int done, int all) {
  if (done <= 1) return first * all;
  return first + (elapsed - first) / (done - 1) * (all - 1);
}

int pairs_for_estimate(int all) { return std::max(10, all / 12); }

}  // namespace giga
