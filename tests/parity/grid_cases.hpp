// Scenarios and helpers of the tests of grids: how a step is compared, knots of agents that lie together.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <ostream>
#include <string>

#include "core/error.hpp"
#include "core/geometry.hpp"
#include "parity/cases.hpp"
#include "sim/simulator.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {

struct Case {
  int n_team_0, n_team_1;
  int n_variants, n_steps;
};
inline void PrintTo(const Case& c, std::ostream* out) { *out << c.n_team_0 << " v " << c.n_team_1; }
inline SimSpec variant_of(const Case& c, int variant) {
  SimSpec spec = variant_spec(7000, c.n_team_0, c.n_team_1, variant);
  spec.finish();
  return spec;
}

inline SimOptions options_of(int variant) {
  SimOptions options = variant_options(0xABCDEF, 3, variant);
  options.n_threads = 1 + variant % 2;
  return options;
}

inline std::unique_ptr<Simulator> grid(const SimSpec& spec, SimOptions options) {
  options.pairs = Pairs::by_place;
  return make_grid_simulator(spec, options);
}

/// Without the tables of which a grid keeps nothing. What they led to, the observations, is compared.
inline Snapshot without_tables(Snapshot shot) {
  std::erase_if(shot.fields, [](const SnapshotField& f) { return f.name == "detected" || f.name == "seen"; });
  return shot;
}

/// Starts and steps both: each state and output of `b`, a grid, is that of `a`, and so are the observations where they
/// are written once more. `look` gets what is there after each step.
inline void expect_same_steps(SimRunner& a, SimRunner& b, int n_steps, int variant,
                              const std::function<void(const Snapshot&)>& look) {
  a.start();
  b.start();
  ASSERT_EQ(difference(without_tables(a.snapshot()), b.snapshot()), "") << "variant " << variant << ", start";
  for (int k = 0; k < n_steps; ++k) {
    a.step(static_cast<uint64_t>(k));
    b.step(static_cast<uint64_t>(k));
    const Snapshot now = a.snapshot();
    ASSERT_EQ(difference(without_tables(now), b.snapshot()), "") << "variant " << variant << ", step " << k;
    look(now);
    if (k % 6 != 5) continue;
    a.observe();
    b.observe();
    ASSERT_EQ(difference(observations(a.snapshot()), observations(b.snapshot())), "")
        << "variant " << variant << ", observe after step " << k;
  }
}

/// Agents that start at two points, or so near one that keys of distances cannot tell them apart: who has which row is
/// decided by number, or by looking closer.
struct Knot {
  int n_team_0, n_team_1;
  float spread, limit;
  int n_neighbors;
  bool stochastic;
};
inline const Knot kKnots[] = {
    {6, 7, 0, 20, 15, false},                                   // fewer than rows
    {6, 7, 2e-5f, 20, 15, true},                                // in the wrong order
    {40, 30, 0, 20, 15, true},                                  // more detect one than are kept
    {40, 30, 2e-5f, 20, 15, true},                              // whoever has the last row too
    {40, 30, 2e-5f, 20, 40, false}, {40, 30, 0, 20, 33, true},  // longer rows
    {3, 400, 1, 1000, 15, true},                                // hundreds in a cell
    {60, 50, 8, 30, 15, true},                                  // told by somebody who is not kept
};
inline SimSpec knot_spec(const Knot& c) {
  SimSpec spec = plain_spec(c.n_team_0, c.n_team_1);
  spec.params.limit_x = spec.params.limit_y = c.limit;
  spec.params.stochastic_detection = spec.params.stochastic_communication = c.stochastic;
  spec.params.collision_range2 = 0;
  spec.params.max_episode_length = 4;
  // Where it may be, a plain crowd (PlainCrowd): those have crews.
  spec.params.actions = c.stochastic ? ActionKind::discrete : ActionKind::continuous;
  set_cone(spec.params, 8, c.stochastic ? 3.1f : kTwoPi);
  set_damage_cone(spec.params, c.n_team_1 > kMostShooters ? 1.0f : 6.0f, 0.2f);
  spec.maps[0].start[0] = {5, 5, 5 + c.spread, 5 + c.spread, 2, 2, 0, 1};
  spec.maps[0].start[1] = {9, 8, 9 + c.spread, 8 + c.spread, 2, 2, 3, 4};
  spec.neighbor_limit = c.n_neighbors;
  spec.finish();
  return spec;
}
/// Plays those of so many agents by `expected` and `actual`, and compares what holds for both.
constexpr int kMostInKnots = 403;
inline void play_knots(const std::function<std::unique_ptr<Simulator>(const SimSpec&, const SimOptions&)>& expected,
                       const std::function<std::unique_ptr<Simulator>(const SimSpec&, const SimOptions&)>& actual,
                       int most_agents = kMostInKnots) {
  for (const Knot& c : kKnots) {
    if (c.n_team_0 + c.n_team_1 > most_agents) continue;
    const SimSpec spec = knot_spec(c);
    SimOptions options;
    options.n_worlds = 2;
    SimRunner a(expected(spec, options)), b(actual(spec, options));
    a.start();
    b.start();
    for (uint64_t k = 0; k < 6; ++k) {
      const Snapshot now = a.snapshot();
      ASSERT_EQ(difference(without_tables(now), without_tables(b.snapshot())), "")
          << c.n_team_0 << " v " << c.n_team_1 << " within " << c.spread << ", " << c.n_neighbors << " rows, step "
          << k;
      a.step(k);
      b.step(k);
    }
  }
}

/// 16 opponents look at two agents from two units away: each fires at both, and both fire at all 16. A plain crowd, so
/// that those that look may have crews (PlainCrowd).
constexpr int kShootersAtTwo = 16;
inline SimSpec two_under_fire() {
  SimSpec spec = plain_spec(2, kShootersAtTwo);
  spec.params.actions = ActionKind::discrete;
  spec.params.stochastic_detection = spec.params.stochastic_communication = true;
  // 3.1 is short of pi: only who looks straight away, within 0.04, does not fire; a step turns by 0.4 at most.
  set_cone(spec.params, 5, 3.1f);
  set_damage_cone(spec.params, 5, 3.1f);
  spec.params.collision_range2 = 0;
  spec.maps[0].start[0] = {7, 5, 7, 5, 0, 0, kPi, kPi};
  spec.maps[0].start[1] = {5, 5, 5, 5, 0, 0, 0, 0};
  spec.finish();
  return spec;
}
/// With room for 16 all of it is counted. With room for 15 each step ends with an error that says at how many agents
/// more fired, and an error that was told is not told again.
inline void expect_full_lists_tell(
    const std::function<std::unique_ptr<Simulator>(const SimSpec&, const SimOptions&)>& make) {
  const SimSpec spec = two_under_fire();
  SimOptions options;
  options.pairs = Pairs::by_place;
  options.most_shooters = kShootersAtTwo;
  SimRunner enough(make(spec, options));
  enough.start();
  enough.step(1);
  EXPECT_EQ(std::ranges::count(enough.snapshot().field("tracked").bytes, 1), 64) << "16 at each of 2, 2 at each of 16";
  options.most_shooters = kShootersAtTwo - 1;
  SimRunner full(make(spec, options));
  full.start();
  for (uint64_t k = 1; k <= 2; ++k) {
    try {
      full.step(k);
      ADD_FAILURE() << "16 shooters in a list of 15, step " << k;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("2 agents were fired at by more than 15 opponents at once"),
                std::string::npos)
          << error.what();
    }
    EXPECT_NO_THROW(full.sim().synchronize());
  }
}

}  // namespace giga::test
