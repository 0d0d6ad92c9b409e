#include "learn/players/value_function.hpp"

#include <torch/types.h>

#include <algorithm>

#include "learn/mappo/fused_update.hpp"
#include "learn/team_policy.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"

namespace giga {

ValueFunction::ValueFunction(const LoadedRun& run, int team, const Actor& actor, Device device)
    : actor_(actor),
      parallel_for_(device, 1, current_stream(device)),  // a few rows at a time
      critic_(run.config.mappo.critic, critic_shape(run.config.mappo.critic, actor, run.spec, team), Precision::fp32,
              parallel_for_, torch_device(device), std::nullopt),
      norm_(1, run.config.mappo.value_norm_beta, torch_device(device)) {
  if (device.is_cuda() && run.config.mappo.fused &&
      fused_update_refusal(actor, critic_, run.spec.params.n_team[team], device).empty())
    fused_ = critic_.fused_mlp();
  if (fused_ && fused_->is_wide()) fused_.reset();  // whose kernels need work memory
}

std::unique_ptr<ValueFunction> ValueFunction::load(const LoadedRun& run, int team, const NamedArrays& arrays,
                                                   const Actor& actor, Device device) {
  const std::string critic = cat("team_", team, "/critic/");
  if (std::none_of(arrays.begin(), arrays.end(), [&](const NamedArray& a) { return a.name.starts_with(critic); }))
    return nullptr;
  auto values = std::unique_ptr<ValueFunction>(new ValueFunction(run, team, actor, device));
  values->critic_.load(critic, arrays);
  values->norm_.load(cat("team_", team, "/value_norm/"), arrays);
  return values;
}

at::Tensor ValueFunction::forward(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& state,
                                  NetworkState& memory) const {
  at::NoGradGuard no_grad;
  if (fused_) {
    const at::Tensor seen = (critic_.needs_state() ? state : obs).contiguous(), living = alive.contiguous();
    const at::Tensor value = at::empty(alive.sizes(), seen.options());
    const FusedRows rows = fused_critic_rows(critic_, actor_, static_cast<int>(alive.size(1)), seen, living);
    write_fused_values(critic_, *fused_, rows, parallel_for_, value);
    return value * norm_.std() + norm_.mean();
  }
  at::Tensor after;
  const at::Tensor value = critic_.forward(critic_.input_of(actor_, obs), alive.to(at::kFloat), state,
                                           {.start = memory.rows, .states = &after});
  if (critic_.state_size() > 0) memory.rows = after[0];
  return value * norm_.std() + norm_.mean();
}

}  // namespace giga
