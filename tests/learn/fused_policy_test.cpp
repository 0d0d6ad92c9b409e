// The fused policy against LibTorch, and against the fused update that learns from it.
#include "policy/fused_actor.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "fused_cases.hpp"

namespace giga::test {
namespace {

// The fused policy takes the actions that its probabilities say, and the update finds the same probabilities.
TEST_P(LearnFusedUpdateGpu, ThePolicyAndTheUpdateAgree) {
  if (const std::string why = no_fused_kernels(); !why.empty()) GTEST_SKIP() << why;
  const FusedCase& c = GetParam();
  at::NoGradGuard no_grad;
  FusedSetting s(c, kOneGpu);
  if (!FusedPolicy::serves(s.actor.fused_mlp().value())) GTEST_SKIP() << "LibTorch plays wide networks on many numbers";
  const int64_t n_rows = s.n_states * c.n;
  const bool discrete = c.actions == ActionKind::discrete;
  const at::Tensor action = at::full({s.n_states, c.n}, -1, s.action.options());
  const at::Tensor u = at::full({s.n_states, c.n, kActionSize}, NAN, s.obs.options()), squashed = u.clone();
  const at::Tensor log_prob = at::full({s.n_states, c.n}, NAN, s.obs.options());
  const at::Tensor draw_step = at::zeros({s.n_states}, s.action.options());
  const RowDraws draws{reinterpret_cast<const uint32_t*>(draw_step.const_data_ptr<int32_t>()), 5, 0, c.n, 0};
  FusedPolicy policy = fused_policy(s.actor).value();
  policy.rows_per_group = n_rows;
  policy.obs = s.obs.const_data_ptr<float>() + s.actor.inputs().first;
  policy.obs_stride = FusedSetting::kRow;
  policy.discrete = {nullptr, draws, action.data_ptr<int32_t>(), log_prob.data_ptr<float>()};
  policy.continuous.draws = draws;
  policy.continuous.pre_tanh_action = u.data_ptr<float>();
  policy.continuous.action = squashed.data_ptr<float>();
  policy.continuous.log_prob = log_prob.data_ptr<float>();
  launch_fused_policies({&policy, 1}, false, 0, s.parallel_for.stream());

  // Two policies in one launch, the second for the worlds behind the first's; then a group for each world, all with the
  // same network, which are too many for that launch.
  const at::Tensor kept_action = action.clone(), kept_log_prob = log_prob.clone();
  const int64_t worlds = s.n_states / 3, split = worlds * c.n;
  FusedPolicy two[] = {policy, policy};
  two[0].rows_per_group = split;
  two[1].rows_per_group = n_rows - split;
  two[1].obs += split * policy.obs_stride;
  two[1].discrete.action += split;
  two[1].discrete.log_prob += split;
  two[1].discrete.draws.first_world = two[1].continuous.draws.first_world = worlds;
  two[1].continuous.pre_tanh_action += split * kActionSize;
  two[1].continuous.action += split * kActionSize;
  two[1].continuous.log_prob += split;
  FusedPolicy groups = policy;
  groups.groups = static_cast<int>(s.n_states);
  groups.rows_per_group = c.n;
  for (const std::span<const FusedPolicy> other : {std::span<const FusedPolicy>(two), {&groups, 1}})
    for (const bool early : {false, true}) {  // behind kernels that write what it writes
      action.fill_(-1);
      log_prob.fill_(NAN);
      launch_fused_policies(other, early, 0, s.parallel_for.stream());
      EXPECT_TRUE(at::equal(action, kept_action)) << other.size() << " policies";
      EXPECT_TRUE(at::equal(log_prob, kept_log_prob)) << other.size() << " policies";
    }

  // Against LibTorch in fp32.
  const at::Tensor head = s.actor.forward(s.obs.flatten(0, 1)).view({s.n_states, c.n, -1});
  at::Tensor expected;
  if (discrete) {
    ASSERT_GE(action.min().item<int>(), 0);
    ASSERT_LT(action.max().item<int>(), kNDiscreteActions);
    expected = at::log_softmax(head.slice(-1, 0, kNDiscreteActions), -1)
                   .gather(-1, action.to(at::kLong).unsqueeze(-1))
                   .squeeze(-1);
  } else {
    const at::Tensor e = (u - head) * (-s.actor.log_std()).exp();
    expected = (-0.5 * e.square() - s.actor.log_std() - kHalfLogTwoPi - 2 * (std::log(2.0) - u - at::softplus(-2 * u)))
                   .sum(-1);
    EXPECT_LT((squashed - u.tanh()).abs().max().item<double>(), 1e-6);
  }
  EXPECT_LT((log_prob - expected).abs().mean().item<double>(), 0.003);

  // Against the update.
  FusedUpdate fused(s.actor, s.critic, c.n, s.parallel_for);
  const at::Tensor states = at::arange(s.n_states, s.states.options());
  FusedSteps steps(s);
  fused.begin_epoch(s.inputs(), s.alive, states, 1, s.advantage);
  fused.compute_gradients(0,
                          {.old_log_prob = log_prob.const_data_ptr<float>(),
                           .advantage = s.advantage.const_data_ptr<float>(),
                           .action = discrete ? action.const_data_ptr<int32_t>() : nullptr,
                           .pre_tanh_action = u.const_data_ptr<float>(),
                           .entropy_coef = s.entropy_coef.const_data_ptr<float>(),
                           .clip_coef = s.clip_coef.const_data_ptr<float>()},
                          {.old_value = s.old_value.const_data_ptr<float>(),
                           .returns = s.returns.const_data_ptr<float>(),
                           .value_mean = s.mean.const_data_ptr<float>(),
                           .value_std = s.std.const_data_ptr<float>()});
  fused.add_up(steps.of(s));
  fused.end_epoch();
  const at::Tensor sums = fused.sums()[0].cpu();
  EXPECT_LT(sums[kLossRatioError].item<double>() / sums[kLossCount].item<double>(), 1e-5);
}

}  // namespace
}  // namespace giga::test
