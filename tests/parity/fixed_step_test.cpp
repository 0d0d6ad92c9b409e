// The step with the constants of one scenario against the general code, bit for bit over many episodes: as a GPU
// compiles it at run time, and as the GPU's threads would run it on the CPU.
#include <gtest/gtest.h>
#include <stdlib.h>

#include <memory>
#include <string>

#include "cuda/nvrtc.hpp"
#include "cuda/runtime.hpp"
#include "io/temporary_folder.hpp"
#include "parity/cases.hpp"
#include "parity/emulated_simulator.hpp"
#include "parity/odd_scenarios.hpp"
#include "sim/usual_params.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// Worlds of a block or two, with some left over.
SimOptions odd_options(const OddScenario& odd, int variant, int n_blocks) {
  const int n = odd.values.team_0 + odd.values.team_1, per_block = n > 16 ? 160 / n : 4 * (32 / n);
  return variant_options(0xF1D0, n_blocks * per_block + 1, variant);
}

constexpr const char* kFixedWay = "a kernel for this scenario";

/// Steps both and compares all that they have written, every `stride` steps.
void expect_same_steps(SimRunner& general, SimRunner& fixed, int n_steps, int stride, const std::string& where) {
  ASSERT_EQ(fixed.sim().step_way().substr(0, std::string(kFixedWay).size()), kFixedWay) << where;
  general.start();
  fixed.start();
  for (int k = 0; k < n_steps; ++k) {
    general.step(static_cast<uint64_t>(k));
    fixed.step(static_cast<uint64_t>(k));
    if (k % stride == stride - 1 || k + 1 == n_steps) {
      ASSERT_EQ(difference(general.snapshot(), fixed.snapshot()), "") << where << ", step " << k;
    }
  }
  const EpisodeStats stats = general.sim().take_stats();
  expect_same_stats(stats, fixed.sim().take_stats());
  EXPECT_GT(stats[EpisodeStat::episodes], 0) << where;
}

/// Dense rows, rows with a gap that nobody may touch, rows with zeros behind; other endings of an episode.
constexpr int kOddVariants = 6;
Outputs odd_outputs(int variant) {
  return variant == 5 ? Outputs::in_mirror : variant == 3 ? Outputs::by_world : Outputs::all;
}
int odd_row_step(int variant) { return variant % 3 == 0 ? 0 : variant % 3 == 1 ? 32 : SimRunner::kZerosBehind; }

const auto kOddName = [](const auto& test) { return test.param.name; };

class FixedStep : public ::testing::TestWithParam<OddScenario> {};

TEST_P(FixedStep, EmulatedIsTheCpus) {
  const OddScenario odd = GetParam();
  for (int variant = 0; variant < kOddVariants; ++variant) {
    const SimSpec spec = odd_spec(odd, static_cast<uint64_t>(variant));
    SimOptions options = odd_options(odd, variant, 1);
    SimRunner general(make_cpu_simulator(spec, options), odd_outputs(variant), odd_row_step(variant));
    options.compile_step = CompileStep::always;
    SimRunner fixed(make_emulated_simulator(spec, options, static_cast<ThreadOrder>(variant % 3)), odd_outputs(variant),
                    odd_row_step(variant));
    expect_same_steps(general, fixed, parity_is_small() ? 24 : 40, 1, cat(odd.name, ", variant ", variant));
  }
}

INSTANTIATE_TEST_SUITE_P(Emulated, FixedStep, ::testing::ValuesIn(kOddScenarios), kOddName);

/// What these tests compile is kept for each other, in a folder that goes with them, and apart from the user's.
void use_cache_of_tests() {
  static const TemporaryFolder folder;
  ::setenv("GIGASTEP_CACHE_DIR", folder.path().c_str(), 1);
}

class FixedStepGpu : public ::testing::TestWithParam<OddScenario> {
 protected:
  void SetUp() override {
    if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
    if (const Nvrtc nvrtc; !nvrtc.missing().empty()) GTEST_SKIP() << "skipped: " << nvrtc.missing();
    use_cache_of_tests();
  }
};

TEST_P(FixedStepGpu, CompiledIsTheGeneral) {
  const OddScenario odd = GetParam();
  for (int variant = 0; variant < kOddVariants; ++variant) {
    const SimSpec spec = odd_spec(odd, static_cast<uint64_t>(variant));
    SimOptions options = odd_options(odd, variant, parity_is_small() ? 2 : 40);
    SimRunner general(make_cuda_simulator(spec, options, 0), odd_outputs(variant), odd_row_step(variant));
    options.compile_step = CompileStep::always;
    SimRunner fixed(make_cuda_simulator(spec, options, 0), odd_outputs(variant), odd_row_step(variant));
    const int n_steps = parity_is_small() ? 24 : 300;
    expect_same_steps(general, fixed, n_steps, 20, cat(odd.name, ", variant ", variant));
  }
}

INSTANTIATE_TEST_SUITE_P(Gpu, FixedStepGpu, ::testing::ValuesIn(kOddScenarios), kOddName);

// Games record their steps.
TEST(FixedStepRecordedGpu, ReplaysTheCompiledStep) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  if (const Nvrtc nvrtc; !nvrtc.missing().empty()) GTEST_SKIP() << "skipped: " << nvrtc.missing();
  use_cache_of_tests();
  const SimSpec spec = odd_spec(kOddScenarios[0], 0);
  SimOptions options = odd_options(kOddScenarios[0], 0, 40);
  SimRunner general(make_cuda_simulator(spec, options, 0, work_stream(0)));
  options.compile_step = CompileStep::always;
  SimRunner fixed(make_cuda_simulator(spec, options, 0, work_stream(0)));
  for (SimRunner* runner : {&general, &fixed}) {
    runner->start();
    runner->step(0);
    const std::unique_ptr<RecordedWork> recorded = runner->record_step();
    ASSERT_NE(recorded, nullptr);
    for (int k = 0; k < 100; ++k) {
      runner->sim().begin_steps(1);
      recorded->queue();
    }
    runner->sim().synchronize();
  }
  EXPECT_EQ(difference(general.snapshot(), fixed.snapshot()), "");
}

// By default what no kernel of the program is for.
TEST(FixedStepWayGpu, FollowsTheOption) {
  const auto usual_of = [](int n) {
    SimSpec spec = plain_spec(n, n);
    spec.params.actions = ActionKind::discrete;
    spec.params.stochastic_detection = spec.params.stochastic_communication = true;
    spec.params.egocentric_view = n == 20;
    spec.finish();
    return spec;
  };
  const SimSpec usual = usual_of(5), with_view = usual_of(20);
  ASSERT_TRUE(UsualParams<5>::fits(usual.params) && UsualParams<20>::fits(with_view.params));
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  if (const Nvrtc nvrtc; !nvrtc.missing().empty()) GTEST_SKIP() << "skipped: " << nvrtc.missing();
  use_cache_of_tests();
  const auto way = [](SimSpec spec, CompileStep compile) {
    spec.finish();
    SimOptions options;
    options.n_worlds = 3;
    options.compile_step = compile;
    return make_cuda_simulator(std::move(spec), options, 0)->step_way();
  };
  const SimSpec odd = odd_spec(kOddScenarios[0], 0), large = plain_spec(21, 20);
  using enum CompileStep;
  EXPECT_EQ(way(usual, never), "a kernel for usual scenarios");
  EXPECT_EQ(way(usual, automatic), "a kernel for usual scenarios");
  // Its block takes more shared memory than a kernel has unasked.
  EXPECT_EQ(way(with_view, automatic), "a kernel for usual scenarios");
  EXPECT_TRUE(way(usual, always).starts_with("a kernel for this scenario ("));
  EXPECT_EQ(way(odd, never), "the general kernel (none was to be compiled for this scenario)");
  EXPECT_TRUE(way(odd, automatic).starts_with("a kernel for this scenario ("));
  EXPECT_EQ(way(large, always), "the general kernel (it has 41 agents, and steps are compiled for up to 40)");
}

}  // namespace
}  // namespace giga::test
