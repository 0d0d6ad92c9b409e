// Properties of hundreds of random scenarios under random actions: numbers stay finite and in bounds, the dead stay
// dead until the reset, and a seed gives one trajectory, whatever the number of threads and the order of the agents.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "core/error.hpp"
#include "core/geometry.hpp"
#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/step.hpp"
#include "sim/vector_observation.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

constexpr uint64_t kNScenarios = 300;
constexpr int kStride = 7;  // thinned; teams' sizes have periods of 12, other properties of 2, 3, 4 and 5
constexpr uint64_t kNSteps = 100;

SimSpec scenario(uint64_t seed) {
  return random_spec(seed, static_cast<int>(1 + seed % 12), static_cast<int>(1 + seed / 12 % 12));
}

SimOptions options_for(uint64_t seed, int n_worlds, int n_threads, OnDone on_done = OnDone::reset) {
  SimOptions options;
  options.seed = 1000 + seed;
  options.n_worlds = n_worlds;
  options.n_threads = n_threads;
  options.on_done = on_done;
  return options;
}

/// Agents in reversed order and, every other stage, the even ones first: any stage that reads what another agent of the
/// same stage writes gives other results than SerialLanes.
struct ScrambledLanes {
  static constexpr bool kSerial = false;
  int* stage;
  template <class F>
  void each(int n, F&& f) const {
    if (++*stage % 2) {
      for (int i = n - 1; i >= 0; --i) f(i);
    } else {
      for (int start : {1, 0})
        for (int i = start; i < n; i += 2) f(i);
    }
  }
  template <class F>
  void each_agent(int n, F&& f) const {
    each(n, f);
  }
  template <class OfRow, class F>
  void each_cell(int rows, int columns, OfRow&& of_row, F&& f) const {
    each(rows * columns, [&](int k) {
      if (const auto common = of_row(k / columns)) f(common, k % columns);
    });
  }
  void wait_delivered() const {}
  bool any(bool) const { return true; }  // as if another world of the same warp had ended
};

class ScrambledSimulator final : public Simulator {
 public:
  ScrambledSimulator(SimSpec spec, const SimOptions& options)
      : Simulator(std::move(spec), options, host_memory()), layout_(params()), scratch_(host_memory(), layout_.size) {}
  void redraw(const Redraw&) override {}
  EpisodeStats take_stats() override { return {}; }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds) override {
    int stage = 0;
    for (int64_t world = n_worlds() - 1; world >= 0; --world) {
      std::memset(scratch_.data(), 0xFF, scratch_.size());  // scratch must not carry anything from step to step
      WorldView w = world_view(state_.view(), params().n_agents, world);
      attach_scratch(w, layout_, scratch_.data());
      const auto number = static_cast<uint32_t>(options_.first_world + world);
      const auto draws_at = [&](uint32_t step) { return PhiloxDraws(options_.seed, number, step); };
      run_jobs(ScrambledLanes{&stage}, jobs, params(), w, draws_at, io, ending(), world);
    }
  }
  void list_playing() override {}

 private:
  ScratchLayout layout_;
  Buffer<char> scratch_;
};

/// What a violation prints.
std::string where(uint64_t seed, uint64_t step, int64_t world, int agent) {
  return cat("scenario ", seed, ", step ", step, ", world ", world, ", agent ", agent);
}

void check_state(const SimSpec& spec, const StateView& s, int n_worlds, uint64_t seed, uint64_t step) {
  const SimParams& p = spec.params;
  // Both ends: the float below 2 pi minus pi rounds to at most pi, and the original reaches -3 pi.
  const float lowest_heading = p.original() ? -3 * kPi : -kPi;
  for (int64_t w = 0; w < n_worlds; ++w) {
    const bool fresh = s.episode_length[w] == 0;
    ASSERT_GE(s.map[w], 0);
    ASSERT_LT(s.map[w], p.n_maps);
    ASSERT_GE(s.waypoint_time[w], 0) << "world " << w;
    ASSERT_LE(s.waypoint_time[w], 10) << "world " << w;
    ASSERT_TRUE(p.max_episode_length == 0 || s.episode_length[w] < p.max_episode_length) << "world " << w;
    for (int i = 0; i < p.n_agents; ++i) {
      const int64_t k = w * p.n_agents + i;
      const std::string at = where(seed, step, w, i);
      for (const float value : {s.x[k], s.y[k], s.z[k], s.v[k], s.heading[k], s.health[k]})
        ASSERT_TRUE(std::isfinite(value)) << at << ": " << value;
      ASSERT_LE(s.alive[k], 1) << at;
      if (s.alive[k]) {
        ASSERT_TRUE(s.x[k] >= 0 && s.x[k] <= p.limit_x && s.y[k] >= 0 && s.y[k] <= p.limit_y)
            << at << ": (" << s.x[k] << ", " << s.y[k] << ")";
        ASSERT_GT(s.health[k], 0) << at;
        // The original starts everybody at 1, above the maximum of some (Q5); the first step cuts that.
        const float limit = spec.agents[static_cast<size_t>(i)].max_health;
        ASSERT_LE(s.health[k], fresh && p.original() ? 1.0f : limit) << at;
      } else {
        ASSERT_EQ(s.health[k], 0) << at;
      }
      ASSERT_TRUE(s.z[k] >= 0 && s.z[k] <= kAltitudeLimit) << at << ": z " << s.z[k];
      if (fresh) {
        ASSERT_EQ(s.v[k], 1) << at;
      } else {
        ASSERT_GE(s.v[k], 1.3f - 1e-6f) << at;
      }
      ASSERT_GE(s.heading[k], lowest_heading) << at;
      ASSERT_LT(s.heading[k], kPi) << at;
    }
  }
}

/// Every float that a step writes. `final_*` are written only for worlds that ended, so there the poison must remain.
void check_outputs(const Snapshot& shot, uint64_t seed, uint64_t step, bool first) {
  for (const SnapshotField& field : shot.fields) {
    if (!field.is_float) continue;
    const bool final_only = field.name.rfind("final ", 0) == 0;
    const bool in_start = field.observed;
    const bool is_output = field.name.rfind("reward of", 0) == 0 || field.name.rfind("terms", 0) == 0;
    for (size_t k = 0; k < field.bytes.size() / 4; ++k) {
      float value;
      std::memcpy(&value, field.bytes.data() + 4 * k, 4);
      const size_t world = k / field.per_world;
      bool written = true;
      if (first) written = in_start || (!final_only && !is_output);
      if (!first && final_only) written = shot.byte_at("done", world) != 0;
      ASSERT_EQ(std::isfinite(value), written)
          << "scenario " << seed << ", step " << step << ", " << field.name << ", world " << world << ", index "
          << k % field.per_world << ": " << value;
    }
  }
}

TEST(SimProperty, FiniteAndInBounds) {
  Activity activity;
  const int stride = thinned(kStride);
  for (uint64_t seed = 0; seed < kNScenarios; seed += static_cast<uint64_t>(stride)) {
    const SimSpec spec = scenario(seed);
    const int n_worlds = 5;
    SimRunner runner(make_cpu_simulator(spec, options_for(seed, n_worlds, 1)));
    runner.start();
    check_outputs(runner.snapshot(), seed, 0, true);
    for (uint64_t k = 1; k <= kNSteps; ++k) {
      runner.step(k);
      check_state(spec, runner.sim().state().view(), n_worlds, seed, k);
      if (k % 10 == 0) {
        const Snapshot shot = runner.snapshot();
        check_outputs(shot, seed, k, false);
        activity.add(shot);
      }
      if (HasFatalFailure()) return;
    }
  }
  // The scenarios are not idle: of 15,000 looks, many see detections, fire, deaths, resets and waypoints.
  EXPECT_GT(activity.detections * stride, 1000);
  EXPECT_GT(activity.shots * stride, 1000);
  EXPECT_GT(activity.dead * stride, 1000);
  EXPECT_GT(activity.ended * stride, 100);
  EXPECT_GT(activity.waypoints * stride, 100);
}

TEST(SimProperty, TheDeadStayDeadUntilTheReset) {
  int64_t deaths = 0, resets = 0;
  const int stride = thinned(kStride);
  for (uint64_t seed = 0; seed < kNScenarios; seed += static_cast<uint64_t>(stride)) {
    const SimSpec spec = scenario(seed);
    const int n_worlds = 3, n = spec.params.n_agents;
    const OnDone on_done = seed % 3 == 0 ? OnDone::keep : OnDone::reset;
    SimRunner runner(make_cpu_simulator(spec, options_for(seed, n_worlds, 1, on_done)));
    runner.start();
    const StateView& s = runner.sim().state().view();
    std::vector<uint8_t> before(s.alive, s.alive + n_worlds * n);
    for (uint64_t k = 1; k <= kNSteps; ++k) {
      runner.step(k);
      for (int64_t w = 0; w < n_worlds; ++w) {
        const bool reset = s.episode_length[w] == 0;
        ASSERT_FALSE(reset && on_done == OnDone::keep) << "scenario " << seed;
        resets += reset;
        for (int i = 0; i < n; ++i) {
          const auto at = static_cast<size_t>(w * n + i);
          ASSERT_TRUE(!reset || s.alive[at]) << where(seed, k, w, i) << " is dead at the start";
          ASSERT_TRUE(reset || before[at] || !s.alive[at]) << where(seed, k, w, i) << " came back to life";
          deaths += before[at] && !s.alive[at];
          before[at] = s.alive[at];
        }
      }
    }
  }
  EXPECT_GT(deaths * stride, 1000);
  EXPECT_GT(resets * stride, 1000);
}

TEST(SimProperty, SameTrajectoryForAnyNumberOfThreadsAndAnyOrder) {
  const int stride = thinned(kStride);
  for (uint64_t seed = 0; seed < kNScenarios; seed += 3 * static_cast<uint64_t>(stride)) {
    const SimSpec spec = scenario(seed);
    const int n_worlds = seed % 15 == 0 ? 65 : 7;
    const OnDone on_done = seed % 4 == 1 ? OnDone::freeze : (seed % 4 == 2 ? OnDone::keep : OnDone::reset);
    SimRunner one(make_cpu_simulator(spec, options_for(seed, n_worlds, 1, on_done)));
    SimRunner two(make_cpu_simulator(spec, options_for(seed, n_worlds, 2, on_done)));
    SimRunner three(make_cpu_simulator(spec, options_for(seed, n_worlds, 3, on_done)));
    SimRunner scrambled(std::make_unique<ScrambledSimulator>(spec, options_for(seed, n_worlds, 1, on_done)));
    one.start();
    const Snapshot first = one.snapshot();
    for (SimRunner* other : {&two, &three, &scrambled}) {
      other->start();
      ASSERT_EQ(difference(first, other->snapshot()), "") << "scenario " << seed << ", start";
    }
    for (uint64_t k = 1; k <= 40; ++k) {
      for (SimRunner* runner : {&one, &two, &three, &scrambled}) runner->step(k);
      if (k % 8 != 0) continue;
      const Snapshot expected = one.snapshot();
      ASSERT_EQ(difference(expected, two.snapshot()), "") << "scenario " << seed << ", step " << k << ", 2 threads";
      ASSERT_EQ(difference(expected, three.snapshot()), "") << "scenario " << seed << ", step " << k << ", 3 threads";
      ASSERT_EQ(difference(expected, scrambled.snapshot()), "") << "scenario " << seed << ", step " << k << ", order";
    }
  }
}

TEST(SimProperty, OtherSeedsGiveOtherTrajectories) {
  const SimSpec spec = random_spec(7, 3, 4);
  SimRunner a(make_cpu_simulator(spec, options_for(1, 65, 1))), b(make_cpu_simulator(spec, options_for(2, 65, 1)));
  a.start();
  b.start();
  const StateView &sa = a.sim().state().view(), &sb = b.sim().state().view();
  int same_as_other_seed = 0, same_as_next_world = 0;
  for (int k = 0; k < 65 * 7; ++k) same_as_other_seed += sa.x[k] == sb.x[k];
  for (int k = 0; k < 64 * 7; ++k) same_as_next_world += sa.x[k] == sa.x[k + 7];
  EXPECT_LT(same_as_other_seed, 5);  // of 455 draws of 24 bits
  EXPECT_LT(same_as_next_world, 5);
}

TEST(SimProperty, WorldsAreNumberedAcrossDevices) {
  // Worlds 40 to 64 of one simulator are those of another whose first world is 40.
  const SimSpec spec = random_spec(11, 4, 3);
  SimOptions options = options_for(3, 65, 2);
  SimRunner all(make_cpu_simulator(spec, options));
  options.n_worlds = 25;
  options.first_world = 40;
  SimRunner part(make_cpu_simulator(spec, options));
  all.start();
  part.start();
  const StateView &sa = all.sim().state().view(), &sp = part.sim().state().view();
  for (int k = 0; k < 25 * 7; ++k) {
    ASSERT_EQ(sa.x[40 * 7 + k], sp.x[k]) << "world " << k / 7 << ", agent " << k % 7;
    ASSERT_EQ(sa.heading[40 * 7 + k], sp.heading[k]) << "world " << k / 7 << ", agent " << k % 7;
  }
}

TEST(SimProperty, StridedObservationsHoldTheSameNumbers) {
  const SimSpec spec = random_spec(13, 4, 3);
  const size_t columns = static_cast<size_t>(VectorObservation::shape(spec.params).size()),
               stride = columns / 5 * 5 + 5;
  SimRunner dense(make_cpu_simulator(spec, options_for(1, 65, 1)));
  SimRunner strided(make_cpu_simulator(spec, options_for(1, 65, 1)), Outputs::all, 5);
  dense.start();
  strided.start();
  int64_t final_rows = 0;
  for (uint64_t k = 0; k < 70; ++k) {
    dense.step(k);
    strided.step(k);
    const Snapshot a = dense.snapshot(), b = strided.snapshot();
    for (const char* name :
         {"vector of team 0", "vector of team 1", "final vector of team 0", "final vector of team 1"})
      for (size_t row = 0; row < a.field(name).bytes.size() / 4 / columns; ++row) {
        const uint8_t* in_dense = a.field(name).bytes.data() + 4 * row * columns;
        const uint8_t* in_strided = b.field(name).bytes.data() + 4 * row * stride;
        ASSERT_EQ(std::memcmp(in_dense, in_strided, 4 * columns), 0) << name << ", step " << k << ", row " << row;
        for (size_t gap = 4 * columns; gap < 4 * stride; ++gap)
          ASSERT_EQ(in_strided[gap], 0xFF) << name << ", step " << k << ", row " << row << ": the gap is not ours";
        final_rows += name[0] == 'f' && in_dense[3] != 0xFF;
      }
  }
  EXPECT_GT(final_rows, 0) << "some episode ended";
}

TEST(SimProperty, SaveThenLoadContinuesBitForBit) {
  for (uint64_t seed = 0; seed < 30; ++seed) {
    const SimSpec spec = scenario(seed * 7);
    SimRunner straight(make_cpu_simulator(spec, options_for(seed, 7, 1)));
    SimRunner resumed(make_cpu_simulator(spec, options_for(seed, 7, 1)));
    straight.start();
    for (uint64_t k = 0; k < 20; ++k) straight.step(k);
    resumed.sim().state().load(straight.sim().state().save());
    resumed.observe();
    ASSERT_EQ(difference(observations(straight.snapshot()), observations(resumed.snapshot())), "")
        << "scenario " << seed;
    for (uint64_t k = 20; k < 40; ++k) {
      straight.step(k);
      resumed.step(k);
    }
    ASSERT_EQ(difference(straight.snapshot(), resumed.snapshot()), "") << "scenario " << seed;
  }
}

}  // namespace
}  // namespace giga::test
