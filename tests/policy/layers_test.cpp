// Layers, networks and their parameters: the mean of the living, orthogonal starts, seeds, saving and loading.
#include "policy/layers.hpp"

#include <gtest/gtest.h>
#include <torch/autograd.h>

#include <cmath>

#include "policy/critic.hpp"
#include "policy/network.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

TEST(PolicyLayers, LivingMeanByFiniteDifferences) {
  // f(x) = sum(c * living_mean(x)) is linear in x, so that differences of any width give the gradient.
  const at::Tensor x0 = random({3, 4, 5}, 1), c = random({3, 5}, 2);
  at::Tensor alive = at::ones({3, 4});
  alive[0][2] = 0;
  alive[2].zero_();
  at::Tensor x = x0.clone().requires_grad_(true);
  (living_mean(cpu_loop(), x, alive) * c).sum().backward();
  const auto value = [&](const at::Tensor& at) {
    return (living_mean(cpu_loop(), at, alive) * c).sum().item<double>();
  };
  for (int64_t s = 0; s < 3; ++s)
    for (int64_t i = 0; i < 4; ++i)
      for (int64_t k = 0; k < 5; ++k) {
        at::Tensor up = x0.clone(), down = x0.clone();
        up[s][i][k] += 0.5;
        down[s][i][k] -= 0.5;
        EXPECT_NEAR(x.grad()[s][i][k].item<double>(), value(up) - value(down), 2e-6) << s << " " << i << " " << k;
      }
  EXPECT_EQ(largest(x.grad()[2]), 0);
  EXPECT_EQ(largest(living_mean(cpu_loop(), x0, alive)[2]), 0);
}

TEST(PolicyLayers, AnMlpTakesAnImageAsARow) {
  ParameterSet parameters;
  NetworkConfig config;
  config.hidden = {5};
  const auto mlp = encoder_factory(EncoderKind::mlp)(parameters, "mlp", ObservationShape(4, 3, 2), config);
  EXPECT_EQ(parameters.shape(mlp->layers()[0].weight)[1], 4 * 3 * 2);
}

TEST(PolicyLayers, LivingMeanEqualsTensorOperations) {
  at::Tensor x = random({7, 5, 6}, 3).requires_grad_(true), y = x.detach().clone().requires_grad_(true);
  const at::Tensor alive = (random({7, 5}, 4) > 0).to(at::kFloat), c = random({7, 6}, 5);
  const at::Tensor fused = living_mean(cpu_loop(), x, alive);
  const at::Tensor plain = (y * alive.unsqueeze(-1)).sum(1) / alive.sum(1, true).clamp_min(1);
  EXPECT_LT(worst(fused, plain), 1e-6);
  (fused.tanh() * c).sum().backward();
  (plain.tanh() * c).sum().backward();
  EXPECT_LT(worst(x.grad(), y.grad()), 1e-6);
  EXPECT_GT(largest(x.grad()), 0.1);
}

TEST(PolicyLayers, ANetworkOfDenseLayersIsTheFormula) {
  // 3 -> 4 -> 2: W1 act(norm(W0 x + b0)) + b1 with the parameters in the order in which they are announced.
  for (const bool norm : {false, true})
    for (const Activation activation : {Activation::tanh, Activation::relu, Activation::silu, Activation::gelu}) {
      ParameterSet p;
      NetworkConfig config;
      config.hidden = {4};
      config.activation = activation;
      config.layer_norm = norm;
      const Network network(p, "mlp", config, {3, 2, 1.0f});
      p.allocate(at::kCPU, 3);
      { p.values().copy_(p.values() + 0.3 * random({p.size()}, 9)); }
      const at::Tensor x = random({6, 3}, 4);
      at::Tensor h = at::mm(x, p[0].t()) + p[1];
      if (norm) {
        const at::Tensor centred = h - h.mean(1, true);
        h = centred / (centred.square().mean(1, true) + 1e-5).sqrt() * p[2] + p[3];
      }
      switch (activation) {
        case Activation::tanh:
          h = h.tanh();
          break;
        case Activation::relu:
          h = h.clamp_min(0);
          break;
        case Activation::silu:
          h = h / (1 + (-h).exp());
          break;
        case Activation::gelu:
          h = h * 0.5 * (1 + (h / std::sqrt(2.0)).erf());
          break;
      }
      const int last = norm ? 4 : 2;
      const at::Tensor expected = at::mm(h, p[last].t()) + p[last + 1];
      EXPECT_LT(worst(network.forward(p, x, {}), expected), 2e-6) << "activation " << static_cast<int>(activation);
    }
}

TEST(PolicyParameters, OrthogonalStartsWithTheGain) {
  ParameterSet p;
  const int tall = p.add("tall", {7, 4}, {Init::Kind::orthogonal, 1.5f});
  const int wide = p.add("wide", {3, 8}, {Init::Kind::orthogonal, 0.01f});
  const int constant = p.add("constant", {5}, {Init::Kind::constant, -0.5f});
  p.allocate(at::kCPU, 11);
  // Columns of the tall one and rows of the wide one: orthogonal, of length gain.
  EXPECT_LT(worst(at::mm(p[tall].t(), p[tall]), 2.25 * at::eye(4)), 1e-6);
  EXPECT_LT(worst(at::mm(p[wide], p[wide].t()), 1e-4 * at::eye(3)), 1e-9);
  EXPECT_TRUE(same(p[constant], at::full({5}, -0.5)));
  EXPECT_EQ(p.size(), 28 + 24 + 5);
}

// A layer of a composed critic reads own and mean features side by side: its weights start as one orthogonal matrix.
TEST(PolicyLayers, OwnAndTeamWeightsStartAsOneLayer) {
  CriticConfig config;
  config.hidden = {16, 12, 40};
  config.output_gain = 0.5f;
  const Critic critic(config, {0, {3, 2}, 10, 0}, Precision::fp32, cpu_loop(), at::kCPU, 3);
  NamedArrays arrays;
  critic.parameters().save("", arrays);
  const auto layer = [&](int k) {
    at::Tensor parts[2];
    for (int j = 0; j < 2; ++j) {
      const NamedArray& a = find_array(arrays, cat("team_mlp/", k, j == 0 ? "/weight" : "/team_weight"));
      parts[j] = numbers(array_values<float>(a)).view(a.shape);
    }
    return at::cat({parts[0], parts[1]}, 1);
  };
  // Gain sqrt(2): rows of length sqrt(2) over all 2 x 16 inputs. If each half had such rows, the outputs would have
  // twice the variance.
  const at::Tensor wide = layer(1);
  ASSERT_EQ(wide.sizes(), at::IntArrayRef({12, 32}));
  EXPECT_LT(worst(at::mm(wide, wide.t()), 2 * at::eye(12)), 1e-5);
  const at::Tensor tall = layer(2);
  ASSERT_EQ(tall.sizes(), at::IntArrayRef({40, 24}));
  EXPECT_LT(worst(at::mm(tall.t(), tall), 2 * at::eye(24)), 1e-5);
  const at::Tensor output = layer(3);  // gain 0.5
  ASSERT_EQ(output.sizes(), at::IntArrayRef({1, 80}));
  EXPECT_NEAR(output.norm().item<double>(), 0.5, 1e-6);
  for (const at::Tensor& w : {wide, tall, output}) {  // both halves have their part of it
    const int64_t half = w.size(1) / 2;
    EXPECT_GT(largest(w.slice(1, 0, half)), 0.03);
    EXPECT_GT(largest(w.slice(1, half)), 0.03);
  }
}

TEST(PolicyParameters, SeedDecides) {
  const auto values = [](uint64_t seed) {
    ParameterSet p;
    p.add("a", {6, 6}, {Init::Kind::orthogonal, 1});
    p.add("b", {6, 6}, {Init::Kind::orthogonal, 1});
    p.allocate(at::kCPU, seed);
    EXPECT_GT(worst(p[0], p[1]), 0.1);
    return p.values();
  };
  EXPECT_TRUE(same(values(3), values(3)));
  EXPECT_GT(worst(values(3), values(4)), 0.1);
}

TEST(PolicyParameters, ViewsShareOneBufferAndOneGradient) {
  ParameterSet p;
  p.add("a", {2, 3}, {Init::Kind::constant, 1});
  p.add("b", {2}, {Init::Kind::constant, 2});
  p.allocate(at::kCPU, 1);
  (p[0].sum() * 3 + (p[1] * p[1]).sum()).backward();
  EXPECT_TRUE(same(p.gradient(), numbers({3, 3, 3, 3, 3, 3, 4, 4})));  // d b^2 = 2 x 2
  p.values().fill_(7);
  EXPECT_EQ(p[1][1].item<float>(), 7.0f);
}

TEST(PolicyParameters, SaveAndLoad) {
  const auto make = [](int64_t rows, uint64_t seed) {
    ParameterSet p;
    p.add("layer/weight", {rows, 4}, {Init::Kind::orthogonal, 1});
    p.add("layer/bias", {rows}, {Init::Kind::constant, 0});
    p.allocate(at::kCPU, seed);
    return p;
  };
  const ParameterSet source = make(3, 1);
  NamedArrays arrays;
  source.save("team_0/", arrays);
  ASSERT_EQ(arrays.size(), 2u);
  EXPECT_EQ(arrays[0].name, "team_0/layer/weight");
  EXPECT_EQ(arrays[0].shape, (std::vector<int64_t>{3, 4}));

  ParameterSet target = make(3, 2);
  ASSERT_FALSE(same(target.values(), source.values()));
  target.load("team_0/", arrays);
  EXPECT_TRUE(same(target.values(), source.values()));

  const auto message = [&](ParameterSet p, const std::string& prefix) -> std::string {
    try {
      p.load(prefix, arrays);
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  };
  EXPECT_EQ(message(make(2, 1), "team_0/"),
            "array 'team_0/layer/weight' of the checkpoint has shape [3, 4], expected [2, 4]: it was written with "
            "other settings or by another version");
  EXPECT_EQ(message(make(3, 1), "team_1/"),
            "the checkpoint has no array 'team_1/layer/weight': it was written with other settings or by another "
            "version");
}

}  // namespace
}  // namespace giga::test
