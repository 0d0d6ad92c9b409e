#include "learn/ppo_team.hpp"

#include <algorithm>

#include "learn/team_policy.hpp"
#include "math/gae.hpp"
#include "math/ppo_loss.hpp"
#include "math/step_gate.hpp"
#include "rollout/tensors.hpp"
#include "sim/state_encoding.hpp"

namespace giga {
namespace {

/// Mean and 1 / deviation over the entries with weight.
std::pair<at::Tensor, at::Tensor> moments(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& inv_count) {
  const at::Tensor mean = (x * weight).sum() * inv_count;
  const at::Tensor variance = ((x - mean).square() * weight).sum() * inv_count;
  return {mean, (variance.sqrt() + 1e-8).reciprocal()};
}

}  // namespace

PpoTeam::PpoTeam(const LoadedRun& run, int team, Device device, const ParallelFor& rows, const WorldRange& worlds)
    : config_(run.config.mappo),
      team_(team),
      n_(run.spec.params.n_team[team]),
      n_worlds_(run.config.train.n_worlds),
      worlds_(worlds),
      rows_(rows),
      actor_(make_actor(run, team, device)),
      critic_(config_.critic, critic_shape(config_.critic, run.spec, team), precision_on(run, device), rows,
              torch_device(device), network_seed(run, team, 1)),
      actor_adam_(actor_.parameters(), config_.adam_epsilon),
      critic_adam_(critic_.parameters(), config_.adam_epsilon),
      value_norm_(1, config_.value_norm_beta, torch_device(device)) {
  const auto options = at::TensorOptions().dtype(at::kFloat).device(torch_device(device));
  zero_ = at::zeros({1}, options);
  one_ = at::ones({1}, options);
  stop_ = at::zeros({1}, options);
  figures_ = at::zeros({kNFigures}, options);
  if (!everywhere()) slots_ = states(at::arange((config_.horizon + 1) * worlds.count, options.dtype(at::kLong)));
}

at::Tensor PpoTeam::states(const at::Tensor& own) const {
  if (everywhere()) return own;
  return own + own.div(worlds_.count, "floor").mul_(n_worlds_ - worlds_.count).add_(worlds_.first);
}

std::vector<at::Tensor> PpoTeam::minibatches(const at::Tensor& order) const {
  return states(order).tensor_split(config_.n_minibatches);
}

/// Values [S, n] of the states `index`, the others 0; of all where it is undefined.
at::Tensor PpoTeam::values_of(const Seen& seen, const at::Tensor& index) const {
  at::NoGradGuard no_grad;
  const bool all = !index.defined();
  at::Tensor values =
      all ? at::empty(seen.alive.sizes(), seen.obs.options()) : at::zeros(seen.alive.sizes(), seen.obs.options());
  const int64_t count = all ? seen.obs.size(0) : index.size(0);
  for (int64_t from = 0; from < count; from += kValueChunk) {
    const int64_t to = std::min(from + kValueChunk, count);
    const auto part = [&](const at::Tensor& x) {
      if (!x.defined()) return x;
      return all ? x.slice(0, from, to) : x.index_select(0, index.slice(0, from, to));
    };
    at::Tensor x = part(seen.obs);
    if (actor_.normalizes()) x = actor_.normalizer().apply(x);
    const at::Tensor value = critic_.forward(x, part(seen.alive).to(at::kFloat), part(seen.state));
    all ? part(values).copy_(value) : values.index_copy_(0, index.slice(0, from, to), value);
  }
  return values;
}

void PpoTeam::prepare(const Rollout& rollout) {
  at::NoGradGuard no_grad;
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), w = r.reward.size(1), d = r.obs.size(-1);
  const auto true_states = [&](const at::Tensor& global) {
    return critic_.needs_state() ? global.reshape({-1, global.size(-1)}) : at::Tensor();
  };
  const at::Tensor value = values_of(
      {r.obs.view({(t + 1) * w, n_, d}), r.alive.view({(t + 1) * w, n_}), true_states(rollout.global)}, slots_);
  const at::Tensor final_value = values_of({r.final_obs, r.final_alive, true_states(rollout.final_global)},
                                           everywhere() ? slots_ : slots_.slice(0, 0, worlds_.count));

  advantage_ = at::empty_like(r.reward);
  returns_ = at::empty_like(r.reward);
  rows_.run(Gae{static_cast<int>(t), w, n_, config_.gamma, config_.gae_lambda, r.reward.const_data_ptr<float>(),
                rollout.done.const_data_ptr<uint8_t>(), r.alive.const_data_ptr<uint8_t>(),
                value.const_data_ptr<float>(), final_value.const_data_ptr<float>(),
                r.final_alive.const_data_ptr<uint8_t>(), value_norm_.mean().const_data_ptr<float>(),
                value_norm_.std().const_data_ptr<float>(), advantage_.data_ptr<float>(), returns_.data_ptr<float>()},
            w * n_);
  value_ = value.view({t + 1, w, n_}).slice(0, 0, t);

  const at::Tensor weight = own(r.alive.slice(0, 0, t)).to(at::kFloat), returns = own(returns_);
  const at::Tensor inv_count = weight.sum().clamp_min(1).reciprocal();
  std::tie(batch_mean_, batch_inv_std_) = moments(own(advantage_), weight, inv_count);
  figures_.zero_();
  stop_.zero_();
  // Explained variance: 1 - Var(returns - values) / Var(returns), and returns - values are the advantages.
  const auto [return_mean, return_inv_std] = moments(returns, weight, inv_count);
  figures_[kFigExplained].copy_(1.0 - (return_inv_std / batch_inv_std_).square());
  figures_[kFigLiving].copy_(weight.mean());
  note_faults(r);
  if (config_.value_norm) value_norm_.update(returns.reshape({-1, 1}), weight.view({-1}));
}

void PpoTeam::note_faults(const TeamRollout& r) {
  const std::array<at::Tensor, kFaultActorGradient> tensors = {r.obs,  r.log_prob, r.reward,
                                                               value_, advantage_, returns_};
  std::array<at::Tensor, kFaultActorGradient> least, greatest;
  FiniteCheck check{};
  check.fault = figures_.data_ptr<float>() + kFirstFault;
  for (size_t k = 0; k < tensors.size(); ++k) {
    std::tie(least[k], greatest[k]) = at::aminmax(own(tensors[k]));
    if (k == kFaultValues) {  // in reward units, so that a fault of their normaliser shows
      least[k] = least[k] * value_norm_.std() + value_norm_.mean();
      greatest[k] = greatest[k] * value_norm_.std() + value_norm_.mean();
    }
    check.least[k] = least[k].const_data_ptr<float>();
    check.greatest[k] = greatest[k].const_data_ptr<float>();
  }
  rows_.run(check, static_cast<int64_t>(tensors.size()));
}

at::Tensor PpoTeam::policy_gradient(const Rollout& rollout, const at::Tensor& head, const at::Tensor& index,
                                    const at::Tensor& alive, const at::Tensor& inv_count, bool first) {
  at::NoGradGuard no_grad;
  const TeamRollout& r = rollout.team[team_];
  at::Tensor mean = zero_, inv_std = one_;
  if (config_.advantage_norm == AdvantageNorm::batch) {
    mean = batch_mean_;
    inv_std = batch_inv_std_;
  } else if (config_.advantage_norm == AdvantageNorm::minibatch) {
    const at::Tensor a = advantage_.view({-1, n_}).index_select(0, index);
    std::tie(mean, inv_std) = moments(a, alive, inv_count);
  }
  const int64_t count = head.size(0);
  at::Tensor gradient = at::empty_like(head);
  const at::Tensor diagnostics = at::empty({count, kNPolicyDiagnostics}, head.options());
  const PolicyLossInput in{{index.const_data_ptr<int64_t>(), n_},
                           r.log_prob.const_data_ptr<float>(),
                           advantage_.const_data_ptr<float>(),
                           r.alive.const_data_ptr<uint8_t>(),
                           mean.const_data_ptr<float>(),
                           inv_std.const_data_ptr<float>(),
                           inv_count.const_data_ptr<float>(),
                           config_.clip_coef,
                           config_.entropy_coef};
  if (actor_.actions() == ActionKind::discrete) {
    rows_.run(CategoricalLoss{in, head.const_data_ptr<float>(), r.action.const_data_ptr<int32_t>(),
                              gradient.data_ptr<float>(), diagnostics.data_ptr<float>()},
              count);
  } else {
    const at::Tensor d_log_std = at::empty_like(head);
    rows_.run(GaussianLoss{in, head.const_data_ptr<float>(), actor_.log_std().const_data_ptr<float>(),
                           r.raw.const_data_ptr<float>(), gradient.data_ptr<float>(), d_log_std.data_ptr<float>(),
                           diagnostics.data_ptr<float>()},
              count);
    actor_.log_std().grad().add_(d_log_std.sum(0));
  }
  note_policy(diagnostics.sum(0), head, alive, first);
  return gradient;
}

void PpoTeam::note_policy(const at::Tensor& sums, const at::Tensor& head, const at::Tensor& alive, bool first) {
  static_assert(kFigRows + 1 == kNPolicyDiagnostics);
  figures_.slice(0, 0, kNPolicyDiagnostics).add_(sums);
  const at::Tensor rows = sums[kLossCount].clamp_min(1), kl = sums[kLossKl] / rows;
  figures_[kFigLastKl].copy_(kl);
  if (first) {
    figures_[kFigFirstRatioError].copy_(sums[kLossRatioError] / rows);
    figures_[kFigInformation].copy_(policy_information(actor_, head, alive.view({-1})).squeeze(0));
  }
  if (config_.target_kl) stop_.copy_(at::maximum(stop_, (kl > *config_.target_kl).to(at::kFloat)));
  figures_[kFigSkipped].add_(stop_.squeeze(0));
}

StepFlags PpoTeam::step_flags(PpoFault fault, PpoFigure norm_sum, int minibatch) const {
  float* figures = figures_.data_ptr<float>();
  return {stop_.const_data_ptr<float>(),
          figures + kFirstFault + fault,
          figures + kFirstFault,
          kNFaults,
          minibatch,
          figures + norm_sum};
}

void PpoTeam::learn(const Rollout& rollout, const at::Tensor& index, int minibatch, StepSizes step_sizes) {
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), d = r.obs.size(-1), b = index.size(0);
  const auto pick = [&](const at::Tensor& x) { return x.slice(0, 0, t).flatten(0, 1).index_select(0, index); };
  at::Tensor obs = pick(r.obs);                           // [B, n, D]
  const at::Tensor alive = pick(r.alive).to(at::kFloat);  // [B, n]
  const at::Tensor inv_count = alive.sum().clamp_min(1).reciprocal();
  const bool shared_input = actor_.normalizes();

  const at::Tensor head = actor_.forward(obs.view({b * n_, d}));
  head.backward(policy_gradient(rollout, head, index, alive, inv_count, minibatch == 1));
  actor_adam_.step(actor_.parameters(), rows_, step_sizes.actor, config_.max_grad_norm,
                   step_flags(kFaultActorGradient, kFigActorNorm, minibatch));

  if (shared_input) obs = actor_.normalizer().apply(obs);
  const at::Tensor value = critic_.forward(obs, alive, critic_.needs_state() ? pick(rollout.global) : at::Tensor());
  const at::Tensor gradient = at::empty_like(value), loss = at::empty_like(value);
  rows_.run(ValueLoss{{index.const_data_ptr<int64_t>(), n_},
                      value.const_data_ptr<float>(),
                      value_.const_data_ptr<float>(),
                      returns_.const_data_ptr<float>(),
                      r.alive.const_data_ptr<uint8_t>(),
                      value_norm_.mean().const_data_ptr<float>(),
                      value_norm_.std().const_data_ptr<float>(),
                      inv_count.const_data_ptr<float>(),
                      config_.value_coef,
                      config_.value_loss == ValueLossKind::clipped ? config_.value_clip_coef : 0.0f,
                      config_.value_loss == ValueLossKind::huber ? config_.huber_delta : 0.0f,
                      gradient.data_ptr<float>(),
                      loss.data_ptr<float>()},
            b * n_);
  value.backward(gradient);
  critic_adam_.step(critic_.parameters(), rows_, step_sizes.critic, config_.max_grad_norm,
                    step_flags(kFaultCriticGradient, kFigCriticNorm, minibatch));
  figures_[kFigValueLoss].add_(loss.sum());
}

void PpoTeam::finish(const Rollout& rollout) {
  if (!actor_.normalizes()) return;
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), d = r.obs.size(-1);
  actor_.normalizer().update(own(r.obs.slice(0, 0, t)).reshape({-1, d}),
                             own(r.alive.slice(0, 0, t)).to(at::kFloat).view({-1}));
}

at::Tensor PpoTeam::faulty_states(const Rollout& rollout, int64_t most) const {
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), n_states = t * worlds_.count;
  at::Tensor bad = at::zeros({n_states}, r.reward.options().dtype(at::kBool));
  for (const at::Tensor& x : {r.obs.slice(0, 0, t), r.log_prob, r.reward, value_, advantage_, returns_})
    bad.logical_or_(at::isfinite(own(x)).logical_not().reshape({n_states, -1}).any(1));
  const at::Tensor index = states(bad.nonzero().squeeze(1));
  return index.slice(0, 0, std::min(most, index.size(0)));
}

void PpoTeam::save_batch(const Rollout& rollout, const at::Tensor& index, NamedArrays& out) const {
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0);
  const auto add = [&](const char* name, const at::Tensor& x) {
    if (x.defined())
      out.push_back(to_array(cat("batch/", name), x.slice(0, 0, t).flatten(0, 1).index_select(0, index)));
  };
  out.push_back(to_array("batch/index", index));
  add("obs", r.obs);
  add("alive", r.alive);
  add("action", r.action);
  add("raw", r.raw);
  add("log_prob", r.log_prob);
  add("reward", r.reward);
  add("value", value_);
  add("advantage", advantage_);
  add("returns", returns_);
  add("global", rollout.global);
}

void PpoTeam::save(const std::string& prefix, NamedArrays& out) const {
  actor_.save(prefix + "actor/", out);
  critic_.parameters().save(prefix + "critic/", out);
  actor_adam_.save(prefix + "actor_adam/", out);
  critic_adam_.save(prefix + "critic_adam/", out);
  value_norm_.save(prefix + "value_norm/", out);
}

void PpoTeam::load(const std::string& prefix, const NamedArrays& in) {
  actor_.load(prefix + "actor/", in);
  critic_.parameters().load(prefix + "critic/", in);
  actor_adam_.load(prefix + "actor_adam/", in);
  critic_adam_.load(prefix + "critic_adam/", in);
  value_norm_.load(prefix + "value_norm/", in);
}

}  // namespace giga
