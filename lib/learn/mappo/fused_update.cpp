#include "learn/mappo/fused_update.hpp"

#include <ATen/ATen.h>

#include <algorithm>

#include "core/error.hpp"
#include "cuda/ppo_wide.hpp"
#include "policy/cpu_kernels.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

constexpr int kMostAgents = FusedState::kMostAgents;  // of a team: a tile has whole states

/// A block of the gradients fills a multiprocessor, and the kernel of one team follows that of the other: where ranks
/// add up gradients on another stream than theirs, one multiprocessor is left to that, which else would wait at each of
/// its steps until a kernel of some hundred microseconds ends.
int blocks_on(Device device, bool alone) {
  if (!device.is_cuda()) return kCpuParts;
  return fused_blocks(device.index) - (alone ? 0 : 1);
}
int step_blocks_on(Device device, const FusedMlp& actor, const FusedMlp& critic) {
  return device.is_cuda() ? fused_step_blocks(actor.size, critic.size) : 0;
}

/// The same rows with what a network reads of their observations.
FusedRows only(const InputColumns& inputs, FusedRows rows) {
  rows.obs += inputs.first;
  if (rows.obs_mean) {
    rows.obs_mean += inputs.first;
    rows.obs_std += inputs.first;
  }
  return rows;
}

/// Makes work memory (int32 words) at least this large; it never shrinks.
void grow(at::Tensor& memory, int64_t words, Device device) {
  if (words == 0 || (memory.defined() && memory.numel() >= words)) return;
  memory.reset();  // given back first
  memory = at::empty({words}, at::TensorOptions().dtype(at::kInt).device(torch_device(device)));
}
uint32_t* words_of(const at::Tensor& memory) {
  return memory.defined() ? reinterpret_cast<uint32_t*>(memory.data_ptr<int32_t>()) : nullptr;
}
/// Rows of `partial`.
int partial_rows_on(Device device, const FusedMlp& net, int blocks) {
  return device.is_cuda() ? partial_rows(net, blocks) : blocks;
}
/// Tiles of each block whose values are computed at once: so many that loading the weights is a small part, and that
/// they take less memory than the gradients of a large minibatch.
constexpr int kValueTiles = 32;

std::string network_refusal(const char* name, bool serves) {
  return serves ? std::string()
                : cat("they serve dense networks with two hidden layers of at most ", FusedMlp::kHidden,
                      ", without layer normalisation, on at most ", FusedMlp::kMaxInput, " numbers (", name, ")");
}

std::string state_refusal() {
  return cat("of critics of the true state they serve those with one or two hidden layers of at most ",
             FusedMlp::kBlockHidden, ", without layer normalisation, in games of at most ", FusedState::kMostAgents,
             " agents a team and ", FusedState::kMostWorld, " numbers of the world (mappo.critic)");
}

}  // namespace

std::string fused_actor_refusal(const Actor& actor, int n_agents, Device device) {
  if (device.is_cuda() && !fused_gradients_run(device.index))
    return "the GPU has less than 227 KB of shared memory for a block";
  if (device.is_cuda() && actor.precision() != Precision::tf32)
    return "they compute with the 10 bits of mantissa of TF32 (train.precision)";
  if (actor.reads_image()) return "they read no images (mappo.actor.encoder)";
  if (actor.state_size() > 0) return "they know no memory (mappo.actor.memory)";
  if (n_agents > kMostAgents) return cat("they serve teams of at most ", kMostAgents, " agents");
  return network_refusal("mappo.actor", actor.fused_mlp().has_value());
}

std::string fused_update_refusal(const Actor& actor, const Critic& critic, int n_agents, Device device) {
  if (const std::string reason = fused_actor_refusal(actor, n_agents, device); !reason.empty()) return reason;
  if (critic.reads_image()) return "they read no images (mappo.critic.encoder)";
  if (critic.shares_encoder()) return "they know no encoder of two networks (mappo.critic.shared_encoder)";
  if (critic.state_size() > 0) return "they know no memory (mappo.critic.memory)";
  if (!critic.fused_mlp()) return critic.needs_state() ? state_refusal() : network_refusal("mappo.critic", false);
  return "";
}

FusedRows fused_rows(const Actor& actor, int n, const at::Tensor& obs, const at::Tensor& alive,
                     const at::Tensor& states) {
  GIGA_CHECK(obs.is_contiguous() && alive.is_contiguous(), "observations with gaps");
  FusedRows rows;
  rows.states = states.defined() ? states.const_data_ptr<int64_t>() : nullptr;
  rows.n_states = states.defined() ? states.numel() : alive.numel() / n;
  rows.n = n;
  rows.obs = obs.const_data_ptr<float>();
  rows.obs_stride = obs.size(-1);
  rows.alive = alive.const_data_ptr<uint8_t>();
  if (actor.normalizes()) {
    rows.obs_mean = actor.normalizer().mean().const_data_ptr<float>();
    rows.obs_std = actor.normalizer().std().const_data_ptr<float>();
    rows.obs_limit = kNormalizedLimit;
  }
  return rows;
}

FusedRows fused_critic_rows(const Critic& critic, const Actor& actor, int n, const at::Tensor& seen,
                            const at::Tensor& alive, const at::Tensor& states) {
  FusedRows rows = fused_rows(actor, n, seen, alive, states);
  if (!critic.needs_state()) return only(critic.inputs(), rows);
  rows.obs_mean = rows.obs_std = nullptr;
  return rows;
}

void write_fused_values(const Critic& critic, const FusedMlp& net, const FusedRows& rows,
                        const ParallelFor& parallel_for, const at::Tensor& values, const at::Tensor& work) {
  GIGA_CHECK(values.is_contiguous(), "values with gaps");
  if (rows.n_states == 0) return;
  const Device device = parallel_for.device();
  FusedCritic pass{.net = net,
                   .parameters = critic.parameters().values().const_data_ptr<float>(),
                   .rows = rows,
                   .n_partial = blocks_on(device, true),
                   .values = values.data_ptr<float>()};
  if (work.defined()) {
    pass.wide = words_of(work);
    pass.wide_tiles = WideLayers::tiles_for_values(net, rows.n, work.numel());
  }
  if (device.is_cuda())
    launch_critic_gradient(pass, device.index, parallel_for.stream());
  else
    run_critic_gradient(pass, parallel_for.pool());
}

FusedUpdate::FusedUpdate(const Actor& actor, const Critic& critic, int n, const ParallelFor& parallel_for,
                         const SumOverRanks& sum, FusedUpdate* twin)
    : actor_(actor),
      critic_(critic),
      actor_mlp_(actor.fused_mlp().value()),
      critic_mlp_(critic.fused_mlp().value()),
      n_(n),
      parallel_for_(parallel_for),
      sum_(sum),
      blocks_(blocks_on(parallel_for.device(), sum.alone())) {
  const Device device = parallel_for.device();
  if (device.is_cuda()) beside_ = std::make_unique<Beside>(device.index, parallel_for.stream());
  const auto options = at::TensorOptions().dtype(at::kFloat).device(torch_device(device));
  actor_partial_ = at::empty({partial_rows_on(device, actor_mlp_, blocks_), actor_mlp_.size + kFusedSums}, options);
  critic_partial_ = at::empty({partial_rows_on(device, critic_mlp_, blocks_), critic_mlp_.size + kFusedSums}, options);
  if (!sum_.alone()) over_ranks_ = at::empty({actor_mlp_.size + critic_mlp_.size + 2 * kFusedSums}, options);
  sums_ = at::zeros({2, kFusedSums}, options);
  squares_ = at::empty({step_blocks_on(device, actor_mlp_, critic_mlp_)}, options.dtype(at::kDouble));
  finished_ = at::zeros({1}, options.dtype(at::kInt));
  if (twin) {
    twin_ = twin;
    twin_->twin_ = this;
  }
}

FusedUpdate::~FusedUpdate() {
  if (twin_) twin_->twin_ = nullptr;
}

void FusedUpdate::write_values(const at::Tensor& seen, const at::Tensor& alive, const at::Tensor& states,
                               const at::Tensor& values) {
  states_ = states.defined() ? states.contiguous() : states;
  const FusedRows rows = fused_critic_rows(critic_, actor_, n_, seen, alive, states_);
  if (beside_) {
    const int64_t tiles = std::min<int64_t>(WideLayers::tiles_of(n_, rows.n_states), int64_t{kValueTiles} * blocks_);
    grow(wide_, WideLayers::words_for_values(critic_mlp_, n_, tiles), parallel_for_.device());
  }
  write_fused_values(critic_, critic_mlp_, rows, parallel_for_, values, critic_mlp_.is_wide() ? wide_ : at::Tensor());
}

void FusedUpdate::begin_epoch(const FusedInputs& inputs, const at::Tensor& alive, const at::Tensor& states,
                              int n_minibatches, const at::Tensor& advantage) {
  states_ = states.contiguous();
  rows_ = only(actor_.inputs(), fused_rows(actor_, n_, inputs.obs, alive, states_));
  critic_rows_ =
      fused_critic_rows(critic_, actor_, n_, critic_.needs_state() ? inputs.true_state : inputs.obs, alive, states_);
  pieces_ = {rows_.n_states, n_minibatches};
  if (!moments_.defined() || moments_.size(0) != n_minibatches)
    moments_ = at::empty({n_minibatches, kMomentParts, kMoments}, squares_.options());
  // The first piece is a largest one.
  if (beside_) {
    grow(kept_states_, kept_words(critic_mlp_, n_, pieces_.begin(1), blocks_), parallel_for_.device());
    const auto words = [this](const FusedMlp& net) {
      return WideLayers::words_for(net, n_, pieces_.begin(1), blocks_);
    };
    grow(wide_, std::max(words(actor_mlp_), words(critic_mlp_)), parallel_for_.device());
  }
  const auto* a = advantage.const_data_ptr<float>();
  auto* moments = moments_.data_ptr<double>();
  if (!beside_) {
    run_moments(rows_, pieces_, a, moments);
    sum_(moments_);
    return;
  }
  launch_moments(rows_, pieces_, a, moments, index(), parallel_for_.stream());
  sum_(moments_);
  beside_->stream.fork();
  // Twins begin one after the other: what is queued on the main stream for the second reads the actor of both.
  if (twin_) twin_->beside_->stream.fork();
}

void FusedUpdate::end_epoch() {
  if (!beside_) return;
  beside_->stream.join();
  if (twin_) twin_->beside_->actor_step.wait(parallel_for_.stream());
}

void FusedUpdate::compute_gradients(int k, const FusedPolicyLoss& policy, const FusedValueLoss& value) {
  const double* moments = moments_.const_data_ptr<double>() + k * moments_.stride(0);
  const auto rows_of_piece = [&](FusedRows piece) {
    piece.states += pieces_.begin(k);
    piece.n_states = pieces_.begin(k + 1) - pieces_.begin(k);
    return piece;
  };
  const FusedActor actor{.net = actor_mlp_,
                         .parameters = actor_.parameters().values().const_data_ptr<float>(),
                         .rows = rows_of_piece(rows_),
                         .loss = policy,
                         .moments = moments,
                         .n_partial = blocks_,
                         .partial = actor_partial_.data_ptr<float>(),
                         .wide = words_of(wide_)};
  const FusedCritic critic{.net = critic_mlp_,
                           .parameters = critic_.parameters().values().const_data_ptr<float>(),
                           .rows = rows_of_piece(critic_rows_),
                           .loss = value,
                           .moments = moments,
                           .n_partial = blocks_,
                           .partial = critic_partial_.data_ptr<float>(),
                           .kept = words_of(kept_states_),
                           .wide = words_of(wide_)};
  if (beside_) {
    launch_gradients(actor, critic);
  } else {
    run_actor_gradient(actor, parallel_for_.pool());
    run_critic_gradient(critic, parallel_for_.pool());
  }
}

/// Of twins only one at a time has its turn with the actor: from the gradient to the step. The other's critic fills the
/// gap while parts are added up, over ranks too, and the step is taken, which leave most of the GPU idle: its gradient
/// is queued as that turn begins, so that its blocks find room as those of the actor's gradient end.
void FusedUpdate::launch_gradients(const FusedActor& actor, const FusedCritic& critic) {
  if (twin_) twin_->beside_->actor_turn.wait(stream());
  launch_critic_gradient(critic, index(), stream());
  if (twin_) {
    twin_->beside_->actor_step.wait(stream());
    beside_->actor_turn.set(stream());
  }
  launch_actor_gradient(actor, index(), stream());
}

at::Tensor FusedUpdate::own_gradient(const at::Tensor& partial, const FusedMlp& net) {
  return partial.narrow(1, 0, net.size).sum(0, false, at::kDouble);
}

void FusedUpdate::complete(FusedStep& step) const {
  float* sums = sums_.data_ptr<float>();
  const auto network = [&](FusedStep::Network& net, const at::Tensor& partial, int64_t size, float* to) {
    net.n_partial = static_cast<int>(partial.size(0));
    net.partial = partial.const_data_ptr<float>();
    net.size = size;
    net.sums = to;
  };
  network(step.actor, actor_partial_, actor_mlp_.size, sums);
  network(step.critic, critic_partial_, critic_mlp_.size, sums + kFusedSums);
  step.note.sums = sums;
  step.squares = squares_.data_ptr<double>();
  step.finished = reinterpret_cast<uint32_t*>(finished_.data_ptr<int32_t>());
}

/// In the place of this rank's parts: one part for each network, of all ranks; one message.
void FusedUpdate::add_ranks(FusedStep& step) {
  if (sum_.alone()) return;
  if (beside_) {
    launch_block_sums(step, over_ranks_.data_ptr<float>(), index(), stream());
    sum_(over_ranks_, stream());
  } else {
    at::cat_out(over_ranks_, {actor_partial_.sum(0), critic_partial_.sum(0)});
    sum_(over_ranks_);
  }
  step.actor.n_partial = step.critic.n_partial = 1;
  step.actor.partial = over_ranks_.const_data_ptr<float>();
  step.critic.partial = step.actor.partial + actor_partial_.size(1);
}

void FusedUpdate::add_up(FusedStep step) {
  complete(step);
  add_ranks(step);
  if (beside_)
    launch_gradient_sums(step, index(), stream());
  else
    run_gradient_sums(step);
}

void FusedUpdate::step(FusedStep step) {
  add_up(step);
  complete(step);
  if (!beside_) return run_adam(step);
  launch_adam(step, index(), stream());
  if (twin_) beside_->actor_step.set(stream());
}

// ---- The actor alone ------------------------------------------------------------------------------------------------

FusedActorGradient::FusedActorGradient(const Actor& actor, int n, const ParallelFor& parallel_for,
                                       const SumOverRanks& sum)
    : actor_(actor),
      mlp_(actor.fused_mlp().value()),
      n_(n),
      parallel_for_(parallel_for),
      sum_(sum),
      blocks_(blocks_on(parallel_for.device(), true)) {
  const auto options = at::TensorOptions().dtype(at::kFloat).device(torch_device(parallel_for.device()));
  moments_ = at::empty({1, kMomentParts, kMoments}, options.dtype(at::kDouble));
  partial_ = at::empty({partial_rows_on(parallel_for.device(), mlp_, blocks_), mlp_.size + kFusedSums}, options);
  sums_ = at::empty({kFusedSums}, options);
}

const at::Tensor& FusedActorGradient::compute(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& states,
                                              const FusedPolicyLoss& policy) {
  GIGA_CHECK(states.is_contiguous(), "states with gaps");
  const FusedRows rows = fused_rows(actor_, n_, obs, alive, states);
  const MinibatchPieces all{rows.n_states, 1};
  auto* moments = moments_.data_ptr<double>();
  const Device device = parallel_for_.device();
  if (device.is_cuda()) grow(wide_, WideLayers::words_for(mlp_, n_, rows.n_states, blocks_), device);
  const FusedActor pass{.net = mlp_,
                        .parameters = actor_.parameters().values().const_data_ptr<float>(),
                        .rows = only(actor_.inputs(), rows),
                        .loss = policy,
                        .moments = moments,
                        .n_partial = blocks_,
                        .partial = partial_.data_ptr<float>(),
                        .wide = words_of(wide_)};
  if (device.is_cuda()) {
    launch_moments(rows, all, policy.advantage, moments, device.index, parallel_for_.stream());
    sum_(moments_);
    launch_actor_gradient(pass, device.index, parallel_for_.stream());
  } else {
    run_moments(rows, all, policy.advantage, moments);
    sum_(moments_);
    run_actor_gradient(pass, parallel_for_.pool());
  }
  at::Tensor gradient = actor_.parameters().gradient();
  at::sum_out(gradient, partial_.narrow(1, 0, mlp_.size), 0);
  at::sum_out(sums_, partial_.narrow(1, mlp_.size, kFusedSums), 0);
  return sums_;
}

}  // namespace giga
