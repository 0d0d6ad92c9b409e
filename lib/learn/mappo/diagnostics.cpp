// What PpoTeam reports of an update: figures, faults, and the batch that a diverged run was to learn from.
#include <algorithm>
#include <cmath>
#include <tuple>

#include "core/error.hpp"
#include "learn/mappo/ppo_team.hpp"
#include "math/ppo_loss.hpp"
#include "math/step_gate.hpp"
#include "policy/mutual_information.hpp"

namespace giga {

/// Clears the figures, and notes in them what is not finite. -> [kNFaults] of them, to be added up over all ranks so
/// that these refuse the same steps.
at::Tensor PpoTeam::find_faults(const TeamRollout& r) {
  figures_.zero_();
  faults_.zero_();
  const std::array<at::Tensor, kFaultActorGradient> tensors = {r.obs,  r.log_prob, r.reward,
                                                               value_, advantage_, returns_};
  std::array<at::Tensor, kFaultActorGradient> least, greatest;
  FiniteCheck check{};
  check.fault = faults_.data_ptr<float>();
  for (size_t k = 0; k < tensors.size(); ++k) {
    std::tie(least[k], greatest[k]) = at::aminmax(tensors[k].defined() ? own(tensors[k]) : zero_);  // images: bytes
    if (k == kFaultValues) {  // in reward units, so that a fault of their normaliser shows
      least[k] = least[k] * value_norm_.std() + value_norm_.mean();
      greatest[k] = greatest[k] * value_norm_.std() + value_norm_.mean();
    }
    check.least[k] = least[k].const_data_ptr<float>();
    check.greatest[k] = greatest[k].const_data_ptr<float>();
  }
  parallel_for_.run(check, static_cast<int64_t>(tensors.size()));
  return faults_;
}

/// `sums`: those of the diagnostics over the living rows of the minibatch.
PolicyNote PpoTeam::policy_note(const float* sums, const float* minibatch) const {
  return {.sums = sums,
          .figures = figures_.data_ptr<float>(),
          .stop = stop_.data_ptr<float>(),
          .target_kl = config_.target_kl.value_or(-1.0f),
          .minibatch = minibatch};
}

/// Of the policy as it has played, on the first minibatch of the epoch at hand.
void PpoTeam::note_information(const Rollout& rollout) {
  at::NoGradGuard no_grad;
  const Minibatch batch = minibatch_of(rollout, minibatches_[0], numbers_.const_data_ptr<float>());
  figures_[kFigMutualInformation].copy_(
      mutual_information(actor_, head_of(rollout, batch), batch.alive.view({-1}), sum_).squeeze(0));
}

StepFlags PpoTeam::step_flags(PpoFault fault, PpoFigure norm_sum, const float* minibatch) const {
  return {.stop = stop_.const_data_ptr<float>(),
          .fault = faults_.data_ptr<float>() + fault,
          .faults = faults_of_both_.const_data_ptr<float>(),
          .n_faults = kNTeams * kNFaults,
          .minibatch = minibatch,
          .norm_sum = figures_.data_ptr<float>() + norm_sum};
}

bool PpoTeam::is_own(PpoFault fault_of_rollout) const { return own_faults_[fault_of_rollout].item<float>() > 0; }

// The parameters are those of then, because nothing is learned behind a fault; the normaliser of observations alone may
// know this rollout by now.
bool PpoTeam::is_own(PpoFault fault_of_gradient, const Rollout& rollout, const at::Tensor& order, int k,
                     int minibatch) {
  looked_at_ = fault_of_gradient;
  begin_epoch(rollout, order);
  update_minibatch(rollout, k, minibatch);
  end_epoch();
  looked_at_.reset();
  if (fused_) {
    const bool of_actor = fault_of_gradient == kFaultActorGradient;
    own_norm_ = (of_actor ? fused_->own_actor_gradient() : fused_->own_critic_gradient()).norm();
  }
  return !std::isfinite(static_cast<float>(own_norm_.item<double>()));
}

at::Tensor PpoTeam::faulty_states(const Rollout& rollout, int64_t most) const {
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0), n_states = t * n_own_worlds();
  at::Tensor bad = at::zeros({n_states}, r.reward.options().dtype(at::kBool));
  for (const at::Tensor& x :
       {r.obs.defined() ? r.obs.slice(0, 0, t) : r.reward, r.log_prob, r.reward, value_, advantage_, returns_})
    bad.logical_or_(at::isfinite(own(x)).logical_not().reshape({n_states, -1}).any(1));
  if (r.obs.defined()) {  // what is seen behind the last step counts for that step
    const at::Tensor behind = own(r.obs.slice(0, t)).isfinite().logical_not().reshape({n_own_worlds(), -1}).any(1);
    bad.slice(0, n_states - n_own_worlds()).logical_or_(behind);
  }
  const at::Tensor index = states(bad.nonzero().squeeze(1));
  return index.slice(0, 0, std::min(most, index.size(0)));
}

void PpoTeam::save_batch(const Rollout& rollout, const at::Tensor& states, NamedArrays& out) const {
  const TeamRollout& r = rollout.team[team_];
  const int64_t t = r.reward.size(0);
  const at::Tensor index = states.flatten();
  const auto add = [&](const char* name, const at::Tensor& x) {
    if (x.defined())
      out.push_back(to_array(cat("batch/", name), x.slice(0, 0, t).flatten(0, 1).index_select(0, index)));
  };
  out.push_back(to_array("batch/index", index));
  add("obs", r.obs);
  add("alive", r.alive);
  add("action", r.action);
  add("pre_tanh_action", r.pre_tanh_action);
  add("log_prob", r.log_prob);
  add("reward", r.reward);
  add("value", value_);
  add("advantage", advantage_);
  add("returns", returns_);
  add("true_state", rollout.true_state);
  add("image_state", rollout.images.states);
}

}  // namespace giga
