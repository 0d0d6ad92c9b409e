// Networks with memory: a step, a reset, a sequence and its gradient against a loop written out by hand.
#include <gtest/gtest.h>
#include <torch/autograd.h>

#include "core/error.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "support/leaky_sum.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

constexpr int64_t kLeakySteps = 4, kLeakyRows = 3, kLeakyInputs = 6;

Actor make_leaky(ActionKind actions = ActionKind::continuous) {
  ActorConfig config;
  config.output_gain = 1;
  return Actor(config, kLeakyInputs, actions, false, Precision::fp32, at::kCPU, 1, make_leaky_sum);
}

/// Heads [kLeakySteps kLeakyRows, 3] of parameters weight, leak, output weight and bias, in the order of the actor's.
at::Tensor unrolled(const std::vector<at::Tensor>& p, const at::Tensor& obs, const at::Tensor& begins, at::Tensor h) {
  std::vector<at::Tensor> heads;
  for (int64_t t = 0; t < kLeakySteps; ++t) {
    const at::Tensor kept = begins[t].logical_not().to(at::kFloat).unsqueeze(1);
    h = p[1] * (h * kept) + at::mm(obs[t], p[0].t());
    heads.push_back(at::mm(h, p[2].t()) + p[3]);
  }
  return at::cat(heads);
}

TEST(PolicyMemory, ASequenceIsTheUnrolledLoop) {
  const Actor actor = make_leaky();
  ASSERT_EQ(actor.state_size(), LeakySum::kFeatures);
  const at::Tensor obs = random({kLeakySteps, kLeakyRows, kLeakyInputs}, 2),
                   c = random({kLeakySteps * kLeakyRows, kActionSize}, 3);
  const at::Tensor start = random({kLeakyRows, LeakySum::kFeatures}, 4);
  at::Tensor begins = at::zeros({kLeakySteps, kLeakyRows}, at::kBool);
  begins[2][1] = begins[0][2] = begins[3][2] = true;

  std::vector<at::Tensor> p;
  for (int k = 0; k < 4; ++k) p.push_back(actor.parameters()[k].detach().clone().requires_grad_(true));
  const at::Tensor heads = actor.forward_sequence(obs, begins, {start}), expected = unrolled(p, obs, begins, start);
  EXPECT_LT(worst(heads, expected), 1e-6);
  (heads * c).sum().backward();
  (expected * c).sum().backward();
  for (int k = 0; k < 4; ++k) {
    EXPECT_LT(worst(actor.parameters()[k].grad(), p[static_cast<size_t>(k)].grad()), 1e-5) << "parameter " << k;
    EXPECT_GT(largest(actor.parameters()[k].grad()), 0.1) << "parameter " << k;
  }
  // The start and the resets matter.
  EXPECT_GT(worst(heads, actor.forward_sequence(obs, begins, {})), 0.1);
  EXPECT_GT(worst(heads, actor.forward_sequence(obs, at::zeros_like(begins), {start})), 0.1);
}

TEST(PolicyMemory, StepByStepIsTheSequence) {
  at::NoGradGuard no_grad;
  const Actor actor = make_leaky();
  const at::Tensor obs = random({kLeakySteps, kLeakyRows, kLeakyInputs}, 2);
  at::Tensor begins = at::zeros({kLeakySteps, kLeakyRows}, at::kBool);
  begins[2][1] = true;
  const at::Tensor heads = actor.forward_sequence(obs, begins, {}).view({kLeakySteps, kLeakyRows, kActionSize});
  NetworkState state;  // undefined: an episode begins everywhere
  for (int64_t t = 0; t < kLeakySteps; ++t) {
    state.reset(begins[t]);
    EXPECT_TRUE(same(actor.forward(obs[t], state), heads[t])) << "step " << t;
    ASSERT_EQ(state.rows.sizes(), at::IntArrayRef({kLeakyRows, LeakySum::kFeatures}));
  }
  EXPECT_TRUE(same(actor.forward(obs[0]), heads[0]));
}

TEST(PolicyMemory, EachMemberOfAPopulationRemembers) {
  at::NoGradGuard no_grad;
  Actor actor = make_leaky();
  const at::Tensor members = actor.parameters().values().detach() + 0.3 * random({2, actor.parameters().size()}, 5);
  const at::Tensor obs = random({kLeakySteps, 2, kLeakyRows, kLeakyInputs}, 6);
  NetworkState state, own[2];
  for (int64_t t = 0; t < kLeakySteps; ++t) {
    const at::Tensor heads = actor.forward_members(members, obs[t], state);
    for (int64_t m = 0; m < 2; ++m) {
      actor.parameters().values().copy_(members[m]);
      EXPECT_LT(worst(heads[m], actor.forward(obs[t][m], own[m])), 1e-5) << "member " << m << ", step " << t;
    }
  }
}

TEST(PolicyMemory, AnMlpHasNone) {
  ActorConfig config;
  const Actor actor(config, kLeakyInputs, ActionKind::discrete, false, Precision::fp32, at::kCPU, 1);
  EXPECT_EQ(actor.state_size(), 0);
  const at::Tensor obs = random({kLeakySteps, kLeakyRows, kLeakyInputs}, 2);
  NetworkState state;
  EXPECT_TRUE(same(actor.forward(obs[0], state), actor.forward(obs[0])));
  EXPECT_FALSE(state.rows.defined());
  EXPECT_TRUE(same(actor.forward_sequence(obs, {}, {}), actor.forward(obs.flatten(0, 1))));
}

// Only chains of dense layers have a layout for the fused kernel.
TEST(PolicyMemory, TheFusedKernelHasNoRoomForIt) {
  EXPECT_TRUE(make_leaky().network().encoder().layers().empty());
  ActorConfig config;
  const Actor half(config, kLeakyInputs, ActionKind::discrete, false, Precision::fp16, at::kCPU, 1, make_leaky_sum);
  EXPECT_FALSE(half.small_mlp());
}

// Where nobody would keep or train what a network remembers, it is refused rather than forgotten.
TEST(PolicyMemory, IsRefusedWhereItIsNotServed) {
  const auto expect_refused = [](auto&& make, const std::string& reason) {
    try {
      make();
      FAIL() << "not refused: " << reason;
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(reason), std::string::npos) << e.what();
    }
  };
  for (const CriticKind kind : {CriticKind::composed, CriticKind::state, CriticKind::independent}) {
    CriticConfig config;
    config.kind = kind;
    const CriticShape shape{0, {2, 2}, kLeakyInputs, 3, make_leaky_sum};
    expect_refused([&] { Critic(config, shape, Precision::fp32, cpu_loop(), at::kCPU, 1); },
                   "critics are trained on single steps: encoder mlp has a memory");
  }
  const Actor actor = make_leaky();
  const at::Tensor members = actor.parameters().values().detach().repeat({2, 1});
  expect_refused(
      [&] {
        actor.forward_members(members, random({2, kLeakyRows, kLeakyInputs}, 6));
      },
      "nobody keeps what these networks remember");
}

}  // namespace
}  // namespace giga::test
