#include "rollout/group_policy.hpp"

#include <torch/types.h>

namespace giga {

GroupPolicy::GroupPolicy(const Actor& network, const ActorConfig& config, Precision precision)
    : normalize_(network.normalizes()),
      shape_(config, network.inputs(), network.actions(), false, precision, network.parameters().values().device(), 0) {
  shape_.take_fused_kernels(network.takes_fused_kernels());
}

at::Tensor GroupPolicy::row_of(const Actor& actor) {
  at::NoGradGuard no_grad;
  const at::Tensor& values = actor.parameters().values();
  if (!actor.normalizes()) return values.detach();
  return at::cat({values, actor.normalizer().mean(), actor.normalizer().std()});
}

at::Tensor GroupPolicy::forward(const at::Tensor& obs, NetworkState& state) const {
  at::NoGradGuard no_grad;
  const int64_t d = shape_.inputs().row;
  at::Tensor x = obs.view({groups(), -1, d});
  const int64_t p = shape_.parameters().size();
  if (normalize_) {
    const auto moment = [&](int64_t k) { return rows_.narrow(1, p + k * d, d).unsqueeze(1); };
    x = RunningNorm::normalized(x, moment(0), moment(1));
  }
  if (state.rows.defined()) state.rows = state.rows.view({groups(), -1, state_size()});
  const at::Tensor head = shape_.forward_members(rows_.narrow(1, 0, p), x, state);
  if (state.rows.defined()) state.rows = state.rows.view({obs.size(0), -1});
  return head.contiguous().view({obs.size(0), -1});
}

std::optional<FusedPolicy> GroupPolicy::fused() const {
  std::optional<FusedPolicy> policy = fused_policy(shape_);
  if (!policy) return policy;
  policy->groups = static_cast<int>(groups());
  policy->parameters = rows_.const_data_ptr<float>();
  policy->group_stride = rows_.stride(0);
  if (actions() == ActionKind::continuous) policy->continuous.log_std = policy->parameters + log_std_offset();
  if (normalize_) {
    policy->obs_mean = policy->parameters + shape_.parameters().size() + inputs().first;
    policy->obs_std = policy->obs_mean + inputs().row;
    policy->obs_limit = kNormalizedLimit;
  }
  return policy;
}

}  // namespace giga
