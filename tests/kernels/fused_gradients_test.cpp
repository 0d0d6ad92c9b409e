// The kernels of the fused gradients as PTX, thread by thread on a CPU, against what does the same in fp32
// (policy/cpu_kernels.hpp): numbers within the rounding of factors to half precision, and the same bits in three orders
// of the threads between their barriers.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "core/thread_pool.hpp"
#include "kernels/ptx_files.hpp"
#include "kernels/ptx_module.hpp"
#include "kernels/setting.hpp"
#include "policy/cpu_kernels.hpp"

namespace giga::test {
namespace {

/// The sum over the rows of `partial`, which `compute(rows)` fills; NaN where it does not.
template <class Pass>
std::vector<double> summed(Pass pass, int n_partial, const std::function<void(const Pass&)>& compute,
                           std::vector<float>* bits = nullptr) {
  const auto stride = static_cast<size_t>(pass.net.size + kFusedSums);
  Guarded<float> partial((pass.net.size + kFusedSums) * n_partial);
  pass.n_partial = n_partial;
  pass.partial = partial.data();
  compute(pass);
  EXPECT_TRUE(partial.intact()) << "sums behind those of the last block";
  const std::vector<float> numbers = partial.numbers();
  std::vector<double> sum(stride);
  for (size_t k = 0; k < numbers.size(); ++k) sum[k % stride] += static_cast<double>(numbers[k]);
  if (bits) *bits = numbers;
  return sum;
}

/// |found - expected| / |expected| of some numbers.
double apart(const std::vector<double>& found, const std::vector<double>& expected, int first, int count) {
  double difference = 0, size = 0;
  for (auto k = static_cast<size_t>(first); k < static_cast<size_t>(first + count); ++k) {
    difference += (found[k] - expected[k]) * (found[k] - expected[k]);
    size += expected[k] * expected[k];
  }
  return std::sqrt(difference / size);
}

void expect_near(const FusedMlp& net, const std::vector<double>& found, const std::vector<double>& expected) {
  for (int k = 0; k < net.n_layers; ++k) {
    EXPECT_LT(apart(found, expected, net.weight[k], Setting::inputs_of(net, k) * net.width[k + 1]), kRounding)
        << "weight " << k;
    EXPECT_LT(apart(found, expected, net.bias[k], net.width[k + 1]), kRounding) << "bias " << k;
    if (net.team_weight[k] < 0) continue;
    EXPECT_LT(apart(found, expected, net.team_weight[k], net.width[k] * net.width[k + 1]), kRounding)
        << "team weight " << k;
  }
}

/// A kernel for inputs of so many numbers at most, and its threads.
struct Shape {
  int input, threads;
};
constexpr Shape kNarrow[] = {{64, 512}, {128, 512}, {192, 256}};  // of networks of up to 64
constexpr Shape kBroad[] = {{64, 256}, {128, 256}, {192, 256}};
const Shape& shape_of(const FusedMlp& net) {
  const Shape* shape = net.is_narrow() ? kNarrow : kBroad;
  while (shape->input < net.width[0]) ++shape;
  return *shape;
}

class FusedGradientsAsPtx : public testing::TestWithParam<KernelCase> {
 protected:
  void SetUp() override {
    if (!has_ptx()) GTEST_SKIP() << "the build has no CUDA, and so no kernels";
  }
  static void run(const FusedActor& pass, ThreadOrder order) {
    const Shape& shape = shape_of(pass.net);
    const bool narrow = pass.net.is_narrow();
    ptx_module(narrow ? "ppo_actor" : "ppo_block_actor")
        .launch({cat("ShapeILi", shape.input, "E")}, pass.n_partial, shape.threads, kSharedBytes, pass, order);
  }
  static void run(FusedCritic pass, ThreadOrder order) {
    const Shape& shape = shape_of(pass.net);
    const bool narrow = pass.net.is_narrow();
    const int team = pass.net.team_weight[1] >= 0 ? 1 : 0, gradient = pass.values ? 0 : 1;
    Guarded<uint32_t> kept(kept_words(pass.net, pass.rows.n, pass.rows.n_states, pass.n_partial));
    pass.kept = kept.data();
    if (pass.net.reads_state()) {
      ptx_module("ppo_state_critic")
          .launch({cat("StateShapeILi", narrow ? 64 : 128, "EEELb", gradient, "EEEv")}, pass.n_partial, 256,
                  kSharedBytes, pass, order);
    } else {
      const std::string flags = narrow ? cat("EELb", gradient, "EEEv") : cat("EELb", team, "ELb", gradient, "EEEv");
      ptx_module(narrow ? "ppo_critic" : "ppo_block_critic")
          .launch({cat("ShapeILi", shape.input, "E"), flags}, pass.n_partial, shape.threads, kSharedBytes, pass, order);
    }
    EXPECT_TRUE(kept.intact()) << "what is kept of states, behind its end";
  }
  template <class Pass>
  void expect_the_same(const Pass& pass, const std::function<void(const Pass&)>& on_cpu) {
    const std::vector<double> expected = summed<Pass>(pass, kCpuParts, on_cpu);
    std::vector<float> first, bits;
    for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
      const auto found = summed<Pass>(
          pass, GetParam().blocks, [&](const Pass& p) { run(p, order); }, &bits);
      if (order == ThreadOrder::forward) {
        expect_near(pass.net, found, expected);
        if (pass.net.width[3] == kActionSize) {
          EXPECT_LT(apart(found, expected, pass.net.log_std, kActionSize), kRounding) << "log_std";
        }
        for (size_t k = static_cast<size_t>(pass.net.size); k < found.size(); ++k)
          EXPECT_NEAR(found[k], expected[k], 0.01 * std::fabs(expected[k]) + 0.01)
              << "sum " << k - static_cast<size_t>(pass.net.size);
        first = bits;
      }
      for (size_t k = 0; k < bits.size(); ++k)
        ASSERT_TRUE(std::bit_cast<uint32_t>(bits[k]) == std::bit_cast<uint32_t>(first[k]))
            << "number " << k << " depends on the order of threads " << static_cast<int>(order);
    }
  }
  void expect_the_critics_gradient() {
    const Setting s(GetParam());
    expect_the_same<FusedCritic>(s.critic_pass(), [&](const FusedCritic& pass) { run_critic_gradient(pass, pool_); });
  }
  void expect_the_values() {
    const Setting s(GetParam());
    FusedCritic pass = s.critic_pass();
    pass.n_partial = GetParam().blocks;
    std::vector<float> expected(s.alive.size(), NAN), first;
    pass.values = expected.data();
    run_critic_gradient(pass, pool_);
    for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
      Guarded<float> values(s.n_rows());
      pass.values = values.data();
      run(pass, order);
      EXPECT_TRUE(values.intact()) << "values behind those of the last row";
      const std::vector<float> found = values.numbers();
      if (order == ThreadOrder::forward) first = found;
      for (size_t k = 0; k < found.size(); ++k) {
        ASSERT_EQ(std::isnan(found[k]), std::isnan(expected[k])) << k;
        if (std::isnan(found[k])) continue;
        EXPECT_NEAR(found[k], expected[k], 3 * kRounding) << k;
        EXPECT_EQ(found[k], first[k]) << k << ", the order of threads " << static_cast<int>(order);
      }
    }
  }
  const ThreadPool pool_{1};
};
/// Of critics of the true state.
class StateGradientsAsPtx : public FusedGradientsAsPtx {};

TEST_P(FusedGradientsAsPtx, OfTheActor) {
  const Setting s(GetParam());
  expect_the_same<FusedActor>(s.actor_pass(), [&](const FusedActor& pass) { run_actor_gradient(pass, pool_); });
}

TEST_P(FusedGradientsAsPtx, OfTheCritic) { expect_the_critics_gradient(); }
TEST_P(FusedGradientsAsPtx, Values) { expect_the_values(); }
TEST_P(StateGradientsAsPtx, OfTheCritic) { expect_the_critics_gradient(); }
TEST_P(StateGradientsAsPtx, Values) { expect_the_values(); }

INSTANTIATE_TEST_SUITE_P(All, FusedGradientsAsPtx, testing::ValuesIn(observation_cases()),
                         [](const auto& p) { return std::string(p.param.name); });
INSTANTIATE_TEST_SUITE_P(All, StateGradientsAsPtx, testing::ValuesIn(state_cases()),
                         [](const auto& p) { return std::string(p.param.name); });

}  // namespace
}  // namespace giga::test
