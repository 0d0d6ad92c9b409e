#include "eval/match.hpp"

#include <algorithm>
#include <cmath>

#include "config/fields.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "cuda/rows.hpp"
#include "cuda/runtime.hpp"
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

}  // namespace

MatchResult play_match(const SimSpec& spec, const Player& side0, const Player& side1, const MatchOptions& options) {
  GIGA_CHECK(options.episodes > 0, "episodes: ", options.episodes);
  const Player player[kNTeams] = {side0, side1};
  SimSpec limited = spec;  // every episode ends, so that each is counted
  if (limited.params.max_episode_length == 0) limited.params.max_episode_length = kMatchStepLimit;
  SimOptions sim_options;
  sim_options.n_worlds = options.episodes;
  sim_options.seed = options.seed;
  sim_options.on_done = OnDone::freeze;
  sim_options.n_threads = options.n_threads;
  const auto sim = make_simulator(limited, sim_options, options.device);
  const RowRunner rows(options.device, options.n_threads);

  Buffer<float> obs[kNTeams];
  Buffer<float> action[kNTeams];
  StepIo io;
  io.obs_stride = spec.padded_observation_size();
  for (int team = 0; team < kNTeams; ++team) {
    const MatchShapes shapes = match_shapes(spec, team, options.episodes, player[team].actor != nullptr);
    action[team] = Buffer<float>(sim->memory(), static_cast<size_t>(shapes.action.elements()));
    obs[team] = Buffer<float>(sim->memory(), static_cast<size_t>(shapes.obs.elements()));
    io.team[team].action = action[team].data();
    io.team[team].obs = obs[team].data();
  }

  sim->start(io);
  for (int step = 0; step < limited.params.max_episode_length; ++step) {
    if (step % kStepsBetweenChecks == 0 && step > 0 && all_finished(*sim)) break;
    for (int team = 0; team < kNTeams; ++team)
      act(player[team], *sim, rows, team, {obs[team].data(), action[team].data(), nullptr, nullptr});
    sim->step(io);
  }

  const EpisodeStats stats = sim->take_stats();
  MatchResult result;
  result.episodes = static_cast<int>(std::lround(stats[EpisodeStat::episodes]));
  GIGA_CHECK(result.episodes == options.episodes, result.episodes, " of ", options.episodes, " episodes ended");
  const auto mean = [&](EpisodeStat s) { return stats[s] / options.episodes; };
  result.wins[0] = static_cast<int>(std::lround(stats[EpisodeStat::wins_0]));
  result.wins[1] = static_cast<int>(std::lround(stats[EpisodeStat::wins_1]));
  result.ties = static_cast<int>(std::lround(stats[EpisodeStat::ties]));
  result.mean_return[0] = mean(EpisodeStat::return_0);
  result.mean_return[1] = mean(EpisodeStat::return_1);
  result.mean_return_masked[0] = mean(EpisodeStat::return_masked_0);
  result.mean_return_masked[1] = mean(EpisodeStat::return_masked_1);
  result.mean_score[0] = mean(EpisodeStat::score_0);
  result.mean_score[1] = mean(EpisodeStat::score_1);
  result.mean_length = mean(EpisodeStat::length);
  return result;
}

Scripted parse_scripted(const std::string& name) {
  const std::vector<std::string> names = FieldCodec<Scripted>::names();
  for (size_t k = 0; k < names.size(); ++k)
    if (name == names[k]) return static_cast<Scripted>(k);
  throw InputError(cat("opponent '", name, "' is unknown", nearest_hint(name, names), "; allowed: ", join(names)));
}

}  // namespace giga
