// The fused kernels, and what takes their place on a CPU, against LibTorch in fp32: gradients parameter by parameter,
// values, the step, the policy.
#include "learn/mappo/fused_update.hpp"

#include <ATen/CPUGeneratorImpl.h>
#include <c10/core/impl/VirtualGuardImpl.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "learn/mappo/config.hpp"
#include "math/ppo_loss.hpp"
#include "policy/fused_actor.hpp"
#include "policy/optimizer.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"

namespace giga::test {
namespace {

constexpr Device kOneGpu{Device::Kind::cuda, 0}, kCpu{};
constexpr float kEntropyCoef = 0.05f, kValueCoef = 0.5f, kValueClip = 0.3f;

// How far a gradient may be from LibTorch's in fp32, as a share of its length: factors of products are rounded to half
// precision, by up to 2^-11 = 0.0005 each, in five products one after the other. The derivative of relu jumps, and so
// does that of the clipped ratio: rounding switches some units and some rows on or off. A row of 1,000 is 3 % of a
// gradient.
constexpr float kMaxNorm = 0.1f;
constexpr double kSmooth = 0.004, kJumps = 0.15;
constexpr float kNoClip = 10, kClip = 0.2f;
// A CPU rounds to fp32, by up to 2^-24 = 6e-8 each, in sums of up to 1,400 rows.
constexpr double kOnCpu = 2e-5;

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
  int64_t n_states = 600;  // of the rollout, of which every third is learned from
};

struct Normal {
  at::Device device;
  at::Tensor operator()(at::IntArrayRef shape, uint64_t seed) const {
    at::Generator generator = at::detail::createCPUGenerator(seed);
    return at::randn(shape, generator, at::TensorOptions().dtype(at::kFloat)).to(device);
  }
};

/// Networks of a case, whose parameters are those of the initialisation plus normal numbers, and a rollout.
struct Setting {
  static constexpr int64_t kRow = 200;
  const int64_t n_states;
  ParallelFor parallel_for;
  Actor actor;
  Critic critic;
  at::Tensor obs, alive, states, action, u, log_prob, advantage, old_value, returns, mean, std;

  Setting(const FusedCase& c, Device device, int n_threads = 2)
      : n_states(c.n_states),
        parallel_for(device, n_threads, current_stream(device)),
        actor(actor_config(c), inputs(c), c.actions, c.normalize, precision(device), torch_device(device), 1),
        critic(critic_config(c), {0, {c.n, 2}, inputs(c), 7}, precision(device), parallel_for, torch_device(device),
               2) {
    const Normal normal{torch_device(device)};
    at::NoGradGuard no_grad;
    actor.parameters().values().add_(0.1 * normal({actor.parameters().size()}, 3));
    critic.parameters().values().add_(0.1 * normal({critic.parameters().size()}, 4));
    obs = normal({n_states, c.n, kRow}, 5);
    alive = (normal({n_states, c.n}, 6) > -0.7).to(at::kByte);
    alive[0].zero_();  // a state in which nobody lives
    if (c.normalize) actor.normalizer().update(obs.view({-1, kRow}) * 3 + 1, alive.to(at::kFloat).view({-1}));
    states = at::arange(n_states - n_states % 3 - 3, -1, -3, obs.options().dtype(at::kLong));
    action = (normal({n_states, c.n}, 7).abs() * 10).to(at::kInt).remainder(kNDiscreteActions);
    // Actions that the policy draws, and probabilities near its own: where they are far apart, the ratio makes rounding
    // larger, and single rows count more than all others.
    const at::Tensor head = actor.forward(obs.flatten(0, 1)).view({n_states, c.n, -1});
    if (c.actions == ActionKind::discrete) {
      log_prob = at::log_softmax(head.slice(-1, 0, kNDiscreteActions), -1)
                     .gather(-1, action.to(at::kLong).unsqueeze(-1))
                     .squeeze(-1);
    } else {
      const at::Tensor e = normal({n_states, c.n, 3}, 8);
      u = head + actor.log_std().exp() * e;
      const at::Tensor log_slope = 2 * (std::log(2.0) - u - at::softplus(-2 * u));
      log_prob = (-0.5 * e.square() - actor.log_std() - kHalfLogTwoPi - log_slope).sum(-1);
    }
    log_prob = log_prob + 0.3 * normal({n_states, c.n}, 9);
    advantage = 2 * normal({n_states, c.n}, 10) + 1;
    old_value = 0.3 * normal({n_states, c.n}, 11);
    returns = 4 + 2 * normal({n_states, c.n}, 12);
    mean = at::full({1}, 4.0f, obs.options());
    std = at::full({1}, 2.0f, obs.options());
  }

  static Precision precision(Device device) { return device.is_cuda() ? Precision::tf32 : Precision::fp32; }
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

/// What a step needs besides the gradients: optimizers, flags and figures of its own.
struct Steps {
  Adam adam[2];
  at::Tensor figures, stop;

  explicit Steps(const Setting& s)
      : adam{{s.actor.parameters(), 1e-5f}, {s.critic.parameters(), 1e-5f}},
        figures(at::zeros({kNFigures}, s.obs.options())),
        stop(at::zeros({1}, s.obs.options())) {}
  StepFlags flags(int network) const {
    float* f = figures.data_ptr<float>();
    return {stop.const_data_ptr<float>(), f + kFirstFault + kFaultActorGradient + network, f + kFirstFault, kNFaults, 1,
            f + kFigActorNorm + network};
  }
  FusedStep of(const Setting& s, float step_size) const {
    const ParameterSet* parameters[2] = {&s.actor.parameters(), &s.critic.parameters()};
    FusedStep::Network network[2];
    for (int k = 0; k < 2; ++k)
      network[k] = {.gate = adam[k].gate(kMaxNorm, flags(k)),
                    .adam = adam[k].adam(*parameters[k], step_size),
                    .norm = adam[k].norm().data_ptr<float>()};
    return {.actor = network[0],
            .critic = network[1],
            .note = {nullptr, figures.data_ptr<float>(), stop.data_ptr<float>(), -1, true},
            .value_loss = figures.data_ptr<float>() + kFigValueLoss};
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
    // Hidden layers of up to 128.
    {"Broad",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::tanh,
     {128, 128},
     5,
     59,
     101,
     false,
     AdvantageNorm::minibatch},
    {"BroadContinuous",
     ActionKind::continuous,
     CriticKind::composed,
     Activation::silu,
     {100, 72},
     7,
     40,
     8,
     true,
     AdvantageNorm::minibatch},
    {"BroadIndependent",
     ActionKind::discrete,
     CriticKind::independent,
     Activation::gelu,
     {128, 128},
     3,
     106,
     3,
     true,
     AdvantageNorm::none},
    {"BroadReluClipped",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::relu,
     {72, 128},
     20,
     176,
     0,
     false,
     AdvantageNorm::minibatch,
     kClip},
    {"BroadAlone",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::tanh,
     {16, 127},
     1,
     192,
     0,
     false,
     AdvantageNorm::minibatch},
    {"BroadContinuousIndependent",
     ActionKind::continuous,
     CriticKind::independent,
     Activation::tanh,
     {128, 100},
     2,
     176,
     0,
     false,
     AdvantageNorm::none},
    {"BroadCrowd",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::gelu,
     {128, 128},
     64,
     106,
     2,
     false,
     AdvantageNorm::minibatch},
    // Each block of a GPU takes several tiles: 20,000 rows, in tiles of 60.
    {"BroadManyRows",
     ActionKind::discrete,
     CriticKind::composed,
     Activation::silu,
     {128, 128},
     5,
     64,
     0,
     false,
     AdvantageNorm::minibatch,
     kNoClip,
     12'000},
};

void expect_what_libtorch_says(const FusedCase& c, Device device) {
  const double rounding = device.is_cuda() ? kSmooth : kOnCpu;
  const double tolerance = device.is_cuda() && c.clip == kClip ? kJumps : rounding;
  Setting s(c, device);
  const Expected expected(s, c);
  ASSERT_EQ(fused_update_refusal(s.actor, s.critic, c.n, device), "");
  FusedUpdate fused(s.actor, s.critic, c.n, s.parallel_for);

  at::NoGradGuard no_grad;
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
  const FusedValueLoss value{.old_value = s.old_value.const_data_ptr<float>(),
                             .returns = s.returns.const_data_ptr<float>(),
                             .value_mean = s.mean.const_data_ptr<float>(),
                             .value_std = s.std.const_data_ptr<float>(),
                             .value_coef = kValueCoef,
                             .error = {kValueClip, 0}};

  // The last of three minibatches of an epoch has the states of the test.
  const int64_t n_states = s.states.numel();
  const at::Tensor epoch = at::cat({at::arange(2 * n_states, s.states.options()), s.states});
  Steps steps(s);
  fused.begin_epoch(s.obs, s.alive, epoch, 3, s.advantage);
  fused.compute_gradients(2, policy, value);
  fused.add_up(steps.of(s, 0));
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

  // Bit for bit the same once more; the step is that of the optimizer, which LibTorch's path takes.
  Steps plain(s);
  const at::Tensor before[2] = {s.actor.parameters().values().clone(), s.critic.parameters().values().clone()};
  const ParameterSet* parameters[2] = {&s.actor.parameters(), &s.critic.parameters()};
  at::Tensor after[2];
  for (int k = 0; k < 2; ++k) {
    plain.adam[k].step(*parameters[k], s.parallel_for, 1e-3f, kMaxNorm, plain.flags(k));
    after[k] = parameters[k]->values().clone();
    parameters[k]->values().copy_(before[k]);
  }
  fused.begin_epoch(s.obs, s.alive, epoch, 3, s.advantage);
  fused.compute_gradients(2, policy, value);
  fused.add_up(steps.of(s, 0));
  fused.end_epoch();
  EXPECT_TRUE(at::equal(s.actor.parameters().gradient(), actor));
  EXPECT_TRUE(at::equal(s.critic.parameters().gradient(), critic));
  Steps again(s);
  fused.begin_epoch(s.obs, s.alive, epoch, 3, s.advantage);
  fused.compute_gradients(2, policy, value);
  fused.step(again.of(s, 1e-3f));
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
  const at::Tensor all = s.critic.forward(obs, s.alive.to(at::kFloat), {});
  const double scale = all.abs().max().item<double>();
  at::Tensor values = at::zeros_like(all);
  fused.write_values(s.obs, s.alive, s.states, values);
  EXPECT_LT((s.pick(values) - s.pick(all)).abs().max().item<double>(), rounding * scale);
  EXPECT_EQ((values != 0).any(1).sum().item<int64_t>(), s.states.numel());
  fused.write_values(s.obs, s.alive, {}, values);
  EXPECT_LT((values - all).abs().max().item<double>(), rounding * scale);
}

class LearnFusedUpdate : public testing::TestWithParam<FusedCase> {};
class LearnFusedUpdateGpu : public LearnFusedUpdate {};

TEST_P(LearnFusedUpdate, IsThatOfLibTorch) { expect_what_libtorch_says(GetParam(), kCpu); }

TEST_P(LearnFusedUpdateGpu, AreThoseOfLibTorch) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  if (!fused_gradients_run(0)) GTEST_SKIP() << "this GPU has too little shared memory";
  expect_what_libtorch_says(GetParam(), kOneGpu);
}

// What the kernels serve, and what is said of others.
TEST(LearnFusedUpdateRefusal, SaysWhatIsTooWide) {
  const auto refusal = [](std::vector<int> actor, std::vector<int> critic, int columns) {
    FusedCase c = kFusedCases[0];
    c.hidden = std::move(actor);
    c.columns = columns;
    c.first = 0;
    const Setting on_actor(c, kCpu);
    c.hidden = std::move(critic);
    const Setting on_critic(c, kCpu);
    return fused_update_refusal(on_actor.actor, on_critic.critic, c.n, kCpu);
  };
  EXPECT_EQ(refusal({128, 128}, {128, 128}, 192), "");
  EXPECT_EQ(refusal({64, 64}, {128, 100}, 59), "");
  EXPECT_EQ(refusal({65, 1}, {64, 64}, 59), "");
  const auto told = [](const char* network) {
    return cat(
        "they serve dense networks with two hidden layers of at most 128, without layer normalisation, on at "
        "most 192 numbers (mappo.",
        network, ")");
  };
  EXPECT_EQ(refusal({129, 64}, {64, 64}, 59), told("actor"));
  EXPECT_EQ(refusal({64, 64}, {64, 129}, 59), told("critic"));
  EXPECT_EQ(refusal({64}, {64, 64}, 59), told("actor"));
  EXPECT_EQ(refusal({64, 64}, {64, 64, 64}, 59), told("critic"));
  EXPECT_EQ(refusal({64, 64}, {64, 64}, 193), told("actor"));
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
}

// One thread, two, and three, which share the 16 parts of a minibatch unevenly.
TEST(LearnFusedUpdateThreads, ChangeNoBit) {
  const FusedCase& c = kFusedCases[0];
  std::vector<at::Tensor> found[3];
  for (int k = 0; k < 3; ++k) {
    Setting s(c, kCpu, k + 1);
    FusedUpdate fused(s.actor, s.critic, c.n, s.parallel_for);
    Steps steps(s);
    at::NoGradGuard no_grad;
    fused.begin_epoch(s.obs, s.alive, s.states, 1, s.advantage);
    fused.compute_gradients(0,
                            {.old_log_prob = s.log_prob.const_data_ptr<float>(),
                             .advantage = s.advantage.const_data_ptr<float>(),
                             .action = s.action.const_data_ptr<int32_t>(),
                             .clip_coef = kClip},
                            {.old_value = s.old_value.const_data_ptr<float>(),
                             .returns = s.returns.const_data_ptr<float>(),
                             .value_mean = s.mean.const_data_ptr<float>(),
                             .value_std = s.std.const_data_ptr<float>(),
                             .value_coef = kValueCoef});
    fused.add_up(steps.of(s, 0));
    const at::Tensor values = at::empty({s.n_states, c.n}, s.obs.options());
    fused.write_values(s.obs, s.alive, {}, values);
    found[k] = {s.actor.parameters().gradient(), s.critic.parameters().gradient(), values};
    for (size_t x = 0; x < found[k].size(); ++x) EXPECT_TRUE(at::equal(found[k][x], found[0][x])) << k + 1 << ", " << x;
  }
}

/// The sum over two ranks that have the same rows: twice what is here.
void add_the_same(const at::Tensor& x, void* stream) {
  if (!x.is_cuda() || !stream) {
    x.mul_(2);
    return;
  }
  const c10::impl::VirtualGuardImpl cuda(at::kCUDA);
  const c10::Stream there(c10::Stream::UNSAFE, x.device(), reinterpret_cast<c10::StreamId>(stream));
  const c10::Stream before = cuda.exchangeStream(there);
  x.mul_(2);
  cuda.exchangeStream(before);
}

/// Two ranks with the same rows have the gradients of one, and twice the sums of diagnostics.
void expect_those_of_one_rank(Device device) {
  const FusedCase& c = kFusedCases[0];
  std::vector<at::Tensor> found[2];
  std::vector<std::pair<int64_t, void*>> messages;
  for (int k = 0; k < 2; ++k) {
    Setting s(c, device);
    SumOverRanks sum;
    if (k == 1)
      sum.add = [&](const at::Tensor& x, void* stream) {
        messages.emplace_back(x.numel(), stream);
        add_the_same(x, stream);
      };
    FusedUpdate fused(s.actor, s.critic, c.n, s.parallel_for, sum);
    Steps steps(s);
    at::NoGradGuard no_grad;
    fused.begin_epoch(s.obs, s.alive, s.states, 1, s.advantage);
    fused.compute_gradients(0,
                            {.old_log_prob = s.log_prob.const_data_ptr<float>(),
                             .advantage = s.advantage.const_data_ptr<float>(),
                             .action = s.action.const_data_ptr<int32_t>(),
                             .clip_coef = kClip,
                             .entropy_coef = kEntropyCoef},
                            {.old_value = s.old_value.const_data_ptr<float>(),
                             .returns = s.returns.const_data_ptr<float>(),
                             .value_mean = s.mean.const_data_ptr<float>(),
                             .value_std = s.std.const_data_ptr<float>(),
                             .value_coef = kValueCoef});
    fused.add_up(steps.of(s, 0));
    fused.end_epoch();
    found[k] = {s.actor.parameters().gradient().cpu(), s.critic.parameters().gradient().cpu(), fused.sums().cpu()};
  }
  for (size_t x = 0; x < 2; ++x) {
    const double most = found[0][x].abs().max().item<double>();
    EXPECT_GT(most, 0);
    EXPECT_LT((found[1][x] - found[0][x]).abs().max().item<double>(), 1e-5 * most) << x;
  }
  EXPECT_TRUE(at::allclose(found[1][2], 2 * found[0][2], 1e-5));
  // One for the moments of the epoch, one for both gradients with their sums.
  ASSERT_EQ(messages.size(), 2u);
  EXPECT_EQ(messages[1].first, found[0][0].numel() + found[0][1].numel() + 2 * kFusedSums);
  EXPECT_EQ(messages[1].second != nullptr, device.is_cuda());
}

TEST(LearnFusedUpdateRanks, HaveTheGradientsOfOne) { expect_those_of_one_rank(kCpu); }
TEST(LearnFusedUpdateRanksGpu, HaveTheGradientsOfOne) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  if (!fused_gradients_run(0)) GTEST_SKIP() << "a GPU without room for the fused kernels";
  expect_those_of_one_rank(kOneGpu);
}

// The fused policy takes the actions that its probabilities say, and the update finds the same probabilities.
TEST_P(LearnFusedUpdateGpu, ThePolicyAndTheUpdateAgree) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  if (!fused_gradients_run(0)) GTEST_SKIP() << "this GPU has too little shared memory";
  const FusedCase& c = GetParam();
  at::NoGradGuard no_grad;
  Setting s(c, kOneGpu);
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
  policy.obs_stride = Setting::kRow;
  policy.discrete = {nullptr, draws, action.data_ptr<int32_t>(), log_prob.data_ptr<float>()};
  policy.continuous.draws = draws;
  policy.continuous.pre_tanh_action = u.data_ptr<float>();
  policy.continuous.action = squashed.data_ptr<float>();
  policy.continuous.log_prob = log_prob.data_ptr<float>();
  launch_fused_policy(policy, 0, s.parallel_for.stream());

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
  Steps steps(s);
  fused.begin_epoch(s.obs, s.alive, states, 1, s.advantage);
  fused.compute_gradients(0,
                          {.old_log_prob = log_prob.const_data_ptr<float>(),
                           .advantage = s.advantage.const_data_ptr<float>(),
                           .action = discrete ? action.const_data_ptr<int32_t>() : nullptr,
                           .pre_tanh_action = u.const_data_ptr<float>(),
                           .clip_coef = kClip},
                          {.old_value = s.old_value.const_data_ptr<float>(),
                           .returns = s.returns.const_data_ptr<float>(),
                           .value_mean = s.mean.const_data_ptr<float>(),
                           .value_std = s.std.const_data_ptr<float>()});
  fused.add_up(steps.of(s, 0));
  fused.end_epoch();
  const at::Tensor sums = fused.sums()[0].cpu();
  EXPECT_LT(sums[kLossRatioError].item<double>() / sums[kLossCount].item<double>(), 1e-5);
}

INSTANTIATE_TEST_SUITE_P(All, LearnFusedUpdate, testing::ValuesIn(kFusedCases),
                         [](const auto& p) { return std::string(p.param.name); });
INSTANTIATE_TEST_SUITE_P(All, LearnFusedUpdateGpu, testing::ValuesIn(kFusedCases),
                         [](const auto& p) { return std::string(p.param.name); });

}  // namespace
}  // namespace giga::test
