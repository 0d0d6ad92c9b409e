// Evolution strategies: weights by hand, optima that are known, and ask and tell that can be repeated.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "learn/evolution/fitness.hpp"
#include "learn/evolution/strategy.hpp"
#include "policy/parameters.hpp"
#include "rollout/tensors.hpp"

namespace giga::test {
namespace {

at::Tensor numbers(const std::vector<float>& values) { return at::tensor(values, at::kFloat); }

void expect_near(const at::Tensor& actual, const std::vector<double>& expected, double tolerance) {
  ASSERT_EQ(actual.numel(), static_cast<int64_t>(expected.size()));
  for (int64_t k = 0; k < actual.numel(); ++k)
    EXPECT_NEAR(actual[k].item<double>(), expected[static_cast<size_t>(k)], tolerance) << "number " << k;
}

TEST(LearnEvolutionFitness, WeightsByRankAreSharedByEqualOnes) {
  const RankWeights weights(numbers({0.5f, 0.25f, 0.125f, 0.0f, -0.375f, -0.5f}), at::kCPU);
  // 7 is best; the two 3 share ranks 1 and 2; -1 is next; what is not finite shares the last two ranks.
  expect_near(weights.of(numbers({3, NAN, 7, 3, -INFINITY, -1})), {0.1875, -0.4375, 0.5, 0.1875, -0.4375, 0}, 1e-7);
  EXPECT_EQ(count_not_finite(numbers({3, NAN, 7, INFINITY})).item<float>(), 2);
}

TEST(LearnEvolutionFitness, Shaping) {
  const at::Tensor fitness = numbers({10, -2, NAN, 4});
  // Ranks 0, 2, 3, 1 of four: 0.5 - rank / 3.
  expect_near(shape_fitness(fitness, FitnessShaping::centered_ranks), {0.5, 0.5 - 2 / 3.0, -0.5, 0.5 - 1 / 3.0}, 1e-6);
  // Equal ones: the middle of ranks 1, 2 and 3 of five is 2, the others have 0 and 4.
  expect_near(shape_fitness(numbers({1, 9, 1, -4, 1}), FitnessShaping::centered_ranks), {0, 0.5, 0, -0.5, 0}, 1e-6);
  expect_near(shape_fitness(fitness, FitnessShaping::raw), {10, -2, -2, 4}, 0);
  // 10, -2, -2, 4: mean 2.5, deviations 7.5, -4.5, -4.5, 1.5; their squares sum to 99, deviation sqrt(24.75) = 4.9749.
  expect_near(shape_fitness(fitness, FitnessShaping::z_score), {1.50756, -0.904534, -0.904534, 0.301511}, 1e-5);
  expect_near(shape_fitness(numbers({NAN, NAN}), FitnessShaping::raw), {0, 0}, 0);
}

TEST(LearnEvolutionFitness, SnesUtilitiesByHand) {
  // n = 8: ln 5 - ln k = 1.6094379, 0.9162907, 0.5108256, 0.2231436, then 0; sum 3.2596978; each over that, less 1/8.
  expect_near(snes_utilities(8), {0.3687383, 0.1560969, 0.0317095, -0.0565447, -0.125, -0.125, -0.125, -0.125}, 1e-6);
  // n = 10: ln 6 - ln k = 1.7917595, 1.0986123, 0.6931472, 0.4054651, 0.1823216; sum 4.1713057.
  expect_near(snes_utilities(10),
              {0.3295441, 0.1633737, 0.0661703, -0.0027966, -0.0562915, -0.1, -0.1, -0.1, -0.1, -0.1}, 1e-6);
  // n = 512: the sum is 256 ln 257 - ln 256!.
  const at::Tensor large = snes_utilities(512);
  const double sum = 256 * std::log(257.0) - std::lgamma(257.0);
  EXPECT_NEAR(large[0].item<double>(), std::log(257.0) / sum - 1 / 512.0, 1e-7);
  EXPECT_NEAR(large[99].item<double>(), (std::log(257.0) - std::log(100.0)) / sum - 1 / 512.0, 1e-7);
  EXPECT_NEAR(large[511].item<double>(), -1 / 512.0, 1e-9);
  EXPECT_NEAR(large.sum().item<double>(), 0, 1e-6);
}

TEST(LearnEvolutionFitness, DesWeightsByHand) {
  // n = 8: r = -0.5, -0.357143, ...; sigmoid(12.5 r) = 0.001927, 0.011382, 0.064250, 0.290521, 0.709479, ...;
  // exp(-20 s) = 0.962195, 0.796411, 0.276654, 0.002997, 0.000001, ...; sum 2.038256.
  expect_near(des_weights(8, 12.5), {0.4720684, 0.3907317, 0.1357296, 0.00147, 3e-7, 0, 0, 0}, 2e-6);
  expect_near(des_weights(10, 12.5), {0.3883231, 0.3460988, 0.2209888, 0.0440721, 0.0005166, 6e-7, 0, 0, 0, 0}, 2e-6);
  const at::Tensor large = des_weights(512, 12.5);
  EXPECT_NEAR(large.sum().item<double>(), 1, 1e-6);
  // The best against the 103rd, r = -0.5 + 102 / 511: exp(-20 (s - s')).
  const auto s = [](double r) { return 1 / (1 + std::exp(-12.5 * r)); };
  EXPECT_NEAR(large[102].item<double>() / large[0].item<double>(), std::exp(-20 * (s(-0.5 + 102 / 511.0) - s(-0.5))),
              1e-5);
}

/// A strategy under test, by name.
struct Search {
  const char* name;
  std::function<std::unique_ptr<EvolutionStrategy>(const at::Tensor& mean, const ParallelFor& parallel_for,
                                                   uint64_t seed)>
      make;
};
void PrintTo(const Search& s, std::ostream* out) { *out << s.name; }

PopulationConfig population_of(float sigma) {
  PopulationConfig c;
  c.population_size = 64;
  c.sigma_init = sigma;
  return c;
}
Search openai(const char* name, MeanOptimizer optimizer, float rate, EsNoiseKind noise = EsNoiseKind::full) {
  PopulationConfig population = population_of(0.3f);
  population.noise = noise;
  OpenAiEsConfig c;
  c.optimizer = optimizer;
  c.learning_rate = rate;
  c.learning_rate_decay = 0.99f;
  c.learning_rate_min = 0;
  c.sigma_decay = 0.99f;
  c.sigma_min = 0.001f;
  return {name, [population, c](const at::Tensor& mean, const ParallelFor& parallel_for, uint64_t seed) {
            return make_openai_es(population, c, {seed, 0, {{0, 2, mean.size(0) / 2}}}, mean, parallel_for);
          }};
}
std::vector<Search> searches() {
  PopulationConfig free = population_of(0.5f);
  free.antithetic = false;
  return {openai("Adam", MeanOptimizer::adam, 0.1f),
          openai("Momentum", MeanOptimizer::momentum, 0.05f),
          openai("ClipUp", MeanOptimizer::clip_up, 0.05f),
          openai("LowRank", MeanOptimizer::adam, 0.1f, EsNoiseKind::low_rank),
          {"Snes",
           [free](const at::Tensor& mean, const ParallelFor& parallel_for, uint64_t seed) {
             return make_snes(free, {}, {seed, 0, {}}, mean, parallel_for);
           }},
          {"Des", [free](const at::Tensor& mean, const ParallelFor& parallel_for, uint64_t seed) {
             return make_des(free, {}, {seed, 0, {}}, mean, parallel_for);
           }}};
}

using Function = std::function<at::Tensor(const at::Tensor& members)>;  // [M, P] -> fitness [M]

/// -sum((x - 1)^2).
at::Tensor quadratic(const at::Tensor& x) { return -(x - 1).square().sum(1); }
/// Minus Rosenbrock's valley; the optimum is at ones.
at::Tensor rosenbrock(const at::Tensor& x) {
  const int64_t d = x.size(1);
  const at::Tensor a = x.slice(1, 0, d - 1), b = x.slice(1, 1, d);
  return -(100 * (b - a.square()).square() + (1 - a).square()).sum(1);
}

/// The largest distance of a coordinate from the optimum after so many generations.
double distance_after(EvolutionStrategy& strategy, int generations, const Function& fitness) {
  for (int g = 0; g < generations; ++g) strategy.tell(fitness(strategy.ask()));
  return (strategy.mean() - 1).abs().max().item<double>();
}

class LearnEvolution : public testing::TestWithParam<Search> {};

// 64 members x 300 generations = 19,200 evaluations, from the origin, 10 dimensions.
TEST_P(LearnEvolution, SolvesAQuadratic) {
  const ParallelFor parallel_for(Device{}, 1);
  const auto strategy = GetParam().make(at::zeros({10}), parallel_for, 1);
  EXPECT_LT(distance_after(*strategy, 300, quadratic), 0.05);
}

// The same with noise of deviation 1 on every evaluation: at the start the fitness is -10.
TEST_P(LearnEvolution, SolvesANoisyQuadratic) {
  const ParallelFor parallel_for(Device{}, 1);
  const auto strategy = GetParam().make(at::zeros({10}), parallel_for, 1);
  int generation = 0;
  const Function noisy = [&generation](const at::Tensor& x) {
    std::vector<float> noise;
    const EsNoise source{99, static_cast<uint32_t>(generation++), 0, 0, 0, nullptr, nullptr, 1};
    for (int64_t m = 0; m < x.size(0); ++m) noise.push_back(source(m, 0));
    return quadratic(x) + numbers(noise);
  };
  EXPECT_LT(distance_after(*strategy, 300, noisy), 0.6);
}

TEST_P(LearnEvolution, SolvesRosenbrocksValley) {
  const ParallelFor parallel_for(Device{}, 1);
  const auto strategy = GetParam().make(at::zeros({2}), parallel_for, 1);
  EXPECT_LT(distance_after(*strategy, 1500, rosenbrock), 0.25);  // 96,000 evaluations
}

TEST_P(LearnEvolution, AskCanBeRepeatedAndTellIsDeterministic) {
  const ParallelFor parallel_for(Device{}, 1);
  const auto one = GetParam().make(at::zeros({10}), parallel_for, 5),
             two = GetParam().make(at::zeros({10}), parallel_for, 5);
  for (int g = 0; g < 3; ++g) {
    const at::Tensor members = one->ask();
    EXPECT_TRUE(at::equal(members, one->ask())) << "the noise that is learned from is the noise that was played";
    EXPECT_TRUE(at::equal(members, two->ask()));
    one->tell(quadratic(members));
    two->tell(quadratic(members));
    EXPECT_TRUE(at::equal(one->mean(), two->mean()));
    EXPECT_FALSE(at::equal(members, one->ask())) << "a new generation";
  }
  const auto other = GetParam().make(at::zeros({10}), parallel_for, 6);
  EXPECT_FALSE(at::equal(other->ask(), GetParam().make(at::zeros({10}), parallel_for, 5)->ask())) << "another seed";
}

TEST_P(LearnEvolution, SaveLoadAndGoOnEqualsGoingOn) {
  const ParallelFor parallel_for(Device{}, 1);
  const auto strategy = GetParam().make(at::zeros({10}), parallel_for, 5),
             loaded = GetParam().make(at::ones({10}), parallel_for, 5);
  for (int g = 0; g < 5; ++g) strategy->tell(quadratic(strategy->ask()));
  NamedArrays arrays;
  strategy->save("es/", arrays);
  loaded->load("es/", arrays);
  for (int g = 0; g < 3; ++g) {
    EXPECT_TRUE(at::equal(strategy->ask(), loaded->ask()));
    strategy->tell(quadratic(strategy->ask()));
    loaded->tell(quadratic(loaded->ask()));
  }
  EXPECT_TRUE(at::equal(strategy->mean(), loaded->mean()));
  EXPECT_TRUE(at::equal(strategy->sigma(), loaded->sigma()));
}

INSTANTIATE_TEST_SUITE_P(All, LearnEvolution, testing::ValuesIn(searches()),
                         [](const auto& search) { return std::string(search.param.name); });

// A population in which one member is not a number: it is the worst, and the search goes on with numbers.
TEST(LearnEvolutionStrategy, WhatIsNotFiniteIsTheWorst) {
  const ParallelFor parallel_for(Device{}, 1);
  for (const Search& search : searches()) {
    const auto strategy = search.make(at::zeros({10}), parallel_for, 1);
    const Function broken = [](const at::Tensor& x) {
      at::Tensor fitness = quadratic(x);
      fitness[3] = NAN;
      fitness[8] = INFINITY;
      return fitness;
    };
    EXPECT_LT(distance_after(*strategy, 300, broken), 0.1) << search.name;
  }
}

TEST(LearnEvolutionStrategy, AnOddPopulationHasNoPairs) {
  const ParallelFor parallel_for(Device{}, 1);
  PopulationConfig config;
  config.population_size = 33;
  EXPECT_THROW(make_openai_es(config, {}, {}, at::zeros({4}), parallel_for), InputError);
  config.antithetic = false;
  EXPECT_NO_THROW(make_openai_es(config, {}, {}, at::zeros({4}), parallel_for));
}

// A mean that is not a number is not taken over, and tell says so.
TEST(LearnEvolutionStrategy, WhatIsNotFiniteIsNotLearned) {
  const ParallelFor parallel_for(Device{}, 1);
  PopulationConfig population = population_of(0.1f);
  population.shaping.kind = FitnessShaping::raw;
  OpenAiEsConfig config;
  config.optimizer = MeanOptimizer::momentum;
  const auto strategy = make_openai_es(population, config, {}, at::ones({4}), parallel_for);
  at::Tensor fitness = at::zeros({64});
  fitness[0] = 3e38f;  // finite, but not three of it
  fitness[2] = fitness[4] = -3e38f;
  strategy->ask();
  EXPECT_FALSE(strategy->tell(fitness).item<bool>());
  EXPECT_TRUE(at::equal(strategy->mean(), at::ones({4})));
  EXPECT_EQ(strategy->generation(), 1u);
}

// Nor is anything else of the state: after a step that was not sound all of it is what it was, and learning goes on.
TEST(LearnEvolutionStrategy, AfterAnUnsoundStepAllOfTheStateIsPutBack) {
  const ParallelFor parallel_for(Device{}, 1);
  PopulationConfig population = population_of(0.1f);
  population.shaping.kind = FitnessShaping::raw;
  at::Tensor unsound = at::full({64}, 3e38f);  // finite, but their sums are not
  unsound.slice(0, 32).neg_();
  std::vector<std::pair<std::string, std::unique_ptr<EvolutionStrategy>>> strategies;
  for (const MeanOptimizer optimizer : {MeanOptimizer::adam, MeanOptimizer::momentum, MeanOptimizer::clip_up}) {
    OpenAiEsConfig config;
    config.optimizer = optimizer;
    strategies.emplace_back(cat("optimizer ", static_cast<int>(optimizer)),
                            make_openai_es(population, config, {}, at::ones({8}), parallel_for));
  }
  for (auto& [name, strategy] : strategies) {
    SCOPED_TRACE(name);
    const auto state = [&] {
      NamedArrays arrays;
      strategy->save("", arrays);
      std::erase_if(arrays, [](const NamedArray& a) { return a.name == "generation"; });
      return arrays;
    };
    for (int g = 0; g < 3; ++g) EXPECT_TRUE(strategy->tell(-strategy->ask().square().sum(1)).item<bool>());
    const NamedArrays before = state();
    strategy->ask();
    EXPECT_FALSE(strategy->tell(unsound).item<bool>());
    const NamedArrays after = state();
    ASSERT_EQ(before.size(), 5u);  // mean, sigma, and the optimizer's
    for (size_t k = 0; k < before.size(); ++k) EXPECT_EQ(after[k].bytes, before[k].bytes) << before[k].name;
    EXPECT_EQ(strategy->generation(), 4u);
    const at::Tensor mean = strategy->mean().clone();
    EXPECT_TRUE(strategy->tell(-strategy->ask().square().sum(1)).item<bool>());
    EXPECT_FALSE(at::equal(strategy->mean(), mean));
  }
}

// Equal fitness for all: only the weight decay of the shaping is left, which draws the mean to zero.
TEST(LearnEvolutionStrategy, WeightDecayOfTheShapingPrefersSmallParameters) {
  const ParallelFor parallel_for(Device{}, 1);
  for (const float decay : {0.0f, 0.1f}) {
    PopulationConfig population = population_of(0.3f);
    population.shaping.weight_decay = decay;
    const auto strategy = make_snes(population, {}, {}, at::full({10}, 2.0), parallel_for);
    for (int g = 0; g < 30; ++g) {
      strategy->ask();
      strategy->tell(at::ones({64}));
    }
    const double largest = strategy->mean().abs().max().item<double>();
    if (decay > 0)
      EXPECT_LT(largest, 1.0);
    else
      EXPECT_NEAR(largest, 2.0, 1e-4);
  }
}

TEST(LearnEvolutionGpu, SolvesTheSameAndAgreesWithTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const ParallelFor on_cpu(Device{}, 1), on_gpu(gpu);
  for (const Search& search : searches()) {
    SCOPED_TRACE(search.name);
    const at::Tensor start = at::zeros({10});
    const auto a = search.make(start, on_cpu, 1), b = search.make(start.to(torch_device(gpu)), on_gpu, 1);
    // The same counters; logarithms and cosines may differ in the last bits.
    EXPECT_LT((a->ask() - b->ask().cpu()).abs().max().item<double>(), 1e-5);
    a->tell(quadratic(a->ask()));
    b->tell(quadratic(b->ask()));
    EXPECT_LT((a->mean() - b->mean().cpu()).abs().max().item<double>(), 1e-4);
    EXPECT_LT((a->sigma() - b->sigma().cpu()).abs().max().item<double>(), 1e-4);
    EXPECT_LT(distance_after(*b, 299, quadratic), 0.05);
  }
}

}  // namespace
}  // namespace giga::test
