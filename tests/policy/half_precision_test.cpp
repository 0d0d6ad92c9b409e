// Precision::fp16: what is rounded, and how near it is to fp32.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "cuda/population_policy.hpp"
#include "cuda/runtime.hpp"
#include "policy/actor.hpp"
#include "rollout/tensors.hpp"
#include "sim/state.hpp"
#include "tensors.hpp"

namespace giga::test {
namespace {

constexpr int64_t kHalfObs = 112;

/// The most by which probabilities of actions differ, and logits and means of actions in units of 1 + the largest of
/// their row. The networks have two hidden layers of 64 with tanh, 112 inputs in [-1, 1], and weights of an orthogonal
/// initialisation plus normal numbers of deviation 0.5. kHalfTolerance: between fp16 (policy/config.hpp), by LibTorch
/// or by the fused kernel, and fp32. kFusedTolerance: between the fused kernel and fp16 by LibTorch.
constexpr double kHalfTolerance = 0.01, kFusedTolerance = 0.005;

/// To 11 bits of mantissa, or to multiples of 2^-24; of two that are equally near the even one.
double nearest_half(double x) {
  if (x == 0) return x;
  const double step = std::exp2(std::max(std::ilogb(x) - 10, -24));
  const double rounded = std::nearbyint(x / step) * step;
  return std::abs(rounded) > 65'504 ? std::copysign(std::numeric_limits<double>::infinity(), x) : rounded;
}

TEST(PolicyHalfPrecision, Rounding) {
  const double e = std::exp2(-11);  // half the distance of the halves above 1
  const std::pair<double, double> cases[] = {{1 + e, 1},
                                             {1 + 1.01 * e, 1 + 2 * e},
                                             {1 + 3 * e, 1 + 4 * e},
                                             {-0.1, -0.0999755859375},  // 1638 x 2^-14, of 1638.4
                                             {2049, 2048},
                                             {65'519, 65'504},
                                             {65'520, std::numeric_limits<double>::infinity()},
                                             {std::exp2(-25), 0},
                                             {1.01 * std::exp2(-25), std::exp2(-24)}};
  for (const auto& [x, expected] : cases) {
    EXPECT_EQ(nearest_half(x), expected) << x;
    EXPECT_EQ(rounded_to_half(numbers({static_cast<float>(x)})).item<float>(), static_cast<float>(expected)) << x;
  }
  const at::Tensor x = random({1000}, 1) * random({1000}, 2).mul(3).exp(), rounded = rounded_to_half(x);
  for (int64_t k = 0; k < 1000; ++k) EXPECT_EQ(rounded[k].item<float>(), nearest_half(x[k].item<float>()));
}

ActorConfig config_of(std::vector<int> hidden, Activation activation = Activation::tanh) {
  ActorConfig config;
  config.hidden = std::move(hidden);
  config.activation = activation;
  return config;
}

/// An actor whose parameters are those of its initialisation plus normal numbers of this deviation.
Actor actor_of(const ActorConfig& config, ActionKind actions, Precision precision, double deviation,
               Device device = {}) {
  Actor actor(config, kHalfObs, actions, false, precision, torch_device(device), 1);
  at::NoGradGuard no_grad;
  actor.parameters().values().add_((deviation * random({actor.parameters().size()}, 7)).to(torch_device(device)));
  return actor;
}

/// As egocentric views are: numbers in [-1, 1], of which a quarter, the unseen, is 0.
at::Tensor observations(int64_t rows) {
  return at::where(random({rows, kHalfObs}, 5) < 0.7, random({rows, kHalfObs}, 3).clamp(-1, 1), 0.0);
}

// One hidden layer by hand: in double precision, where only what is said to be rounded is.
TEST(PolicyHalfPrecision, EachLayerRoundsWeightsBiasesAndWhatItTakesIn) {
  const Actor actor = actor_of(config_of({33}), ActionKind::discrete, Precision::fp16, 0.3);
  const Actor full = actor_of(config_of({33}), ActionKind::discrete, Precision::fp32, 0.3);
  const ParameterSet& p = actor.parameters();
  const at::Tensor obs = observations(20);
  const at::Tensor heads = actor.forward(obs).detach(), fp32 = full.forward(obs).detach();
  const auto layer = [&](int k, const std::vector<double>& x, int64_t out) {
    const at::Tensor weight = p[2 * k].detach(), bias = p[2 * k + 1].detach();
    std::vector<double> y(static_cast<size_t>(out));
    for (int64_t i = 0; i < out; ++i) {
      double sum = nearest_half(bias[i].item<float>());
      for (size_t j = 0; j < x.size(); ++j)
        sum += nearest_half(weight[i][static_cast<int64_t>(j)].item<float>()) * nearest_half(x[j]);
      y[static_cast<size_t>(i)] = sum;
    }
    return y;
  };
  double rounding_shows = 0;
  for (int64_t row = 0; row < obs.size(0); ++row) {
    std::vector<double> x(kHalfObs);
    for (int64_t j = 0; j < kHalfObs; ++j) x[static_cast<size_t>(j)] = obs[row][j].item<float>();
    std::vector<double> hidden = layer(0, x, 33);
    for (double& h : hidden) h = std::tanh(h);
    const std::vector<double> head = layer(1, hidden, actor.head_size());
    for (size_t k = 0; k < head.size(); ++k) {
      // A feature between two halves may be rounded the other way: 2^-11 of it, times a weight below 1.5.
      EXPECT_NEAR(heads[row][static_cast<int64_t>(k)].item<float>(), head[k], 1.5 * std::exp2(-11) + 1e-5);
      rounding_shows = std::max(rounding_shows, std::abs(fp32[row][static_cast<int64_t>(k)].item<float>() - head[k]));
    }
  }
  EXPECT_GT(rounding_shows, 3 * std::exp2(-11));
}

TEST(PolicyHalfPrecision, MembersAreActors) {
  for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous}) {
    const Actor shape = actor_of(config_of({16, 9}, Activation::silu), actions, Precision::fp16, 0);
    const at::Tensor obs = observations(14).view({2, 7, kHalfObs});
    const at::Tensor members = 0.3 * random({2, shape.parameters().size()}, 4);
    const at::Tensor heads = shape.forward_members(members, obs);
    for (int64_t m = 0; m < 2; ++m) {
      at::NoGradGuard no_grad;
      shape.parameters().values().copy_(members[m]);
      EXPECT_LT(worst(heads[m], shape.forward(obs[m])), 1e-3);  // a feature between two halves, as above
      if (actions == ActionKind::discrete) continue;
      EXPECT_TRUE(same(shape.log_std(), rounded_to_half(members[m].narrow(0, shape.log_std_offset(), 3))));
    }
  }
}

// What evolution should know: halves from 1 to 2 are 2^-10 apart, so less than half of that is no perturbation.
TEST(PolicyHalfPrecision, APerturbationBelowHalfAStepVanishes) {
  const Actor actor = actor_of(config_of({16}), ActionKind::discrete, Precision::fp16, 0);
  const at::Tensor obs = observations(3), ones = at::ones({actor.parameters().size()});
  const auto head = [&](double perturbation) {
    at::NoGradGuard no_grad;
    actor.parameters().values().copy_(ones + perturbation);
    return actor.forward(obs);
  };
  EXPECT_TRUE(same(head(0), head(std::exp2(-11))));
  EXPECT_FALSE(same(head(0), head(1.01 * std::exp2(-11))));
}

/// Differences of heads in units of 1 + the largest number of the row, and of probabilities; the largest of all rows.
struct Difference {
  double head, probability;
};
Difference difference(const at::Tensor& a, const at::Tensor& b) {
  const at::Tensor unit = 1 + std::get<0>(a.abs().max(1, true));
  return {worst(a / unit, b / unit), worst(at::softmax(a, 1), at::softmax(b, 1))};
}

/// The heads of an actor of two layers with tanh in fp16, each tanh off by a random share of up to `error` of it.
at::Tensor with_errors_of_tanh(const Actor& actor, at::Tensor x, double error) {
  const ParameterSet& p = actor.parameters();
  at::Generator generator = at::detail::createCPUGenerator(11);
  for (int k = 0; k < 3; ++k) {
    x = at::linear(rounded_to_half(x), rounded_to_half(p[2 * k]), rounded_to_half(p[2 * k + 1])).detach();
    if (k < 2) x = at::tanh(x) * (1 + error * (2 * at::rand(x.sizes(), generator, x.options()) - 1));
  }
  return x;
}

// Measured over ten networks at deviation 0.5, whose logits reach 18: 0.0025 of a row's largest and probabilities by
// 0.0038; with errors of tanh 0.0030 and 0.0042, these alone 0.0019 and 0.0031. The most likely action is another one
// in 0.08 % of the rows.
TEST(PolicyHalfPrecision, IsAsNearToFp32AsStated) {
  for (const double deviation : {0.0, 0.1, 0.3, 0.5}) {
    const Actor half = actor_of(config_of({64, 64}), ActionKind::discrete, Precision::fp16, deviation);
    const Actor full = actor_of(config_of({64, 64}), ActionKind::discrete, Precision::fp32, deviation);
    const at::Tensor obs = observations(20'000);
    const at::Tensor fp32 = full.forward(obs).detach().narrow(1, 0, kNDiscreteActions);
    const at::Tensor fp16 = half.forward(obs).detach().narrow(1, 0, kNDiscreteActions);
    const at::Tensor kernel = with_errors_of_tanh(half, obs, std::exp2(-11)).narrow(1, 0, kNDiscreteActions);
    const Difference rounding = difference(fp32, fp16), fused = difference(fp32, kernel),
                     tanh = difference(fp16, kernel);
    std::cout << "deviation " << deviation << ", logits up to " << largest(fp32) << ": fp16 - fp32 " << rounding.head
              << ", probabilities " << rounding.probability << "; with errors of tanh " << fused.head << ", "
              << fused.probability << "; these alone " << tanh.head << ", " << tanh.probability << std::endl;
    EXPECT_LT(std::max(rounding.head, rounding.probability), kHalfTolerance);
    EXPECT_LT(std::max(fused.head, fused.probability), kHalfTolerance);
    EXPECT_LT(std::max(tanh.head, tanh.probability), kFusedTolerance);
  }
}

// What the mean is evaluated by, where its population plays in fp16: LibTorch on the GPU, with TF32 or without.
TEST(PolicyHalfPrecision, TheKernelsLayoutIsOfTheWholeActor) {
  ActorConfig config;
  config.hidden = {64, 32};
  const auto layout = [&](ActionKind actions, Precision precision) {
    return Actor(config, 40, actions, false, precision, at::kCPU, 1).small_mlp();
  };
  const std::optional<SmallMlp> discrete = layout(ActionKind::discrete, Precision::fp16);
  const std::optional<SmallMlp> continuous = layout(ActionKind::continuous, Precision::fp16);
  ASSERT_TRUE(discrete && continuous);
  ASSERT_EQ(continuous->n_layers, 3);
  EXPECT_EQ(std::vector(continuous->width, continuous->width + 4), (std::vector{40, 64, 32, 3}));
  EXPECT_EQ(continuous->log_std, 40 * 64 + 64 + 64 * 32 + 32 + 32 * 3 + 3);  // behind weights and biases: 4,803
  EXPECT_EQ(discrete->width[3], kLogitStride);
  EXPECT_FALSE(layout(ActionKind::discrete, Precision::tf32));
  for (const std::vector<int>& hidden : {std::vector{129, 8}, {8, 129}}) {
    config.hidden = hidden;
    EXPECT_FALSE(layout(ActionKind::discrete, Precision::fp16)) << "the kernel has room for layers of 128";
  }
}

TEST(PolicyHalfPrecisionGpu, LibTorchComputesAsOnTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const bool before = at::globalContext().allowTF32CuBLAS();
  for (const bool tf32 : {false, true}) {
    at::globalContext().setAllowTF32CuBLAS(tf32);
    const Actor a = actor_of(config_of({64, 64}), ActionKind::discrete, Precision::fp16, 0.3);
    const Actor b = actor_of(config_of({64, 64}), ActionKind::discrete, Precision::fp16, 0.3, gpu);
    const at::Tensor obs = observations(5000);
    const at::Tensor on_cpu = a.forward(obs).detach(), on_gpu = b.forward(obs.to(torch_device(gpu))).detach().cpu();
    // Now and then a feature between two halves is rounded the other way.
    EXPECT_LT(worst(on_cpu, on_gpu), 5e-3) << tf32;
    EXPECT_LT((on_cpu - on_gpu).abs().mean().item<double>(), 1e-4) << tf32;
  }
  at::globalContext().setAllowTF32CuBLAS(before);
}

/// Greedy actions by the fused kernel, in worlds of one agent: [R] indices, or [R, 3].
at::Tensor actions_by_the_kernel(const Actor& actor, const at::Tensor& obs) {
  const PackedMlp layout(actor.small_mlp().value());
  const auto rows = static_cast<int>(obs.size(0));
  const at::Tensor& parameters = actor.parameters().values();
  const at::Tensor packed = at::empty({layout.size}, obs.options().dtype(at::kHalf));
  pack_population(layout, parameters.const_data_ptr<float>(), 1, parameters.size(0),
                  static_cast<uint16_t*>(packed.data_ptr()), 0, nullptr);
  const at::Tensor phase = at::full({rows}, static_cast<int>(Phase::plays), obs.options().dtype(at::kByte));
  const at::Tensor steps = at::zeros({rows}, obs.options().dtype(at::kInt));
  const bool discrete = actor.actions() == ActionKind::discrete;
  at::Tensor actions = discrete ? at::full({rows}, -1, obs.options().dtype(at::kInt))
                                : at::full({rows, kActionSize}, std::nan(""), obs.options());
  PopulationPolicy policy;
  policy.packed = layout;
  policy.obs_stride = obs.size(1);
  policy.phase = static_cast<const Phase*>(phase.const_data_ptr());
  NetworkGroups& part = policy.part[policy.n_parts++];
  part.networks = static_cast<const uint16_t*>(packed.const_data_ptr());
  part.groups = part.world_step = 1;
  part.worlds_per_group = rows;
  part.obs = obs.const_data_ptr<float>();
  part.act = {
      actor.actions(), true, {static_cast<const uint32_t*>(steps.const_data_ptr()), 9, 0, 1, 0}, actions.data_ptr()};
  const at::Tensor work = at::empty({population_work(policy)}, steps.options());
  policy.work = work.data_ptr<int32_t>();
  list_population_work(policy, 0, nullptr);
  launch_population_policy(policy, 0, nullptr);
  return actions.cpu();
}

/// Fails where an action has a logit that is further below the largest of its row than both may be off, or a control
/// that is further from the tanh of its mean.
void expect_actions_of(const at::Tensor& actions, const at::Tensor& head, double tolerance) {
  const at::Tensor unit = 1 + std::get<0>(head.abs().max(1, true));
  if (actions.dim() == 2) {
    EXPECT_LT(((actions - at::tanh(head)) / unit).abs().max().item<double>(), tolerance);
    return;
  }
  const at::Tensor logits = head.narrow(1, 0, kNDiscreteActions), chosen = actions.to(at::kLong).unsqueeze(1);
  const at::Tensor below = std::get<0>(logits.max(1, true)) - logits.gather(1, chosen);
  EXPECT_LT((below / unit).max().item<double>(), 2 * tolerance);
  EXPECT_GT((below == 0).to(at::kFloat).mean().item<double>(), 0.98);
}

TEST(PolicyHalfPrecisionGpu, TheFusedKernelIsAsNearAsStated) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const at::Tensor obs = observations(5000), obs_on_gpu = obs.to(torch_device(gpu));
  // Other activations are as in LibTorch: what is left is the order of sums, and features that it rounds the other way.
  const std::pair<ActorConfig, double> cases[] = {{config_of({64, 64}), kFusedTolerance},
                                                  {config_of({64, 64}, Activation::relu), 1e-3},
                                                  {config_of({33, 7, 12}, Activation::silu), 1e-3},
                                                  {config_of({128}, Activation::gelu), 1e-3}};
  for (const auto& [config, tolerance] : cases) {
    for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous}) {
      for (const double deviation : {0.1, 0.5}) {
        SCOPED_TRACE(testing::Message() << config.hidden.size() << " layers, deviation " << deviation);
        const Actor half = actor_of(config, actions, Precision::fp16, deviation);
        const Actor full = actor_of(config, actions, Precision::fp32, deviation);
        const at::Tensor played =
            actions_by_the_kernel(actor_of(config, actions, Precision::fp16, deviation, gpu), obs_on_gpu);
        expect_actions_of(played, half.forward(obs).detach(), tolerance);
        expect_actions_of(played, full.forward(obs).detach(), kHalfTolerance);
      }
    }
  }
}

}  // namespace
}  // namespace giga::test
