#include "eval/match.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "game/game.hpp"
#include "rollout/stream.hpp"

namespace giga {
namespace {

/// A GPU is far from full with the agents of one match; more at once than these only take memory.
constexpr int64_t kAgentsAtOnce = 65'536;

MatchResult match_result(const EpisodeStats& stats) {
  const auto count = [&](EpisodeStat s) { return static_cast<int>(std::lround(stats[s])); };
  const auto mean = [&](EpisodeStat s) { return stats[s] / stats[EpisodeStat::episodes]; };
  constexpr EpisodeStat kDeathStats[kNDeaths] = {EpisodeStat::deaths_damage_0, EpisodeStat::deaths_agent_0,
                                                 EpisodeStat::deaths_obstacle_0, EpisodeStat::deaths_bounds_0};
  MatchResult result;
  result.episodes = count(EpisodeStat::episodes);
  result.ties = count(EpisodeStat::ties);
  result.mean_length = mean(EpisodeStat::length);
  for (int side = 0; side < kNTeams; ++side) {
    result.wins[side] = count(of_team(EpisodeStat::wins_0, side));
    result.mean_return[side] = mean(of_team(EpisodeStat::return_0, side));
    result.mean_return_masked[side] = mean(of_team(EpisodeStat::return_masked_0, side));
    result.mean_score[side] = mean(of_team(EpisodeStat::score_0, side));
    result.mean_survivors[side] = mean(of_team(EpisodeStat::survivors_0, side));
    for (size_t cause = 0; cause < kNDeaths; ++cause)
      result.mean_deaths[side][cause] = mean(of_team(kDeathStats[cause], side));
  }
  return result;
}

/// The parts of a pair's worlds in each of which all policies of a side share the games. Of two teams that several
/// policies share each policy of the one meets each of the other: the second team has a part for each policy of the
/// first. Where there are too few worlds it has fewer, in each of which all of its policies play.
std::vector<WorldRange> parts_of_side(const Pairing& pair, const WorldRange& worlds, int side) {
  const int64_t shared = pair.side[1]->n_sharing();
  const int64_t n =
      side == 1 && shared > 1 ? std::clamp<int64_t>(worlds.count / shared, 1, pair.side[0]->n_sharing()) : 1;
  std::vector<WorldRange> parts;
  for (int64_t k = 0; k < n; ++k) parts.push_back(part_of(worlds, k, n));
  return parts;
}

/// Seats a pair in some worlds.
void seat(const Pairing& pair, const WorldRange& worlds, BothSides& sides) {
  for (int side = 0; side < kNTeams; ++side)
    for (const WorldRange& part : parts_of_side(pair, worlds, side))
      sides[static_cast<size_t>(side)].push_back({pair.side[static_cast<size_t>(side)], part});
}

/// The statistics of all worlds, on the host.
std::vector<float> stats_of(const Simulator& sim) {
  std::vector<float> stats(static_cast<size_t>(sim.n_worlds()) * kNStatRows);
  sim.memory().to_host(stats.data(), sim.state().view().stats, stats.size() * sizeof(float));
  return stats;
}

/// What came of some worlds; takes their statistics.
EpisodeStats take_some(std::vector<float>& stats, const WorldRange& worlds) {
  StateView some{};
  some.stats = stats.data() + worlds.first * kNStatRows;
  return take_host_stats(some, static_cast<int>(worlds.count));
}

/// What came of the episodes of each policy that shares a side of a match; nothing where it is one alone.
std::vector<MatchResult> of_each_policy(const Pairing& pair, int side, const Simulator& sim) {
  std::vector<MatchResult> all;
  const int64_t n = pair.side[static_cast<size_t>(side)]->n_sharing();
  if (n == 1) return all;
  std::vector<float> stats = stats_of(sim);
  for (int64_t k = 0; k < n; ++k) {
    EpisodeStats sum;
    for (const WorldRange& part : parts_of_side(pair, {0, sim.n_worlds()}, side)) {
      const EpisodeStats some = take_some(stats, part_of(part, k, n));
      for (size_t row = 0; row < sum.rows.size(); ++row) sum.rows[row] += some.rows[row];
    }
    all.push_back(match_result(sum));
  }
  return all;
}

/// Plays the games of all pairs, in worlds one after the other: as many for each as there are episodes, and last those
/// of the pair that is watched.
std::unique_ptr<Simulator> play_once(const SimSpec& spec, std::span<const Pairing> pairs, const MatchOptions& options,
                                     std::vector<GameObserver*> observers, const WatchedPair* watched) {
  GIGA_CHECK(options.episodes > 0, "episodes: ", options.episodes);
  const SimSpec limited = spec.with_time_limit();  // every episode ends, so that each is counted
  SimOptions sim_options;
  sim_options.n_worlds = static_cast<int>(pairs.size()) * options.episodes + (watched ? watched->episodes : 0);
  sim_options.seed = options.seed;
  sim_options.draw_period = pairs.size() > 1 || watched ? options.episodes : 0;  // as in a match by itself
  sim_options.on_done = OnDone::freeze;
  sim_options.n_threads = options.n_threads;
  sim_options.pairs = options.pairs;
  if (watched) observers.push_back(watched->observer);
  if (std::any_of(observers.begin(), observers.end(), [](const GameObserver* o) { return o->needs_tables(); }))
    sim_options.pairs = Pairs::tables;
  void* const stream = current_stream(options.device);
  auto sim = make_simulator(limited, sim_options, options.device, stream);
  const ParallelFor parallel_for(options.device, options.n_threads, stream);

  BothSides sides;
  int64_t first = 0;
  for (const Pairing& pair : pairs) {
    seat(pair, {first, options.episodes}, sides);
    first += options.episodes;
  }
  if (watched) seat(watched->pair, {first, watched->episodes}, sides);
  Game game(*sim, parallel_for, sides, std::move(observers));
  game.start();
  game.play(limited.params.max_episode_length);
  sim->synchronize();  // before the game's buffers go
  if (!game.refusal().empty() && options.note)
    options.note("the GPU takes no recorded steps, so matches queue them one by one: " + game.refusal());
  return sim;
}

/// The same; where lists of fire are too short, once more with tables, which count all.
std::unique_ptr<Simulator> play(const SimSpec& spec, std::span<const Pairing> pairs, const MatchOptions& options,
                                std::vector<GameObserver*> observers, const WatchedPair* watched = nullptr) {
  try {
    return play_once(spec, pairs, options, observers, watched);
  } catch (const FullListsError&) {
    if (spec.params.n_agents > kMaxAgents) throw;
    MatchOptions with_tables = options;
    with_tables.pairs = Pairs::tables;
    return play_once(spec, pairs, with_tables, observers, watched);
  }
}

MatchResult checked(const EpisodeStats& stats, int episodes) {
  const MatchResult result = match_result(stats);
  GIGA_CHECK(result.episodes == episodes, result.episodes, " of ", episodes, " episodes ended");
  return result;
}

bool reads_images(const Pairing& pair) {
  return std::any_of(pair.side.begin(), pair.side.end(),
                     [](const auto& controller) { return controller->reads().has(Observation::image); });
}

/// How many matches are played at once.
size_t beside_each_other(const SimSpec& spec, const std::vector<Pairing>& pairs, const MatchOptions& options) {
  if (std::any_of(pairs.begin(), pairs.end(), reads_images)) return 1;
  const int64_t agents = int64_t{options.episodes} * spec.params.n_agents;
  return static_cast<size_t>(std::max<int64_t>(1, kAgentsAtOnce / agents));
}

}  // namespace

void check_episodes(int episodes, int64_t n_sharing_0, int64_t n_sharing_1) {
  const int64_t needed = std::max(n_sharing_0, n_sharing_1);
  if (episodes < needed)
    throw InputError(cat("episodes: ", episodes, ", and ", needed,
                         " policies of a mixed team are to share them; needed: ", needed, " or more"));
}

MatchResult play_match(const SimSpec& spec, std::shared_ptr<TeamController> side0,
                       std::shared_ptr<TeamController> side1, const MatchOptions& options,
                       std::vector<GameObserver*> observers) {
  const Pairing pair{{std::move(side0), std::move(side1)}};
  check_episodes(options.episodes, pair.side[0]->n_sharing(), pair.side[1]->n_sharing());
  const auto sim = play(spec, {&pair, 1}, options, std::move(observers));
  std::vector<MatchResult> of_each[kNTeams];
  for (int side = 0; side < kNTeams; ++side) of_each[side] = of_each_policy(pair, side, *sim);
  MatchResult result = checked(sim->take_stats(), options.episodes);  // and clears them
  for (int side = 0; side < kNTeams; ++side) result.of_each[side] = std::move(of_each[side]);
  return result;
}

std::vector<MatchResult> play_matches(const SimSpec& spec, const std::vector<Pairing>& pairs,
                                      const MatchOptions& options, const WatchedPair* watched) {
  GIGA_CHECK(options.episodes > 0, "episodes: ", options.episodes);
  const size_t at_once = beside_each_other(spec, pairs, options);
  const bool joins = watched && !watched->alone && !pairs.empty() && watched->episodes <= options.episodes &&
                     !finds_by_place(spec, {.pairs = options.pairs}) && !reads_images(watched->pair) &&
                     std::none_of(pairs.begin(), pairs.end(), reads_images);
  std::vector<MatchResult> results;
  for (size_t first = 0; first < pairs.size(); first += at_once) {
    const std::span<const Pairing> some = std::span(pairs).subspan(first, std::min(at_once, pairs.size() - first));
    const bool last = first + some.size() == pairs.size();
    const auto sim = play(spec, some, options, {}, joins && last ? watched : nullptr);
    std::vector<float> stats = stats_of(*sim);
    for (size_t k = 0; k < some.size(); ++k) {
      const WorldRange worlds{static_cast<int64_t>(k) * options.episodes, options.episodes};
      results.push_back(checked(take_some(stats, worlds), options.episodes));
    }
  }
  if (watched && !joins) {
    MatchOptions few = options;
    few.episodes = watched->episodes;
    if (spec.params.n_agents <= kMaxAgents) few.n_threads = 1;  // games are few; the agents of a crowd are not
    play(spec, {&watched->pair, 1}, few, {watched->observer});
  }
  return results;
}

}  // namespace giga
