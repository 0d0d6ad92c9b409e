#include "eval/match.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/error.hpp"
#include "cuda/rows.hpp"
#include "cuda/runtime.hpp"
#include "policy/network_state.hpp"
#include "rollout/shapes.hpp"

namespace giga {
namespace {

constexpr int kStepsBetweenChecks = 64;  // looking whether all episodes are over makes the host wait

bool all_finished(Simulator& sim) {
  std::vector<Phase> phases(static_cast<size_t>(sim.n_worlds()));
  sim.synchronize();
  sim.memory().to_host(phases.data(), sim.state().view().phase, phases.size());
  return std::all_of(phases.begin(), phases.end(), [](Phase phase) { return phase == Phase::waits; });
}

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

MatchResult play_match(const SimSpec& spec, const Player& side0, const Player& side1, const MatchOptions& options) {
  GIGA_CHECK(options.episodes > 0, "episodes: ", options.episodes);
  const Player player[kNTeams] = {side0, side1};
  const SimSpec limited = spec.with_time_limit();  // every episode ends, so that each is counted
  SimOptions sim_options;
  sim_options.n_worlds = options.episodes;
  sim_options.seed = options.seed;
  sim_options.on_done = OnDone::freeze;
  sim_options.n_threads = options.n_threads;
  const auto sim = make_simulator(limited, sim_options, options.device);
  const RowRunner rows(options.device, options.n_threads);

  Buffer<float> obs[kNTeams];
  Buffer<float> action[kNTeams];
  NetworkState state[kNTeams];  // one episode for each world: nothing is ever forgotten
  StepIo io;
  io.obs_stride = spec.padded_observation_size();
  for (int team = 0; team < kNTeams; ++team) {
    const MatchShapes shapes = match_shapes(spec, team, options.episodes, player[team].looks());
    action[team] = Buffer<float>(sim->memory(), static_cast<size_t>(shapes.action.elements()));
    obs[team] = Buffer<float>(sim->memory(), static_cast<size_t>(shapes.obs.elements()));
    io.team[team].action = action[team].data();
    io.team[team].obs = obs[team].data();
  }

  sim->start(io);
  for (int step = 0; step < limited.params.max_episode_length; ++step) {
    if (step % kStepsBetweenChecks == 0 && step > 0 && all_finished(*sim)) break;
    for (int team = 0; team < kNTeams; ++team)
      act(player[team], *sim, rows, team, {obs[team].data(), action[team].data(), nullptr, nullptr, &state[team]});
    sim->step(io);
  }

  const MatchResult result = match_result(sim->take_stats());
  GIGA_CHECK(result.episodes == options.episodes, result.episodes, " of ", options.episodes, " episodes ended");
  return result;
}

}  // namespace giga
