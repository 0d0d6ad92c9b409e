#include "learn/mappo/fused_gradients.hpp"

#include <ATen/ATen.h>

#include <algorithm>

#include "core/error.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

constexpr int kMostAgents = 64;  // of a team: a tile has whole states

}  // namespace

std::string fused_gradients_refusal(const Actor& actor, const Critic& critic, int n_agents, Device device) {
  if (!device.is_cuda()) return "they are for GPUs";
  if (!fused_gradients_run(device.index)) return "the GPU has less than 227 KB of shared memory for a block";
  if (actor.precision() != Precision::tf32) return "they compute in TF32 (train.precision)";
  if (critic.needs_state()) return "they know no true state (mappo.critic.kind)";
  if (n_agents > kMostAgents) return cat("they serve teams of at most ", kMostAgents, " agents");
  const auto network = [](const char* name, bool serves) {
    return serves ? std::string()
                  : cat("they serve dense networks with two hidden layers of at most ", FusedMlp::kHidden,
                        ", without layer normalisation, on at most ", FusedMlp::kMaxInput, " numbers (", name, ")");
  };
  const std::string reason = network("mappo.actor", actor.fused_mlp().has_value());
  return reason.empty() ? network("mappo.critic", critic.fused_mlp().has_value()) : reason;
}

FusedGradients::FusedGradients(const Actor& actor, const Critic& critic, int n, Device device, void* stream)
    : actor_(actor),
      critic_(critic),
      actor_mlp_(actor.fused_mlp().value()),
      critic_mlp_(critic.fused_mlp().value()),
      index_(device.index),
      stream_(stream) {
  const auto options = at::TensorOptions().dtype(at::kFloat).device(torch_device(device));
  moments_ = at::empty({kMomentParts, kMoments}, options.dtype(at::kDouble));
  partial_ = at::empty({fused_blocks(index_), std::max(actor_mlp_.size, critic_mlp_.size) + kFusedSums}, options);
  sums_ = at::empty({kFusedSums}, options);
  rows_.n = n;
  if (actor.normalizes()) {
    rows_.obs_mean = actor.normalizer().mean().const_data_ptr<float>();
    rows_.obs_std = actor.normalizer().std().const_data_ptr<float>();
    rows_.obs_limit = kNormalizedLimit;
  }
}

void FusedGradients::choose(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& states) {
  GIGA_CHECK(obs.is_contiguous() && alive.is_contiguous(), "observations with gaps");
  states_ = states.defined() ? states.contiguous() : states;
  rows_.states = states_.defined() ? states_.const_data_ptr<int64_t>() : nullptr;
  rows_.n_states = states_.defined() ? states_.numel() : alive.numel() / rows_.n;
  rows_.obs = obs.const_data_ptr<float>();
  rows_.obs_stride = obs.size(-1);
  rows_.alive = alive.const_data_ptr<uint8_t>();
}

FusedRows FusedGradients::rows_of(const InputColumns& inputs) const {
  FusedRows rows = rows_;
  rows.obs += inputs.first;
  if (rows.obs_mean) {
    rows.obs_mean += inputs.first;
    rows.obs_std += inputs.first;
  }
  return rows;
}

void FusedGradients::write_values(const at::Tensor& values) {
  GIGA_CHECK(values.is_contiguous(), "values with gaps");
  if (rows_.n_states == 0) return;
  launch_critic_gradient({.net = critic_mlp_,
                          .parameters = critic_.parameters().values().const_data_ptr<float>(),
                          .rows = rows_of(critic_.inputs()),
                          .values = values.data_ptr<float>()},
                         index_, stream_);
}

void FusedGradients::take_moments(const at::Tensor& advantage) {
  launch_moments(rows_, advantage.const_data_ptr<float>(), moments_.data_ptr<double>(), index_, stream_);
}

const at::Tensor& FusedGradients::actor_gradient(const FusedPolicyLoss& loss) {
  launch_actor_gradient({.net = actor_mlp_,
                         .parameters = actor_.parameters().values().const_data_ptr<float>(),
                         .rows = rows_of(actor_.inputs()),
                         .loss = loss,
                         .moments = moments_.const_data_ptr<double>(),
                         .partial = partial_.data_ptr<float>()},
                        index_, stream_);
  launch_gradient_sum(partial_.const_data_ptr<float>(), actor_mlp_.size,
                      actor_.parameters().gradient().data_ptr<float>(), sums_.data_ptr<float>(), index_, stream_);
  return sums_;
}

const at::Tensor& FusedGradients::critic_gradient(const FusedValueLoss& loss) {
  launch_critic_gradient({.net = critic_mlp_,
                          .parameters = critic_.parameters().values().const_data_ptr<float>(),
                          .rows = rows_of(critic_.inputs()),
                          .loss = loss,
                          .moments = moments_.const_data_ptr<double>(),
                          .partial = partial_.data_ptr<float>()},
                         index_, stream_);
  launch_gradient_sum(partial_.const_data_ptr<float>(), critic_mlp_.size,
                      critic_.parameters().gradient().data_ptr<float>(), sums_.data_ptr<float>(), index_, stream_);
  return sums_;
}

}  // namespace giga
