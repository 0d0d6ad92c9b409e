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

/// Plays the games of all pairs, in worlds one after the other: as many for each as there are episodes.
std::unique_ptr<Simulator> play(const SimSpec& spec, std::span<const Pairing> pairs, const MatchOptions& options,
                                std::vector<GameObserver*> observers) {
  GIGA_CHECK(options.episodes > 0, "episodes: ", options.episodes);
  const SimSpec limited = spec.with_time_limit();  // every episode ends, so that each is counted
  SimOptions sim_options;
  sim_options.n_worlds = static_cast<int>(pairs.size()) * options.episodes;
  sim_options.seed = options.seed;
  sim_options.draw_period = pairs.size() > 1 ? options.episodes : 0;  // each pair has the draws of a match by itself
  sim_options.on_done = OnDone::freeze;
  sim_options.n_threads = options.n_threads;
  void* const stream = current_stream(options.device);
  auto sim = make_simulator(limited, sim_options, options.device, stream);
  const ParallelFor parallel_for(options.device, options.n_threads, stream);

  BothSides sides;
  for (size_t k = 0; k < pairs.size(); ++k)
    for (size_t side = 0; side < kNTeams; ++side)
      sides[side].push_back({pairs[k].side[side], {static_cast<int64_t>(k) * options.episodes, options.episodes}});
  Game game(*sim, parallel_for, sides, std::move(observers));
  game.start();
  game.play(limited.params.max_episode_length);
  sim->synchronize();  // before the game's buffers go
  return sim;
}

MatchResult checked(const EpisodeStats& stats, int episodes) {
  const MatchResult result = match_result(stats);
  GIGA_CHECK(result.episodes == episodes, result.episodes, " of ", episodes, " episodes ended");
  return result;
}

/// How many matches are played at once.
size_t beside_each_other(const SimSpec& spec, const std::vector<Pairing>& pairs, const MatchOptions& options) {
  for (const Pairing& pair : pairs)
    for (const auto& controller : pair.side)
      if (controller->reads().has(Observation::image)) return 1;
  const int64_t agents = int64_t{options.episodes} * spec.params.n_agents;
  return static_cast<size_t>(std::max<int64_t>(1, kAgentsAtOnce / agents));
}

}  // namespace

MatchResult play_match(const SimSpec& spec, std::shared_ptr<TeamController> side0,
                       std::shared_ptr<TeamController> side1, const MatchOptions& options,
                       std::vector<GameObserver*> observers) {
  const Pairing pair{{std::move(side0), std::move(side1)}};
  return checked(play(spec, {&pair, 1}, options, std::move(observers))->take_stats(), options.episodes);
}

std::vector<MatchResult> play_matches(const SimSpec& spec, const std::vector<Pairing>& pairs,
                                      const MatchOptions& options) {
  GIGA_CHECK(options.episodes > 0, "episodes: ", options.episodes);
  const size_t at_once = beside_each_other(spec, pairs, options), episodes = static_cast<size_t>(options.episodes);
  std::vector<MatchResult> results;
  for (size_t first = 0; first < pairs.size(); first += at_once) {
    const std::span<const Pairing> some = std::span(pairs).subspan(first, std::min(at_once, pairs.size() - first));
    const auto sim = play(spec, some, options, {});
    StateView state = sim->state().view();
    std::vector<float> stats(some.size() * episodes * kNStatRows);
    sim->memory().to_host(stats.data(), state.stats, stats.size() * sizeof(float));
    for (size_t k = 0; k < some.size(); ++k) {
      state.stats = stats.data() + k * episodes * kNStatRows;
      results.push_back(checked(take_host_stats(state, options.episodes), options.episodes));
    }
  }
  return results;
}

}  // namespace giga
