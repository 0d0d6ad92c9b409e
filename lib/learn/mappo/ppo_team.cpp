// How a team learns by MAPPO, from top to bottom: advantages, minibatches, the loss of the actor, the loss of the
// critic, normalisation. Papers:
//   PPO    Schulman et al. 2017, arXiv 1707.06347
//   GAE    Schulman et al. 2016, arXiv 1506.02438
//   MAPPO  Yu et al. 2022, arXiv 2103.01955, appendix A
// All agents of a team share one actor and one critic. The dead have weight 0 everywhere. The losses and their
// gradients are elementwise operations (math/gae.hpp, math/ppo_loss.hpp); LibTorch carries the gradients on through the
// networks.
#include "learn/mappo/ppo_team.hpp"

#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <tuple>

#include "learn/team_policy.hpp"
#include "math/gae.hpp"
#include "math/ppo_loss.hpp"
#include "rollout/tensors.hpp"

namespace giga {

// ---- Networks -------------------------------------------------------------------------------------------------------

PpoTeam::PpoTeam(const LoadedRun& run, int team, Device device, const ParallelFor& parallel_for,
                 const WorldRange& worlds, const SumOverRanks& sum)
    : config_(run.config.mappo),
      team_(team),
      n_(run.spec.params.n_team[team]),
      n_worlds_(run.config.train.n_worlds),
      worlds_(worlds),
      parallel_for_(parallel_for),
      sum_(sum),
      actor_(make_actor(run, team, device)),
      critic_(config_.critic, critic_shape(config_.critic, actor_, run.spec, team), precision_on(run, device),
              parallel_for, torch_device(device), network_seed(run, team, 1)),
      actor_adam_(actor_.parameters(), config_.adam_epsilon),
      critic_adam_(critic_.parameters(), config_.adam_epsilon),
      value_norm_(1, config_.value_norm_beta, torch_device(device)),
      entropy_coef_(config_.entropy_coef) {
  const auto options = at::TensorOptions().dtype(at::kFloat).device(torch_device(device));
  zero_ = at::zeros({1}, options);
  one_ = at::ones({1}, options);
  stop_ = at::zeros({1}, options);
  figures_ = at::zeros({kNFigures}, options);
  plain_because_ = config_.fused ? fused_update_refusal(actor_, critic_, n_, device) : "mappo.fused is false";
  if (plain_because_.empty()) fused_ = std::make_unique<FusedUpdate>(actor_, critic_, n_, parallel_for, sum_);
  if (config_.view_coef > 0) teacher_ = std::make_unique<ViewTeacher>(run, team, actor_, torch_device(device));
  if (critic_.state_size() > 0) {
    critic_memory_ = at::zeros({n_worlds_, n_, critic_.state_size()}, options);
    critic_start_ = at::zeros_like(critic_memory_);
  }
  if (!everywhere()) slots_ = states(at::arange((config_.horizon + 1) * worlds.count, options.dtype(at::kLong)));
}

// ---- Advantages -----------------------------------------------------------------------------------------------------

WeightedMoments::WeightedMoments(const at::Tensor& x_, const at::Tensor& weight_)
    : x(x_), weight(weight_), total((x * weight).sum()) {}

void WeightedMoments::square(const at::Tensor& inv_count) {
  mean = total * inv_count;
  squares = ((x - mean).square() * weight).sum();
}

at::Tensor WeightedMoments::inv_std(const at::Tensor& inv_count) const {
  return ((squares * inv_count).sqrt() + 1e-8).reciprocal();
}

std::pair<at::Tensor, at::Tensor> weighted_moments(const at::Tensor& x, const at::Tensor& weight,
                                                   const at::Tensor& inv_count, const SumOverRanks& sum) {
  WeightedMoments moments(x, weight);
  sum(moments.total);
  moments.square(inv_count);
  sum(moments.squares);
  return {moments.mean, moments.inv_std(inv_count)};
}

/// Of the rows with weight 1; 1 where there is none.
at::Tensor PpoTeam::inverse_count(const at::Tensor& weight) const {
  const at::Tensor count = weight.sum();
  sum_(count);
  return count.clamp_min(1).reciprocal();
}

/// What the critic reads of all slots [T + 1, W, ...] of a rollout or, `final`, of the last observations [1, W, ...] of
/// episodes that were truncated.
PpoTeam::CriticInput PpoTeam::critic_input(const Rollout& rollout, bool final) const {
  const TeamRollout& r = rollout.team[team_];
  const auto last = [](const at::Tensor& x) { return x.defined() ? x.unsqueeze(0) : x; };
  CriticInput input{r.obs, r.alive, rollout.true_state, rollout.images.states};
  if (final)
    input = {last(r.final_obs), last(r.final_alive), last(rollout.final_true_state), last(rollout.images.final_states)};
  if (critic_.needs_state() || critic_.reads_image()) input.obs = at::Tensor();
  if (!critic_.needs_state()) input.state = at::Tensor();
  if (!critic_.reads_image()) input.image_state = at::Tensor();
  return input;
}

/// Values [S, n] of these rows, for which images are drawn.
at::Tensor PpoTeam::critic_values(const KeptImages& images, const CriticInput& input, const Sequence& sequence) const {
  const at::Tensor seen = critic_.reads_image() ? images.draw(team_, input.image_state) : input.obs;
  return critic_.forward(critic_.input_of(actor_, seen), input.alive.to(at::kFloat), input.state, sequence);
}

/// Values [S, n] of these states, 0 for the others; of all if `states` is undefined.
at::Tensor PpoTeam::values_of(const KeptImages& images, const CriticInput& input, const at::Tensor& states) const {
  at::NoGradGuard no_grad;
  const bool all = !states.defined();
  at::Tensor values =
      all ? at::empty(input.alive.sizes(), zero_.options()) : at::zeros(input.alive.sizes(), zero_.options());
  if (fused_) {
    fused_->write_values(input.obs, input.alive, states, values);
    return values;
  }
  const int64_t count = all ? input.alive.size(0) : states.size(0);
  const int64_t at_once = critic_.reads_image() ? std::max<int64_t>(1, kImagesAtOnce / n_) : kValueChunk;
  for (int64_t from = 0; from < count; from += at_once) {
    const int64_t to = std::min(from + at_once, count);
    const at::Tensor some = all ? states : states.slice(0, from, to);
    const at::Tensor value = critic_values(
        images, input.each([&](const at::Tensor& x) { return all ? x.slice(0, from, to) : x.index_select(0, some); }));
    all ? values.slice(0, from, to).copy_(value) : values.index_copy_(0, some, value);
  }
  return values;
}

namespace {

/// Where episodes begin within a rollout: [T + 1, W] bool, at each slot. What was known before the rollout has been
/// forgotten by then where its first step begins one.
at::Tensor beginnings(const Rollout& rollout) {
  const at::Tensor ended = rollout.done != 0;  // the next step begins an episode
  return at::cat({at::zeros_like(ended.slice(0, 0, 1)), ended});
}

}  // namespace

// A critic with memory goes through all slots in a row. The value of an episode's last observation follows from what
// was remembered after the step before. -> values [(T + 1) W, n] and [W, n], 0 in worlds of others.
std::pair<at::Tensor, at::Tensor> PpoTeam::remembering_values(const Rollout& rollout) {
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), w = r.reward.size(1);
  const at::Tensor begins = beginnings(rollout);
  const at::Tensor values = at::zeros({t + 1, w, n_}, zero_.options()),
                   final_values = at::zeros({w, n_}, zero_.options());
  critic_start_.copy_(critic_memory_);
  const int64_t states_at_once = critic_.reads_image() ? kImagesAtOnce / n_ : kValueChunk;
  const int64_t worlds_at_once = std::max<int64_t>(1, states_at_once / (t + 1));
  for (int64_t from = worlds_.first; from < worlds_.end(); from += worlds_at_once) {
    const int64_t to = std::min(from + worlds_at_once, worlds_.end()), b = to - from;
    const auto critic = [&](bool final, const Sequence& sequence) {
      const auto rows = [&](const at::Tensor& x) { return x.slice(1, from, to).flatten(0, 1).contiguous(); };
      return critic_values(rollout.images, critic_input(rollout, final).each(rows), sequence);
    };
    const at::Tensor begin_here = begins.slice(1, from, to);
    at::Tensor after;  // [T + 1, B n, S]
    const at::Tensor value = critic(false, {.length = t + 1,
                                            .begins = begin_here.repeat_interleave(n_, 1),
                                            .start = critic_start_.slice(0, from, to).flatten(0, 1),
                                            .states = &after});
    values.slice(1, from, to).copy_(value.view({t + 1, b, n_}));
    after = after.view({t + 1, b, n_, -1});
    // Before slot T, from which the next rollout goes on.
    critic_memory_.slice(0, from, to).copy_(after[t - 1].masked_fill(begin_here[t].view({b, 1, 1}), 0));
    // A world is truncated at most once in a rollout.
    const at::Tensor truncated = rollout.done.slice(1, from, to) == static_cast<int64_t>(Done::truncated);  // [T, B]
    const at::Tensor when = truncated.to(at::kLong).argmax(0).view({1, b, 1, 1}).expand({1, b, n_, after.size(3)});
    const at::Tensor last = after.gather(0, when)[0].flatten(0, 1);
    final_values.slice(0, from, to).copy_(critic(true, {.start = last}));
  }
  return {values.view({(t + 1) * w, n_}), final_values};
}

// GAE, equations 11 to 16: the advantage is the sum of (gamma lambda)^k delta_(t + k), where delta_t = r_t + gamma
// V(s_(t + 1)) - V(s_t). The return, which the critic learns, is advantage + value.
void PpoTeam::compute_advantages(const Rollout& rollout) {
  at::NoGradGuard no_grad;
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), w = r.reward.size(1);
  at::Tensor value, final_value;
  if (critic_.state_size() > 0) {
    std::tie(value, final_value) = remembering_values(rollout);
  } else {
    const auto rows = [](const at::Tensor& x) { return x.flatten(0, 1); };
    value = values_of(rollout.images, critic_input(rollout, false).each(rows), slots_);
    final_value = values_of(rollout.images, critic_input(rollout, true).each(rows),
                            everywhere() ? slots_ : slots_.slice(0, 0, worlds_.count));
  }

  advantage_ = at::empty_like(r.reward);
  returns_ = at::empty_like(r.reward);
  parallel_for_.run(Gae{.horizon = static_cast<int>(t),
                        .n_worlds = w,
                        .n = n_,
                        .gamma = config_.gamma,
                        .lambda = config_.gae_lambda,
                        .team_share = config_.team_reward_share,
                        .reward = r.reward.const_data_ptr<float>(),
                        .done = rollout.done.const_data_ptr<uint8_t>(),
                        .alive = r.alive.const_data_ptr<uint8_t>(),
                        .value = value.const_data_ptr<float>(),
                        .final_value = final_value.const_data_ptr<float>(),
                        .final_alive = r.final_alive.const_data_ptr<uint8_t>(),
                        .value_mean = value_norm_.mean().const_data_ptr<float>(),
                        .value_std = value_norm_.std().const_data_ptr<float>(),
                        .advantage = advantage_.data_ptr<float>(),
                        .returns = returns_.data_ptr<float>()},
                    w * n_);
  value_ = value.view({t + 1, w, n_}).slice(0, 0, t);

  stop_.zero_();
  first_epoch_ = true;
  take_moments(r);
}

// Of the advantages and returns of all ranks, in two messages: what is added up, and what follows from the means.
void PpoTeam::take_moments(const TeamRollout& r) {
  const at::Tensor weight = own(r.alive.slice(0, 0, r.reward.size(0))).to(at::kFloat);
  const at::Tensor living = weight.sum(), slots = at::full({}, weight.numel(), weight.options());
  WeightedMoments advantages(own(advantage_), weight), returns(own(returns_), weight);
  const at::Tensor faults = find_faults(r);
  sum_.together({living, slots, advantages.total, returns.total, faults});

  const at::Tensor inv_count = living.clamp_min(1).reciprocal();
  advantages.square(inv_count);
  returns.square(inv_count);
  // MAPPO: the critic predicts returns in units of their running mean and deviation.
  RunningNorm::Moments values;
  if (config_.value_norm) values = RunningNorm::moments(own(returns_).reshape({-1, 1}), weight.view({-1}), living);
  sum_.together({advantages.squares, returns.squares, values.mean, values.squares});

  batch_mean_ = advantages.mean;
  batch_inv_std_ = advantages.inv_std(inv_count);
  living_ = living;
  // Explained variance: 1 - Var(returns - values) / Var(returns), and returns - values are the advantages.
  figures_[kFigExplained].copy_(1.0 - (returns.inv_std(inv_count) / batch_inv_std_).square());
  figures_[kFigLiving].copy_(living / slots);
  if (config_.value_norm) value_norm_.take(values, living);
}

// ---- Minibatches ----------------------------------------------------------------------------------------------------

at::Tensor PpoTeam::states(const at::Tensor& own) const {
  if (everywhere()) return own;
  return own + own.div(worlds_.count, "floor").mul_(n_worlds_ - worlds_.count).add_(worlds_.first);
}

std::vector<at::Tensor> PpoTeam::minibatches(const at::Tensor& order) const {
  at::Tensor own = order.unsqueeze(0);  // [1, sequences]
  if (sequence_length() > 1)
    own = own + at::arange(sequence_length(), order.options()).unsqueeze(1) * worlds_.count;  // [L, sequences]
  return states(own).tensor_split(config_.n_minibatches, 1);
}

void PpoTeam::begin_epoch(const Rollout& rollout, const at::Tensor& order) {
  minibatches_ = minibatches(order);
  const TeamRollout& r = rollout.team[team_];
  if (!fused_) return;
  if (first_epoch_) {
    at::NoGradGuard no_grad;
    const auto pick = [&](const at::Tensor& x) {
      return x.slice(0, 0, r.reward.size(0)).flatten(0, 1).index_select(0, minibatches_[0].flatten());
    };
    note_information(actor_.forward(pick(r.obs).flatten(0, 1)), pick(r.alive).to(at::kFloat));
  }
  first_epoch_ = false;
  fused_->begin_epoch(r.obs, r.alive, states(order), config_.n_minibatches, advantage_);
}

void PpoTeam::end_epoch() {
  if (fused_) fused_->end_epoch();
}

void PpoTeam::update_minibatch(const Rollout& rollout, int k, int minibatch, StepSizes step_sizes) {
  if (fused_) return update_fused(rollout, k, minibatch, step_sizes);
  const TeamRollout& r = rollout.team[team_];
  const at::Tensor& states = minibatches_[static_cast<size_t>(k)];
  const at::Tensor flat = states.flatten().contiguous();  // of one sequence: a column of the order
  const auto pick = [&](const at::Tensor& x) {
    return x.defined() ? x.slice(0, 0, r.reward.size(0)).flatten(0, 1).index_select(0, flat) : x;
  };
  const at::Tensor alive = pick(r.alive).to(at::kFloat);
  const bool sees = actor_.reads_image() || critic_.reads_image();
  const Minibatch batch{
      .number = minibatch,
      .length = states.size(0),
      .states = flat,
      .begins = states.size(0) > 1 ? beginnings(rollout).flatten().index_select(0, flat).view_as(states) : at::Tensor(),
      .obs = pick(r.obs),
      .images = sees ? rollout.images.draw(team_, rollout.images.states.flatten(0, 1), flat) : at::Tensor(),
      .alive = alive,
      .inv_count = inverse_count(alive)};
  if (critic_.shares_encoder()) return update_sharing(rollout, batch, step_sizes);
  update_actor(rollout, batch, step_sizes.actor);
  update_critic(rollout, batch, step_sizes.critic);
}

// ---- The actor's loss -----------------------------------------------------------------------------------------------

/// The agents of the worlds of a minibatch: a network with memory begins with what it remembered at the start of the
/// rollout [W, n, S], and forgets where an episode ends. Undefined: it has none.
Sequence PpoTeam::sequence_of(const Minibatch& batch, const at::Tensor& start) const {
  if (!start.defined()) return {};
  const at::Tensor worlds = batch.states.slice(0, 0, batch.states.size(0) / batch.length);  // those of step 0
  return {.length = batch.length,
          .begins = batch.begins.defined() ? batch.begins.repeat_interleave(n_, 1) : at::Tensor(),
          .start = start.index_select(0, worlds).flatten(0, 1)};
}

// PPO, equation 7, with the entropy bonus of equation 9; MAPPO's L(theta): the mean over all living agents of
//   min(ratio A, clip(ratio, 1 - clip_coef, 1 + clip_coef) A) + entropy_coef * entropy,  ratio = pi(a | o) / pi_old(a |
//   o).
void PpoTeam::update_actor(const Rollout& rollout, const Minibatch& batch, float step_size) {
  const TeamRollout& r = rollout.team[team_];
  const at::Tensor& seen = actor_.reads_image() ? batch.images : batch.obs;
  at::Tensor features;
  const at::Tensor head = actor_.forward_sequence(seen.flatten(0, 1), actor_sequence(r, batch), &features);
  learn(batch, features, {head}, {policy_loss_gradient(r, batch, head)}, step_size);
  step_actor(batch.number, step_size);
}

Sequence PpoTeam::actor_sequence(const TeamRollout& r, const Minibatch& batch) const {
  return sequence_of(batch, actor_.state_size() > 0 ? r.state : at::Tensor());
}

void PpoTeam::step_actor(int minibatch, float step_size) {
  sum_(actor_.parameters().gradient());
  actor_adam_.step(actor_.parameters(), parallel_for_, step_size, config_.max_grad_norm,
                   step_flags(kFaultActorGradient, kFigActorNorm, minibatch));
}

at::Tensor PpoTeam::policy_loss_gradient(const TeamRollout& r, const Minibatch& batch, const at::Tensor& head) {
  at::NoGradGuard no_grad;
  at::Tensor mean = zero_, inv_std = one_;
  if (config_.advantage_norm == AdvantageNorm::batch) {
    mean = batch_mean_;
    inv_std = batch_inv_std_;
  } else if (config_.advantage_norm == AdvantageNorm::minibatch) {
    const at::Tensor a = advantage_.view({-1, n_}).index_select(0, batch.states);
    std::tie(mean, inv_std) = weighted_moments(a, batch.alive, batch.inv_count, sum_);
  }
  const int64_t count = head.size(0);
  at::Tensor gradient = at::empty_like(head);
  const at::Tensor diagnostics = at::empty({count, kNPolicyDiagnostics}, head.options());
  const PolicyLossInput in{.rows = {batch.states.const_data_ptr<int64_t>(), n_},
                           .old_log_prob = r.log_prob.const_data_ptr<float>(),
                           .advantage = advantage_.const_data_ptr<float>(),
                           .alive = r.alive.const_data_ptr<uint8_t>(),
                           .advantage_mean = mean.const_data_ptr<float>(),
                           .advantage_inv_std = inv_std.const_data_ptr<float>(),
                           .inv_count = batch.inv_count.const_data_ptr<float>(),
                           .clip_coef = config_.clip_coef,
                           .entropy_coef = entropy_coef_};
  if (actor_.actions() == ActionKind::discrete) {
    parallel_for_.run(CategoricalLoss{.in = in,
                                      .logits = head.const_data_ptr<float>(),
                                      .action = r.action.const_data_ptr<int32_t>(),
                                      .d_logits = gradient.data_ptr<float>(),
                                      .diagnostics = diagnostics.data_ptr<float>()},
                      count);
  } else {
    const at::Tensor d_log_std = at::empty_like(head);
    parallel_for_.run(GaussianLoss{.in = in,
                                   .mean = head.const_data_ptr<float>(),
                                   .log_std = actor_.log_std().const_data_ptr<float>(),
                                   .pre_tanh_action = r.pre_tanh_action.const_data_ptr<float>(),
                                   .d_mean = gradient.data_ptr<float>(),
                                   .d_log_std = d_log_std.data_ptr<float>(),
                                   .diagnostics = diagnostics.data_ptr<float>()},
                      count);
    actor_.log_std().grad().add_(d_log_std.sum(0));
  }
  const at::Tensor sums = diagnostics.sum(0);
  sum_(sums);
  parallel_for_.run(policy_note(sums.const_data_ptr<float>(), batch.number), 1);
  if (batch.number == 1) note_information(head, batch.alive);
  return gradient;
}

// ---- The critic's loss ----------------------------------------------------------------------------------------------

// PPO, equation 9; MAPPO's L(phi): the mean over all living agents of the error of V(s) against the return, squared,
// clipped around the old value, or Huber.
void PpoTeam::update_critic(const Rollout& rollout, const Minibatch& batch, float step_size) {
  const at::Tensor& seen = critic_.reads_image() ? batch.images : batch.obs;
  at::Tensor state;
  if (critic_.needs_state()) {
    const int64_t t = rollout.done.size(0);
    state = rollout.true_state.slice(0, 0, t).flatten(0, 1).index_select(0, batch.states);
  }
  const at::Tensor value =
      critic_.forward(critic_.input_of(actor_, seen), batch.alive, state, sequence_of(batch, critic_start_));
  value.backward(value_loss_gradient(rollout.team[team_], batch, value));
  step_critic(batch.number, step_size);
}

at::Tensor PpoTeam::value_loss_gradient(const TeamRollout& r, const Minibatch& batch, const at::Tensor& value) {
  at::NoGradGuard no_grad;
  const at::Tensor gradient = at::empty_like(value), loss = at::empty_like(value);
  parallel_for_.run(ValueLoss{.rows = {batch.states.const_data_ptr<int64_t>(), n_},
                              .value = value.const_data_ptr<float>(),
                              .old_value = value_.const_data_ptr<float>(),
                              .returns = returns_.const_data_ptr<float>(),
                              .alive = r.alive.const_data_ptr<uint8_t>(),
                              .value_mean = value_norm_.mean().const_data_ptr<float>(),
                              .value_std = value_norm_.std().const_data_ptr<float>(),
                              .inv_count = batch.inv_count.const_data_ptr<float>(),
                              .value_coef = config_.value_coef,
                              .error = value_error(),
                              .d_value = gradient.data_ptr<float>(),
                              .loss = loss.data_ptr<float>()},
                    value.numel());
  const at::Tensor sum_of_losses = loss.sum();
  sum_(sum_of_losses);
  figures_[kFigValueLoss].add_(sum_of_losses);
  return gradient;
}

ValueError PpoTeam::value_error() const {
  return {.clip_coef = config_.value_loss == ValueLossKind::clipped ? config_.value_clip_coef : 0.0f,
          .huber_delta = config_.value_loss == ValueLossKind::huber ? config_.huber_delta : 0.0f};
}

void PpoTeam::step_critic(int minibatch, float step_size) {
  sum_(critic_.parameters().gradient());
  critic_adam_.step(critic_.parameters(), parallel_for_, step_size, config_.max_grad_norm,
                    step_flags(kFaultCriticGradient, kFigCriticNorm, minibatch));
}

// ---- One encoder for both -------------------------------------------------------------------------------------------

// The critic reads the features behind the actor's encoder. Their gradient is the sum of those of the two losses, so
// the encoder goes each way once; it steps with the actor, as far and as often.
void PpoTeam::update_sharing(const Rollout& rollout, const Minibatch& batch, StepSizes step_sizes) {
  const TeamRollout& r = rollout.team[team_];
  const at::Tensor features = critic_.input_of(actor_, actor_.reads_image() ? batch.images : batch.obs);  // [S, n, F]
  const at::Tensor head = actor_.head(features.flatten(0, 1), actor_sequence(r, batch));
  const at::Tensor value = critic_.forward(features, batch.alive, {}, sequence_of(batch, critic_start_));
  learn(batch, features.flatten(0, 1), {head, value},
        {policy_loss_gradient(r, batch, head), value_loss_gradient(r, batch, value)}, step_sizes.actor);
  step_actor(batch.number, step_sizes.actor);
  step_critic(batch.number, step_sizes.critic);
}

// ---- What images show, taught ---------------------------------------------------------------------------------------

void PpoTeam::learn(const Minibatch& batch, const at::Tensor& features, std::vector<at::Tensor> outputs,
                    std::vector<at::Tensor> gradients, float step_size) {
  if (!teacher_) return torch::autograd::backward(outputs, gradients);
  const at::Tensor told = teacher_->told(features);
  const ViewTeacher::Loss loss = teacher_->loss(told, batch.obs.flatten(0, 1), batch.alive.flatten(), batch.inv_count);
  outputs.push_back(told);
  gradients.push_back(loss.gradient);
  torch::autograd::backward(outputs, gradients);
  sum_(loss.sum);
  figures_[kFigViewLoss].add_(loss.sum);
  sum_(teacher_->parameters().gradient());
  teacher_->adam().step(teacher_->parameters(), parallel_for_, step_size, config_.max_grad_norm,
                        step_flags(kFaultViewGradient, kFigViewNorm, batch.number));
}

// ---- Both networks fused --------------------------------------------------------------------------------------------

void PpoTeam::update_fused(const Rollout& rollout, int k, int minibatch, StepSizes step_sizes) {
  at::NoGradGuard no_grad;
  const TeamRollout& r = rollout.team[team_];
  FusedPolicyLoss policy{.old_log_prob = r.log_prob.const_data_ptr<float>(),
                         .advantage = advantage_.const_data_ptr<float>(),
                         .clip_coef = config_.clip_coef,
                         .entropy_coef = entropy_coef_};
  if (actor_.actions() == ActionKind::discrete)
    policy.action = r.action.const_data_ptr<int32_t>();
  else
    policy.pre_tanh_action = r.pre_tanh_action.const_data_ptr<float>();
  if (config_.advantage_norm != AdvantageNorm::minibatch) {
    const bool batch = config_.advantage_norm == AdvantageNorm::batch;
    policy.advantage_mean = (batch ? batch_mean_ : zero_).const_data_ptr<float>();
    policy.advantage_inv_std = (batch ? batch_inv_std_ : one_).const_data_ptr<float>();
  }
  fused_->compute_gradients(k, policy,
                            {.old_value = value_.const_data_ptr<float>(),
                             .returns = returns_.const_data_ptr<float>(),
                             .value_mean = value_norm_.mean().const_data_ptr<float>(),
                             .value_std = value_norm_.std().const_data_ptr<float>(),
                             .value_coef = config_.value_coef,
                             .error = value_error()});

  const auto network = [&](const Adam& adam, const ParameterSet& parameters, float step_size, const StepFlags& flags) {
    return FusedStep::Network{.gate = adam.gate(config_.max_grad_norm, flags),
                              .adam = adam.adam(parameters, step_size),
                              .norm = adam.norm().data_ptr<float>()};
  };
  fused_->step({.actor = network(actor_adam_, actor_.parameters(), step_sizes.actor,
                                 step_flags(kFaultActorGradient, kFigActorNorm, minibatch)),
                .critic = network(critic_adam_, critic_.parameters(), step_sizes.critic,
                                  step_flags(kFaultCriticGradient, kFigCriticNorm, minibatch)),
                .note = policy_note(nullptr, minibatch),
                .value_loss = figures_.data_ptr<float>() + kFigValueLoss});
}

// ---- Normalisation of observations ----------------------------------------------------------------------------------

void PpoTeam::update_normalizer(const Rollout& rollout) {
  if (!actor_.normalizes()) return;
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), d = r.obs.size(-1);
  const at::Tensor weight = own(r.alive.slice(0, 0, t)).to(at::kFloat).view({-1});
  const RunningNorm::Moments moments =
      RunningNorm::moments(own(r.obs.slice(0, 0, t)).reshape({-1, d}), weight, living_);
  sum_.together({moments.mean, moments.squares});
  actor_.normalizer().take(moments, living_);
}

// ---- Checkpoints ----------------------------------------------------------------------------------------------------

void PpoTeam::save_memory(const std::string& prefix, NamedArrays& out) const {
  if (critic_memory_.defined()) out.push_back(to_array(prefix + "critic_memory", critic_memory_));
}

void PpoTeam::load_memory(const std::string& prefix, const NamedArrays& in) {
  if (critic_memory_.defined()) from_array(find_array(in, prefix + "critic_memory"), critic_memory_);
}

void PpoTeam::save_critic(const std::string& prefix, NamedArrays& out) const {
  critic_.parameters().save(prefix + "critic/", out);
  value_norm_.save(prefix + "value_norm/", out);
}

void PpoTeam::save(const std::string& prefix, NamedArrays& out) const {
  actor_.save(prefix + "actor/", out);
  critic_.parameters().save(prefix + "critic/", out);
  actor_adam_.save(prefix + "actor_adam/", out);
  critic_adam_.save(prefix + "critic_adam/", out);
  value_norm_.save(prefix + "value_norm/", out);
  if (teacher_) teacher_->save(prefix, out);
}

void PpoTeam::load(const std::string& prefix, const NamedArrays& in) {
  actor_.load(prefix + "actor/", in);
  critic_.parameters().load(prefix + "critic/", in);
  actor_adam_.load(prefix + "actor_adam/", in);
  critic_adam_.load(prefix + "critic_adam/", in);
  value_norm_.load(prefix + "value_norm/", in);
  if (teacher_) teacher_->load(prefix, in);
}

}  // namespace giga
