// The end of a dense layer as one function against LibTorch's operations in fp32: features, means, gradients,
// repetition; a critic in bfloat16 against the same in fp32.
#include "policy/dense_epilogue.hpp"

#include <gtest/gtest.h>
#include <torch/autograd.h>

#include <array>

#include "cuda/runtime.hpp"
#include "policy/critic.hpp"
#include "policy/layers.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

/// What goes into a layer's end, in bfloat16 with gradients, and the numbers that its outputs are weighed with.
struct Ending {
  at::Tensor sums, bias, of_team, alive;  // [S n, C], [C], [S, C], [S, n]
  at::Tensor by_features, by_mean;        // [S n, C], [S, C]

  Ending(int64_t states, int64_t n, int64_t columns, at::Device device) {
    const auto leaf = [&](const at::Tensor& x) { return x.to(at::kBFloat16).to(device).requires_grad_(); };
    sums = leaf(2 * random({states * n, columns}, 1));
    bias = leaf(random({columns}, 2));
    of_team = leaf(random({states, columns}, 3));
    alive = (random({states, n}, 4) > 0).to(at::kFloat);
    alive[0].zero_();  // a state in which none lives
    alive = alive.to(device);
    by_features = random({states * n, columns}, 5).to(device);
    by_mean = random({states, columns}, 6).to(device);
  }
  at::Tensor loss(const LayerFeatures& of) const {
    at::Tensor sum = (of.features.to(at::kFloat) * by_features).sum();
    return of.mean.defined() ? sum + (of.mean.to(at::kFloat) * by_mean).sum() : sum;
  }
  /// The gradients by sums, bias and what the team adds, in fp32 on the host.
  std::vector<at::Tensor> gradients(const LayerFeatures& of, bool team) const {
    std::vector<at::Tensor> inputs = {sums, bias};
    if (team) inputs.push_back(of_team);
    std::vector<at::Tensor> out = torch::autograd::grad({loss(of)}, inputs);
    for (at::Tensor& d : out) d = d.to(at::kFloat).cpu();
    return out;
  }
};

/// The formula, step by step in fp32.
LayerFeatures plain(const Ending& e, Activation activation, bool team) {
  const int64_t states = e.alive.size(0), n = e.alive.size(1);
  at::Tensor x = (e.sums.to(at::kFloat) + e.bias.to(at::kFloat)).view({states, n, -1});
  if (!team) return {activate(x, activation).view(e.sums.sizes()), {}};
  const at::Tensor y = activate(x + e.of_team.to(at::kFloat).unsqueeze(1), activation);
  return {y.view(e.sums.sizes()), (y * e.alive.unsqueeze(-1)).sum(1) / e.alive.sum(1, true).clamp_min(1)};
}

void expect_as_formula(at::Device device) {
  for (const Activation activation : {Activation::tanh, Activation::relu, Activation::silu, Activation::gelu})
    for (const bool team : {false, true})
      for (const auto& [states, n, columns] :
           {std::array<int64_t, 3>{37, 5, 24}, {3, 64, 8}, {211, 1, 264}, {6, 3, 520}}) {
        SCOPED_TRACE(testing::Message() << "activation " << static_cast<int>(activation)
                                        << (team ? ", a team of " : ", ") << n << ", " << states << " states, "
                                        << columns << " columns");
        const Ending e(states, n, columns, device);
        const auto ours = [&] {
          return team ? dense_epilogue(e.sums, e.bias, activation, {n, e.of_team, e.alive})
                      : dense_epilogue(e.sums, e.bias, activation);
        };
        const LayerFeatures expected = plain(e, activation, team), got = ours();
        ASSERT_EQ(got.features.sizes(), e.sums.sizes());
        ASSERT_EQ(got.mean.defined(), team);
        // Numbers up to 10 are rounded to 8 bits: by 2^-9 of each; tanh by 2^-11 more.
        const auto off = [](const at::Tensor& a, const at::Tensor& b) {
          return ((a.to(at::kFloat) - b).abs() / (1 + b.abs())).max().item<double>();
        };
        EXPECT_LT(off(got.features, expected.features), 0.004);
        if (team) {
          EXPECT_LT(off(got.mean, expected.mean), 0.004);
        }
        const std::vector<at::Tensor> d = e.gradients(got, team), d_expected = e.gradients(expected, team);
        for (size_t k = 0; k < d.size(); ++k) {
          SCOPED_TRACE(testing::Message() << "gradient " << k);
          // Rounded once each: gradients, slopes, and the output of tanh, whose slope 1 - y^2 is off by up to 2^-8.
          const double size = d_expected[k].norm().item<double>();
          EXPECT_LT((d[k] - d_expected[k]).norm().item<double>(), 0.01 * size);
          EXPECT_GT(size, 1);
        }
        const std::vector<at::Tensor> again = e.gradients(ours(), team);
        for (size_t k = 0; k < d.size(); ++k) EXPECT_TRUE(same(d[k], again[k])) << "gradient " << k;
      }
}

TEST(PolicyDenseEpilogue, AsTheFormula) { expect_as_formula(at::kCPU); }

/// Of two outputs one alone has a gradient; teams add without a mean being wanted; without gradients the numbers are
/// the same.
void expect_parts(at::Device device) {
  const Ending e(5, 4, 16, device);
  Ending zero = e;
  zero.of_team = at::zeros_like(e.of_team);
  const auto by_sums = [&](const at::Tensor& x, const at::Tensor& weights) {
    return torch::autograd::grad({(x.to(at::kFloat) * weights).sum()}, {e.sums})[0].to(at::kFloat);
  };
  const auto ours = [&] { return dense_epilogue(e.sums, e.bias, Activation::tanh, {4, {}, e.alive}); };
  const auto expected = [&] { return plain(zero, Activation::tanh, true); };
  const at::Tensor d = by_sums(ours().mean, e.by_mean);
  EXPECT_LT(worst(d, by_sums(expected().mean, e.by_mean)), 0.01 * largest(e.by_mean));
  EXPECT_EQ(largest(d.narrow(0, 0, 4)), 0);  // of the first state none lives
  EXPECT_LT(worst(by_sums(ours().features, e.by_features), by_sums(expected().features, e.by_features)),
            0.01 * largest(e.by_features));

  const LayerFeatures added = dense_epilogue(e.sums, e.bias, Activation::tanh, {4, e.of_team, {}});
  EXPECT_FALSE(added.mean.defined());
  EXPECT_LT(worst(added.features, plain(e, Activation::tanh, true).features), 0.004);

  for (const Activation activation : {Activation::tanh, Activation::relu, Activation::silu, Activation::gelu}) {
    const at::Tensor with = dense_epilogue(e.sums, e.bias, activation).features;
    const at::NoGradGuard no_grad;
    EXPECT_TRUE(same(with, dense_epilogue(e.sums, e.bias, activation).features));
  }
}

TEST(PolicyDenseEpilogue, PartsOfIt) { expect_parts(at::kCPU); }

TEST(PolicyDenseEpilogueGpu, PartsOfIt) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  expect_parts(at::Device(at::kCUDA, 0));
}

// A gradient that begins between two numbers of 16 bytes, as a row of a larger tensor does, is copied first.
TEST(PolicyDenseEpilogue, ReadsWhatIsNotAligned) {
  const Ending e(1, 1, 16, at::kCPU);
  const at::Tensor moved = at::zeros({19}, at::kBFloat16).narrow(0, 3, 16);
  moved.copy_(e.sums.detach().flatten());
  EXPECT_TRUE(same(dense_epilogue(moved.view({1, 16}), e.bias, Activation::relu).features,
                   dense_epilogue(e.sums, e.bias, Activation::relu).features));
}

TEST(PolicyDenseEpilogue, RefusesWhatDoesNotFit) {
  const Ending e(5, 4, 16, at::kCPU);
  EXPECT_THROW(dense_epilogue(e.sums, e.bias.narrow(0, 0, 8), Activation::relu), Error);
  EXPECT_THROW(dense_epilogue(e.sums, e.bias, Activation::relu, {3, {}, e.alive}), Error);
  EXPECT_THROW(dense_epilogue(e.sums, e.bias, Activation::relu, {5, e.of_team, e.alive}), Error);
}

TEST(PolicyDenseEpilogue, ServesBfloat16OnAGpu) {
  const auto bias = [](int64_t columns, at::ScalarType type) { return at::zeros({columns}, type); };
  EXPECT_FALSE(dense_epilogue_serves(bias(512, at::kBFloat16)));
  if (cuda_device_count() == 0) return;
  const at::Device gpu(at::kCUDA, 0);
  EXPECT_TRUE(dense_epilogue_serves(bias(512, at::kBFloat16).to(gpu), 64));
  EXPECT_FALSE(dense_epilogue_serves(bias(512, at::kBFloat16).to(gpu), 65));
  EXPECT_FALSE(dense_epilogue_serves(bias(300, at::kBFloat16).to(gpu)));
  EXPECT_FALSE(dense_epilogue_serves(bias(512, at::kFloat).to(gpu)));
}

TEST(PolicyDenseEpilogueGpu, AsTheFormula) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  expect_as_formula(at::Device(at::kCUDA, 0));
}

// In fp32 by LibTorch's operations, in bfloat16 by the kernels. Both round features, to 8 bits here.
TEST(PolicyDenseEpilogueGpu, CriticsAsInFp32) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const at::Device gpu(at::kCUDA, 0);
  const ParallelFor on_gpu({Device::Kind::cuda, 0}, 1);
  struct Case {
    int n;
    MemoryKind memory = MemoryKind::none;
    bool layer_norm = false, fused = true;
  };
  for (const Case& c : {Case{5}, Case{1}, Case{64}, Case{65, MemoryKind::none, false, false}, Case{5, MemoryKind::gru},
                        Case{5, MemoryKind::none, true, false}}) {
    SCOPED_TRACE(testing::Message() << c.n << " agents" << (c.layer_norm ? ", normalised" : "")
                                    << (c.memory == MemoryKind::gru ? ", gru" : ""));
    CriticConfig config;
    config.hidden = {320, 512};
    config.output_gain = 1;
    config.layer_norm = c.layer_norm;
    config.memory = c.memory;
    const int64_t states = 50, n = c.n;
    const at::Tensor obs = random({states, n, 40}, 7).to(gpu);
    const at::Tensor alive = (random({states, n}, 8) > -0.5).to(at::kFloat).to(gpu);
    const auto of = [&](Precision precision) {
      const Critic critic(config, {0, {c.n, c.n}, 40, 0}, precision, on_gpu, gpu, 3);
      if (precision == Precision::bf16) {
        const ParameterSet rounded = critic.parameters().in_bfloat16();
        const at::Tensor x = at::zeros({1, 8}, obs.options().dtype(at::kBFloat16));
        // Parameters are announced layer by layer: weight, bias and, where it normalises, the two of its norm.
        for (const int first : {0, c.layer_norm ? 4 : 2}) {
          DenseLayer layer{.weight = first, .bias = first + 1, .activation = Activation::tanh};
          if (c.layer_norm) layer.norm_weight = first + 2;
          EXPECT_EQ(has_fused_epilogue(rounded, layer, x, n), c.fused) << "parameter " << first;
          EXPECT_FALSE(has_fused_epilogue(rounded, layer, x.to(at::kFloat), n));
          EXPECT_FALSE(has_fused_epilogue(rounded, layer, x.narrow(0, 0, 0), n)) << "no rows";
          layer.activation.reset();
          EXPECT_FALSE(has_fused_epilogue(rounded, layer, x, n)) << "no activation";
        }
      }
      const at::Tensor value = critic.forward(obs, alive, {}, {});
      (value * random({states, n}, 9).to(gpu)).sum().backward();
      return std::pair(value.detach().cpu(), critic.parameters().gradient().cpu().clone());
    };
    const auto [value, gradient] = of(Precision::fp32);
    const auto [rounded, d_rounded] = of(Precision::bf16);
    EXPECT_LT(worst(value, rounded), 0.02 * largest(value));
    EXPECT_LT((gradient - d_rounded).norm().item<double>(), 0.02 * gradient.norm().item<double>());
  }
}

}  // namespace
}  // namespace giga::test
