// The closed-form policy gradients against autograd of the PPO formula written with tensor operations.
#include <gtest/gtest.h>
#include <torch/autograd.h>

#include <cmath>

#include "math/ppo_loss.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

constexpr int64_t kStates = 40, kAgents = 3, kRows = kStates * kAgents;
constexpr float kClip = 0.2f, kEntropyCoef = 0.07f;

/// A minibatch that is the whole rollout, in another order: row r of the minibatch is row `source[r]` of the rollout.
struct Batch {
  at::Tensor index, source, old_log_prob, advantage, alive, mean, inv_std, inv_count;

  explicit Batch(const at::Tensor& log_prob_by_row, uint64_t seed) {
    index = at::arange(kStates - 1, -1, -1, at::kLong);
    source = (index.unsqueeze(1) * kAgents + at::arange(kAgents)).view({-1});
    // Ratios between about 0.5 and 2, so that the clip binds on both sides.
    old_log_prob = at::empty({kRows});
    old_log_prob.index_put_({source}, (log_prob_by_row + 0.3 * random({kRows}, seed)).detach());
    advantage = 2 * random({kRows}, seed + 1) + 0.5;
    alive = (random({kRows}, seed + 2) > -0.7).to(at::kByte);
    mean = advantage.mean().reshape({1});
    inv_std = advantage.std().reciprocal().reshape({1});
    inv_count = alive.to(at::kFloat).sum().reciprocal().reshape({1});
  }
  PolicyLossInput input() const {
    return {.rows = {index.const_data_ptr<int64_t>(), static_cast<int>(kAgents)},
            .old_log_prob = old_log_prob.const_data_ptr<float>(),
            .advantage = advantage.const_data_ptr<float>(),
            .alive = alive.const_data_ptr<uint8_t>(),
            .advantage_mean = mean.const_data_ptr<float>(),
            .advantage_inv_std = inv_std.const_data_ptr<float>(),
            .inv_count = inv_count.const_data_ptr<float>(),
            .entropy_coef = &kEntropyCoef,
            .clip_coef = &kClip};
  }
  /// Mean over the living of -min(ratio A, clip(ratio) A) - entropy_coef H; all in the minibatch's order.
  at::Tensor loss(const at::Tensor& log_prob, const at::Tensor& entropy) const {
    const at::Tensor a = (advantage - mean) * inv_std;
    const at::Tensor ratio = (log_prob - old_log_prob.index_select(0, source)).exp();
    const at::Tensor gain =
        at::minimum(ratio * a.index_select(0, source), ratio.clamp(1 - kClip, 1 + kClip) * a.index_select(0, source));
    const at::Tensor weight = alive.index_select(0, source).to(at::kFloat);
    clipped_share = ((ratio - 1).abs() > kClip).to(at::kFloat).mean().item<double>();
    return ((-gain - kEntropyCoef * entropy) * weight).sum() / weight.sum();
  }
  mutable double clipped_share = 0;
};

TEST(PolicyLossAutograd, Categorical) {
  at::Tensor logits = random({kRows, kLogitStride}, 1).requires_grad_(true);
  const at::Tensor action_by_row = at::arange(kRows) * 7 % kNDiscreteActions;
  const at::Tensor log_p = at::log_softmax(logits.slice(1, 0, kNDiscreteActions), 1);
  const at::Tensor log_prob = log_p.gather(1, action_by_row.unsqueeze(1)).squeeze(1);
  const Batch batch(log_prob, 10);
  const at::Tensor loss = batch.loss(log_prob, -(log_p.exp() * log_p).sum(1));
  loss.backward();

  at::Tensor action = at::empty({kRows}, at::kInt);
  action.index_put_({batch.source}, action_by_row.to(at::kInt));
  const at::Tensor d_logits = at::full({kRows, kLogitStride}, NAN);
  const at::Tensor diagnostics = at::full({kRows, kNPolicyDiagnostics}, NAN);
  cpu_loop().run(CategoricalLoss{batch.input(), logits.const_data_ptr<float>(), action.const_data_ptr<int32_t>(),
                                 d_logits.data_ptr<float>(), diagnostics.data_ptr<float>()},
                 kRows);
  EXPECT_GT(batch.clipped_share, 0.2);
  EXPECT_LT(batch.clipped_share, 0.8);
  EXPECT_GT(largest(logits.grad()), 1e-3);
  EXPECT_LT(worst(d_logits, logits.grad()), 1e-7);
  EXPECT_EQ(largest(d_logits.select(1, kNDiscreteActions)), 0);
  const at::Tensor sums = diagnostics.sum(0);
  EXPECT_NEAR(((sums[kLossPolicy] - kEntropyCoef * sums[kLossEntropy]) / sums[kLossCount]).item<double>(),
              loss.item<double>(), 1e-6);
}

TEST(PolicyLossAutograd, GaussianAndItsLogStd) {
  at::Tensor mean = random({kRows, 3}, 2).requires_grad_(true);
  at::Tensor log_std = numbers({-0.5f, 0.2f, 0.0f}).requires_grad_(true);
  const at::Tensor u = mean.detach() + random({kRows, 3}, 3) * log_std.detach().exp();
  const at::Tensor e = (u - mean) / log_std.exp();
  const at::Tensor log_prob =
      (-0.5 * e.square() - log_std - 0.5 * std::log(2 * M_PI) - (1 - u.tanh().square()).log()).sum(1);
  // Of the squashed action, by the nodes of squash_entropy: math_policy_loss_test.cpp looks how far these are off.
  const at::Tensor z = at::arange(-5, 6, mean.options()) * 0.8, weight = at::softmax(-0.5 * z.square(), 0);
  const at::Tensor far = (mean.unsqueeze(-1) + log_std.exp().unsqueeze(-1) * z).abs();  // [R, 3, 11]
  const at::Tensor squashed = ((2 * (std::log(2.0) - far - (-2 * far).exp().log1p())) * weight).sum(-1);
  const at::Tensor entropy = (log_std + 0.5 * (1 + std::log(2 * M_PI)) + squashed).sum(1);
  const Batch batch(log_prob, 20);
  const at::Tensor loss = batch.loss(log_prob, entropy);
  loss.backward();

  at::Tensor pre_tanh_action = at::empty({kRows, 3});
  pre_tanh_action.index_put_({batch.source}, u);
  const at::Tensor d_mean = at::full({kRows, 3}, NAN), d_log_std = at::full({kRows, 3}, NAN);
  const at::Tensor diagnostics = at::full({kRows, kNPolicyDiagnostics}, NAN);
  cpu_loop().run(GaussianLoss{.in = batch.input(),
                              .mean = mean.const_data_ptr<float>(),
                              .log_std = log_std.const_data_ptr<float>(),
                              .pre_tanh_action = pre_tanh_action.const_data_ptr<float>(),
                              .d_mean = d_mean.data_ptr<float>(),
                              .d_log_std = d_log_std.data_ptr<float>(),
                              .diagnostics = diagnostics.data_ptr<float>()},
                 kRows);
  EXPECT_GT(batch.clipped_share, 0.2);
  EXPECT_LT(batch.clipped_share, 0.8);
  EXPECT_LT(worst(d_mean, mean.grad()), 5e-7);
  EXPECT_LT(worst(d_log_std.sum(0), log_std.grad()), 2e-6);
  EXPECT_GT(largest(log_std.grad()), 0.01);
  const at::Tensor sums = diagnostics.sum(0);
  EXPECT_NEAR(((sums[kLossPolicy] - kEntropyCoef * sums[kLossEntropy]) / sums[kLossCount]).item<double>(),
              loss.item<double>(), 2e-6);
}

}  // namespace
}  // namespace giga::test
