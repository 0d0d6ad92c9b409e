// The fused kernels, and what takes their place on a CPU, against LibTorch in fp32: gradients parameter by parameter,
// values, the step; and what they serve.
#include "learn/mappo/fused_update.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <string>
#include <utility>
#include <vector>

#include "core/error.hpp"
#include "cuda/ppo_wide.hpp"
#include "fused_cases.hpp"
#include "math/ppo_loss.hpp"

namespace giga::test {
namespace {

constexpr float kValueClip = 0.3f;

// How far a gradient may be from LibTorch's in fp32, as a share of its length: both factors of a product are rounded to
// half precision, by up to 2^-11 = 0.0005 each, in five products one after the other: 0.005. The derivative of relu
// jumps, and so does that of the clipped ratio: rounding switches some units and some rows on or off. A row of 1,000 is
// 3 % of a gradient.
constexpr double kSmooth = 0.005, kJumps = 0.15;
// The slope of a clipped value error jumps to 0 in the same way. No row of a test is so near to where it does.
constexpr float kFromJump = 0.02f;
// A CPU rounds to fp32, by up to 2^-24 = 6e-8 each, in sums of up to 1,400 rows.
constexpr double kOnCpu = 2e-5;

/// What LibTorch says of the same minibatch.
struct Expected {
  at::Tensor actor, critic, policy_sums, value_loss;

  /// Changes what the critic said of some rows, to be away from jumps.
  Expected(FusedSetting& s, const FusedCase& c) {
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
    const at::Tensor entropy_coef = at::full({1}, kEntropyCoef, head.options());
    const PolicyLossInput in{.rows = {s.states.const_data_ptr<int64_t>(), c.n},
                             .old_log_prob = s.log_prob.const_data_ptr<float>(),
                             .advantage = s.advantage.const_data_ptr<float>(),
                             .alive = s.alive.const_data_ptr<uint8_t>(),
                             .advantage_mean = mean.const_data_ptr<float>(),
                             .advantage_inv_std = inv_std.const_data_ptr<float>(),
                             .inv_count = inv_count.const_data_ptr<float>(),
                             .entropy_coef = entropy_coef.const_data_ptr<float>(),
                             .clip_coef = s.clip_coef.const_data_ptr<float>()};
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
    const at::Tensor value = s.critic.forward(obs, alive, s.pick(s.true_state));
    keep_from_jumps(s, value.detach());
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
  /// Rows near a jump of the value error have not moved at all.
  static void keep_from_jumps(FusedSetting& s, const at::Tensor& values) {
    const at::Tensor old = s.pick(s.old_value), value = values.view_as(old), moved = value - old;
    const at::Tensor held = old + moved.clamp(-kValueClip, kValueClip), target = (s.pick(s.returns) - s.mean) / s.std;
    const at::Tensor at_clip = (moved.abs() - kValueClip).abs() < kFromJump;
    const at::Tensor at_equal = ((value - target).abs() - (held - target).abs()).abs() < kFromJump;
    const at::Tensor near = at_clip.logical_or(at_equal.logical_and(moved.abs() > kValueClip));
    s.old_value.index_copy_(0, s.states, at::where(near, value, old));
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

void expect_what_libtorch_says(const FusedCase& c, Device device) {
  const double rounding = device.is_cuda() ? kSmooth : kOnCpu;
  const double tolerance = device.is_cuda() && c.clip == kClip ? kJumps : rounding;
  FusedSetting s(c, device);
  const Expected expected(s, c);
  ASSERT_EQ(fused_update_refusal(s.actor, s.critic, c.n, device), "");
  FusedUpdate fused(s.actor, s.critic, c.n, s.parallel_for);

  at::NoGradGuard no_grad;
  FusedPolicyLoss policy = s.policy_loss();
  const at::Tensor zero = at::zeros({1}, s.obs.options()), one = at::ones({1}, s.obs.options());
  if (c.norm == AdvantageNorm::none) {
    policy.advantage_mean = zero.const_data_ptr<float>();
    policy.advantage_inv_std = one.const_data_ptr<float>();
  }
  FusedValueLoss value = s.value_loss();
  value.error = {kValueClip, 0};

  // The last of three minibatches of an epoch has the states of the test.
  const int64_t n_states = s.states.numel();
  const at::Tensor epoch = at::cat({at::arange(2 * n_states, s.states.options()), s.states});
  FusedSteps steps(s);
  fused.begin_epoch(s.inputs(), s.alive, epoch, 3, s.advantage);
  fused.compute_gradients(2, policy, value);
  fused.add_up(steps.of(s));
  fused.end_epoch();
  const at::Tensor actor = s.actor.parameters().gradient().clone(), critic = s.critic.parameters().gradient().clone();
  expect_near("actor", s.actor.parameters(), actor, expected.actor, tolerance);
  expect_near("critic", s.critic.parameters(), critic, expected.critic, tolerance);
  const at::Tensor sums = fused.sums().cpu();
  for (int k = 0; k < kNPolicyDiagnostics; ++k)
    EXPECT_NEAR(sums[0][k].item<double>(), expected.policy_sums[k].item<double>(),
                device.is_cuda() ? 0.002 * expected.policy_sums[k].abs().item<double>() + 2 : 0.05)
        << k;
  EXPECT_EQ(sums[0][kLossCount].item<float>(), expected.policy_sums[kLossCount].item<float>());
  const double right = expected.value_loss.item<double>();
  EXPECT_NEAR(sums[1][0].item<double>(), right, (device.is_cuda() ? 0.001 : 1e-5) * right);
  EXPECT_NEAR(steps.adam[0].norm().item<double>(), actor.norm().item<double>(), 1e-5 * actor.norm().item<double>());
  EXPECT_NEAR(steps.adam[1].norm().item<double>(), critic.norm().item<double>(), 1e-5 * critic.norm().item<double>());

  // The actor's half alone, of the same states: sums over blocks are LibTorch's, in another order.
  FusedActorGradient alone(s.actor, c.n, s.parallel_for);
  const at::Tensor alone_sums = alone.compute(s.obs, s.alive, s.states, policy).cpu();
  EXPECT_LT(apart(s.actor.parameters().gradient(), actor), 1e-5);
  for (int k = 0; k < kNPolicyDiagnostics; ++k)
    EXPECT_NEAR(alone_sums[k].item<double>(), sums[0][k].item<double>(), 1e-4 * sums[0][k].abs().item<double>() + 1e-3)
        << k;
  const at::Tensor alone_gradient = s.actor.parameters().gradient().clone();
  alone.compute(s.obs, s.alive, s.states, policy);
  EXPECT_TRUE(at::equal(s.actor.parameters().gradient(), alone_gradient)) << "bit for bit the same once more";

  // Bit for bit the same once more; the step is that of the optimizer, which LibTorch's path takes.
  FusedSteps plain(s, 1e-3f);
  const at::Tensor before[2] = {s.actor.parameters().values().clone(), s.critic.parameters().values().clone()};
  const ParameterSet* parameters[2] = {&s.actor.parameters(), &s.critic.parameters()};
  at::Tensor after[2];
  for (int k = 0; k < 2; ++k) {
    plain.adam[k].step(*parameters[k], s.parallel_for, plain.step_size.const_data_ptr<float>(), kMaxNorm,
                       plain.flags(k));
    after[k] = parameters[k]->values().clone();
    parameters[k]->values().copy_(before[k]);
  }
  fused.begin_epoch(s.inputs(), s.alive, epoch, 3, s.advantage);
  fused.compute_gradients(2, policy, value);
  fused.add_up(steps.of(s));
  fused.end_epoch();
  EXPECT_TRUE(at::equal(s.actor.parameters().gradient(), actor));
  EXPECT_TRUE(at::equal(s.critic.parameters().gradient(), critic));
  FusedSteps again(s, 1e-3f);
  fused.begin_epoch(s.inputs(), s.alive, epoch, 3, s.advantage);
  fused.compute_gradients(2, policy, value);
  fused.step(again.of(s));
  fused.end_epoch();
  for (int k = 0; k < 2; ++k) {
    EXPECT_LT((parameters[k]->values() - after[k]).abs().max().item<double>(), 1e-7) << "network " << k;
    EXPECT_GT((parameters[k]->values() - before[k]).abs().max().item<double>(), 5e-4) << "network " << k;
    EXPECT_EQ(parameters[k]->gradient().abs().max().item<double>(), 0) << "the gradient is cleared";
    parameters[k]->values().copy_(before[k]);
  }

  // Values, of the chosen states and of all.
  at::Tensor obs = s.obs;
  if (c.normalize) obs = s.actor.normalizer().apply(obs);
  const at::Tensor all = s.critic.forward(obs, s.alive.to(at::kFloat), s.true_state);
  const double scale = all.abs().max().item<double>();
  at::Tensor values = at::zeros_like(all);
  fused.write_values(s.seen(), s.alive, s.states, values);
  EXPECT_LT((s.pick(values) - s.pick(all)).abs().max().item<double>(), rounding * scale);
  EXPECT_EQ((values != 0).any(1).sum().item<int64_t>(), s.states.numel());
  fused.write_values(s.seen(), s.alive, {}, values);
  EXPECT_LT((values - all).abs().max().item<double>(), rounding * scale);
  for (int k = 0; k < 3; ++k) {
    const at::Tensor once_more = at::zeros_like(all);
    fused.write_values(s.seen(), s.alive, {}, once_more);
    EXPECT_TRUE(at::equal(once_more, values)) << "values, bit for bit the same once more";
  }
}

TEST_P(LearnFusedUpdate, IsThatOfLibTorch) { expect_what_libtorch_says(GetParam(), kCpu); }

TEST_P(LearnFusedUpdateGpu, AreThoseOfLibTorch) {
  if (const std::string why = no_fused_kernels(); !why.empty()) GTEST_SKIP() << why;
  expect_what_libtorch_says(GetParam(), kOneGpu);
}

// What the kernels serve, and what is said of others.
TEST(LearnFusedUpdateRefusal, SaysWhatIsTooWide) {
  const auto refusal = [](std::vector<int> actor, std::vector<int> critic, int columns) {
    FusedCase c = fused_cases()[0];
    c.hidden = std::move(actor);
    c.columns = columns;
    c.first = 0;
    const FusedSetting on_actor(c, kCpu);
    c.hidden = std::move(critic);
    const FusedSetting on_critic(c, kCpu);
    return fused_update_refusal(on_actor.actor, on_critic.critic, c.n, kCpu);
  };
  EXPECT_EQ(refusal({128, 128}, {128, 128}, 192), "");
  EXPECT_EQ(refusal({256, 256}, {256, 256}, 192), "");
  EXPECT_EQ(refusal({64, 64}, {128, 100}, 59), "");
  EXPECT_EQ(refusal({65, 1}, {64, 64}, 59), "");
  const auto told = [](const char* network) {
    return cat(
        "they serve dense networks with two hidden layers of at most 256, without layer normalisation, on at "
        "most 192 numbers (mappo.",
        network, ")");
  };
  EXPECT_EQ(refusal({257, 64}, {64, 64}, 59), told("actor"));
  EXPECT_EQ(refusal({64, 64}, {64, 257}, 59), told("critic"));
  EXPECT_EQ(refusal({64}, {64, 64}, 59), told("actor"));
  EXPECT_EQ(refusal({64, 64}, {64, 64, 64}, 59), told("critic"));
  EXPECT_EQ(refusal({64, 64}, {64, 64}, 193), told("actor"));
}

TEST(LearnFusedUpdateRefusal, SaysWhichCriticsOfTheTrueState) {
  const auto refusal = [](std::vector<int> hidden, int n_other, int world) {
    FusedCase c = fused_cases()[0];
    const FusedSetting on_actor(c, kCpu);
    c.critic = CriticKind::state;
    c.hidden = std::move(hidden);
    c.n_other = n_other;
    c.world = world;
    const Critic critic = make_critic(c, on_actor.parallel_for, kCpu);
    return fused_update_refusal(on_actor.actor, critic, c.n, kCpu);
  };
  EXPECT_EQ(refusal({128, 128}, 64, 47), "");
  EXPECT_EQ(refusal({64}, 5, 21), "") << "64 numbers of an agent's code, and a layer of 64";
  const std::string told =
      "of critics of the true state they serve those with one or two hidden layers of at most 128, without layer "
      "normalisation, in games of at most 64 agents a team and 47 numbers of the world (mappo.critic)";
  EXPECT_EQ(refusal({64, 64, 64}, 5, 21), told);
  EXPECT_EQ(refusal({129}, 5, 21), told);
  EXPECT_EQ(refusal({64, 129}, 5, 21), told);
  EXPECT_EQ(refusal({129, 64}, 5, 21), told);
  EXPECT_EQ(refusal({64, 64}, 65, 21), told);
  EXPECT_EQ(refusal({64, 64}, 5, 48), told);
}

// What is kept of states: that of a tile's whole states, in as many tiles as the busiest block has.
TEST(LearnFusedUpdateKeptStates, HaveRoom) {
  FusedMlp net;
  net.width[1] = net.width[2] = 128;
  EXPECT_EQ(KeptStates::words(net, 5, 1000, 10), 0) << "no team weight";
  net.team_weight[1] = 0;
  // 1,000 states in 84 tiles of 12, up to 9 tiles for each of 10 blocks, 2 rows of 64 words for each state.
  EXPECT_EQ(KeptStates::words(net, 5, 1000, 10), 10 * 9 * 12 * 2 * 64);
  EXPECT_EQ(KeptStates(1, 1000, 10).per_tile, 32);
  EXPECT_EQ(KeptStates(2, 1000, 10).per_tile, 32);
  EXPECT_EQ(KeptStates(64, 1000, 10).per_tile, 1);
  net.width[1] = net.width[2] = 64;
  EXPECT_EQ(KeptStates::words(net, 5, 1000, 10), 0) << "the kernels of 64 need none";
  net.width[1] = 129;
  EXPECT_EQ(KeptStates::words(net, 5, 1000, 10), 0) << "wide networks have other memory";
  net.width[1] = 64;

  // Of the true state: 64 agents of a team in a tile, 12 states of 5 against 5, 4 rows of 32 or 64 words of each state.
  net.team_weight[1] = -1;
  net.state = {.first_own = 0, .first_other = 5, .n_other = 5, .world = 21};
  EXPECT_EQ(kept_words(net, 5, 1000, 10), 10 * 9 * 12 * 4 * 32);
  net.width[2] = 65;
  EXPECT_EQ(kept_words(net, 5, 1000, 10), 10 * 9 * 12 * 4 * 64);
  EXPECT_EQ(KeptTrueStates(net, 1, 1000, 10).per_tile, 12);
  net.state.n_other = 1;
  EXPECT_EQ(KeptTrueStates(net, 1, 1000, 10).per_tile, 16);
  EXPECT_EQ(KeptTrueStates(net, 64, 1000, 10).per_tile, 1);
}

// What lies between the kernels of wide networks: rows of tiles with whole states.
TEST(LearnFusedUpdateWideLayers, HaveRoom) {
  FusedMlp net;
  net.width[0] = 59;
  net.width[1] = 200;
  net.width[2] = 64;
  net.size = 1000;
  EXPECT_EQ(WideLayers::tiles_of(5, 1000), 84) << "12 states of 5 in 64 rows";
  // Of 84 * 64 rows: features and d2 of 128 words, inputs of 32, shares of 1; 10 parts of 1,008; one number.
  EXPECT_EQ(WideLayers::words_for(net, 5, 1000, 10), 84 * 64 * (128 + 128 + 32 + 1) + 10112 + 64);
  net.activation = Activation::gelu;
  net.team_weight[1] = 0;
  // Also slopes; of 84 * 12 states means, sums, and what comes of a team weight.
  EXPECT_EQ(WideLayers::words_for(net, 5, 1000, 10), 84 * 64 * (3 * 128 + 32 + 1) + 84 * 12 * (3 * 128) + 10112 + 64);
  EXPECT_EQ(WideLayers::words_for_values(net, 5, 7), 7 * (64 * (128 + 1) + 12 * (128 + 128)));
  EXPECT_EQ(WideLayers::tiles_for_values(net, 5, 7 * (64 * (128 + 1) + 12 * (128 + 128)) + 63), 7);
  net.width[1] = 128;
  EXPECT_EQ(WideLayers::words_for(net, 5, 1000, 10), 0);
}

INSTANTIATE_TEST_SUITE_P(All, LearnFusedUpdate, testing::ValuesIn(fused_cases()),
                         [](const auto& p) { return std::string(p.param.name); });
INSTANTIATE_TEST_SUITE_P(All, LearnFusedUpdateGpu, testing::ValuesIn(fused_cases()),
                         [](const auto& p) { return std::string(p.param.name); });

}  // namespace
}  // namespace giga::test
