#include "policy/fused_actor.hpp"

namespace giga {

std::optional<FusedPolicy> fused_policy(const Actor& actor) {
  const at::Tensor& values = actor.parameters().values();
  const std::optional<FusedMlp> mlp = actor.fused_mlp();
  if (!actor.takes_fused_kernels() || !mlp || !values.is_cuda() || !fused_gradients_run(values.get_device()))
    return std::nullopt;
  FusedPolicy policy{.net = *mlp, .parameters = values.const_data_ptr<float>(), .actions = actor.actions()};
  if (actor.actions() == ActionKind::continuous) policy.continuous.log_std = policy.parameters + mlp->log_std;
  if (actor.normalizes()) {
    policy.obs_mean = actor.normalizer().mean().const_data_ptr<float>() + actor.inputs().first;
    policy.obs_std = actor.normalizer().std().const_data_ptr<float>() + actor.inputs().first;
    policy.obs_limit = kNormalizedLimit;
  }
  return policy;
}

}  // namespace giga
