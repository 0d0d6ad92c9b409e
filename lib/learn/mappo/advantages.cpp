// What PpoTeam learns from in a rollout: values, advantages, returns and their moments.
#include <algorithm>
#include <tuple>

#include "learn/mappo/ppo_team.hpp"
#include "math/gae.hpp"

namespace giga {

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
    fused_->write_values(critic_.needs_state() ? input.state : input.obs, input.alive, states, values);
    return values;
  }
  const int64_t count = all ? input.alive.size(0) : states.size(0);
  const int64_t at_once = std::max<int64_t>(1, (critic_.reads_image() ? kImagesAtOnce : kValueRows) / n_);
  for (int64_t from = 0; from < count; from += at_once) {
    const int64_t to = std::min(from + at_once, count);
    const at::Tensor some = all ? states : states.slice(0, from, to);
    const at::Tensor value = critic_values(
        images, input.each([&](const at::Tensor& x) { return all ? x.slice(0, from, to) : x.index_select(0, some); }));
    all ? values.slice(0, from, to).copy_(value) : values.index_copy_(0, some, value);
  }
  return values;
}

// A critic with memory goes through all slots in a row. The value of an episode's last observation follows from what
// was remembered after the step before. -> values [(T + 1) W, n] and [W, n], 0 in worlds of others.
std::pair<at::Tensor, at::Tensor> PpoTeam::remembering_values(const Rollout& rollout) {
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), w = r.reward.size(1);
  const at::Tensor begins = rollout.beginnings();
  const at::Tensor values = at::zeros({t + 1, w, n_}, zero_.options()),
                   final_values = at::zeros({w, n_}, zero_.options());
  critic_start_.copy_(critic_memory_);
  const int64_t states_at_once = (critic_.reads_image() ? kImagesAtOnce : kValueRows) / n_;
  const int64_t worlds_at_once = std::max<int64_t>(1, states_at_once / (t + 1));
  for (const WorldRange& some : worlds_.pieces(worlds_at_once)) {
    const int64_t from = some.first, to = some.end(), b = some.count;
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
                            everywhere() ? slots_ : slots_.slice(0, 0, n_own_worlds()));
  }

  parallel_for_.run(Gae{.horizon = static_cast<int>(t),
                        .n_worlds = w,
                        .n = n_,
                        .gamma = gamma_,
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
  value_.copy_(value.view({t + 1, w, n_}).slice(0, 0, t));

  stop_.zero_();
  first_epoch_ = true;
  ++n_rollouts_;
  take_moments(r);
}

// Of the advantages and returns of all ranks, in two messages: what is added up, and what follows from the means.
void PpoTeam::take_moments(const TeamRollout& r) {
  const at::Tensor weight = own(r.alive.slice(0, 0, r.reward.size(0))).to(at::kFloat);
  const at::Tensor living = weight.sum(), slots = at::full({}, weight.numel(), weight.options());
  WeightedMoments advantages(own(advantage_), weight), returns(own(returns_), weight);
  const at::Tensor faults = find_faults(r);
  if (!sum_.alone()) own_faults_ = faults.clone();
  sum_.together({living, slots, advantages.total, returns.total, faults});

  const at::Tensor inv_count = living.clamp_min(1).reciprocal();
  advantages.square(inv_count);
  returns.square(inv_count);
  // MAPPO: the critic predicts returns in units of their running mean and deviation.
  RunningNorm::Moments values;
  if (config_.value_norm) values = RunningNorm::moments(own(returns_).reshape({-1, 1}), weight.view({-1}), living);
  sum_.together({advantages.squares, returns.squares, values.mean, values.squares});

  batch_mean_.copy_(advantages.mean);
  batch_inv_std_.copy_(advantages.inv_std(inv_count));
  living_ = living;
  // Explained variance: 1 - Var(returns - values) / Var(returns), and returns - values are the advantages.
  figures_[kFigExplained].copy_(1.0 - (returns.inv_std(inv_count) / batch_inv_std_).square());
  figures_[kFigLiving].copy_(living / slots);
  if (config_.value_norm) value_norm_.take(values, living);
}

}  // namespace giga
