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
#include "cuda/ppo_wide.hpp"
#include "kernels/ptx_files.hpp"
#include "kernels/ptx_module.hpp"
#include "kernels/setting.hpp"
#include "policy/cpu_kernels.hpp"

namespace giga::test {
namespace {

/// The sum over the rows of `partial`, which `compute(pass)` fills; NaN where it does not.
template <class Pass>
std::vector<double> summed(Pass pass, int n_partial, int rows, const std::function<void(const Pass&)>& compute,
                           std::vector<float>* bits = nullptr) {
  const auto stride = static_cast<size_t>(pass.net.size + kFusedSums);
  Guarded<float> partial((pass.net.size + kFusedSums) * rows);
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
  const double rounding = net.activation == Activation::relu ? kJumps : kRounding;
  for (int k = 0; k < net.n_layers; ++k) {
    EXPECT_LT(apart(found, expected, net.weight[k], Setting::inputs_of(net, k) * net.width[k + 1]), rounding)
        << "weight " << k;
    EXPECT_LT(apart(found, expected, net.bias[k], net.width[k + 1]), rounding) << "bias " << k;
    if (net.team_weight[k] < 0) continue;
    EXPECT_LT(apart(found, expected, net.team_weight[k], net.width[k] * net.width[k + 1]), rounding)
        << "team weight " << k;
  }
}

/// A kernel for inputs of so many numbers at most, and its threads.
struct Shape {
  int input, threads;
};
constexpr Shape kNarrow[] = {{64, 512}, {96, 512}, {128, 512}, {192, 256}};  // of networks of up to 64
constexpr Shape kBroad[] = {{64, 256}, {128, 256}, {192, 256}};
const Shape& shape_of(const FusedMlp& net) {
  const Shape* shape = net.is_narrow() ? kNarrow : kBroad;
  while (shape->input < net.width[0]) ++shape;
  return *shape;
}

/// Queues the kernels of wide networks one after the other.
struct WideQueue {
  int blocks;
  ThreadOrder order;

  void operator()(const WideFirst& k) const {
    run("layers", {"first_kernel", cat("FirstShapeILi", WideLayers::padded_input(k.net), "E")}, blocks, k, 256);
  }
  void operator()(const WideTeamProduct& k) const {
    run("layers", {cat("product_kernelILb", k.forward ? 1 : 0, "E")}, blocks, k);
  }
  void operator()(const WideActor& k) const { run("actor", {"kernel"}, blocks, k); }
  void operator()(const WideCritic& k) const {
    const int team = k.of.net.team_weight[1] >= 0 ? 1 : 0, gradient = k.of.values ? 0 : 1;
    run("critic", {cat("kernelILb", team, "ELb", gradient, "E")}, blocks, k);
  }
  void operator()(const WideWeight& k) const {
    run("weights", {cat("WeightShapeILi", k.halved() ? 128 : 256, "ELi", k.inner_width, "E")}, k.blocks(blocks), k);
  }
  void operator()(const WideBack& k) const {
    const int team = k.piece.layers.means ? 1 : 0, weight = k.few_inputs() ? 1 : 0;
    run("layers", {cat("back_kernelILb", team, "ELb", weight, "E")}, blocks, k);
  }
  void operator()(const WideSums& k) const { run("weights", {"sums_kernel"}, k.blocks(), k); }

 private:
  template <class Step>
  void run(const char* file, const std::vector<std::string>& words, int n_blocks, const Step& step,
           int threads = 512) const {
    ptx_module(cat("ppo_wide_", file)).launch(words, {n_blocks}, threads, kSharedBytes, step, order);
  }
};

class FusedGradientsAsPtx : public testing::TestWithParam<KernelCase> {
 protected:
  void SetUp() override {
    if (!has_ptx()) GTEST_SKIP() << "the build has no CUDA, and so no kernels";
  }
  static void run(FusedActor pass, ThreadOrder order) {
    if (pass.net.is_wide()) {
      Guarded<uint32_t> work(WideLayers::words_for(pass.net, pass.rows.n, pass.rows.n_states, pass.n_partial));
      pass.wide = work.data();
      queue_wide_actor(pass, WideQueue{pass.n_partial, order});
      EXPECT_TRUE(work.intact()) << "work memory, behind its end";
      return;
    }
    const Shape& shape = shape_of(pass.net);
    const bool narrow = pass.net.is_narrow();
    ptx_module(narrow ? "ppo_actor" : "ppo_block_actor")
        .launch({cat("ShapeILi", shape.input, "E")}, {pass.n_partial}, shape.threads, kSharedBytes, pass, order);
  }
  static void run(FusedCritic pass, ThreadOrder order) {
    const Shape& shape = shape_of(pass.net);
    const bool narrow = pass.net.is_narrow();
    const int team = pass.net.team_weight[1] >= 0 ? 1 : 0, gradient = pass.values ? 0 : 1;
    if (pass.net.is_wide()) {
      const int value_tiles = pass.n_partial + 1;  // at once: one block has two
      Guarded<uint32_t> work(gradient ? WideLayers::words_for(pass.net, pass.rows.n, pass.rows.n_states, pass.n_partial)
                                      : WideLayers::words_for_values(pass.net, pass.rows.n, value_tiles));
      pass.wide = work.data();
      pass.wide_tiles = value_tiles;
      queue_wide_critic(pass, WideQueue{pass.n_partial, order});
      EXPECT_TRUE(work.intact()) << "work memory, behind its end";
      return;
    }
    Guarded<uint32_t> kept(kept_words(pass.net, pass.rows.n, pass.rows.n_states, pass.n_partial));
    pass.kept = kept.data();
    if (pass.net.reads_state()) {
      ptx_module("ppo_state_critic")
          .launch({cat("StateShapeILi", narrow ? 64 : 128, "EEELb", gradient, "EEEv")}, {pass.n_partial}, 256,
                  kSharedBytes, pass, order);
    } else {
      const std::string flags = narrow ? cat("EELb", gradient, "EEEv") : cat("EELb", team, "ELb", gradient, "EEEv");
      ptx_module(narrow ? "ppo_critic" : "ppo_block_critic")
          .launch({cat("ShapeILi", shape.input, "E"), flags}, {pass.n_partial}, shape.threads, kSharedBytes, pass,
                  order);
    }
    EXPECT_TRUE(kept.intact()) << "what is kept of states, behind its end";
  }
  template <class Pass>
  void expect_the_same(const Pass& pass, const std::function<void(const Pass&)>& on_cpu) {
    const std::vector<double> expected = summed<Pass>(pass, kCpuParts, kCpuParts, on_cpu);
    std::vector<float> first, bits;
    for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
      const auto found = summed<Pass>(
          pass, GetParam().blocks, partial_rows(pass.net, GetParam().blocks), [&](const Pass& p) { run(p, order); },
          &bits);
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

// A run that has diverged is recognised by its gradients. tanh of wide networks holds its argument below a limit.
TEST_P(FusedGradientsAsPtx, ANanStaysOne) {
  Setting s(GetParam());
  if (s.c.activation == Activation::relu) GTEST_SKIP() << "relu makes 0 of it, as on a CPU";
  s.actor_values[static_cast<size_t>(s.actor.bias[0])] = NAN;
  const int blocks = GetParam().blocks;
  const std::vector<double> sum = summed<FusedActor>(s.actor_pass(), blocks, partial_rows(s.actor, blocks),
                                                     [](const FusedActor& pass) { run(pass, ThreadOrder::forward); });
  EXPECT_TRUE(std::isnan(sum[static_cast<size_t>(s.actor.weight[1])]));
}

INSTANTIATE_TEST_SUITE_P(All, FusedGradientsAsPtx, testing::ValuesIn(observation_cases()),
                         [](const auto& p) { return std::string(p.param.name); });
INSTANTIATE_TEST_SUITE_P(All, StateGradientsAsPtx, testing::ValuesIn(state_cases()),
                         [](const auto& p) { return std::string(p.param.name); });

}  // namespace
}  // namespace giga::test
