#include "learn/team_policy.hpp"

#include "core/error.hpp"
#include "core/seeds.hpp"
#include "rollout/tensors.hpp"

namespace giga {

bool learns(const TrainConfig& config, int team) {
  return config.opponent == Opponent::self_play || config.learning_team == team;
}

std::string actor_prefix(int team) { return cat("team_", team, "/actor/"); }

uint64_t network_seed(const LoadedRun& run, int team, int role) {
  return seed_of(run.config.seed, Purpose::network, static_cast<uint64_t>(team * 2 + role));
}

Precision precision_on(const LoadedRun& run, Device device) {
  return device.is_cuda() ? run.config.train.precision : Precision::fp32;
}

Actor make_actor(const LoadedRun& run, int team, Device device) {
  const bool gradients = !is_evolution(run.config.train);
  return Actor(actor_config(run.config), input_columns(actor_config(run.config).inputs, run.spec),
               run.spec.params.actions, gradients && run.config.mappo.obs_norm, precision_on(run, device),
               torch_device(device), network_seed(run, team, 0));
}

}  // namespace giga
