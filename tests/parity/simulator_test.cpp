// The CPU back end against the executors of the GPU, bit for bit: every state field and every output, step by step from
// identical states and over whole trajectories, for team sizes that exercise every way of spreading a world over
// threads. Each test runs twice: on a GPU where there is one, and everywhere with the GPU's threads run by the CPU.
// GIGASTEP_PARITY_SMALL=1 cuts the sizes, for compute-sanitizer; a build with the address sanitizer does so by itself.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <tuple>
#include <vector>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "parity/cases.hpp"
#include "parity/emulated_simulator.hpp"
#include "sim/usual_params.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// Who runs the threads of the GPU back end.
enum class Executor { gpu, emulated };
void PrintTo(Executor executor, std::ostream* out) { *out << (executor == Executor::gpu ? "GPU" : "emulated"); }

/// Sizes of a test. TileLanes serve up to 32 agents: 16, 8, 3, 3, 1, 2 and 1 worlds a warp; BlockLanes the rest: the
/// scratch of 200 v 200 does not fit into shared memory.
struct Case {
  int n_team_0, n_team_1;
  int n_worlds, n_variants, n_steps;
  bool thin = false;   // too little happens to expect all of it
  bool usual = false;  // scenarios for which UsualParams serve
  Play play = Play::fight;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << c.n_team_0 << " v " << c.n_team_1 << ", " << c.n_worlds << " worlds";
}
const Case kCases[] = {
    {1, 1, 65, 24, 60},  {2, 2, 65, 24, 60},   {5, 5, 65, 24, 60},   {7, 3, 65, 24, 60},  {16, 16, 65, 24, 60},
    {1, 12, 65, 11, 60}, {10, 10, 65, 11, 60}, {20, 20, 65, 11, 60}, {40, 30, 65, 6, 60}, {200, 200, 5, 4, 12},
};
/// Those for which a GPU has kernels with constants (usual_params.hpp): 16 to 2 worlds a warp, and 8, 4 and 6 a block.
constexpr Case usual_case(int n_team_0, int n_team_1, Play play = Play::fight) {
  return {n_team_0, n_team_1, 65, 6, 60, true, true, play};
}
const Case kUsualCases[] = {
    usual_case(2, 2),
    usual_case(5, 5),
    usual_case(10, 10),
    usual_case(20, 20),
    usual_case(1, 1),
    usual_case(5, 1),
    usual_case(5, 3),
    usual_case(10, 3),
    usual_case(20, 5),
    usual_case(5, 5, Play::hide_and_seek),
    usual_case(5, 10, Play::hide_and_seek),
    usual_case(10, 5, Play::hide_and_seek),
    usual_case(5, 5, Play::waypoints),
    usual_case(5, 3, Play::waypoints),
    usual_case(3, 3, Play::waypoints),
    usual_case(5, 5, Play::published),
};

/// As many worlds, variants and steps as the executor has time for.
Case cut(Case c, Executor executor) {
  if (executor == Executor::gpu && !parity_is_small()) return c;
  const bool large = c.n_team_0 >= 100;
  c.thin = true;
  c.n_worlds = large ? 2 : (c.n_team_0 >= 20 ? 3 : 13);
  c.n_variants = 4;
  c.n_steps = large ? 3 : 8;
  if (executor == Executor::gpu) return c;
  const int n = c.n_team_0 + c.n_team_1;
  if (n <= 32 || c.usual) c.n_worlds = (c.usual && n > 16 ? 160 / n : 4 * (32 / n)) + 1;  // a block, one of the next
  c.n_variants = large || parity_is_small() ? 4 : 8;
  c.n_steps = large ? 6 : (parity_is_small() ? 12 : 24);
  return c;
}

/// Turns a scenario into one for which the constants of UsualParams hold; everything else stays as it is. Agents of a
/// team differ where the teams do.
void make_usual(SimSpec& spec, const Case& c) {
  SimParams& p = spec.params;
  if (c.play != Play::published) p.rules = Rules::corrected;
  p.actions = ActionKind::discrete;
  p.stochastic_detection = p.stochastic_communication = c.play != Play::published;
  p.waypoints = c.play == Play::waypoints;
  p.has_term_factors = false;
  p.obstacle_heights = p.obstacles_block_sight = p.sight_3d = false;
  p.cone_is_full = c.play == Play::published;
  p.damage_cone_is_full = c.play == Play::hide_and_seek;
  spec.neighbor_limit = 15;
  std::stable_sort(spec.agents.begin(), spec.agents.end(),
                   [](const AgentSpec& a, const AgentSpec& b) { return a.team < b.team; });
  for (AgentSpec& agent : spec.agents) {
    agent.idle_reward = c.play == Play::hide_and_seek && agent.team == 1 ? 1.0f : 0.0f;
    if (c.n_team_0 == c.n_team_1) agent.sprite = 1 + agent.team;
  }
}

SimSpec variant_of(const Case& c, int variant) {
  SimSpec spec = variant_spec(1000, c.n_team_0, c.n_team_1, variant);
  if (c.usual) make_usual(spec, c);
  spec.finish();
  bool usual = false;
  with_usual_params<true>(spec.params, [&]<class P>(const P&) { usual = P::kTeam > 0; });
  EXPECT_TRUE(usual || !c.usual);
  return spec;
}

SimOptions options_of(const Case& c, int variant) {
  SimOptions options = variant_options(0x123456789ABC, c.n_worlds, variant);
  options.draw_period = variant % 7 == 6 ? 5 : 0;
  return options;
}

std::unique_ptr<Simulator> cpu(const SimSpec& spec, const SimOptions& options) {
  return make_cpu_simulator(spec, options);
}
/// The simulator that is held against the CPU's. The order of emulated threads changes from variant to variant.
std::unique_ptr<Simulator> other(Executor executor, const SimSpec& spec, const SimOptions& options, int variant) {
  if (executor == Executor::gpu) return make_cuda_simulator(spec, options, 0);
  return make_emulated_simulator(spec, options, static_cast<ThreadOrder>(variant % 3));
}

/// Of three variants one has dense rows, one rows of a multiple of 32 numbers with a gap that nobody may touch, and one
/// rows with zeros behind.
int row_step_of(int variant) { return variant % 3 == 0 ? 0 : variant % 3 == 1 ? 32 : SimRunner::kZerosBehind; }

int count_in(const Snapshot& snapshot, Phase phase) {
  int count = 0;
  for (const uint8_t byte : snapshot.field("phase").bytes) count += static_cast<Phase>(byte) == phase;
  return count;
}

/// Ages at which most episodes end in the next 5 steps, and those of worlds 0, 13, 26 ... last on.
void set_ages(SimRunner& runner, int limit) {
  SimState& state = runner.sim().state();
  SimState on_host(runner.sim().params().n_agents, runner.sim().n_worlds(), host_memory());
  on_host.load(state.save());
  for (int w = 0; w < runner.sim().n_worlds(); ++w)
    on_host.view().episode_length[w] = w % 13 == 0 ? 0 : std::max(0, limit - 1 - w % 5);
  state.load(on_host.save());
}

class SimulatorParity : public ::testing::TestWithParam<std::tuple<Executor, Case>> {
 protected:
  void SetUp() override {
    if (executor_ == Executor::gpu && cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  }
  SimRunner on_cpu(int variant, const SimSpec& spec, const SimOptions& options, Outputs outputs = Outputs::all) const {
    return SimRunner(cpu(spec, options), outputs, row_step_of(variant));
  }
  SimRunner on_other(int variant, const SimSpec& spec, const SimOptions& options,
                     Outputs outputs = Outputs::all) const {
    return SimRunner(other(executor_, spec, options, variant), outputs, row_step_of(variant));
  }

  /// Steps that are looked at one by one: 5 suffice, for the more variants.
  int n_single_steps() const { return case_.thin ? 5 : std::max(5, case_.n_steps / 3); }
  int n_single_variants() const {
    return executor_ == Executor::emulated && !parity_is_small() ? std::get<1>(GetParam()).n_variants
                                                                 : case_.n_variants;
  }

  const Executor executor_ = std::get<0>(GetParam());
  const Case case_ = cut(std::get<1>(GetParam()), executor_);
};

// Worlds that wait keep the observations of their last step, and `observe` writes them again as all others.
TEST_P(SimulatorParity, StepByStepFromTheSameState) {
  Activity activity;
  int waiting = 0;  // worlds, over all steps
  for (int variant = 0; variant < n_single_variants(); ++variant) {
    SimSpec spec = variant_of(case_, variant);
    const SimOptions options = options_of(case_, variant);
    if (options.on_done == OnDone::freeze) spec.params.max_episode_length = 3;
    SimRunner a = on_cpu(variant, spec, options), b = on_other(variant, spec, options);
    a.start();
    b.start();
    Snapshot now = a.snapshot(), written = observations(now);
    ASSERT_EQ(difference(now, b.snapshot()), "") << "variant " << variant << ", start";
    for (int k = 0; k < n_single_steps(); ++k) {
      waiting += count_in(now, Phase::waits);
      b.sim().state().load(a.sim().state().save());
      a.observe();
      b.observe();
      ASSERT_EQ(difference(written, observations(a.snapshot())), "")
          << "variant " << variant << ", CPU, observe before step " << k;
      ASSERT_EQ(difference(written, observations(b.snapshot())), "")
          << "variant " << variant << ", observe before step " << k;
      a.step(static_cast<uint64_t>(k));
      b.step(static_cast<uint64_t>(k));
      const Snapshot before = std::move(now);
      now = a.snapshot();
      ASSERT_EQ(difference(now, b.snapshot()), "") << "variant " << variant << ", step " << k;
      keep_observations(written, before, now);
      activity.add(now);
    }
  }
  EXPECT_GT(waiting, 0);
  if (!case_.thin) {
    EXPECT_GT(activity.detections, 0);
    EXPECT_GT(activity.dead, 0);
  }
}

TEST_P(SimulatorParity, WholeTrajectories) {
  Activity activity;
  for (int variant = 0; variant < case_.n_variants; ++variant) {
    const SimSpec spec = variant_of(case_, variant);
    const SimOptions options = options_of(case_, variant);
    SimRunner a = on_cpu(variant, spec, options), b = on_other(variant, spec, options);
    a.start();
    b.start();
    for (int k = 0; k < case_.n_steps; ++k) {
      a.step(static_cast<uint64_t>(1000 + k));
      b.step(static_cast<uint64_t>(1000 + k));
      if (k % 10 != 9 && k + 1 != case_.n_steps) continue;
      const Snapshot expected = a.snapshot();
      ASSERT_EQ(difference(expected, b.snapshot()), "") << "variant " << variant << ", step " << k;
      activity.add(expected);
    }
    expect_same_stats(a.sim().take_stats(), b.sim().take_stats());
    const EpisodeStats again = b.sim().take_stats();
    for (const double row : again.rows) EXPECT_EQ(row, 0) << "read once";
  }
  if (!case_.thin) {
    EXPECT_GT(activity.dead, 0);
    EXPECT_GT(activity.shots, 0);
    EXPECT_GT(activity.waypoints, 0);
  }
}

// The worlds that play are listed, and the last ones have a warp each.
TEST_P(SimulatorParity, WorldsThatFreezeOneAfterTheOther) {
  int last_ones = 0;  // on the second list, over the variants
  for (const auto& [variant, episodes] : {std::pair{0, 1}, {4, 1}, {5, 1}, {0, 3}, {5, 2}}) {
    SimSpec spec = variant_of(case_, variant);
    spec.params.max_episode_length = case_.n_steps / episodes;
    SimOptions options = options_of(case_, variant);
    options.on_done = OnDone::freeze;
    options.episodes = episodes;
    const Outputs some = variant == 4 ? Outputs::in_mirror : variant == 5 ? Outputs::by_world : Outputs::observations;
    const Outputs outputs = spec.params.egocentric_view && episodes > 1 ? Outputs::egocentric : some;
    SimRunner a = on_cpu(variant, spec, options, outputs), b = on_other(variant, spec, options, outputs);
    for (SimRunner* runner : {&a, &b}) {
      runner->start();
      set_ages(*runner, spec.params.max_episode_length);
    }
    for (int k = 0; k < case_.n_steps; ++k) {
      a.step(static_cast<uint64_t>(2000 + k));
      b.step(static_cast<uint64_t>(2000 + k));
      const Snapshot now = a.snapshot();
      ASSERT_EQ(difference(now, b.snapshot()), "") << "variant " << variant << ", step " << k;
      if (k + 1 == kListPeriod && episodes == 1) last_ones += count_in(now, Phase::plays);
    }
    const EpisodeStats stats = a.sim().take_stats();
    EXPECT_TRUE(a.sim().over());
    EXPECT_EQ(stats[EpisodeStat::episodes], case_.n_worlds * episodes) << "all worlds have ended";
    expect_same_stats(stats, b.sim().take_stats());
  }
  // 5 of 65 worlds at most, where two blocks of 4 warps have room for 8.
  EXPECT_LE(last_ones, 3 * (case_.n_worlds + 12) / 13);
  if (case_.n_steps > kListPeriod) {
    EXPECT_GT(last_ones, 0);
  }
}

TEST_P(SimulatorParity, ThatAllWorldsWaitIsKnownWhateverIsWritten) {
  SimSpec spec = variant_of(case_, 0);
  spec.params.max_episode_length = 3;
  SimOptions options = options_of(case_, 0);
  options.on_done = OnDone::freeze;
  SimRunner runner = on_other(0, spec, options, Outputs::all);  // rewards and ends of episodes too
  runner.start();
  for (uint64_t k = 0; k < 4 * kListPeriod; ++k) runner.step(k);
  EXPECT_TRUE(runner.sim().over());
}

// A state in which more worlds play than did before: the list of the playing worlds is made anew.
TEST_P(SimulatorParity, LoadedStatePlaysOn) {
  SimSpec spec = variant_of(case_, 0);
  spec.params.max_episode_length = 3;
  SimOptions options = options_of(case_, 0);
  options.on_done = OnDone::freeze;
  SimRunner a = on_cpu(0, spec, options, Outputs::observations);
  SimRunner b = on_other(0, spec, options, Outputs::observations);
  a.start();
  b.start();
  const std::vector<uint8_t> started = a.sim().state().save();
  for (uint64_t k = 0; k < 10; ++k) b.step(k);  // the list of step 8 is empty
  b.sim().state().load(started);
  EXPECT_FALSE(b.sim().over());
  a.step(7);
  b.step(7);
  EXPECT_EQ(a.snapshot().field("episode_length").bytes[0], 1);
  EXPECT_EQ(difference(a.snapshot(), b.snapshot()), "");
}

TEST_P(SimulatorParity, OutputsThatNobodyWantsChangeNothing) {
  const SimSpec spec = variant_of(case_, 0);
  const SimOptions options = options_of(case_, 0);
  SimRunner with(other(executor_, spec, options, 0)), without(other(executor_, spec, options, 1), Outputs::none);
  with.start();
  without.start();
  for (int k = 0; k < n_single_steps(); ++k) {
    with.step(static_cast<uint64_t>(k));
    without.step(static_cast<uint64_t>(k));
  }
  Snapshot state = with.snapshot();
  const Snapshot bare = without.snapshot();
  state.fields.resize(bare.fields.size());
  EXPECT_EQ(difference(state, bare), "");
}

const auto kName = [](const auto& test) {
  const Case& c = std::get<1>(test.param);
  constexpr const char* kPlays[] = {"", "hide", "waypoints", "published"};
  return cat(c.n_team_0, "v", c.n_team_1, kPlays[static_cast<int>(c.play)]);
};
INSTANTIATE_TEST_SUITE_P(GpuUsual, SimulatorParity,
                         ::testing::Combine(::testing::Values(Executor::gpu), ::testing::ValuesIn(kUsualCases)), kName);
INSTANTIATE_TEST_SUITE_P(Gpu, SimulatorParity,
                         ::testing::Combine(::testing::Values(Executor::gpu), ::testing::ValuesIn(kCases)), kName);
INSTANTIATE_TEST_SUITE_P(EmulatedUsual, SimulatorParity,
                         ::testing::Combine(::testing::Values(Executor::emulated), ::testing::ValuesIn(kUsualCases)),
                         kName);
INSTANTIATE_TEST_SUITE_P(Emulated, SimulatorParity,
                         ::testing::Combine(::testing::Values(Executor::emulated), ::testing::ValuesIn(kCases)), kName);

class Simulators : public ::testing::TestWithParam<Executor> {};

TEST_P(Simulators, TwoScenariosSideBySide) {
  const Executor executor = GetParam();
  if (executor == Executor::gpu && cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  // No global state: two simulators stepped in turn give what each gives alone.
  const Case a{5, 5, 7, 1, 6}, b{20, 20, 3, 1, 6};
  SimRunner cpu_a(cpu(variant_of(a, 0), options_of(a, 0))), cpu_b(cpu(variant_of(b, 1), options_of(b, 1)));
  SimRunner other_a(other(executor, variant_of(a, 0), options_of(a, 0), 0));
  SimRunner other_b(other(executor, variant_of(b, 1), options_of(b, 1), 1));
  for (SimRunner* runner : {&cpu_a, &other_a, &cpu_b, &other_b}) runner->start();
  for (uint64_t k = 0; k < 6; ++k)
    for (SimRunner* runner : {&other_a, &other_b, &cpu_a, &cpu_b}) runner->step(k);
  EXPECT_EQ(difference(cpu_a.snapshot(), other_a.snapshot()), "");
  EXPECT_EQ(difference(cpu_b.snapshot(), other_b.snapshot()), "");
}

INSTANTIATE_TEST_SUITE_P(Gpu, Simulators, ::testing::Values(Executor::gpu));
INSTANTIATE_TEST_SUITE_P(Emulated, Simulators, ::testing::Values(Executor::emulated));

}  // namespace
}  // namespace giga::test
