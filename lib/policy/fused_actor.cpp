#include "policy/fused_actor.hpp"

#include "policy/cpu_kernels.hpp"

namespace giga {

std::optional<FusedPolicy> fused_policy(const Actor& actor) {
  const at::Tensor& values = actor.parameters().values();
  const std::optional<FusedMlp> mlp = actor.fused_mlp();
  if (!actor.takes_fused_kernels() || !mlp) return std::nullopt;
  const bool serves = values.is_cuda() ? FusedPolicy::serves(*mlp) && actor.precision() == Precision::tf32 &&
                                             fused_gradients_run(values.get_device())
                                       : actor.precision() == Precision::fp32;
  if (!serves) return std::nullopt;
  FusedPolicy policy{.net = *mlp, .parameters = values.const_data_ptr<float>(), .actions = actor.actions()};
  if (actor.actions() == ActionKind::continuous) policy.continuous.log_std = policy.parameters + mlp->log_std;
  if (actor.normalizes()) {
    policy.obs_mean = actor.normalizer().mean().const_data_ptr<float>() + actor.inputs().first;
    policy.obs_std = actor.normalizer().std().const_data_ptr<float>() + actor.inputs().first;
    policy.obs_limit = kNormalizedLimit;
  }
  return policy;
}

void act_fused(std::span<const FusedPolicy> policies, bool behind_step, const ParallelFor& parallel_for) {
  if (parallel_for.device().is_cuda())
    return launch_fused_policies(policies, behind_step, parallel_for.device().index, parallel_for.stream());
  for (const FusedPolicy& policy : policies) run_fused_policy(policy, parallel_for.pool());
}

}  // namespace giga
