// Every recorded step of the original: state before + action + draws -> state after, rewards, flags, observations.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "core/error.hpp"
#include "golden/comparison.hpp"
#include "golden/golden_world.hpp"
#include "golden/observation_check.hpp"
#include "golden/recording.hpp"

namespace giga::golden {
namespace {

constexpr double kMaxLooseShare = 0.01;  ///< of all records may need a loose comparison
constexpr int kMaxFlips = 4;             ///< entries of a flag that one rounding may change, by field and record
constexpr int kShownFailures = 25;

/// The datasets of a recorded state.
struct RecordedState {
  Array<float> x, y, z, v, heading, health, alive, waypoint_location, waypoint_enabled, aux_rewards_factor;
  Array<int32_t> tracked, map_idx, episode_length;

  explicit RecordedState(const H5Group& g)
      : x(g.floats("x")),
        y(g.floats("y")),
        z(g.floats("z")),
        v(g.floats("v")),
        heading(g.floats("heading")),
        health(g.floats("health")),
        alive(g.floats("alive")),
        waypoint_location(g.floats("waypoint_location")),
        waypoint_enabled(g.floats("waypoint_enabled")),
        aux_rewards_factor(g.floats("aux_rewards_factor")),
        tracked(g.ints("tracked")),
        map_idx(g.ints("map_idx")),
        episode_length(g.ints("episode_length")) {}
};

int map_of(const SimParams& p, int32_t map_idx) { return std::clamp(map_idx, 0, p.n_maps - 1); }

void load_state(GoldenWorld& world, const RecordedState& s, size_t t) {
  WorldView& w = world.view();
  const int n = world.n_agents();
  for (int i = 0; i < n; ++i) {
    w.x[i] = s.x.row(t)[i];
    w.y[i] = s.y.row(t)[i];
    w.z[i] = s.z.row(t)[i];
    w.v[i] = s.v.row(t)[i];
    w.heading[i] = s.heading.row(t)[i];
    w.health[i] = s.health.row(t)[i];
    w.alive[i] = s.alive.row(t)[i] != 0;
  }
  for (int k = 0; k < n * n; ++k) w.tracked[k] = static_cast<uint8_t>(std::min(s.tracked.row(t)[k], 255));
  *w.map = map_of(world.params(), s.map_idx.data[t]);
  for (int k = 0; k < 4; ++k) w.waypoint[k] = s.waypoint_location.row(t)[k];
  *w.waypoint_time = s.waypoint_enabled.data[t];
  *w.reward_factor = s.aux_rewards_factor.data[t];
  *w.episode_length = s.episode_length.data[t];
  *w.phase = Phase::plays;
  *w.outcome = Outcome::open;
}

/// One step case in memory.
struct StepCase {
  std::string where;
  GoldenWorld world;
  RecordedState before, after;
  Array<int32_t> discrete;
  Array<float> continuous;
  Array<float> detect, comm, appear, location, time;
  Array<float> reward, vec, margin, margin_obs;
  Array<int32_t> done, episode_done, has_detected, took_damage, seen;
  Array<float> terms[kNOriginalRewardTerms];

  /// `images`: what was recorded of vectors beside images (obs_type rgb_vector).
  StepCase(const std::string& file, const H5Group& g, const std::string& name, bool images)
      : where(file + " " + name + (images ? ", rgb_vector" : "")),
        world(spec_of(g, name, images)),
        before(g.group("before")),
        after(g.group("after")),
        detect(g.floats_if("draws/detect")),
        comm(g.floats_if("draws/comm")),
        appear(g.floats_if("draws/wp_appear")),
        location(g.floats_if("draws/wp_loc_unit")),
        time(g.floats_if("draws/wp_time_unit")),
        reward(g.floats("out/reward")),
        vec(g.floats(images ? "out/vec_of_rgb_vector" : "out/vec")),
        margin(g.floats("margin")),
        margin_obs(g.floats("margin_obs")),
        done(g.ints("out/done")),
        episode_done(g.ints("out/episode_done")),
        has_detected(g.ints("out/has_detected")),
        took_damage(g.ints("out/took_damage")),
        seen(g.ints("out/seen")) {
    const bool is_discrete = world.params().actions == ActionKind::discrete;
    GIGA_CHECK(is_discrete == (g.number_attribute("discrete") != 0), where, ": kind of action");
    if (is_discrete) {
      discrete = g.ints("action");
    } else {
      continuous = g.floats("action");
    }
    const H5Group recorded_terms = g.group("out/terms");
    const auto names = recorded_terms.children();
    for (const std::string& term : names) {
      const auto* known = std::find(std::begin(kRewardTermNames), std::end(kRewardTermNames), term);
      GIGA_CHECK(known != std::end(kRewardTermNames), where, ": unknown reward term ", term);
      terms[known - kRewardTermNames] = recorded_terms.floats(term);
    }
    GIGA_CHECK(names.size() >= 8, where, ": only ", names.size(), " reward terms");
    const Array<int32_t> steps = images ? g.ints("out/vec_of_rgb_vector_step") : Array<int32_t>{};
    for (size_t t = 0; t < steps.rows(); ++t)
      GIGA_CHECK(steps.data[t] == static_cast<int32_t>(t), where, ": not the first steps");
    GIGA_CHECK(vec.row_size() == reward.row_size() * static_cast<size_t>(world.columns()), where,
               ": recorded observations have ", vec.shape[2], " numbers, ours ", world.columns());
  }
  size_t n_records() const { return vec.rows(); }

 private:
  static SimSpec spec_of(const H5Group& g, const std::string& name, bool images) {
    SimSpec spec = recorded_spec(g, name);
    const Params params(g.text_attribute("params"), name + " params");
    if (images) spec.params.resolution = static_cast<int>(params.number("resolution_x"));
    return spec;
  }
};

void run_step(StepCase& s, size_t t) {
  load_state(s.world, s.before, t);
  RecordedDraws draws;
  draws.n_agents = s.world.n_agents();
  if (!s.detect.empty()) draws.detect_at = s.detect.row(t);
  if (!s.comm.empty()) draws.comm_at = s.comm.row(t);
  if (!s.appear.empty()) draws.appear_at = s.appear.row(t);
  if (!s.location.empty()) draws.location_at = s.location.row(t);
  if (!s.time.empty()) draws.time_at = s.time.row(t);
  s.world.step(s.discrete.empty() ? nullptr : s.discrete.row(t), s.continuous.empty() ? nullptr : s.continuous.row(t),
               draws);
}

/// What no close comparison can change: movement and counters.
void compare_robust(Comparison& c, StepCase& s, size_t t, bool loose) {
  const WorldView& w = s.world.view();
  for (int i = 0; i < s.world.n_agents(); ++i) {
    c.near("x", i, -1, w.x[i], s.after.x.row(t)[i]);
    c.near("y", i, -1, w.y[i], s.after.y.row(t)[i]);
    c.near("z", i, -1, w.z[i], s.after.z.row(t)[i]);
    c.near("v", i, -1, w.v[i], s.after.v.row(t)[i]);
    c.angle("heading", i, -1, w.heading[i], s.after.heading.row(t)[i], loose);
  }
  c.same("map_idx", -1, -1, *w.map, map_of(s.world.params(), s.after.map_idx.data[t]));
  c.near("aux_rewards_factor", -1, -1, *w.reward_factor, s.after.aux_rewards_factor.data[t]);
  c.same("episode_length", -1, -1, *w.episode_length, s.after.episode_length.data[t]);
}

/// Who lives, detects, shoots, sees.
void compare_flags(Comparison& c, StepCase& s, size_t t) {
  const WorldView& w = s.world.view();
  const int n = s.world.n_agents();
  for (int i = 0; i < n; ++i) {
    const bool alive = s.after.alive.row(t)[i] != 0;
    c.same("alive", i, -1, w.alive[i], alive);
    c.same("done", i, -1, !s.world.alive(i), s.done.row(t)[i]);
    c.same("took_damage", i, -1, (w.flags[i] & kTookDamage) != 0, s.took_damage.row(t)[i]);
    for (int j = 0; j < n; ++j) {
      c.same("tracked", i, j, w.tracked[i * n + j], std::min(s.after.tracked.row(t)[i * n + j], 255));
      c.same("has_detected", i, j, s.world.detected(i, j), s.has_detected.row(t)[i * n + j]);
      c.same("seen", i, j, s.world.seen(i, j), s.seen.row(t)[i * n + j]);
    }
  }
  c.same("episode_done", -1, -1, s.world.done(), s.episode_done.data[t]);
}

/// Health, waypoint, rewards and their terms.
void compare_values(Comparison& c, StepCase& s, size_t t) {
  const WorldView& w = s.world.view();
  for (int i = 0; i < s.world.n_agents(); ++i) {
    c.near("health", i, -1, w.health[i], s.after.health.row(t)[i]);
    c.near("reward", i, -1, s.world.reward(i), s.reward.row(t)[i]);
    for (int k = 0; k < kNOriginalRewardTerms; ++k)
      if (!s.terms[k].empty())
        c.near(std::string("terms/") + kRewardTermNames[k], i, -1, s.world.term(static_cast<RewardTerm>(k), i),
               s.terms[k].row(t)[i]);
  }
  for (int k = 0; k < 4; ++k) c.near("waypoint_location", -1, k, w.waypoint[k], s.after.waypoint_location.row(t)[k]);
  c.near("waypoint_enabled", -1, -1, *w.waypoint_time, s.after.waypoint_enabled.data[t]);
}

void compare_observations(Comparison& c, StepCase& s, size_t t, bool as_set) {
  const size_t size = static_cast<size_t>(s.world.columns());
  for (int i = 0; i < s.world.n_agents(); ++i) {
    const float* recorded = s.vec.row(t) + static_cast<size_t>(i) * size;
    if (as_set) {
      compare_observation_as_set(c, s.world, i, recorded);
    } else {
      compare_observation(c, s.world, i, recorded, false);
    }
  }
}

/// Everything, strictly.
Comparison compare_strictly(StepCase& s, size_t t) {
  Comparison c;
  compare_robust(c, s, t, false);
  compare_flags(c, s, t);
  compare_values(c, s, t);
  compare_observations(c, s, t, false);
  return c;
}

/// `margin_obs` is small: only the order of the rows, and relative headings by whole turns, are free.
Comparison compare_loose_order(StepCase& s, size_t t) {
  Comparison c;
  compare_robust(c, s, t, false);
  compare_flags(c, s, t);
  compare_values(c, s, t);
  compare_observations(c, s, t, true);
  return c;
}

/// `margin` is small: one comparison of the step may fall the other way. Movement must agree. Where it changes who
/// lives, is detected or shot at, that may be only a few entries. Where it does not, it may only be whom one agent
/// hears: all but what that agent sees must agree too.
Comparison compare_loose_step(StepCase& s, size_t t) {
  Comparison c, flags;
  compare_robust(c, s, t, true);
  compare_flags(flags, s, t);
  long flips = 0;
  for (const char* field : {"alive", "tracked", "has_detected"}) {
    const long count = flags.n_mismatches_of(field);
    c.same(std::string(field) + " flips beyond limit", -1, -1, count > kMaxFlips, 0);
    flips += count;
  }
  if (flips > 0) return c;
  compare_values(c, s, t);
  int n_deaf = 0;
  const size_t n = static_cast<size_t>(s.world.n_agents()), size = s.vec.row_size() / n;
  for (size_t e = 0; e < n; ++e) {
    const int ego = static_cast<int>(e);
    Comparison seen;
    for (size_t a = 0; a < n; ++a)
      seen.same("seen", ego, static_cast<int>(a), s.world.seen(ego, static_cast<int>(a)), s.seen.row(t)[e * n + a]);
    if (seen.passed()) {
      compare_observation_as_set(c, s.world, ego, s.vec.row(t) + e * size);
    } else {
      ++n_deaf;
    }
  }
  c.same("agents that see otherwise, beyond limit", -1, -1, n_deaf > 1, 0);
  return c;
}

struct Totals {
  long files = 0, cases = 0, records = 0, passed = 0, small_margin = 0, loose_order = 0, loose_step = 0, compared = 0;
  long pixel_sorted = 0;  // records of vectors beside images, whose rows are sorted by pixel
  int shown = 0;
  WorstDifferences worst;
};

void check_record(StepCase& s, size_t t, Totals& totals) {
  ++totals.records;
  run_step(s, t);
  const double margin = s.margin.data[t], margin_obs = s.margin_obs.data[t];
  if (margin < kMarginLimit || margin_obs < kMarginLimit) ++totals.small_margin;
  const std::string prefix = s.where + " record " + std::to_string(t);
  Comparison accepted = compare_strictly(s, t);
  std::string report = accepted.passed() ? "" : accepted.describe(prefix);
  const auto try_loosely = [&](auto compare, const char* kind, long& count) {
    Comparison loose = compare(s, t);
    if (loose.passed()) {
      std::printf("%s: compared loosely (%s, margin %.2g, margin_obs %.2g)\n%s", prefix.c_str(), kind, margin,
                  margin_obs, report.c_str());
      ++count;
      accepted = loose;
    }
  };
  if (!accepted.passed() && margin_obs < kMarginLimit)
    try_loosely(compare_loose_order, "order of observation rows", totals.loose_order);
  if (!accepted.passed() && margin < kMarginLimit) try_loosely(compare_loose_step, "one decision", totals.loose_step);
  if (accepted.passed()) {
    ++totals.passed;
    totals.compared += accepted.n_compared();
    accepted.merge_into(totals.worst);
  } else if (totals.shown++ < kShownFailures) {
    ADD_FAILURE() << report << "(margin " << margin << ", margin_obs " << margin_obs << ")";
  }
}

TEST(GoldenSteps, EveryRecordedStepIsReproduced) {
  Totals totals;
  for (const Recording& recording : recordings()) {
    const auto cases = step_cases(recording.root);
    totals.files += !cases.empty();
    for (const std::string& name : cases) {
      const H5Group group = recording.root.group(name);
      for (const bool images : {false, true}) {
        if (images && !group.has("out/vec_of_rgb_vector")) continue;
        StepCase s(recording.file, group, name, images);
        ASSERT_GT(s.n_records(), 0u) << s.where << " has no records";
        totals.cases += !images;
        if (images) totals.pixel_sorted += static_cast<long>(s.n_records());
        for (size_t t = 0; t < s.n_records(); ++t) check_record(s, t, totals);
      }
    }
  }
  std::printf("golden steps: %ld files, %ld cases, %ld records run, %ld passed (%ld values compared)\n", totals.files,
              totals.cases, totals.records, totals.passed, totals.compared);
  std::printf("  %ld have a margin below %g; compared loosely: %ld in the order of rows, %ld in one decision\n",
              totals.small_margin, kMarginLimit, totals.loose_order, totals.loose_step);
  std::printf("  %ld of them are vectors beside images, with rows sorted by pixels\n", totals.pixel_sorted);
  std::printf("worst difference by field:\n%s", table_of(totals.worst).c_str());
  if (totals.records == 0 && foreign_folder()) GTEST_SKIP() << "no recorded steps in GIGASTEP_GOLDEN_DIR";
  EXPECT_GT(totals.records, 0);
  EXPECT_EQ(totals.passed, totals.records);
  EXPECT_EQ(totals.pixel_sorted, foreign_folder() ? totals.pixel_sorted : 70);
  EXPECT_LE(static_cast<double>(totals.loose_order + totals.loose_step),
            std::max(1.0, kMaxLooseShare * static_cast<double>(totals.records)));
}

}  // namespace
}  // namespace giga::golden
