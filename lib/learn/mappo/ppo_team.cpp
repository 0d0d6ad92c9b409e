// How a team learns by MAPPO from a rollout: minibatches, the loss of the actor, the loss of the critic, normalisation.
// advantages.cpp comes before. Papers:
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
#include <utility>

#include "learn/team_policy.hpp"
#include "math/ppo_loss.hpp"
#include "rollout/tensors.hpp"

namespace giga {

// ---- Networks -------------------------------------------------------------------------------------------------------

PpoTeam::PpoTeam(const LoadedRun& run, int team, Device device, const ParallelFor& parallel_for,
                 const ShardRange& worlds, const SumOverRanks& sum, PpoTeam* twin)
    : config_(run.config.mappo),
      team_(team),
      n_(run.spec.params.n_team[team]),
      n_worlds_(run.config.train.n_worlds),
      worlds_(worlds),
      parallel_for_(parallel_for),
      sum_(sum),
      own_actor_(twin ? nullptr : std::make_unique<Actor>(make_actor(run, team, device))),
      actor_(twin ? twin->actor_ : *own_actor_),
      critic_(config_.critic, critic_shape(config_.critic, actor_, run.spec, team), precision_on(run, device),
              parallel_for, torch_device(device), network_seed(run, team, 1)),
      own_actor_adam_(twin ? nullptr : std::make_unique<Adam>(actor_.parameters(), config_.adam_epsilon)),
      actor_adam_(twin ? twin->actor_adam_ : *own_actor_adam_),
      critic_adam_(critic_.parameters(), config_.adam_epsilon),
      value_norm_(1, config_.value_norm_beta, torch_device(device),
                  config_.value_norm ? kValueDeviation : DeviationLimits{}) {
  const auto options = at::TensorOptions().dtype(at::kFloat).device(torch_device(device));
  zero_ = at::zeros({1}, options);
  one_ = at::ones({1}, options);
  stop_ = twin ? twin->stop_ : at::zeros({1}, options);
  figures_ = at::zeros({kFirstFault}, options);
  faults_of_both_ = twin ? twin->faults_of_both_ : at::zeros({kNTeams, kNFaults}, options);
  faults_ = faults_of_both_[twin ? 1 : 0];
  settings_ = at::zeros({kNSettings}, options);
  set(StepSettings::of(config_));
  numbers_ = at::arange(1, config_.n_epochs * config_.n_minibatches + 1, options);
  value_ = at::zeros({config_.horizon, n_worlds_, n_}, options);
  advantage_ = at::zeros_like(value_);
  returns_ = at::zeros_like(value_);
  batch_mean_ = at::zeros({}, options);
  batch_inv_std_ = at::ones({}, options);
  plain_because_ = config_.fused ? fused_update_refusal(actor_, critic_, n_, device) : "mappo.fused is false";
  const bool actor_alone = config_.fused && config_.view_coef == 0 && !critic_.shares_encoder();
  if (plain_because_.empty())
    fused_ =
        std::make_unique<FusedUpdate>(actor_, critic_, n_, parallel_for, sum_, twin ? twin->fused_.get() : nullptr);
  else if (actor_alone && fused_actor_refusal(actor_, n_, device).empty())
    fused_actor_ = std::make_unique<FusedActorGradient>(actor_, n_, parallel_for, sum_);
  if (config_.view_coef > 0) teacher_ = std::make_unique<ViewTeacher>(run, team, actor_, torch_device(device));
  if (critic_.state_size() > 0) {
    critic_memory_ = at::zeros({n_worlds_, n_, critic_.state_size()}, options);
    critic_start_ = at::zeros_like(critic_memory_);
  }
  if (!everywhere()) slots_ = states(at::arange((config_.horizon + 1) * n_own_worlds(), options.dtype(at::kLong)));
}

void PpoTeam::set(const StepSettings& settings) {
  gamma_ = settings.gamma;
  settings_[kActorStepSize].fill_(settings.actor_step_size);
  settings_[kCriticStepSize].fill_(settings.critic_step_size);
  settings_[kClip].fill_(settings.clip_coef);
  settings_[kEntropyWeight].fill_(settings.entropy_coef);
}

void PpoTeam::record_minibatches(std::shared_ptr<TorchRecorder> recorder) {
  if (!fused_ && recorder) recorded_ = std::make_unique<RecordedMinibatches>(std::move(recorder));
}

// ---- Minibatches ----------------------------------------------------------------------------------------------------

at::Tensor PpoTeam::states(const at::Tensor& own) const {
  if (everywhere()) return own;
  // Of the shards of all steps, one behind the other, as many states are left out.
  const WorldRange& range = worlds_.in_shard;
  return own + own.div(range.count, "floor").mul_(worlds_.shard_size - range.count).add_(range.first);
}

at::Tensor PpoTeam::own(const at::Tensor& x) const { return everywhere() ? x : in_shards(x, worlds_, 1).flatten(1, 2); }

std::vector<at::Tensor> PpoTeam::minibatches(const at::Tensor& order) const {
  at::Tensor own = order.unsqueeze(0);  // [1, sequences]
  if (sequence_length() > 1)
    own = own + at::arange(sequence_length(), order.options()).unsqueeze(1) * n_own_worlds();  // [L, sequences]
  return states(own).tensor_split(config_.n_minibatches, 1);
}

void PpoTeam::begin_epoch(const Rollout& rollout, const at::Tensor& order) {
  minibatches_ = minibatches(order);
  if (std::exchange(first_epoch_, false)) note_information(rollout);
  const TeamRollout& r = rollout.team[team_];
  if (fused_)
    fused_->begin_epoch({r.obs, rollout.true_state}, r.alive, states(order), config_.n_minibatches, advantage_);
}

void PpoTeam::end_epoch() {
  if (fused_) fused_->end_epoch();
  actor_.bound_log_std(actor_.parameters().values());
}

void PpoTeam::update_minibatch(const Rollout& rollout, int k, int minibatch) {
  const at::Tensor number = numbers_.narrow(0, minibatch - 1, 1);
  if (fused_) return update_fused(rollout, k, number.const_data_ptr<float>());
  const at::Tensor& states = minibatches_[static_cast<size_t>(k)];
  const bool with_obs = !fused_actor_ || (!critic_.needs_state() && !critic_.reads_image());
  const auto learn = [&](const at::Tensor& of, const float* at) {
    learn_from(rollout, minibatch_of(rollout, of, at, with_obs));
  };
  if (recorded_) return recorded_->learn(states, number, n_rollouts_ > 1, learn);
  learn(states, number.const_data_ptr<float>());
}

PpoTeam::Minibatch PpoTeam::minibatch_of(const Rollout& rollout, const at::Tensor& states, const float* number,
                                         bool with_obs) const {
  const TeamRollout& r = rollout.team[team_];
  const at::Tensor flat = states.flatten().contiguous();  // of one sequence: a column of the order
  const auto pick = [&](const at::Tensor& x) {
    return x.defined() ? x.slice(0, 0, r.reward.size(0)).flatten(0, 1).index_select(0, flat) : x;
  };
  const bool sees = actor_.reads_image() || critic_.reads_image();
  return {.number = number,
          .length = states.size(0),
          .states = flat,
          .begins =
              states.size(0) > 1 ? rollout.beginnings().flatten().index_select(0, flat).view_as(states) : at::Tensor(),
          .obs = with_obs ? pick(r.obs) : at::Tensor(),
          .images = sees ? rollout.images.draw(team_, rollout.images.states.flatten(0, 1), flat) : at::Tensor(),
          .alive = pick(r.alive).to(at::kFloat),
          .inv_count = {}};
}

void PpoTeam::learn_from(const Rollout& rollout, Minibatch batch) {
  batch.inv_count = inverse_count(batch.alive);
  if (critic_.shares_encoder()) return update_sharing(rollout, batch);
  if (fused_actor_)
    update_actor_fused(rollout, batch);
  else
    update_actor(rollout, batch);
  update_critic(rollout, batch);
}

/// Over all ranks.
void PpoTeam::sum_gradient(PpoFault fault, const ParameterSet& parameters) {
  if (looked_at_ == fault) own_norm_ = parameters.gradient().norm();
  sum_(parameters.gradient());
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
void PpoTeam::update_actor(const Rollout& rollout, const Minibatch& batch) {
  at::Tensor features;
  const at::Tensor head = head_of(rollout, batch, &features);
  learn(batch, features, {head}, {policy_loss_gradient(rollout.team[team_], batch, head)});
  step_actor(batch.number);
}

/// What the actor says, and the features behind its encoder.
at::Tensor PpoTeam::head_of(const Rollout& rollout, const Minibatch& batch, at::Tensor* features) const {
  const at::Tensor& seen = actor_.reads_image() ? batch.images : batch.obs;
  return actor_.forward_sequence(seen.flatten(0, 1), actor_sequence(rollout.team[team_], batch), features);
}

Sequence PpoTeam::actor_sequence(const TeamRollout& r, const Minibatch& batch) const {
  return sequence_of(batch, actor_.state_size() > 0 ? r.state : at::Tensor());
}

void PpoTeam::step_actor(const float* minibatch) {
  sum_gradient(kFaultActorGradient, actor_.parameters());
  actor_adam_.step(actor_.parameters(), parallel_for_, setting(kActorStepSize), config_.max_grad_norm,
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
                           .entropy_coef = setting(kEntropyWeight),
                           .clip_coef = setting(kClip)};
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
  return gradient;
}

// ---- The critic's loss ----------------------------------------------------------------------------------------------

// PPO, equation 9; MAPPO's L(phi): the mean over all living agents of the error of V(s) against the return, squared,
// clipped around the old value, or Huber.
void PpoTeam::update_critic(const Rollout& rollout, const Minibatch& batch) {
  const at::Tensor& seen = critic_.reads_image() ? batch.images : batch.obs;
  at::Tensor state;
  if (critic_.needs_state()) {
    const int64_t t = rollout.done.size(0);
    state = rollout.true_state.slice(0, 0, t).flatten(0, 1).index_select(0, batch.states);
  }
  const at::Tensor value =
      critic_.forward(critic_.input_of(actor_, seen), batch.alive, state, sequence_of(batch, critic_start_));
  value.backward(value_loss_gradient(rollout.team[team_], batch, value));
  step_critic(batch.number);
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

void PpoTeam::step_critic(const float* minibatch) {
  sum_gradient(kFaultCriticGradient, critic_.parameters());
  critic_adam_.step(critic_.parameters(), parallel_for_, setting(kCriticStepSize), config_.max_grad_norm,
                    step_flags(kFaultCriticGradient, kFigCriticNorm, minibatch));
}

// ---- One encoder for both -------------------------------------------------------------------------------------------

// The critic reads the features behind the actor's encoder. Their gradient is the sum of those of the two losses, so
// the encoder goes each way once; it steps with the actor, as far and as often.
void PpoTeam::update_sharing(const Rollout& rollout, const Minibatch& batch) {
  const TeamRollout& r = rollout.team[team_];
  const at::Tensor features = critic_.input_of(actor_, actor_.reads_image() ? batch.images : batch.obs);  // [S, n, F]
  const at::Tensor head = actor_.head(features.flatten(0, 1), actor_sequence(r, batch));
  const at::Tensor value = critic_.forward(features, batch.alive, {}, sequence_of(batch, critic_start_));
  learn(batch, features.flatten(0, 1), {head, value},
        {policy_loss_gradient(r, batch, head), value_loss_gradient(r, batch, value)});
  step_actor(batch.number);
  step_critic(batch.number);
}

// ---- What images show, taught ---------------------------------------------------------------------------------------

void PpoTeam::learn(const Minibatch& batch, const at::Tensor& features, std::vector<at::Tensor> outputs,
                    std::vector<at::Tensor> gradients) {
  if (!teacher_) return torch::autograd::backward(outputs, gradients);
  const at::Tensor told = teacher_->told(features);
  const ViewTeacher::Loss loss = teacher_->loss(told, batch.obs.flatten(0, 1), batch.alive.flatten(), batch.inv_count);
  outputs.push_back(told);
  gradients.push_back(loss.gradient);
  torch::autograd::backward(outputs, gradients);
  sum_(loss.sum);
  figures_[kFigViewLoss].add_(loss.sum);
  sum_gradient(kFaultViewGradient, teacher_->parameters());
  teacher_->adam().step(teacher_->parameters(), parallel_for_, setting(kActorStepSize), config_.max_grad_norm,
                        step_flags(kFaultViewGradient, kFigViewNorm, batch.number));
}

// ---- Fused networks -------------------------------------------------------------------------------------------------

FusedPolicyLoss PpoTeam::fused_policy_loss(const TeamRollout& r) const {
  FusedPolicyLoss policy{.old_log_prob = r.log_prob.const_data_ptr<float>(),
                         .advantage = advantage_.const_data_ptr<float>(),
                         .entropy_coef = setting(kEntropyWeight),
                         .clip_coef = setting(kClip)};
  if (actor_.actions() == ActionKind::discrete)
    policy.action = r.action.const_data_ptr<int32_t>();
  else
    policy.pre_tanh_action = r.pre_tanh_action.const_data_ptr<float>();
  if (config_.advantage_norm != AdvantageNorm::minibatch) {
    const bool batch = config_.advantage_norm == AdvantageNorm::batch;
    policy.advantage_mean = (batch ? batch_mean_ : zero_).const_data_ptr<float>();
    policy.advantage_inv_std = (batch ? batch_inv_std_ : one_).const_data_ptr<float>();
  }
  return policy;
}

void PpoTeam::update_actor_fused(const Rollout& rollout, const Minibatch& batch) {
  at::NoGradGuard no_grad;
  const TeamRollout& r = rollout.team[team_];
  const at::Tensor& sums = fused_actor_->compute(r.obs, r.alive, batch.states, fused_policy_loss(r));
  sum_(sums);
  parallel_for_.run(policy_note(sums.const_data_ptr<float>(), batch.number), 1);
  step_actor(batch.number);
}

void PpoTeam::update_fused(const Rollout& rollout, int k, const float* number) {
  at::NoGradGuard no_grad;
  fused_->compute_gradients(k, fused_policy_loss(rollout.team[team_]),
                            {.old_value = value_.const_data_ptr<float>(),
                             .returns = returns_.const_data_ptr<float>(),
                             .value_mean = value_norm_.mean().const_data_ptr<float>(),
                             .value_std = value_norm_.std().const_data_ptr<float>(),
                             .value_coef = config_.value_coef,
                             .error = value_error()});

  const auto network = [&](const Adam& adam, const ParameterSet& parameters, Setting step_size,
                           const StepFlags& flags) {
    return FusedStep::Network{.gate = adam.gate(config_.max_grad_norm, flags),
                              .adam = adam.adam(parameters, setting(step_size)),
                              .norm = adam.norm().data_ptr<float>()};
  };
  fused_->step({.actor = network(actor_adam_, actor_.parameters(), kActorStepSize,
                                 step_flags(kFaultActorGradient, kFigActorNorm, number)),
                .critic = network(critic_adam_, critic_.parameters(), kCriticStepSize,
                                  step_flags(kFaultCriticGradient, kFigCriticNorm, number)),
                .note = policy_note(nullptr, number),
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

void PpoTeam::forget() {
  if (critic_memory_.defined()) critic_memory_.zero_();
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

void PpoTeam::expect_twins_actor(const std::string& prefix, const NamedArrays& in) const {
  NamedArrays loaded;
  actor_.save(prefix + "actor/", loaded);
  actor_adam_.save(prefix + "actor_adam/", loaded);
  for (const NamedArray& array : loaded)
    if (find_array(in, array.name).bytes != array.bytes)
      throw InputError(cat(array.name,
                           ": it is another policy's than team 0's, and both teams play by one "
                           "(mappo.one_policy)"));
}

void PpoTeam::load(const std::string& prefix, const NamedArrays& in) {
  if (own_actor_) {
    actor_.load(prefix + "actor/", in);
    actor_adam_.load(prefix + "actor_adam/", in);
  } else {
    expect_twins_actor(prefix, in);
  }
  critic_.load(prefix + "critic/", in);
  critic_adam_.load(prefix + "critic_adam/", in);
  value_norm_.load(prefix + "value_norm/", in);
  if (teacher_) teacher_->load(prefix, in);
}

}  // namespace giga
