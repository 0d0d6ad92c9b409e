// Adam against a hand-written one, clipping, the skipped step; the running normaliser.
#include "policy/optimizer.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "policy/normalizer.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

ParameterSet parameters_of(const std::vector<float>& values) {
  ParameterSet p;
  p.add("x", {static_cast<int64_t>(values.size())}, {Init::Kind::constant, 0});
  p.allocate(at::kCPU, 1);
  p.values().copy_(numbers(values));
  return p;
}

/// Adam (Kingma and Ba 2015, algorithm 1) with the gradient scaled down to `max_norm`, in double precision.
struct PlainAdam {
  std::vector<double> x, m, v;
  int t = 0;
  explicit PlainAdam(const std::vector<float>& start) : x(start.begin(), start.end()), m(x.size()), v(x.size()) {}
  void step(const std::vector<float>& gradient, double rate, double max_norm, double epsilon) {
    double norm = 0;
    for (const float g : gradient) norm += static_cast<double>(g) * static_cast<double>(g);
    norm = std::sqrt(norm);
    const double scale = max_norm > 0 && norm > max_norm ? max_norm / norm : 1;
    ++t;
    for (size_t k = 0; k < x.size(); ++k) {
      const double g = scale * static_cast<double>(gradient[k]);
      m[k] = 0.9 * m[k] + 0.1 * g;
      v[k] = 0.999 * v[k] + 0.001 * g * g;
      x[k] -= rate * (m[k] / (1 - std::pow(0.9, t))) / (std::sqrt(v[k] / (1 - std::pow(0.999, t))) + epsilon);
    }
  }
};

/// Adam with the flags around it, on the CPU.
struct GatedAdam {
  explicit GatedAdam(const ParameterSet& p, double epsilon) : adam(p, epsilon) {}
  /// Returns the norm before clipping.
  float step(const ParameterSet& p, double rate, double max_norm, int minibatch = 1) {
    norm_sum = 0;
    const auto step_size = static_cast<float>(rate), number = static_cast<float>(minibatch);
    adam.step(p, parallel_for, &step_size, static_cast<float>(max_norm),
              {&stop, &faults[1], faults, 2, &number, &norm_sum});
    return norm_sum;
  }
  ParallelFor parallel_for{Device{}, 1};
  Adam adam;
  float stop = 0, faults[2] = {0, 0}, norm_sum = 0;
};

TEST(PolicyAdam, ThreeStepsEqualTheFormula) {
  const std::vector<float> start = {1, -2, 0.5f};
  const std::vector<std::vector<float>> gradients = {{3, 4, 0}, {0.1f, -0.2f, 0.3f}, {-30, 0, 40}};
  const float norms[] = {5, 0.3741657f, 50};  // sqrt(9 + 16), sqrt(0.01 + 0.04 + 0.09), sqrt(900 + 1600)
  for (const double max_norm : {0.0, 0.5}) {
    const ParameterSet p = parameters_of(start);
    GatedAdam adam(p, 1e-5);
    PlainAdam plain(start);
    for (size_t s = 0; s < 3; ++s) {
      const double rate = 0.1 / static_cast<double>(s + 1);
      p.gradient().copy_(numbers(gradients[s]));
      const float norm = adam.step(p, rate, max_norm);
      plain.step(gradients[s], rate, max_norm, 1e-5);
      EXPECT_FLOAT_EQ(norm, norms[s]) << "before clipping";
      EXPECT_EQ(largest(p.gradient()), 0) << "the gradient is cleared";
      for (size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(p.values()[static_cast<int64_t>(k)].item<double>(), plain.x[k], 2e-6)
            << "step " << s << ", number " << k << ", max_norm " << max_norm;
    }
  }
}

TEST(PolicyAdam, FirstStepByHandWithLargeEpsilon) {
  // Gradient (3, 4) clipped from norm 5 to 1: (0.6, 0.8). First step: m / (1 - 0.9) = g, v / (1 - 0.999) = g^2, so
  // x = -0.1 g / (g + 1): -0.1 x 0.6 / 1.6 = -0.0375, -0.1 x 0.8 / 1.8 = -0.0444444. Unclipped: -0.075, -0.08.
  for (const bool clips : {true, false}) {
    const ParameterSet p = parameters_of({0, 0});
    GatedAdam adam(p, 1.0);
    p.gradient().copy_(numbers({3, 4}));
    adam.step(p, 0.1, clips ? 1.0 : 0.0);
    EXPECT_NEAR(p.values()[0].item<float>(), clips ? -0.0375 : -0.075, 1e-6);
    EXPECT_NEAR(p.values()[1].item<float>(), clips ? -0.0444444 : -0.08, 1e-6);
  }
}

TEST(PolicyAdam, SkippedStepChangesNothingButClearsTheGradient) {
  const ParameterSet p = parameters_of({1, -2, 0.5f});
  GatedAdam adam(p, 1e-5);
  p.gradient().copy_(numbers({3, 4, 1}));
  adam.step(p, 0.1, 0.5);
  NamedArrays before, after;
  adam.adam.save("", before);
  const at::Tensor values = p.values().clone();
  for (float* flag : {&adam.stop, &adam.faults[0], &adam.faults[1]}) {
    *flag = 1;
    p.gradient().copy_(numbers({-1, 2, 5}));
    EXPECT_FLOAT_EQ(adam.step(p, 0.1, 0.5), 5.4772256f);  // sqrt(1 + 4 + 25)
    EXPECT_TRUE(same(p.values(), values));
    EXPECT_EQ(largest(p.gradient()), 0);
    *flag = 0;
  }
  adam.adam.save("", after);
  ASSERT_EQ(before.size(), 3u);
  for (size_t k = 0; k < before.size(); ++k) EXPECT_EQ(after[k].bytes, before[k].bytes) << before[k].name;
  EXPECT_EQ(array_values<float>(find_array(after, "steps")).at(0), 1.0f);
}

TEST(PolicyAdam, AGradientThatIsNotFiniteIsAFaultAndNothingIsLearnedAnyMore) {
  for (const float bad : {NAN, INFINITY, -INFINITY}) {
    const ParameterSet p = parameters_of({1, -2, 0.5f});
    GatedAdam adam(p, 1e-5);
    const at::Tensor values = p.values().clone();
    p.gradient().copy_(numbers({3, bad, 1}));
    adam.step(p, 0.1, 0.5, 4);
    EXPECT_EQ(adam.faults[1], 4) << "the number of the minibatch";
    EXPECT_EQ(adam.faults[0], 0) << "another's fault";
    p.gradient().copy_(numbers({3, 4, 1}));
    adam.step(p, 0.1, 0.5, 5);
    EXPECT_EQ(adam.faults[1], 4) << "the first one counts";
    p.gradient().copy_(numbers({3, bad, 1}));
    adam.step(p, 0.1, 0.5, 6);
    EXPECT_EQ(adam.faults[1], 4);
    EXPECT_TRUE(same(p.values(), values));
  }
}

TEST(PolicyAdam, LoadGoesOnBitForBit) {
  const ParameterSet p = parameters_of({1, -2, 0.5f}), q = parameters_of({0, 0, 0});
  GatedAdam adam(p, 1e-5), loaded(q, 1e-5);
  const auto step = [](GatedAdam& a, const ParameterSet& x) {
    x.gradient().copy_(numbers({0.3f, 0.1f, -0.7f}));
    a.step(x, 0.01, 0.5);
  };
  step(adam, p);
  step(adam, p);
  NamedArrays arrays;
  adam.adam.save("adam/", arrays);
  loaded.adam.load("adam/", arrays);
  q.values().copy_(p.values());
  step(adam, p);
  step(loaded, q);
  EXPECT_TRUE(same(p.values(), q.values()));
}

TEST(PolicyRunningNorm, MomentsWithBiasCorrection) {
  RunningNorm norm(1, 0.9, at::kCPU);
  EXPECT_EQ(norm.mean().item<float>(), 0.0f);
  EXPECT_EQ(norm.std().item<float>(), 1.0f);
  // Rows 1 and 3 count, 100 does not: mean 2, mean square 5, deviation sqrt(5 - 4) = 1. The first update's weight 0.1
  // is corrected away.
  norm.update(numbers({1, 3, 100}).view({3, 1}), numbers({1, 1, 0}));
  EXPECT_NEAR(norm.mean().item<float>(), 2, 1e-6);
  EXPECT_NEAR(norm.std().item<float>(), 1, 1e-5);
  // Then 6 and 6: mean (0.9 x 0.1 x 2 + 0.1 x 6) / 0.19 = 0.78 / 0.19 = 4.1052632; mean square
  // (0.9 x 0.1 x 5 + 0.1 x 36) / 0.19 = 21.3157895; deviation sqrt(21.3157895 - 16.8531856) = 2.1124876.
  norm.update(numbers({6, 6}).view({2, 1}), numbers({1, 1}));
  EXPECT_NEAR(norm.mean().item<float>(), 4.1052632, 1e-5);
  EXPECT_NEAR(norm.std().item<float>(), 2.1124876, 1e-5);
  // (10 - 4.1052632) / 2.1124876 = 2.7904243; and the limits +-10.
  EXPECT_LT(worst(norm.apply(numbers({10, 1e6f, -1e6f}).view({3, 1})), numbers({2.7904243f, 10, -10}).view({3, 1})),
            1e-5);
}

// Returns have the scale of rewards, which may be small or far from 0.
TEST(PolicyRunningNorm, ValuesOfAnyScale) {
  const auto values = [] { return RunningNorm(1, 0.9, at::kCPU, kValueDeviation); };
  EXPECT_EQ(values().std().item<float>(), 0.0f) << "a critic that has seen no rewards knows nothing";
  const auto after = [&](std::vector<float> returns) {
    RunningNorm norm = values();
    norm.update(numbers(returns).view({-1, 1}), at::ones({static_cast<int64_t>(returns.size())}));
    return norm.std().item<float>();
  };
  EXPECT_NEAR(after({1, 3}), 1, 1e-5);
  EXPECT_NEAR(after({1e-6f, 3e-6f}) * 1e6f, 1, 1e-4);
  EXPECT_NEAR(after({1000, 1000}), 1, 1e-5) << "alike: a thousandth of the mean";
  EXPECT_NEAR(after({0, 0}) * 1e10f, 1, 1e-5) << "no rewards yet: small, and not 0, by which targets are divided";
}

TEST(PolicyRunningNorm, NobodyLivingChangesNothing) {
  RunningNorm norm(2, 0.9, at::kCPU);
  norm.update(numbers({5, 6, 7, 8}).view({2, 2}), at::zeros({2}));
  EXPECT_TRUE(same(norm.mean(), at::zeros({2})));
  EXPECT_TRUE(same(norm.std(), at::ones({2})));
  norm.update(numbers({5, 6, 7, 8}).view({2, 2}), at::ones({2}));
  NamedArrays before, after;
  norm.save("", before);
  norm.update(numbers({50, 60, 70, 80}).view({2, 2}), at::zeros({2}));
  norm.save("", after);
  ASSERT_EQ(before.size(), after.size());
  for (size_t k = 0; k < before.size(); ++k) EXPECT_EQ(after[k].bytes, before[k].bytes) << before[k].name;
}

TEST(PolicyRunningNorm, FeaturesApartAndConstantOnesBounded) {
  // Feature 0 is constant: its deviation is held at 0.01. Feature 1: -1 and 1.
  RunningNorm norm(2, 0.5, at::kCPU);
  norm.update(numbers({3, -1, 3, 1}).view({2, 2}), at::ones({2}));
  EXPECT_LT(worst(norm.mean(), numbers({3, 0})), 1e-6);
  EXPECT_LT(worst(norm.std(), numbers({0.01f, 1})), 1e-6);
  RunningNorm loaded(2, 0.5, at::kCPU);
  NamedArrays arrays;
  norm.save("n/", arrays);
  loaded.load("n/", arrays);
  for (RunningNorm* n : {&norm, &loaded}) n->update(numbers({0, 5, 1, 9}).view({2, 2}), at::ones({2}));
  EXPECT_TRUE(same(norm.mean(), loaded.mean()));
  EXPECT_TRUE(same(norm.std(), loaded.std()));
}

}  // namespace
}  // namespace giga::test
