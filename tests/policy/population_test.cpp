// A population's networks in one batched evaluation: each member is what an actor with its parameters would be.
#include <gtest/gtest.h>

#include "cuda/runtime.hpp"
#include "policy/actor.hpp"
#include "rollout/tensors.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

constexpr int64_t kMembers = 5, kMemberRows = 7, kMemberObs = 12;

struct Kind {
  ActionKind actions;
  bool layer_norm, normalize;
  Activation activation;
};
const Kind kKinds[] = {{ActionKind::discrete, false, false, Activation::tanh},
                       {ActionKind::continuous, false, true, Activation::relu},
                       {ActionKind::discrete, true, true, Activation::gelu},
                       {ActionKind::continuous, true, false, Activation::silu}};

Actor make(const Kind& kind, Device device) {
  ActorConfig config;
  config.hidden = {16, 9};
  config.output_gain = 1;
  config.layer_norm = kind.layer_norm;
  config.activation = kind.activation;
  return Actor(config, kMemberObs, kind.actions, kind.normalize, Precision::fp32, torch_device(device), 1);
}

void expect_members_are_actors(Device device, double tolerance) {
  for (const Kind& kind : kKinds) {
    Actor actor = make(kind, device);
    const at::Device on = torch_device(device);
    if (kind.normalize) actor.normalizer().update(3 * random({20, kMemberObs}, 4).to(on) + 1, at::ones({20}).to(on));
    const at::Tensor members =
        actor.parameters().values().detach() + 0.3 * random({kMembers, actor.parameters().size()}, 2).to(on);
    const at::Tensor obs = random({kMembers, kMemberRows, kMemberObs}, 3).to(on);
    const at::Tensor heads = actor.forward_members(members, obs);
    ASSERT_EQ(heads.sizes(), (std::vector<int64_t>{kMembers, kMemberRows, actor.head_size()}));
    EXPECT_FALSE(heads.requires_grad());
    for (int64_t m = 0; m < kMembers; ++m) {
      {
        at::NoGradGuard no_grad;
        actor.parameters().values().copy_(members[m]);
      }
      EXPECT_LT(worst(heads[m].cpu(), actor.forward(obs[m]).detach().cpu()), tolerance) << "member " << m;
    }
  }
}

TEST(PolicyPopulation, EachMemberIsAnActor) { expect_members_are_actors(Device{}, 1e-5); }

TEST(PolicyPopulationGpu, EachMemberIsAnActor) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  expect_members_are_actors({Device::Kind::cuda, 0}, 1e-2);  // matrix products may be TF32
}

TEST(PolicyPopulation, MatricesAreThoseOfTheLayers) {
  const Actor actor = make(kKinds[1], Device{});
  // 12 -> 16 -> 9 -> 3, each matrix followed by its bias.
  const std::vector<MatrixPlace> places = actor.parameters().matrices();
  ASSERT_EQ(places.size(), 3u);
  const int64_t expected[3][3] = {{0, 16, 12}, {16 * 12 + 16, 9, 16}, {16 * 12 + 16 + 9 * 16 + 9, 3, 9}};
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(places[k].offset, expected[k][0]);
    EXPECT_EQ(places[k].rows, expected[k][1]);
    EXPECT_EQ(places[k].columns, expected[k][2]);
  }
}

}  // namespace
}  // namespace giga::test
