// I(observation; action), by hand.
#include "policy/mutual_information.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tensors.hpp"

namespace giga::test {
namespace {

/// Of which nothing but the kind of its actions and their deviation, exp(-0.5), is asked.
struct Heads final : Policy {
  explicit Heads(ActionKind kind) : kind_(kind) {}
  at::Tensor forward(const at::Tensor& obs, NetworkState&) const override { return obs; }
  ActionKind actions() const override { return kind_; }
  at::Tensor log_std() const override { return at::full({kActionSize}, -0.5); }
  ActionKind kind_;
};
const Heads kDiscrete(ActionKind::discrete), kContinuous(ActionKind::continuous);

double nats(const Heads& policy, const at::Tensor& head, const std::vector<float>& weight, bool greedy = false) {
  return mutual_information(information_sums(policy, head, numbers(weight), greedy)).item<double>();
}

TEST(PolicyMutualInformation, CategoricalByHand) {
  // Rows that are certain of action 0, 0, 5, 5: the mean policy has entropy log 2, each alone none.
  at::Tensor logits = at::zeros({4, kLogitStride});
  logits[0][0] = logits[1][0] = logits[2][5] = logits[3][5] = 200;
  logits.select(1, 27).fill_(500);  // not an action
  EXPECT_NEAR(nats(kDiscrete, logits, {1, 1, 1, 1}), std::log(2.0), 1e-5);
  EXPECT_NEAR(mutual_information(kDiscrete, logits, at::ones({4})).item<double>(), std::log(2.0), 1e-5);
  EXPECT_NEAR(nats(kDiscrete, logits, {1, 1, 0, 0}), 0, 1e-5);  // the dead do not count
  // Weights 1 : 2: H(1/3) = -(log(1/3) / 3 + 2 log(2/3) / 3) = 0.6365142.
  EXPECT_NEAR(nats(kDiscrete, logits, {1, 0, 1, 1}), 0.6365142, 1e-5);
  EXPECT_NEAR(nats(kDiscrete, at::zeros({4, kLogitStride}), {1, 1, 1, 1}), 0, 1e-5);  // uniform, the same everywhere
  EXPECT_EQ(nats(kDiscrete, logits, {0, 0, 0, 0}), 0);
}

TEST(PolicyMutualInformation, GaussianInNineBins) {
  // Means far out on both sides with deviation exp(-0.5): the outer bins hold all, so log 2 for the first dimension.
  at::Tensor mean = at::zeros({2, 3});
  EXPECT_NEAR(nats(kContinuous, mean, {1, 1}), 0, 1e-5);
  mean[0][0] = 20;
  mean[1][0] = -20;
  EXPECT_NEAR(nats(kContinuous, mean, {1, 1}), std::log(2.0), 1e-4);
}

// Who always takes the likeliest action is certain of it, however little likelier it is.
TEST(PolicyMutualInformation, OfGreedyActions) {
  at::Tensor logits = at::zeros({4, kLogitStride});
  logits[0][0] = logits[1][0] = logits[2][5] = logits[3][5] = 0.01;
  logits.select(1, 27).fill_(500);
  EXPECT_NEAR(nats(kDiscrete, logits, {1, 1, 1, 1}), 0, 1e-4);
  EXPECT_NEAR(nats(kDiscrete, logits, {1, 1, 1, 1}, true), std::log(2.0), 1e-5);
  // tanh(0.1) = 0.0997 lies in the middle bin (-1/9, 1/9), tanh(0.2) = 0.197 and tanh(-0.2) in its neighbours.
  at::Tensor mean = at::zeros({2, 3});
  mean[0][1] = 0.1;
  EXPECT_NEAR(nats(kContinuous, mean, {1, 1}, true), 0, 1e-6);
  mean[0][1] = 0.2;
  mean[1][1] = -0.2;
  EXPECT_NEAR(nats(kContinuous, mean, {1, 1}, true), std::log(2.0), 1e-6);
}

// Sums of parts are those of the whole: 3 : 1 gives -(3/4 log 3/4 + 1/4 log 1/4) = 0.5623351.
TEST(PolicyMutualInformation, OfRowsInParts) {
  at::Tensor logits = at::zeros({4, kLogitStride});
  logits[0][0] = logits[1][0] = logits[2][0] = logits[3][5] = 200;
  const auto part = [&](int64_t first) {
    return information_sums(kDiscrete, logits.narrow(0, first, 2), at::ones({2}));
  };
  const InformationSums a = part(0), b = part(2);
  EXPECT_NEAR(mutual_information({a.rows + b.rows, a.policy + b.policy, a.entropies + b.entropies}).item<double>(),
              0.5623351, 1e-5);
}

}  // namespace
}  // namespace giga::test
