// The fused gradients of actor and critic against LibTorch's in fp32, parameter by parameter.
#include "learn/mappo/fused_gradients.hpp"

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "cuda/runtime.hpp"
#include "learn/mappo/config.hpp"
#include "math/ppo_loss.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"

namespace giga::test {
namespace {

constexpr Device kOneGpu{Device::Kind::cuda, 0};
constexpr float kEntropyCoef = 0.05f, kValueCoef = 0.5f, kValueClip = 0.3f;

// How far a gradient may be from LibTorch's in fp32, as a share of its length: factors of products are rounded to TF32,
// by up to 2^-11 = 0.0005 each, in five products one after the other. The derivative of relu jumps, and so does that of
// the clipped ratio: rounding switches some units and some rows on or off. A row of 1,000 is 3 % of a gradient.
constexpr double kSmooth = 0.004, kJumps = 0.15;
constexpr float kNoClip = 10, kClip = 0.2f;

struct FusedCase {
  const char* name;
  ActionKind actions;
  CriticKind critic;
  Activation activation;
  std::vector<int> hidden;
  int n;               // agents
  int columns, first;  // numbers that the networks read, from this one on
  bool normalize;
  AdvantageNorm norm;
  float clip = kNoClip;
};

at::Tensor normal(at::IntArrayRef shape, uint64_t seed) {
  at::Generator generator = at::detail::createCPUGenerator(seed);
  return at::randn(shape, generator, at::TensorOptions().dtype(at::kFloat)).to(torch_device(kOneGpu));
}

/// Networks of a case, whose parameters are those of the initialisation plus normal numbers, and a rollout of 600
/// states, of which every third is learned from.
struct Setting {
  static constexpr int64_t kStates = 600, kRow = 200;
  ParallelFor parallel_for{kOneGpu, 0, current_stream(kOneGpu)};
  Actor actor;
  Critic critic;
  at::Tensor obs, alive, states, action, u, log_prob, advantage, old_value, returns, mean, std;

  explicit Setting(const FusedCase& c)
      : actor(actor_config(c), inputs(c), c.actions, c.normalize, Precision::tf32, torch_device(kOneGpu), 1),
        critic(critic_config(c), {0, {c.n, 2}, inputs(c), 7}, Precision::tf32, parallel_for, torch_device(kOneGpu), 2) {
    at::NoGradGuard no_grad;
    actor.parameters().values().add_(0.1 * normal({actor.parameters().size()}, 3));
    critic.parameters().values().add_(0.1 * normal({critic.parameters().size()}, 4));
    obs = normal({kStates, c.n, kRow}, 5);
    alive = (normal({kStates, c.n}, 6) > -0.7).to(at::kByte);
    alive[0].zero_();  // a state in which nobody lives
    if (c.normalize) actor.normalizer().update(obs.view({-1, kRow}) * 3 + 1, alive.to(at::kFloat).view({-1}));
    states = at::arange(kStates - kStates % 3 - 3, -1, -3, obs.options().dtype(at::kLong));
    action = (normal({kStates, c.n}, 7).abs() * 10).to(at::kInt).remainder(kNDiscreteActions);
    // Actions that the policy draws, and probabilities near its own: where they are far apart, the ratio makes rounding
    // larger, and single rows count more than all others.
    const at::Tensor head = actor.forward(obs.flatten(0, 1)).view({kStates, c.n, -1});
    if (c.actions == ActionKind::discrete) {
      log_prob = at::log_softmax(head.slice(-1, 0, kNDiscreteActions), -1)
                     .gather(-1, action.to(at::kLong).unsqueeze(-1))
                     .squeeze(-1);
    } else {
      const at::Tensor e = normal({kStates, c.n, 3}, 8);
      u = head + actor.log_std().exp() * e;
      const at::Tensor log_slope = 2 * (std::log(2.0) - u - at::softplus(-2 * u));
      log_prob = (-0.5 * e.square() - actor.log_std() - kHalfLogTwoPi - log_slope).sum(-1);
    }
    log_prob = log_prob + 0.3 * normal({kStates, c.n}, 9);
    advantage = 2 * normal({kStates, c.n}, 10) + 1;
    old_value = 0.3 * normal({kStates, c.n}, 11);
    returns = 4 + 2 * normal({kStates, c.n}, 12);
    mean = at::full({1}, 4.0f, obs.options());
    std = at::full({1}, 2.0f, obs.options());
  }

  static InputColumns inputs(const FusedCase& c) { return {kRow, c.first, c.columns}; }
  static ActorConfig actor_config(const FusedCase& c) {
    ActorConfig config;
    config.hidden = c.hidden;
    config.activation = c.activation;
    return config;
  }
  static CriticConfig critic_config(const FusedCase& c) {
    CriticConfig config;
    config.kind = c.critic;
    config.hidden = c.hidden;
    config.activation = c.activation;
    return config;
  }
  at::Tensor pick(const at::Tensor& x) const { return x.index_select(0, states); }
};

/// What LibTorch says of the same minibatch.
struct Expected {
  at::Tensor actor, critic, policy_sums, value_loss;

  Expected(Setting& s, const FusedCase& c) {
    const at::Tensor alive = s.pick(s.alive).to(at::kFloat), inv_count = alive.sum().reciprocal().reshape({1});
    const at::Tensor a = s.pick(s.advantage);
    at::Tensor mean = at::zeros({1}, a.options()), inv_std = at::ones({1}, a.options());
    if (c.norm == AdvantageNorm::minibatch) {
      mean = (a * alive).sum().reshape({1}) * inv_count;
      inv_std = (((a - mean).square() * alive).sum() * inv_count).sqrt().reciprocal();
    }
    const at::Tensor head = s.actor.forward(s.pick(s.obs).flatten(0, 1));
    const at::Tensor gradient = at::empty_like(head), d_log_std = at::zeros_like(head);
    const at::Tensor diagnostics = at::empty({head.size(0), kNPolicyDiagnostics}, head.options());
    const PolicyLossInput in{.rows = {s.states.const_data_ptr<int64_t>(), c.n},
                             .old_log_prob = s.log_prob.const_data_ptr<float>(),
                             .advantage = s.advantage.const_data_ptr<float>(),
                             .alive = s.alive.const_data_ptr<uint8_t>(),
                             .advantage_mean = mean.const_data_ptr<float>(),
                             .advantage_inv_std = inv_std.const_data_ptr<float>(),
                             .inv_count = inv_count.const_data_ptr<float>(),
                             .clip_coef = c.clip,
                             .entropy_coef = kEntropyCoef};
    if (c.actions == ActionKind::discrete)
      s.parallel_for.run(CategoricalLoss{in, head.const_data_ptr<float>(), s.action.const_data_ptr<int32_t>(),
                                         gradient.data_ptr<float>(), diagnostics.data_ptr<float>()},
                         head.size(0));
    else
      s.parallel_for.run(GaussianLoss{in, head.const_data_ptr<float>(), s.actor.log_std().const_data_ptr<float>(),
                                      s.u.const_data_ptr<float>(), gradient.data_ptr<float>(),
                                      d_log_std.data_ptr<float>(), diagnostics.data_ptr<float>()},
                         head.size(0));
    head.backward(gradient);
    if (c.actions == ActionKind::continuous) s.actor.log_std().grad().add_(d_log_std.sum(0));
    policy_sums = diagnostics.sum(0);
    actor = take(s.actor.parameters());

    at::Tensor obs = s.pick(s.obs);
    if (c.normalize) obs = s.actor.normalizer().apply(obs);
    const at::Tensor value = s.critic.forward(obs, alive, {});
    const at::Tensor d_value = at::empty_like(value), loss = at::empty_like(value);
    s.parallel_for.run(ValueLoss{.rows = in.rows,
                                 .value = value.const_data_ptr<float>(),
                                 .old_value = s.old_value.const_data_ptr<float>(),
                                 .returns = s.returns.const_data_ptr<float>(),
                                 .alive = in.alive,
                                 .value_mean = s.mean.const_data_ptr<float>(),
                                 .value_std = s.std.const_data_ptr<float>(),
                                 .inv_count = in.inv_count,
                                 .value_coef = kValueCoef,
                                 .error = {kValueClip, 0},
                                 .d_value = d_value.data_ptr<float>(),
                                 .loss = loss.data_ptr<float>()},
                       value.numel());
    value.backward(d_value);
    value_loss = loss.sum();
    critic = take(s.critic.parameters());
  }
  static at::Tensor take(const ParameterSet& p) {
    const at::Tensor gradient = p.gradient().clone();
    p.gradient().zero_();
    return gradient;
  }
};

/// |found - expected| / |expected|.
double apart(const at::Tensor& found, const at::Tensor& expected) {
  return ((found - expected).norm() / expected.norm()).item<double>();
}

/// Each matrix, and what lies between the matrices.
void expect_near(const char* what, const ParameterSet& p, const at::Tensor& found, const at::Tensor& expected,
                 double tolerance) {
  at::Tensor others = at::ones_like(found);
  for (const MatrixPlace& m : p.matrices()) {
    const auto of = [&m](const at::Tensor& x) { return x.slice(0, m.offset, m.offset + m.rows * m.columns); };
    of(others).zero_();
    EXPECT_LT(apart(of(found), of(expected)), tolerance) << what << ", weight at " << m.offset;
  }
  EXPECT_LT(apart(found * others, expected * others), tolerance) << what << ", biases";
}

const FusedCase kFusedCases[] = {
    {"Shipped",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::tanh,
     {64, 64},
     5,
     59,
     101,
     false,
     AdvantageNorm::minibatch},
    {"Normalized",
     ActionKind::discrete,
     CriticKind::independent,
     Activation::tanh,
     {64, 64},
     3,
     106,
     3,
     true,
     AdvantageNorm::none},
    {"Continuous",
     ActionKind::continuous,
     CriticKind::composed,
     Activation::silu,
     {32, 48},
     7,
     40,
     8,
     true,
     AdvantageNorm::minibatch},
    {"Many",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::gelu,
     {64, 64},
     20,
     176,
     0,
     false,
     AdvantageNorm::none},
    {"Alone",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::tanh,
     {16, 64},
     1,
     192,
     0,
     false,
     AdvantageNorm::minibatch},
    {"ReluClipped",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::relu,
     {64, 64},
     2,
     64,
     0,
     false,
     AdvantageNorm::minibatch,
     kClip},
};

class LearnFusedGradientsGpu : public testing::TestWithParam<FusedCase> {};

TEST_P(LearnFusedGradientsGpu, AreThoseOfLibTorch) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  if (!fused_gradients_run(0)) GTEST_SKIP() << "this GPU has too little shared memory";
  const FusedCase& c = GetParam();
  const double tolerance = c.clip == kClip ? kJumps : kSmooth;
  Setting s(c);
  const Expected expected(s, c);
  ASSERT_EQ(fused_gradients_refusal(s.actor, s.critic, c.n, kOneGpu), "");
  FusedGradients fused(s.actor, s.critic, c.n, kOneGpu, s.parallel_for.stream());

  at::NoGradGuard no_grad;
  fused.choose(s.obs, s.alive, s.states);
  fused.take_moments(s.advantage);
  FusedPolicyLoss policy{.old_log_prob = s.log_prob.const_data_ptr<float>(),
                         .advantage = s.advantage.const_data_ptr<float>(),
                         .clip_coef = c.clip,
                         .entropy_coef = kEntropyCoef};
  if (c.actions == ActionKind::discrete)
    policy.action = s.action.const_data_ptr<int32_t>();
  else
    policy.pre_tanh_action = s.u.const_data_ptr<float>();
  const at::Tensor zero = at::zeros({1}, s.obs.options()), one = at::ones({1}, s.obs.options());
  if (c.norm == AdvantageNorm::none) {
    policy.advantage_mean = zero.const_data_ptr<float>();
    policy.advantage_inv_std = one.const_data_ptr<float>();
  }
  const at::Tensor sums = fused.actor_gradient(policy).clone();
  const at::Tensor actor = s.actor.parameters().gradient().clone();
  expect_near("actor", s.actor.parameters(), actor, expected.actor, tolerance);
  for (int k = 0; k < kNPolicyDiagnostics; ++k)
    EXPECT_NEAR(sums[k].item<double>(), expected.policy_sums[k].item<double>(),
                0.002 * expected.policy_sums[k].abs().item<double>() + 2)
        << k;
  EXPECT_EQ(sums[kLossCount].item<float>(), expected.policy_sums[kLossCount].item<float>());

  const FusedValueLoss value_loss{.old_value = s.old_value.const_data_ptr<float>(),
                                  .returns = s.returns.const_data_ptr<float>(),
                                  .value_mean = s.mean.const_data_ptr<float>(),
                                  .value_std = s.std.const_data_ptr<float>(),
                                  .value_coef = kValueCoef,
                                  .error = {kValueClip, 0}};
  const double loss = fused.critic_gradient(value_loss)[0].item<double>(), right = expected.value_loss.item<double>();
  EXPECT_NEAR(loss, right, 0.001 * right);
  const at::Tensor critic = s.critic.parameters().gradient().clone();
  expect_near("critic", s.critic.parameters(), critic, expected.critic, tolerance);

  // Bit for bit the same once more.
  fused.actor_gradient(policy);
  fused.critic_gradient(value_loss);
  EXPECT_TRUE(at::equal(s.actor.parameters().gradient(), actor));
  EXPECT_TRUE(at::equal(s.critic.parameters().gradient(), critic));

  // Values, of the chosen states and of all.
  at::Tensor obs = s.obs;
  if (c.normalize) obs = s.actor.normalizer().apply(obs);
  const at::Tensor all = s.critic.forward(obs, s.alive.to(at::kFloat), {});
  const double scale = all.abs().max().item<double>();
  at::Tensor values = at::zeros_like(all);
  fused.write_values(values);
  EXPECT_LT((s.pick(values) - s.pick(all)).abs().max().item<double>(), 0.004 * scale);
  EXPECT_EQ((values != 0).any(1).sum().item<int64_t>(), s.states.numel());
  fused.choose(s.obs, s.alive, {});
  fused.write_values(values);
  EXPECT_LT((values - all).abs().max().item<double>(), 0.004 * scale);
}

INSTANTIATE_TEST_SUITE_P(All, LearnFusedGradientsGpu, testing::ValuesIn(kFusedCases),
                         [](const auto& p) { return std::string(p.param.name); });

}  // namespace
}  // namespace giga::test
