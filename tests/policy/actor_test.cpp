// Actors: execution sees the agent's own observation alone; both kinds of heads.
#include "policy/actor.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tensors.hpp"

namespace giga::test {
namespace {

constexpr int64_t kObs = 12;

Actor make(ActionKind actions, bool normalize = false, uint64_t seed = 1, float output_gain = 1) {
  ActorConfig config;
  config.hidden = {16, 16};
  config.output_gain = output_gain;
  return Actor(config, kObs, actions, normalize, Precision::fp32, at::kCPU, seed);
}

TEST(PolicyActor, SeesItsOwnObservationOnly) {
  for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous}) {
    const Actor actor = make(actions);
    const at::Tensor obs = random({9, kObs}, 2);
    const at::Tensor before = actor.forward(obs);
    ASSERT_EQ(before.size(1), actions == ActionKind::discrete ? kLogitStride : kActionSize);
    at::Tensor changed = obs.clone();
    changed[4].add_(1);
    const at::Tensor after = actor.forward(changed);
    for (int64_t row = 0; row < 9; ++row) EXPECT_EQ(same(after[row], before[row]), row != 4) << "row " << row;
  }
}

TEST(PolicyActor, ReadsTheColumnsThatItIsGiven) {
  ActorConfig config;
  config.hidden = {16, 16};
  config.output_gain = 1;
  const auto make_part = [&](const InputColumns& inputs, bool normalize) {
    return Actor(config, inputs, ActionKind::discrete, normalize, Precision::fp32, at::kCPU, 1);
  };
  const at::Tensor obs = random({9, kObs}, 2), part = obs.narrow(1, 4, 6);
  const Actor actor = make_part({kObs, 4, 6}, false), plain = make_part(6, false);
  EXPECT_EQ(actor.parameters().size(), plain.parameters().size());
  EXPECT_TRUE(same(actor.forward(obs), plain.forward(part)));
  const at::Tensor members = actor.parameters().values().detach().unsqueeze(0).repeat({3, 1});
  EXPECT_TRUE(same(actor.forward_members(members, obs.view({3, 3, kObs})),
                   plain.forward_members(members, part.reshape({3, 3, 6}))));
  // The normaliser keeps the moments of whole rows; each column has its own.
  Actor normalized = make_part({kObs, 4, 6}, true), expected = make_part(6, true);
  normalized.normalizer().update(obs, at::ones({9}));
  expected.normalizer().update(part, at::ones({9}));
  EXPECT_LT(largest(normalized.forward(obs) - expected.forward(part)), 1e-5);
}

TEST(PolicyActor, AnUnknownEncoderIsRefusedWithTheAllowedOnes) {
  Errors errors;
  ActorConfig config;
  read_fields(parse_yaml_text("{encoder: mpl}", "a.yaml", errors).root, config, errors);
  EXPECT_EQ(errors.text(), "a.yaml:1:11: encoder: 'mpl' is not one of: mlp, nature, impala, compact; nearest: 'mlp'");
}

TEST(PolicyActor, SmallOutputGainStartsNearlyUniform) {
  // Hidden features lie in (-1, 1)^16 and the output rows have length 0.01: |logit| <= 0.01 sqrt(16) = 0.04.
  const Actor actor = make(ActionKind::discrete, false, 1, 0.01f);
  const double top = largest(actor.forward(random({50, kObs}, 2)));
  EXPECT_LE(top, 0.04);
  EXPECT_GT(top, 1e-4);
}

TEST(PolicyActor, LogStdIsAParameterOfContinuousActorsOnly) {
  const Actor continuous = make(ActionKind::continuous), discrete = make(ActionKind::discrete);
  EXPECT_TRUE(same(continuous.log_std(), at::full({3}, -0.5)));
  const int64_t hidden = 16 * kObs + 16 + 16 * 16 + 16;
  EXPECT_EQ(continuous.parameters().size(), hidden + 3 * 16 + 3 + 3);
  EXPECT_EQ(discrete.parameters().size(), hidden + 28 * 16 + 28);
}

TEST(PolicyActor, LogStdIsHeldWithinItsBounds) {
  const Actor continuous = make(ActionKind::continuous), discrete = make(ActionKind::discrete);
  const at::Tensor all = at::full_like(continuous.parameters().values(), 7.0);
  const int64_t at = continuous.log_std_offset();
  all[at] = -9, all[at + 1] = 0.5;
  continuous.bound_log_std(all);
  EXPECT_TRUE(same(all.narrow(0, at, 3), numbers({-5, 0.5f, 1})));
  EXPECT_EQ((all == 7).sum().item<int64_t>(), all.numel() - 3) << "nothing else has moved";
  const at::Tensor others = at::full_like(discrete.parameters().values(), 7.0);
  discrete.bound_log_std(others);
  EXPECT_TRUE(same(others, at::full_like(others, 7.0)));
}

TEST(PolicyActor, NormaliserIsAppliedAndSaved) {
  Actor actor = make(ActionKind::discrete, true), plain = make(ActionKind::discrete, false);
  const at::Tensor obs = 3 * random({20, kObs}, 2) + 5;
  EXPECT_TRUE(same(actor.forward(obs.clamp(-10, 10)), plain.forward(obs.clamp(-10, 10))));  // mean 0, deviation 1
  actor.normalizer().update(obs, at::ones({20}));
  const at::Tensor expected =
      plain.forward(((obs - actor.normalizer().mean()) / actor.normalizer().std()).clamp(-10, 10));
  EXPECT_TRUE(same(actor.forward(obs), expected));
  EXPECT_FALSE(same(actor.forward(obs), plain.forward(obs)));
  NamedArrays arrays;
  actor.save("a/", arrays);
  Actor loaded = make(ActionKind::discrete, true, 2);
  EXPECT_FALSE(same(loaded.forward(obs), actor.forward(obs)));
  loaded.load("a/", arrays);
  EXPECT_TRUE(same(loaded.forward(obs), actor.forward(obs)));
}

TEST(PolicyActor, SmallHeadsAreComputedWithoutLibTorch) {
  const ParallelFor loop(Device{}, 2);
  for (const Activation activation : {Activation::tanh, Activation::relu, Activation::silu, Activation::gelu})
    for (const bool normalize : {false, true}) {
      ActorConfig config;
      config.hidden = {16, 7};
      config.activation = activation;
      config.output_gain = 1;
      const bool discrete = normalize;
      Actor actor(config, {kObs, 4, 6}, discrete ? ActionKind::discrete : ActionKind::continuous, normalize,
                  Precision::fp32, at::kCPU, 1);
      if (normalize) actor.normalizer().update(random({65, kObs}, 3) * 4, at::ones({65}));
      at::Tensor obs = random({9, kObs}, 2);
      obs[3][5] = 1000;  // beyond the limit of the normaliser
      const std::optional<at::Tensor> head = actor.small_head(obs, loop);
      ASSERT_TRUE(head);
      EXPECT_LT((*head - actor.forward(obs)).abs().max().item<float>(), normalize ? 1e-5f : 1e-2f);
    }
  ActorConfig config;
  config.hidden = {16};
  config.layer_norm = true;
  const auto small_head = [&] {
    return Actor(config, kObs, ActionKind::discrete, false, Precision::fp32, at::kCPU, 1)
        .small_head(random({9, kObs}, 2), loop);
  };
  EXPECT_FALSE(small_head());
  config.layer_norm = false;
  config.hidden = {8, 129};
  EXPECT_FALSE(small_head());
  config.hidden = {8, 128};
  EXPECT_TRUE(small_head());
}

}  // namespace
}  // namespace giga::test
