// Worlds of more agents than tables of pairs serve, against the rules asked of all pairs: who fires at whom (rules 4.4,
// 4.5 and 17.2) and whom the rows of an observation are about (rules 6 and 7.1). Written by the rules alone, without
// the simulator's formulas or grid, from the places that a step leaves; in double precision.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "core/philox.hpp"
#include "sim/grid.hpp"
#include "sim/vector_observation.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

constexpr int kAskedTeam0 = 700, kAskedTeam1 = 500, kAsked = kAskedTeam0 + kAskedTeam1;
constexpr uint64_t kAskedSeed = 5;
constexpr double kSightDepth = 3, kSightAngle = 2.3, kWeaponDepth = 2, kWeaponAngle = 0.8, kVeryClose = 1, kEarshot = 8;

SimSpec crowd_to_ask(bool stochastic) {
  SimSpec spec = plain_spec(kAskedTeam0, kAskedTeam1);
  SimParams& p = spec.params;
  p.limit_x = p.limit_y = 30;  // 1,200 / 30^2 = 1.3 agents a unit^2
  p.stochastic_detection = p.stochastic_communication = stochastic;
  p.very_close_depth2 = kVeryClose * kVeryClose;
  set_cone(p, kSightDepth, kSightAngle);
  set_damage_cone(p, kWeaponDepth, kWeaponAngle);
  p.communication_range = kEarshot;
  p.min_tracking_time = 0;  // three steps of fire take 0.3 + 0.6 + 0.9 of 1
  p.damage_per_second = 3;
  for (size_t i = 0; i < spec.agents.size(); ++i) {
    spec.agents[i].range = i % 3 == 0 ? 2.0f : 1.0f;
    spec.agents[i].damage_range = i % 5 == 0 ? 0.0f : 1.0f;
  }
  spec.maps[0].start[0] = {2, 2, 28, 28, 0, 5, 0, 6};
  spec.maps[0].start[1] = {2, 2, 28, 28, 0, 5, 0, 6};
  spec.finish();
  return spec;
}

/// What a step leaves of world 0.
struct Moment {
  uint32_t step;  // whose draws it has made
  std::vector<double> x, y, heading;
  std::vector<bool> alive;
  std::vector<Death> death;
  std::vector<std::map<int, int>> fire;  // of a target: counters by shooter
  std::vector<std::vector<int>> rows;    // of an observer: agents, -1 = a row of zeros
};
Moment moment_of(const SimState& state) {
  const StateView& all = state.view();
  const auto most = static_cast<size_t>(state.shape().shooters), n_rows = static_cast<size_t>(state.shape().rows);
  Moment m{*all.draw_step - 1,
           {all.x, all.x + kAsked},
           {all.y, all.y + kAsked},
           {all.heading, all.heading + kAsked},
           {},
           {},
           {},
           {}};
  m.alive.assign(all.alive, all.alive + kAsked);
  m.death.assign(all.death, all.death + kAsked);
  m.fire.resize(kAsked);
  m.rows.resize(kAsked);
  for (size_t i = 0; i < kAsked; ++i) {
    for (size_t k = 0; k < most; ++k)
      if (const uint32_t entry = state.lists().fire[i * most + k]; entry != 0)
        m.fire[i][shooter_of(entry)] = count_of(entry);
    for (size_t k = 0; k < n_rows; ++k) m.rows[i].push_back(static_cast<int>(state.lists().neighbors[i * n_rows + k]));
  }
  return m;
}

/// Asks all pairs, after a step that led from one moment to the next.
class AllPairs {
 public:
  AllPairs(const SimSpec& spec, const Moment& before, const Moment& now)
      : spec_(spec), before_(before), now_(now), draws_(kAskedSeed, 0, now.step), detectors_(kAsked), fire_(kAsked) {
    for (size_t a = 0; a < kAsked; ++a)
      for (size_t b = 0; b < kAsked; ++b)
        if (team(a) != team(b) && fought(a) && fought(b)) look(a, b);
  }

  const std::map<int, int>& fire(size_t target) const { return fire_[target]; }
  size_t n_detectors(size_t target) const { return detectors_[target].size(); }
  /// Of ego e: the ego if it sees itself, then whom it sees, the nearest first, then nobody.
  std::vector<int> rows(size_t e) {
    std::vector<bool> hears(kAsked);
    for (size_t b = 0; b < kAsked; ++b) hears[b] = team(b) == team(e) && now_.alive[b] && (b == e || heard(e, b));
    std::vector<std::pair<double, int>> seen;
    bool sees_itself = false;
    for (size_t a = 0; a < kAsked; ++a) {
      const bool told = std::ranges::any_of(detectors_[a], [&](size_t b) { return !stochastic() || hears[b]; });
      if (!hears[a] && !told) continue;
      if (a == e)
        sees_itself = true;
      else
        seen.emplace_back(distance(a, e), static_cast<int>(a));
    }
    std::ranges::sort(seen);
    std::vector<int> rows{sees_itself ? static_cast<int>(e) : -1};
    for (const auto& [away, a] : seen) rows.push_back(a);
    rows.resize(static_cast<size_t>(spec_.params.n_neighbors), -1);
    return rows;
  }

 private:
  static int team(size_t i) { return i < kAskedTeam0 ? 0 : 1; }
  bool stochastic() const { return spec_.params.stochastic_communication; }
  double distance(size_t i, size_t j) const { return std::hypot(now_.x[i] - now_.x[j], now_.y[i] - now_.y[j]); }
  float draw(Draw what, size_t row, size_t index) {
    return draws_.uniform(what, static_cast<uint32_t>(row), static_cast<uint32_t>(index));
  }
  /// It was alive when all looked: it lives, or was shot in this step.
  bool fought(size_t i) const { return now_.alive[i] || (before_.alive[i] && now_.death[i] == Death::damage); }
  /// Without chance all of a team are.
  bool heard(size_t e, size_t b) {
    return !stochastic() ||
           std::clamp(distance(e, b) / kEarshot, 0.0, 1.0) <= static_cast<double>(draw(Draw::comm, e, b));
  }
  /// Rules 4.4 of target a and observer b.
  void look(size_t a, size_t b) {
    const double d = distance(a, b), bearing = std::atan2(now_.y[a] - now_.y[b], now_.x[a] - now_.x[b]);
    const double angle = std::abs(std::remainder(bearing - now_.heading[b], 2 * std::numbers::pi));
    const double depth = d * d / (kSightDepth * kSightDepth * static_cast<double>(spec_.agents[b].range));
    const bool in_cone = angle < kSightAngle, in_damage = angle < kWeaponAngle;
    const bool see =
        stochastic() ? (in_damage && depth <= 1) || (in_cone && depth < static_cast<double>(draw(Draw::detect, a, b)))
                     : in_cone && depth <= 1;
    if (!see && d >= kVeryClose) return;
    detectors_[a].push_back(b);
    const bool can_shoot = spec_.agents[b].damage_range > 0;  // of those that can it is 1
    if (!can_shoot || !in_damage || d > kWeaponDepth) return;
    const auto fired = before_.fire[a].find(static_cast<int>(b));
    fire_[a][static_cast<int>(b)] = (fired == before_.fire[a].end() ? 0 : fired->second) + 1;
  }

  const SimSpec& spec_;
  const Moment &before_, &now_;
  DrawKey draws_;
  std::vector<std::vector<size_t>> detectors_;  // of a target
  std::vector<std::map<int, int>> fire_;
};

/// The rows of the observation of ego e are about these agents: there is one or not, of its team or not, where it is.
void expect_rows_about(const Snapshot& shot, const SimSpec& spec, const Moment& now, size_t e,
                       const std::vector<int>& agents) {
  const bool second = e >= kAskedTeam0;
  const std::string name = second ? "vector of team 1" : "vector of team 0";
  const size_t first = (second ? e - kAskedTeam0 : e) * shot.field(name).per_agent;
  for (size_t k = 0; k < agents.size(); ++k) {
    const auto number = [&](Feature f) { return shot.float_at(name, first + k * kNeighborFeatures + f); };
    const bool some = agents[k] >= 0;
    ASSERT_EQ(number(kSeen), some ? 1 : 0) << "agent " << e << ", row " << k;
    if (!some) continue;
    const auto a = static_cast<size_t>(agents[k]);
    const double from_x = k > 0 ? now.x[e] : 0, from_y = k > 0 ? now.y[e] : 0;
    ASSERT_EQ(number(kSameTeam), (a >= kAskedTeam0) == second ? 1 : 0) << "agent " << e << ", row " << k;
    ASSERT_NEAR(number(kX), (now.x[a] - from_x) / spec.params.limit_x, 1e-6) << "agent " << e << ", row " << k;
    ASSERT_NEAR(number(kY), (now.y[a] - from_y) / spec.params.limit_y, 1e-6) << "agent " << e << ", row " << k;
  }
}

class GridBruteForce : public ::testing::TestWithParam<bool> {};

TEST_P(GridBruteForce, FireAndRowsAreThoseOfAllPairs) {
  const SimSpec spec = crowd_to_ask(GetParam());
  SimOptions options;
  options.seed = kAskedSeed;
  SimRunner runner(make_grid_simulator(spec, options));
  runner.start();
  Moment before = moment_of(runner.sim().state());
  // How often there was what is hard: fire that goes on, the shot that are shown, the dead that look on, more detectors
  // than are kept, rows with room left.
  int goes_on = 0, shot = 0, dead = 0, more_detectors = 0, room_left = 0;
  for (uint32_t step = 0; step < 4; ++step) {
    runner.step(step);
    const Snapshot written = runner.snapshot();
    const Moment now = moment_of(runner.sim().state());
    AllPairs all(spec, before, now);
    for (size_t i = 0; i < kAsked; ++i) {
      ASSERT_EQ(now.fire[i], all.fire(i)) << "at agent " << i << ", step " << step;
      const std::vector<int> rows = all.rows(i);
      ASSERT_EQ(now.rows[i], rows) << "of agent " << i << ", step " << step;
      ASSERT_NO_FATAL_FAILURE(expect_rows_about(written, spec, now, i, rows));
      for (const auto& [shooter, count] : now.fire[i]) goes_on += count > 1;
      for (const int a : rows) shot += a >= 0 && !now.alive[static_cast<size_t>(a)];
      dead += !now.alive[i];
      more_detectors += all.n_detectors(i) > kKeptDetectors;
      room_left += rows.back() < 0;
    }
    before = now;
  }
  EXPECT_GT(goes_on, 100);
  EXPECT_GT(shot, 100);
  EXPECT_GT(dead, 100);
  EXPECT_GT(more_detectors, 10);
  EXPECT_EQ(room_left > 0, GetParam()) << "without chance there are always 14 mates";
}

INSTANTIATE_TEST_SUITE_P(Crowds, GridBruteForce, ::testing::Bool(),
                         [](const auto& test) { return test.param ? "ByChance" : "Certain"; });

}  // namespace
}  // namespace giga::test
