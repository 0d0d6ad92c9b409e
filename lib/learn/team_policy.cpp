#include "learn/team_policy.hpp"

#include "core/error.hpp"
#include "core/seeds.hpp"
#include "cuda/population_policy.hpp"
#include "cuda/runtime.hpp"
#include "rollout/tensors.hpp"

namespace giga {

bool learns(const TrainConfig& config, int team) {
  return config.opponent.is_self_play() || config.learning_team == team;
}

std::string actor_prefix(int team) { return cat("team_", team, "/actor/"); }

uint64_t network_seed(const LoadedRun& run, int team, int role) {
  return seed_of(run.config.seed, Purpose::network,
                 static_cast<uint64_t>(role < 2 ? team * 2 + role : role * kNTeams + team));
}

Precision precision_on(const LoadedRun& run, Device device) {
  return device.is_cuda() ? run.config.train.precision : Precision::fp32;
}

void check_precision(const LoadedRun& run, Device device) {
  if (precision_on(run, device) != Precision::fp16 || device.index >= cuda_device_count()) return;
  if (!population_policy_runs(device.index))
    throw InputError(cat("train.precision: fp16 needs a GPU of compute capability 8.0 or more, and ", device.name(),
                         " has less; allowed there: fp32, tf32, bf16"));
}

Actor make_actor(const LoadedRun& run, int team, Device device) {
  const PolicySettings policy = algorithm_of(run.config).policy(run.config);
  Actor actor(policy.actor, inputs_of(policy.actor, run.spec), run.spec.params.actions, policy.obs_norm,
              precision_on(run, device), torch_device(device), network_seed(run, team, 0));
  actor.take_fused_kernels(policy.fused);
  return actor;
}

}  // namespace giga
