// CPU against CUDA, bit for bit: every state field and every output, step by step from identical states and over whole
// trajectories, for team sizes that exercise every way of spreading a world over threads.
// GIGASTEP_PARITY_SMALL=1 cuts the sizes, for compute-sanitizer.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

bool small() {
  const char* text = std::getenv("GIGASTEP_PARITY_SMALL");
  return text && std::string(text) == "1";
}

/// Sizes of a test. TileLanes serve up to 32 agents: 16, 8, 3, 3 and 1 worlds a warp; BlockLanes the rest: the scratch
/// of 200 v 200 does not fit into shared memory.
struct Case {
  int n_team_0, n_team_1;
  int n_worlds, n_variants, n_steps;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << c.n_team_0 << " v " << c.n_team_1 << ", " << c.n_worlds << " worlds";
}
const Case kCases[] = {
    {1, 1, 65, 24, 60},  {2, 2, 65, 24, 60},   {5, 5, 65, 24, 60},  {7, 3, 65, 24, 60},   {16, 16, 65, 24, 60},
    {1, 12, 65, 11, 60}, {20, 20, 65, 11, 60}, {40, 30, 65, 6, 60}, {200, 200, 5, 4, 12},
};

Case cut(Case c) {
  if (!small()) return c;
  c.n_worlds = c.n_team_0 >= 100 ? 2 : (c.n_team_0 >= 20 ? 3 : 13);
  c.n_variants = 3;
  c.n_steps = c.n_team_0 >= 100 ? 3 : 8;
  return c;
}

/// Variant 0 has every switch on, 1 none, then each one alone and each one missing; the rest of the scenario is random.
SimSpec variant_of(const Case& c, int variant) {
  const uint64_t seed = static_cast<uint64_t>(1000 * variant + 31 * c.n_team_0 + c.n_team_1);
  SimSpec spec = random_spec(seed, c.n_team_0, c.n_team_1);
  const unsigned all = kNSwitchMasks - 1;
  unsigned mask = variant == 0 ? all : 0;
  if (variant >= 2) mask = 1u << (static_cast<unsigned>(variant - 2) / 2 % kNSwitches);
  if (variant >= 2 && variant % 2) mask = all ^ mask;
  set_switches(spec, mask);
  spec.params.max_episode_length = variant % 5 == 4 ? 0 : 5 + variant % 9;
  spec.finish();
  return spec;
}

SimOptions options_of(const Case& c, int variant) {
  SimOptions options;
  options.n_worlds = c.n_worlds;
  options.seed = 0x123456789ABCull + static_cast<uint64_t>(variant);
  options.first_world = variant % 3 == 2 ? 100000 : 0;
  options.draw_period = variant % 7 == 6 ? 5 : 0;
  options.on_done = variant % 4 == 3 ? (variant % 8 == 3 ? OnDone::freeze : OnDone::keep) : OnDone::reset;
  return options;
}

std::unique_ptr<Simulator> cpu(const SimSpec& spec, const SimOptions& options) {
  return make_cpu_simulator(spec, options);
}
std::unique_ptr<Simulator> gpu(const SimSpec& spec, const SimOptions& options) {
  return make_cuda_simulator(spec, options, 0);
}

/// Every third variant has rows of a multiple of 32 numbers, with a gap that nobody may touch.
int stride_of(const SimSpec& spec, int variant) {
  return variant % 3 == 1 ? spec.observation_size() / 32 * 32 + 32 : 0;
}

/// Counts of episodes are sums of whole numbers, hence exact; sums of returns are doubles added in another order.
void expect_same_stats(const EpisodeStats& a, const EpisodeStats& b) {
  for (size_t row = 0; row < a.rows.size(); ++row) {
    const double tolerance = row < static_cast<size_t>(EpisodeStat::return_0) ? 0 : 1e-9 * (1 + std::abs(a.rows[row]));
    EXPECT_NEAR(a.rows[row], b.rows[row], tolerance) << "statistics row " << row;
  }
}

class GpuParity : public ::testing::TestWithParam<Case> {
 protected:
  void SetUp() override {
    if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  }
};

TEST_P(GpuParity, StepByStepFromTheSameState) {
  const Case c = cut(GetParam());
  Activity activity;
  for (int variant = 0; variant < c.n_variants; ++variant) {
    const SimSpec spec = variant_of(c, variant);
    const SimOptions options = options_of(c, variant);
    SimRunner on_cpu(cpu(spec, options), Outputs::all, stride_of(spec, variant));
    SimRunner on_gpu(gpu(spec, options), Outputs::all, stride_of(spec, variant));
    on_cpu.start();
    on_gpu.start();
    ASSERT_EQ(difference(on_cpu.snapshot(), on_gpu.snapshot()), "") << "variant " << variant << ", start";
    for (int k = 0; k < c.n_steps / 3; ++k) {
      on_gpu.sim().state().load(on_cpu.sim().state().save());
      on_gpu.observe();
      ASSERT_EQ(difference(observations(on_cpu.snapshot()), observations(on_gpu.snapshot())), "")
          << "variant " << variant << ", observe before step " << k;
      on_cpu.step(static_cast<uint64_t>(k));
      on_gpu.step(static_cast<uint64_t>(k));
      const Snapshot expected = on_cpu.snapshot();
      ASSERT_EQ(difference(expected, on_gpu.snapshot()), "") << "variant " << variant << ", step " << k;
      activity.add(expected);
    }
  }
  if (!small()) {
    EXPECT_GT(activity.detections, 0);
    EXPECT_GT(activity.dead, 0);
  }
}

TEST_P(GpuParity, WholeTrajectories) {
  const Case c = cut(GetParam());
  Activity activity;
  for (int variant = 0; variant < c.n_variants; ++variant) {
    const SimSpec spec = variant_of(c, variant);
    const SimOptions options = options_of(c, variant);
    SimRunner on_cpu(cpu(spec, options), Outputs::all, stride_of(spec, variant));
    SimRunner on_gpu(gpu(spec, options), Outputs::all, stride_of(spec, variant));
    on_cpu.start();
    on_gpu.start();
    for (int k = 0; k < c.n_steps; ++k) {
      on_cpu.step(static_cast<uint64_t>(1000 + k));
      on_gpu.step(static_cast<uint64_t>(1000 + k));
      if (k % 10 != 9 && k + 1 != c.n_steps) continue;
      const Snapshot expected = on_cpu.snapshot();
      ASSERT_EQ(difference(expected, on_gpu.snapshot()), "") << "variant " << variant << ", step " << k;
      activity.add(expected);
    }
    expect_same_stats(on_cpu.sim().take_stats(), on_gpu.sim().take_stats());
    const EpisodeStats again = on_gpu.sim().take_stats();
    for (const double row : again.rows) EXPECT_EQ(row, 0) << "read once";
  }
  if (!small()) {
    EXPECT_GT(activity.dead, 0);
    EXPECT_GT(activity.shots, 0);
    EXPECT_GT(activity.waypoints, 0);
  }
}

// The worlds that play are listed, and the last ones have a warp each.
TEST_P(GpuParity, WorldsThatFreezeOneAfterTheOther) {
  const Case c = cut(GetParam());
  for (const auto& [variant, episodes] : {std::pair{0, 1}, {4, 1}, {5, 1}, {0, 3}, {5, 2}}) {
    SimSpec spec = variant_of(c, variant);
    spec.params.max_episode_length = c.n_steps / episodes;
    SimOptions options = options_of(c, variant);
    options.on_done = OnDone::freeze;
    options.episodes = episodes;
    const Outputs outputs = spec.params.body_view && episodes > 1 ? Outputs::body_view : Outputs::observations;
    SimRunner on_cpu(cpu(spec, options), outputs, stride_of(spec, variant));
    SimRunner on_gpu(gpu(spec, options), outputs, stride_of(spec, variant));
    on_cpu.start();
    on_gpu.start();
    for (int k = 0; k < c.n_steps; ++k) {
      on_cpu.step(static_cast<uint64_t>(2000 + k));
      on_gpu.step(static_cast<uint64_t>(2000 + k));
      ASSERT_EQ(difference(on_cpu.snapshot(), on_gpu.snapshot()), "") << "variant " << variant << ", step " << k;
    }
    const EpisodeStats stats = on_cpu.sim().take_stats();
    EXPECT_TRUE(on_cpu.sim().over());
    EXPECT_EQ(stats[EpisodeStat::episodes], c.n_worlds * episodes) << "all worlds have ended";
    expect_same_stats(stats, on_gpu.sim().take_stats());
  }
}

TEST_P(GpuParity, OutputsThatNobodyWantsChangeNothing) {
  Case c = cut(GetParam());
  const SimSpec spec = variant_of(c, 0);
  const SimOptions options = options_of(c, 0);
  SimRunner with(gpu(spec, options)), without(gpu(spec, options), Outputs::none);
  with.start();
  without.start();
  for (int k = 0; k < c.n_steps / 3; ++k) {
    with.step(static_cast<uint64_t>(k));
    without.step(static_cast<uint64_t>(k));
  }
  Snapshot state = with.snapshot();
  const Snapshot bare = without.snapshot();
  state.fields.resize(bare.fields.size());
  EXPECT_EQ(difference(state, bare), "");
}

INSTANTIATE_TEST_SUITE_P(Sizes, GpuParity, ::testing::ValuesIn(kCases),
                         [](const auto& test) { return cat(test.param.n_team_0, "v", test.param.n_team_1); });

TEST(GpuSimulators, TwoScenariosSideBySide) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  // No global state: two simulators stepped in turn give what each gives alone.
  const Case a{5, 5, 7, 1, 6}, b{20, 20, 3, 1, 6};
  SimRunner cpu_a(cpu(variant_of(a, 0), options_of(a, 0))), gpu_a(gpu(variant_of(a, 0), options_of(a, 0)));
  SimRunner cpu_b(cpu(variant_of(b, 1), options_of(b, 1))), gpu_b(gpu(variant_of(b, 1), options_of(b, 1)));
  for (SimRunner* runner : {&cpu_a, &gpu_a, &cpu_b, &gpu_b}) runner->start();
  for (uint64_t k = 0; k < 6; ++k)
    for (SimRunner* runner : {&gpu_a, &gpu_b, &cpu_a, &cpu_b}) runner->step(k);
  EXPECT_EQ(difference(cpu_a.snapshot(), gpu_a.snapshot()), "");
  EXPECT_EQ(difference(cpu_b.snapshot(), gpu_b.snapshot()), "");
}

}  // namespace
}  // namespace giga::test
