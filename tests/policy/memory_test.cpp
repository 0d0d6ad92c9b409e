// Networks with memory: a step, a reset, a sequence and its gradient against a loop written out by hand.
#include <gtest/gtest.h>
#include <torch/autograd.h>

#include <cmath>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "sim/state_observation.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

constexpr int64_t kLoopSteps = 4, kLoopRows = 3, kLoopInputs = 6, kLoopEncoded = 7, kLoopMemory = 5;
constexpr MemoryKind kBothKinds[] = {MemoryKind::gru, MemoryKind::lstm};

/// 6 inputs, a hidden layer of 7, 5 numbers remembered.
ActorConfig remembering(MemoryKind kind) {
  ActorConfig config;
  config.hidden = {kLoopEncoded};
  config.memory = kind;
  config.memory_size = kLoopMemory;
  config.output_gain = 1;
  return config;
}
Actor make_remembering(MemoryKind kind) {
  return Actor(remembering(kind), kLoopInputs, ActionKind::continuous, false, Precision::fp32, at::kCPU, 1);
}

at::Tensor episodes_that_begin() {
  at::Tensor begins = at::zeros({kLoopSteps, kLoopRows}, at::kBool);
  begins[2][1] = begins[0][2] = begins[3][2] = true;
  return begins;
}

/// Heads [kLoopSteps kLoopRows, 3] by LibTorch's own operations, one step after the other. Parameters in the order of
/// the actor's: weight and bias of the hidden layer, of the cell's inputs, of what it remembers, of the output.
at::Tensor unrolled(MemoryKind kind, const std::vector<at::Tensor>& p, const at::Tensor& obs, const at::Tensor& begins,
                    const at::Tensor& start) {
  at::Tensor h = start.narrow(1, 0, kLoopMemory), c;
  if (kind == MemoryKind::lstm) c = start.narrow(1, kLoopMemory, kLoopMemory);
  std::vector<at::Tensor> heads;
  for (int64_t t = 0; t < kLoopSteps; ++t) {
    const at::Tensor kept = begins[t].logical_not().to(at::kFloat).unsqueeze(1);
    h = h * kept;
    const at::Tensor x = at::tanh(at::linear(obs[t], p[0], p[1]));
    const std::vector<at::Tensor> in = at::linear(x, p[2], p[3]).split(kLoopMemory, 1),
                                  back = at::linear(h, p[4], p[5]).split(kLoopMemory, 1);
    const auto gate = [&](size_t k) { return at::sigmoid(in[k] + back[k]); };
    if (kind == MemoryKind::gru) {
      const at::Tensor candidate = at::tanh(in[2] + gate(0) * back[2]);
      h = (1 - gate(1)) * candidate + gate(1) * h;
    } else {
      c = gate(1) * (c * kept) + gate(0) * at::tanh(in[2] + back[2]);
      h = gate(3) * at::tanh(c);
    }
    heads.push_back(at::linear(h, p[6], p[7]));
  }
  return at::cat(heads);
}

TEST(PolicyMemory, ASequenceIsTheUnrolledLoop) {
  for (const MemoryKind kind : kBothKinds) {
    const Actor actor = make_remembering(kind);
    const int64_t size = kind == MemoryKind::lstm ? 2 * kLoopMemory : kLoopMemory;
    ASSERT_EQ(actor.state_size(), size);
    const at::Tensor obs = random({kLoopSteps, kLoopRows, kLoopInputs}, 2),
                     c = random({kLoopSteps * kLoopRows, kActionSize}, 3);
    const at::Tensor start = random({kLoopRows, size}, 4), begins = episodes_that_begin();
    {
      at::NoGradGuard no_grad;  // biases start at 0, where they could be mistaken for one another
      for (int k = 1; k < 8; k += 2) actor.parameters()[k].copy_(0.3 * random(actor.parameters()[k].sizes(), 5));
    }
    std::vector<at::Tensor> p;
    for (int k = 0; k < 8; ++k) p.push_back(actor.parameters()[k].detach().clone().requires_grad_(true));
    const Sequence sequence{.length = kLoopSteps, .begins = begins, .start = start};
    const at::Tensor heads = actor.forward_sequence(obs.flatten(0, 1), sequence),
                     expected = unrolled(kind, p, obs, begins, start);
    EXPECT_LT(worst(heads, expected), 1e-6);
    (heads * c).sum().backward();
    (expected * c).sum().backward();
    for (int k = 0; k < 8; ++k) {
      EXPECT_LT(worst(actor.parameters()[k].grad(), p[static_cast<size_t>(k)].grad()), 1e-5) << "parameter " << k;
      EXPECT_GT(largest(actor.parameters()[k].grad()), 0.05) << "parameter " << k;
    }
    // The start and the resets matter.
    const auto heads_of = [&](const Sequence& s) { return actor.forward_sequence(obs.flatten(0, 1), s); };
    EXPECT_GT(worst(heads, heads_of({.length = kLoopSteps, .begins = begins})), 0.05);
    EXPECT_GT(worst(heads, heads_of({.length = kLoopSteps, .start = start})), 0.05);
  }
}

/// A cell of one number on one input, and all its weights: `in` and `back` by gate, no biases.
NetworkState state_after(MemoryKind kind, const std::vector<float>& in, const std::vector<float>& back,
                         const std::vector<float>& inputs) {
  at::NoGradGuard no_grad;
  ParameterSet p;
  const RecurrentCell cell(p, "cell", kind, 1, 1);
  p.allocate(at::kCPU, 1);
  const auto gates = static_cast<int64_t>(in.size());
  p[0].copy_(numbers(in).view({gates, 1}));
  p[1].zero_();
  p[2].copy_(numbers(back).view({gates, 1}));
  at::Tensor states;
  const auto steps = static_cast<int64_t>(inputs.size());
  cell.forward(p, numbers(inputs).view({steps, 1}), {.length = steps, .states = &states});
  return {states[steps - 1]};
}

// Two steps with inputs 1 and -1.
TEST(PolicyMemory, TwoStepsByHand) {
  const auto sigmoid = [](double x) { return 1 / (1 + std::exp(-x)); };
  // GRU, reset = s(x), update = s(2 x + h), candidate = tanh(x / 2 + reset 3 h).
  // Step 1, h = 0: update 0.880797, candidate 0.462117: h = 0.119203 * 0.462117 = 0.055086.
  const double h1 = (1 - sigmoid(2)) * std::tanh(0.5);
  EXPECT_NEAR(h1, 0.055086, 1e-6);
  // Step 2: reset s(-1) = 0.268941, update s(-2 + 0.055086) = 0.125108, candidate tanh(-0.5 + 0.044445) = -0.426456:
  // h = 0.874892 * -0.426456 + 0.125108 * 0.055086 = -0.366212.
  const double update = sigmoid(-2 + h1);
  const double h2 = (1 - update) * std::tanh(-0.5 + sigmoid(-1) * 3 * h1) + update * h1;
  EXPECT_NEAR(h2, -0.366212, 2e-5);
  EXPECT_NEAR(state_after(MemoryKind::gru, {1, 2, 0.5f}, {0, 1, 3}, {1, -1}).rows.item<double>(), h2, 1e-6);

  // LSTM, in = s(x), forget = s(2 x), candidate = tanh(x / 2 + h), out = s(-x).
  // Step 1: c = 0.731059 * 0.462117 = 0.337835, h = 0.268941 * tanh(c) = 0.087566.
  const double c1 = sigmoid(1) * std::tanh(0.5), o1 = sigmoid(-1) * std::tanh(c1);
  EXPECT_NEAR(c1, 0.337835, 1e-6);
  // Step 2: c = s(-2) c + s(-1) tanh(-0.5 + h) = 0.040271 - 0.105331 = -0.06506, h = s(1) tanh(c).
  const double c2 = sigmoid(-2) * c1 + sigmoid(-1) * std::tanh(-0.5 + o1);
  const at::Tensor state = state_after(MemoryKind::lstm, {1, 2, 0.5f, -1}, {0, 0, 1, 0}, {1, -1}).rows;
  EXPECT_NEAR(state[0][1].item<double>(), c2, 1e-6);
  EXPECT_NEAR(state[0][0].item<double>(), sigmoid(1) * std::tanh(c2), 1e-6);
}

TEST(PolicyMemoryGpu, HeadsAndGradientsAreThoseOfTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  for (const MemoryKind kind : kBothKinds) {
    const Actor cpu = make_remembering(kind);
    const Actor gpu(remembering(kind), kLoopInputs, ActionKind::continuous, false, Precision::fp32, at::kCUDA, 1);
    const at::Tensor obs = random({kLoopSteps * kLoopRows, kLoopInputs}, 2),
                     start = random({kLoopRows, cpu.state_size()}, 4);
    const auto run = [&](const Actor& actor, at::Device device) {
      const at::Tensor heads = actor.forward_sequence(
          obs.to(device),
          {.length = kLoopSteps, .begins = episodes_that_begin().to(device), .start = start.to(device)});
      heads.square().sum().backward();
      return heads.detach().cpu();
    };
    EXPECT_LT(worst(run(cpu, at::kCPU), run(gpu, at::kCUDA)), 1e-5);
    EXPECT_LT(worst(cpu.parameters().gradient(), gpu.parameters().gradient().cpu()), 1e-4);
  }
}

TEST(PolicyMemory, StepByStepIsTheSequence) {
  at::NoGradGuard no_grad;
  for (const MemoryKind kind : kBothKinds) {
    const Actor actor = make_remembering(kind);
    const at::Tensor obs = random({kLoopSteps, kLoopRows, kLoopInputs}, 2), begins = episodes_that_begin();
    at::Tensor states;
    const at::Tensor heads =
        actor.forward_sequence(obs.flatten(0, 1), {.length = kLoopSteps, .begins = begins, .states = &states})
            .view({kLoopSteps, kLoopRows, kActionSize});
    NetworkState state;  // undefined: an episode begins everywhere
    for (int64_t t = 0; t < kLoopSteps; ++t) {
      state.reset(begins[t]);
      EXPECT_LT(worst(actor.forward(obs[t], state), heads[t]), 1e-6) << "step " << t;
      ASSERT_EQ(state.rows.sizes(), at::IntArrayRef({kLoopRows, actor.state_size()}));
      EXPECT_LT(worst(state.rows, states[t]), 1e-6) << "step " << t;
    }
    EXPECT_LT(worst(actor.forward(obs[0]), heads[0]), 1e-6);
  }
}

TEST(PolicyMemory, EachMemberOfAPopulationRemembers) {
  at::NoGradGuard no_grad;
  for (const MemoryKind kind : kBothKinds) {
    Actor actor = make_remembering(kind);
    const at::Tensor members = actor.parameters().values().detach() + 0.3 * random({2, actor.parameters().size()}, 5);
    const at::Tensor obs = random({kLoopSteps, 2, kLoopRows, kLoopInputs}, 6);
    NetworkState state, own[2];
    for (int64_t t = 0; t < kLoopSteps; ++t) {
      const at::Tensor heads = actor.forward_members(members, obs[t], state);
      for (int64_t m = 0; m < 2; ++m) {
        actor.parameters().values().copy_(members[m]);
        EXPECT_LT(worst(heads[m], actor.forward(obs[t][m], own[m])), 1e-5) << "member " << m << ", step " << t;
      }
    }
  }
}

// Every kind of critic goes through a sequence as it does through its steps, and each agent of each world is remembered
// by itself.
TEST(PolicyMemory, CriticsRemember) {
  at::NoGradGuard no_grad;
  constexpr int64_t kTwoWorlds = 2, kTwoAgents = 2;
  for (const CriticKind kind : {CriticKind::composed, CriticKind::state, CriticKind::independent}) {
    CriticConfig config;
    config.kind = kind;
    config.hidden = {8, 6};
    config.memory = MemoryKind::gru;
    config.memory_size = kLoopMemory;
    const CriticShape shape{0, {2, 2}, kLoopInputs, 3};
    const Critic critic(config, shape, Precision::fp32, cpu_loop(), at::kCPU, 1);
    ASSERT_EQ(critic.state_size(), kLoopMemory);
    const at::Tensor obs = random({kLoopSteps * kTwoWorlds, kTwoAgents, kLoopInputs}, 2),
                     alive = at::ones({kLoopSteps * kTwoWorlds, kTwoAgents});
    const at::Tensor truth = random({kLoopSteps * kTwoWorlds, 4 * kEntityFeatures + 3}, 3);
    at::Tensor begins = at::zeros({kLoopSteps, kTwoWorlds}, at::kBool);
    begins[2][1] = true;
    const at::Tensor values =
        critic.forward(obs, alive, truth, {.length = kLoopSteps, .begins = begins.repeat_interleave(kTwoAgents, 1)});
    ASSERT_EQ(values.sizes(), at::IntArrayRef({kLoopSteps * kTwoWorlds, kTwoAgents}));
    NetworkState state;
    for (int64_t t = 0; t < kLoopSteps; ++t) {
      state.reset(begins[t].repeat_interleave(kTwoAgents));
      const auto part = [&](const at::Tensor& x) { return x.narrow(0, t * kTwoWorlds, kTwoWorlds); };
      at::Tensor after;
      const at::Tensor step =
          critic.forward(part(obs), part(alive), part(truth), {.start = state.rows, .states = &after});
      state.rows = after[0];
      EXPECT_LT(worst(step, part(values)), 1e-6) << "step " << t;
    }
    // Without the reset world 1 has other values from step 2 on, world 0 the same.
    const at::Tensor other = critic.forward(obs, alive, truth, {.length = kLoopSteps});
    EXPECT_GT(worst(other[5], values[5]), 1e-3);
    EXPECT_TRUE(same(other[4], values[4]));
  }
}

TEST(PolicyMemory, AnMlpHasNone) {
  ActorConfig config;
  const Actor actor(config, kLoopInputs, ActionKind::discrete, false, Precision::fp32, at::kCPU, 1);
  EXPECT_EQ(actor.state_size(), 0);
  const at::Tensor obs = random({kLoopRows, kLoopInputs}, 2);
  NetworkState state;
  EXPECT_TRUE(same(actor.forward(obs, state), actor.forward(obs)));
  EXPECT_FALSE(state.rows.defined());
}

// The fused kernels know no memory, and half precision is theirs alone.
TEST(PolicyMemory, TheFusedKernelsHaveNoRoomForIt) {
  ActorConfig config = remembering(MemoryKind::gru);
  config.hidden = {64, 64};
  const auto actor = [&](Precision precision) {
    return Actor(config, kLoopInputs, ActionKind::discrete, false, precision, at::kCPU, 1);
  };
  EXPECT_FALSE(actor(Precision::tf32).fused_mlp());
  EXPECT_THROW(actor(Precision::fp16), Error);
  config.memory = MemoryKind::none;
  EXPECT_TRUE(actor(Precision::tf32).fused_mlp());
}

// A forget gate starts nearly open, and the weights of each gate have rows of about length 1.
TEST(PolicyMemory, HowACellStarts) {
  ParameterSet p;
  const RecurrentCell cell(p, "cell", MemoryKind::lstm, 32, 32);
  p.allocate(at::kCPU, 1);
  EXPECT_TRUE(same(p[1].view({4, 32}).sum(1), numbers({0, 32, 0, 0})));
  EXPECT_NEAR(p[2].square().sum(1).mean().item<double>(), 1, 1e-3);
}

}  // namespace
}  // namespace giga::test
