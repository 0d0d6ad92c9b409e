// sim_hash [STEPS]: steps worlds of five against five with random actions, with nothing but lib/core and lib/sim, and
// prints a hash of their state. The preset `sim` and an ordinary build print the same.
#include <cstdio>
#include <cstdlib>
#include <span>
#include <vector>

#include "core/fnv1a.hpp"
#include "core/philox.hpp"
#include "sim/row_layout.hpp"
#include "sim/simulator.hpp"

namespace giga {
namespace {

SimSpec five_vs_five() {
  SimSpec spec;
  spec.name = "five_vs_five";
  for (int i = 0; i < 10; ++i) {
    AgentSpec agent;
    agent.team = i / 5;
    spec.agents.push_back(agent);
  }
  MapSpec map;
  map.name = "one_box";
  map.boxes = {{4, 4, 6, 6, 0, 10}};
  map.start[0] = {0.5f, 0.5f, 2.5f, 9.5f, 2, 8, -1, 1};
  map.start[1] = {7.5f, 0.5f, 9.5f, 9.5f, 2, 8, 2, 4};
  spec.maps = {map};
  spec.params.damage_cone_depth2 = 4;
  spec.params.max_episode_length = 200;
  spec.params.waypoints = spec.params.egocentric_view = true;
  spec.params.reward_weight[static_cast<int>(RewardTerm::damage)] = 1;
  spec.finish();
  return spec;
}

int run(int steps) {
  constexpr int kWorlds = 64;
  const SimSpec spec = five_vs_five();
  SimOptions options;
  options.n_worlds = kWorlds;
  options.seed = 1;
  const auto sim = make_cpu_simulator(spec, options);
  const RowLayout layout = observation_rows(spec);
  std::vector<int32_t> action[kNTeams];
  std::vector<float> rows[kNTeams];
  StepIo io;
  for (int t = 0; t < kNTeams; ++t) {
    const auto agents = static_cast<size_t>(kWorlds * spec.params.n_team[t]);
    action[t].resize(agents);
    rows[t].resize(agents * static_cast<size_t>(layout.stride()));
    io.team[t].action = action[t].data();
    layout.attach(io.team[t], layout.set(), rows[t].data());
  }
  sim->start(io);
  Fnv1a hash;
  for (int step = 0; step < steps; ++step) {
    for (uint32_t t = 0; t < kNTeams; ++t) {
      DrawKey key(2, t, static_cast<uint32_t>(step));
      for (size_t k = 0; k < action[t].size(); ++k)
        action[t][k] = static_cast<int32_t>(key.uniform(Draw::action, static_cast<uint32_t>(k), 0) * kNDiscreteActions);
    }
    sim->step(io);
    if (step % 64 != 63 && step + 1 != steps) continue;
    hash.add_all(sim->state().save());
    for (const std::vector<float>& team : rows) {
      const auto* bytes = reinterpret_cast<const uint8_t*>(team.data());
      hash.add_all(std::span(bytes, team.size() * sizeof(float)));
    }
  }
  std::printf("%016llx\n", static_cast<unsigned long long>(hash.value()));
  return 0;
}

}  // namespace
}  // namespace giga

int main(int argc, char** argv) { return giga::run(argc > 1 ? std::atoi(argv[1]) : 1000); }
