// Both teams of a small run with a league, for tests of frozen opponents.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "cuda/runtime.hpp"
#include "learn/mappo/ppo_team.hpp"
#include "learn/opponents/league.hpp"
#include "rollout/collector.hpp"
#include "rollout/stream.hpp"
#include "runs.hpp"

namespace giga::test {

inline constexpr int kSmallRunWorlds = 24;  // of SmallRun

/// Both teams with their networks, and a league that collects rollouts; nothing is learned.
struct LeagueGames {
  explicit LeagueGames(const SmallRun& small, int64_t n_shards = 1, const SumOverRanks& sum = {}, Device device = kCpu)
      : run(small.load()),
        parallel_for(device, 1, current_stream(device)),
        shares(world_shares(run.config.opponents, kSmallRunWorlds, n_shards)),
        team{{run, 0, device, parallel_for, shares.learning(0)}, {run, 1, device, parallel_for, shares.learning(1)}},
        league(run, shares, {&team[0].actor(), &team[1].actor()}, parallel_for, sum),
        sim(make_simulator(run.spec, {kSmallRunWorlds, 17, 0, OnDone::reset, 1}, device, parallel_for.stream())),
        collector(*sim, parallel_for, {run.config.mappo.horizon, team[0].needs_state(), false},
                  {league.side(0), league.side(1)}) {
    collector.start();
  }
  void collect() {
    league.begin();
    collector.collect();
  }
  const LoadedRun run;
  const ParallelFor parallel_for;
  const WorldShares shares;
  PpoTeam team[kNTeams];
  League league;
  std::unique_ptr<Simulator> sim;
  Collector collector;
};

inline SmallRun with_opponents(const std::string& keys) {
  SmallRun run;
  run.more = "opponents: {" + keys + "}\n";
  return run;
}

/// Writes episodes, wins of team 0, wins of team 1 and ties of a world.
inline void set_stats(const Simulator& sim, int64_t world, std::array<float, 4> counts) {
  float* stats = sim.state().view().stats + world * kNStatRows;
  const EpisodeStat stat[] = {EpisodeStat::episodes, EpisodeStat::wins_0, EpisodeStat::wins_1, EpisodeStat::ties};
  for (size_t k = 0; k < 4; ++k) stats[static_cast<int>(stat[k])] = counts[k];
}

}  // namespace giga::test
