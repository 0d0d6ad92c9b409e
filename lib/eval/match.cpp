#include "eval/match.hpp"

#include <cmath>
#include <utility>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "game/game.hpp"
#include "rollout/stream.hpp"

namespace giga {
namespace {

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

}  // namespace

MatchResult play_match(const SimSpec& spec, std::shared_ptr<TeamController> side0,
                       std::shared_ptr<TeamController> side1, const MatchOptions& options,
                       std::vector<GameObserver*> observers) {
  GIGA_CHECK(options.episodes > 0, "episodes: ", options.episodes);
  const SimSpec limited = spec.with_time_limit();  // every episode ends, so that each is counted
  SimOptions sim_options;
  sim_options.n_worlds = options.episodes;
  sim_options.seed = options.seed;
  sim_options.on_done = OnDone::freeze;
  sim_options.n_threads = options.n_threads;
  void* const stream = current_stream(options.device);
  const auto sim = make_simulator(limited, sim_options, options.device, stream);
  const ParallelFor parallel_for(options.device, options.n_threads, stream);

  Game game(*sim, parallel_for, {everywhere(std::move(side0), *sim), everywhere(std::move(side1), *sim)},
            std::move(observers));
  game.start();
  game.play(limited.params.max_episode_length);

  const MatchResult result = match_result(sim->take_stats());
  GIGA_CHECK(result.episodes == options.episodes, result.episodes, " of ", options.episodes, " episodes ended");
  return result;
}

}  // namespace giga
