// Critics: whom a value depends on, by gradients and by changing inputs, and that the order of agents does not matter.
#include "policy/critic.hpp"

#include <gtest/gtest.h>
#include <torch/autograd.h>

#include "cuda/runtime.hpp"
#include "sim/state_observation.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

constexpr int64_t kCriticObs = 10, kWorld = 7;

CriticConfig config_of(CriticKind kind) {
  CriticConfig config;
  config.kind = kind;
  config.hidden = {16, 12};
  return config;
}
CriticShape shape_of(int team) { return {team, {3, 2}, kCriticObs, kWorld}; }
Critic make(CriticKind kind, int team = 0, uint64_t seed = 1) {
  return Critic(config_of(kind), shape_of(team), Precision::fp32, cpu_loop(), at::kCPU, seed);
}

/// [3, n]: all alive; agent 1 dead; only the last one alive.
at::Tensor some_alive(int64_t n) {
  at::Tensor alive = at::ones({3, n});
  alive[1][1] = 0;
  alive[2].slice(0, 0, n - 1).zero_();
  return alive;
}

TEST(PolicyCritic, ComposedGradientReachesEveryLivingAgentOfItsStateAndNobodyElse) {
  const Critic critic = make(CriticKind::composed);
  const at::Tensor alive = some_alive(3);
  for (int64_t state = 0; state < 3; ++state)
    for (int64_t i = 0; i < 3; ++i) {
      at::Tensor obs = random({3, 3, kCriticObs}, 5).requires_grad_(true);
      critic.forward(obs, alive, at::Tensor())[state][i].backward();
      for (int64_t s = 0; s < 3; ++s)
        for (int64_t j = 0; j < 3; ++j) {
          const double size = largest(obs.grad()[s][j]);
          const bool counts = s == state && (j == i || alive[s][j].item<float>() > 0);
          if (counts)
            EXPECT_GT(size, 1e-4) << "value of agent " << i << " of state " << state << " by agent " << j;
          else
            EXPECT_EQ(size, 0) << "value of agent " << i << " of state " << state << " by agent " << j << " of " << s;
        }
    }
}

// The mean features of one agent are its own: what a team of two that sees the same twice computes with the weights W
// and T of a layer, an agent alone computes with W + T.
TEST(PolicyCritic, AnAgentAloneReadsItsFeaturesOnce) {
  CriticShape alone = shape_of(0), two = shape_of(0);
  alone.n_team[0] = 1;
  two.n_team[0] = 2;
  const auto make_of = [](const CriticShape& shape, CriticKind kind) {
    return Critic(config_of(kind), shape, Precision::fp32, cpu_loop(), at::kCPU, 3);
  };
  Critic composed = make_of(alone, CriticKind::composed);
  const at::Tensor obs = random({4, 1, kCriticObs}, 5);
  EXPECT_TRUE(at::equal(composed.forward(obs, at::ones({4, 1}), {}),
                        make_of(alone, CriticKind::independent).forward(obs, at::ones({4, 1}), {})));
  const Critic former = make_of(two, CriticKind::composed);  // such weights a team of one had
  NamedArrays saved;
  former.parameters().save("critic/", saved);
  composed.load("critic/", saved);
  const at::Tensor expected = former.forward(obs.expand({4, 2, kCriticObs}), at::ones({4, 2}), {}).narrow(1, 0, 1);
  EXPECT_LT(largest(composed.forward(obs, at::ones({4, 1}), {}) - expected), 1e-6);
  EXPECT_GT(largest(expected), 0.01);
}

// Behind a shared encoder the mean features of the team go into each layer, the first one too.
TEST(PolicyCritic, OnSharedFeaturesTheTeamIsReadInEachLayer) {
  CriticConfig config = config_of(CriticKind::composed);
  config.shared_encoder = true;
  CriticShape shape = shape_of(0);
  shape.features = 9;
  const Critic critic(config, shape, Precision::fp32, cpu_loop(), at::kCPU, 1);
  EXPECT_TRUE(critic.shares_encoder());
  EXPECT_FALSE(critic.fused_mlp().has_value());
  NamedArrays arrays;
  critic.parameters().save("", arrays);
  int n_team_weights = 0;
  for (const NamedArray& a : arrays) n_team_weights += a.name.ends_with("team_weight");
  EXPECT_EQ(n_team_weights, 3);
  EXPECT_EQ(find_array(arrays, "team_mlp/0/team_weight").shape, (std::vector<int64_t>{16, 9}));
  // Agent 1 of state 1 is dead: nobody's value but its own follows from its features.
  const at::Tensor alive = some_alive(3), features = random({3, 3, 9}, 5);
  const at::Tensor before = critic.forward(features, alive, at::Tensor());
  at::Tensor changed = features.clone();
  changed[1][1].add_(1);
  changed[0][1].add_(1);
  const at::Tensor after = critic.forward(changed, alive, at::Tensor());
  EXPECT_GT((after[0] - before[0]).abs().min().item<double>(), 1e-4);
  for (const int64_t i : {0, 2}) EXPECT_TRUE(same(after[1][i], before[1][i])) << "agent " << i;
  EXPECT_FALSE(same(after[1][1], before[1][1]));
  EXPECT_TRUE(same(after[2], before[2]));
}

TEST(PolicyCritic, TheDeadDoNotInfluenceTheOthers) {
  const Critic critic = make(CriticKind::composed);
  const at::Tensor alive = some_alive(3), obs = random({3, 3, kCriticObs}, 5);
  const at::Tensor before = critic.forward(obs, alive, at::Tensor());
  at::Tensor changed = obs.clone();
  changed[1][1].add_(5);  // the dead agent of state 1
  const at::Tensor after = critic.forward(changed, alive, at::Tensor());
  for (const int64_t i : {0, 2}) EXPECT_TRUE(same(after[1][i], before[1][i])) << "agent " << i;
  EXPECT_FALSE(same(after[1][1], before[1][1]));
  EXPECT_TRUE(same(after[0], before[0]));
  changed[1][0].add_(5);  // a living one does
  EXPECT_FALSE(same(critic.forward(changed, alive, at::Tensor())[1][2], before[1][2]));
}

TEST(PolicyCritic, TeamsHoldSeparateParameters) {
  // Learning from team 0's values leaves team 1's critic without gradient, and team 0's with one in every parameter.
  const Critic own = make(CriticKind::composed, 0, 1), other = make(CriticKind::composed, 1, 2);
  const at::Tensor other_values = other.forward(random({3, 2, kCriticObs}, 6), some_alive(2), at::Tensor());
  own.forward(random({3, 3, kCriticObs}, 5), some_alive(3), at::Tensor()).square().sum().backward();
  EXPECT_EQ(largest(other.parameters().gradient()), 0);
  EXPECT_NE(own.parameters().values().data_ptr(), other.parameters().values().data_ptr());
  NamedArrays arrays;
  own.parameters().save("", arrays);
  int n_team_weights = 0;
  for (int k = 0; k < static_cast<int>(arrays.size()); ++k) {
    EXPECT_GT(largest(own.parameters()[k].grad()), 1e-6) << arrays[static_cast<size_t>(k)].name;
    n_team_weights += arrays[static_cast<size_t>(k)].name.find("team_weight") != std::string::npos;
  }
  EXPECT_EQ(n_team_weights, 2);  // every layer but the first
  // and the other way round
  own.parameters().gradient().zero_();
  other_values.sum().backward();
  EXPECT_GT(largest(other.parameters().gradient()), 1e-3);
  EXPECT_EQ(largest(own.parameters().gradient()), 0);
}

TEST(PolicyCritic, IndependentValuesAreOfOneAgentEach) {
  const Critic critic = make(CriticKind::independent);
  const at::Tensor alive = at::ones({2, 3}), obs = random({2, 3, kCriticObs}, 5);
  const at::Tensor before = critic.forward(obs, alive, at::Tensor());
  at::Tensor changed = obs.clone();
  changed[1][2].add_(1);
  const at::Tensor differs = critic.forward(changed, alive, at::Tensor()).ne(before);
  EXPECT_EQ(differs.sum().item<int64_t>(), 1);
  EXPECT_TRUE(differs[1][2].item<bool>());
}

TEST(PolicyCritic, ComposedFollowsThePermutationOfItsAgents) {
  const Critic critic = make(CriticKind::composed);
  const at::Tensor alive = some_alive(3), obs = random({3, 3, kCriticObs}, 5);
  const at::Tensor order = torch::tensor({2, 0, 1}, at::kLong);
  const at::Tensor permuted = critic.forward(obs.index_select(1, order), alive.index_select(1, order), at::Tensor());
  const at::Tensor expected = critic.forward(obs, alive, at::Tensor()).index_select(1, order);
  EXPECT_LT(worst(permuted, expected), 1e-6);
  EXPECT_GT(worst(expected[0][0], expected[0][1]), 1e-3);
}

/// States of 3 v 2 agents as the simulator writes them: entities, then the world; agent 1 of state 1 is dead.
at::Tensor some_states() {
  at::Tensor state = random({3, 5 * kEntityFeatures + kWorld}, 8);
  at::Tensor entities = state.slice(1, 0, 5 * kEntityFeatures).view({3, 5, kEntityFeatures});
  entities.select(2, 0).fill_(1);
  entities[1][1].zero_();
  return state;
}
at::Tensor permuted_agents(const at::Tensor& state, const std::vector<int64_t>& order) {
  at::Tensor out = state.clone();
  const at::Tensor entities = state.slice(1, 0, 5 * kEntityFeatures).view({3, 5, kEntityFeatures});
  const at::Tensor index = torch::tensor(order, at::kLong);
  out.slice(1, 0, 5 * kEntityFeatures).copy_(entities.index_select(1, index).reshape({3, 5 * kEntityFeatures}));
  return out;
}

TEST(PolicyCritic, StateFollowsOwnOrderAndIgnoresThatOfOpponents) {
  const at::Tensor none, state = some_states();
  const Critic first = make(CriticKind::state, 0), second = make(CriticKind::state, 1);
  const at::Tensor values0 = first.forward(none, none, state), values1 = second.forward(none, none, state);
  ASSERT_EQ(values0.sizes(), at::IntArrayRef({3, 3}));
  ASSERT_EQ(values1.sizes(), at::IntArrayRef({3, 2}));
  EXPECT_GT(worst(values0[0][0], values0[0][1]), 1e-3);
  EXPECT_GT(worst(values1[0][0], values1[0][1]), 1e-3);
  // Team 0 turned round: 0 1 2 -> 2 0 1.
  const at::Tensor turned = permuted_agents(state, {2, 0, 1, 3, 4});
  EXPECT_LT(worst(first.forward(none, none, turned), values0.index_select(1, torch::tensor({2, 0, 1}))), 1e-6);
  EXPECT_LT(worst(second.forward(none, none, turned), values1), 1e-6);
  // Team 1 swapped.
  const at::Tensor swapped = permuted_agents(state, {0, 1, 2, 4, 3});
  EXPECT_LT(worst(first.forward(none, none, swapped), values0), 1e-6);
  EXPECT_LT(worst(second.forward(none, none, swapped), values1.flip(1)), 1e-6);
  // An agent that changes sides does matter.
  EXPECT_GT(
      worst(first.forward(none, none, permuted_agents(state, {0, 1, 3, 2, 4})).select(1, 0), values0.select(1, 0)),
      1e-3);
}

TEST(PolicyCritic, StateSeesEveryLivingAgentAndTheWorld) {
  for (const int team : {0, 1}) {
    const Critic critic = make(CriticKind::state, team);
    at::Tensor state = some_states().requires_grad_(true);
    critic.forward(at::Tensor(), at::Tensor(), state)[1][team == 0 ? 2 : 0].backward();
    const at::Tensor entities = state.grad().slice(1, 0, 5 * kEntityFeatures).view({3, 5, kEntityFeatures});
    for (int64_t i = 0; i < 5; ++i) {
      if (i == 1)
        EXPECT_EQ(largest(entities[1][i]), 0) << "the dead one";
      else
        EXPECT_GT(largest(entities[1][i]), 1e-4) << "agent " << i;
    }
    EXPECT_GT(largest(state.grad()[1].slice(0, 5 * kEntityFeatures)), 1e-4);
    EXPECT_EQ(largest(state.grad()[0]), 0);
  }
}

// On a GPU only: bf16 is for GPUs, and some CPUs announce an instruction set for it that their host forbids.
TEST(PolicyCriticGpu, HalfPrecisionStaysClose) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  // Same seed, same parameters; bf16 keeps 8 bits, so values of order 1 agree to a few hundredths.
  const at::Device gpu(at::kCUDA, 0);
  const ParallelFor parallel_for(Device{Device::Kind::cuda, 0});
  const at::Tensor alive = some_alive(3).to(gpu), obs = random({3, 3, kCriticObs}, 5).to(gpu),
                   state = some_states().to(gpu);
  for (const CriticKind kind : {CriticKind::composed, CriticKind::state, CriticKind::independent}) {
    const Critic full(config_of(kind), shape_of(0), Precision::fp32, parallel_for, gpu, 1);
    const Critic half(config_of(kind), shape_of(0), Precision::bf16, parallel_for, gpu, 1);
    const at::Tensor a = full.forward(obs, alive, state), b = half.forward(obs, alive, state);
    EXPECT_EQ(b.scalar_type(), at::kFloat);
    EXPECT_GT(worst(a, b), 0);
    EXPECT_LT(worst(a, b), 0.05);
    EXPECT_LT(worst(make(kind).forward(obs.cpu(), alive.cpu(), state.cpu()), a.cpu()), 1e-5) << "CPU and GPU";
    a.sum().backward();
    b.sum().backward();
    const at::Tensor d = full.parameters().gradient(), e = half.parameters().gradient();
    EXPECT_LT(((d - e).norm() / d.norm()).item<double>(), 0.03);
  }
}

}  // namespace
}  // namespace giga::test
