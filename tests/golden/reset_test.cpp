// Every recorded reset of the original, with its draws: places, headings, resampling, first observation.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "core/error.hpp"
#include "golden/comparison.hpp"
#include "golden/golden_world.hpp"
#include "golden/observation_check.hpp"
#include "golden/recording.hpp"
#include "sim/reset.hpp"

namespace giga::golden {
namespace {

constexpr double kMaxLooseResets = 0.01;

/// One reset case in memory.
struct ResetCase {
  std::string where;
  GoldenWorld world;
  Array<float> first[4], retry[4];  // draws by StartDraw
  Array<float> comm, x, y, z, v, heading, health, alive, obs, margin;
  Array<int32_t> map_draw, map_idx, n_resampled;

  ResetCase(const std::string& file, const H5Group& g, const std::string& name)
      : where(file + " reset/" + name),
        world(recorded_spec(g, name)),
        comm(g.floats_if("draws/comm")),
        x(g.floats("state/x")),
        y(g.floats("state/y")),
        z(g.floats("state/z")),
        v(g.floats("state/v")),
        heading(g.floats("state/heading")),
        health(g.floats("state/health")),
        alive(g.floats("state/alive")),
        obs(g.floats("obs")),
        margin(g.floats("margin")),
        map_draw(g.ints("draws/map_idx")),
        map_idx(g.ints("state/map_idx")),
        n_resampled(g.ints("n_resampled")) {
    const char* axis[4] = {"x", "y", "z", "heading"};
    for (int k = 0; k < 4; ++k) {
      first[k] = g.floats(std::string("draws/u_") + axis[k]);
      if (k < 3) retry[k] = g.floats(std::string("draws/u_") + axis[k] + "_retry");
    }
    GIGA_CHECK(n_resampled.row_size() == static_cast<size_t>(kResampleRounds), where, ": rounds of resampling");
    GIGA_CHECK(obs.row_size() == x.row_size() * static_cast<size_t>(world.columns()), where,
               ": size of the observation");
  }
  size_t n_records() const { return x.rows(); }
};

/// Recorded draws that also count how many agents were placed anew in each round.
struct CountingDraws : RecordedDraws {
  int n_drawn[kResampleRounds + 1] = {};

  float start(int agent, int round, StartDraw what) {
    if (what == StartDraw::x) ++n_drawn[round];
    return RecordedDraws::start(agent, round, what);
  }
};

/// Marks the state so that a reset that forgets a field is found out.
void soil(GoldenWorld& world) {
  WorldView& w = world.view();
  const int n = world.n_agents();
  for (int i = 0; i < n; ++i) {
    w.x[i] = w.y[i] = w.z[i] = w.v[i] = w.heading[i] = w.health[i] = 3.3f;
    w.alive[i] = 0;
  }
  std::fill(w.tracked, w.tracked + n * n, uint8_t{9});
  std::fill(w.detected, w.detected + n * words_for(n), ~0u);
  std::fill(w.waypoint, w.waypoint + 4, 4.4f);
  *w.waypoint_time = 5.5f;
  *w.episode_length = 77;
  *w.map = 0;
}

/// What no resampling changes.
void compare_certain(Comparison& c, ResetCase& s, size_t t) {
  const WorldView& w = s.world.view();
  const int n = s.world.n_agents();
  c.same("map_idx", -1, -1, *w.map, std::min(s.map_idx.data[t], s.world.params().n_maps - 1));
  c.same("map_idx (unclamped)", -1, -1, s.map_draw.data[t], s.map_idx.data[t]);
  for (int i = 0; i < n; ++i) {
    c.near("v", i, -1, w.v[i], s.v.row(t)[i]);
    c.angle("heading", i, -1, w.heading[i], s.heading.row(t)[i]);
    c.near("health", i, -1, w.health[i], s.health.row(t)[i]);
    c.same("alive", i, -1, w.alive[i], s.alive.row(t)[i] != 0);
    for (int j = 0; j < n; ++j) {
      c.same("tracked", i, j, w.tracked[i * n + j], 0);
      c.same("has_detected", i, j, s.world.detected(i, j), 0);
    }
  }
  // Rules 2: what the original starts with, in fields that were not recorded.
  for (int k = 0; k < 4; ++k) c.near("waypoint_location", -1, k, w.waypoint[k], 0);
  c.near("waypoint_enabled", -1, -1, *w.waypoint_time, 0);
  c.same("episode_length", -1, -1, *w.episode_length, 0);
}

struct ResetTotals {
  long files = 0, cases = 0, records = 0, passed = 0, loose = 0, resampled = 0;
  WorstDifferences worst;
};

void check_reset(ResetCase& s, size_t t, ResetTotals& totals) {
  ++totals.records;
  CountingDraws draws;
  draws.n_agents = s.world.n_agents();
  draws.map_index = s.map_draw.data[t];
  for (int k = 0; k < 4; ++k) {
    draws.start_at[k] = s.first[k].row(t);
    if (k < 3) draws.retry_at[k] = s.retry[k].row(t);
  }
  if (!s.comm.empty()) draws.comm_at = s.comm.row(t);
  soil(s.world);
  s.world.reset(draws);

  Comparison certain, c;
  compare_certain(certain, s, t);
  compare_certain(c, s, t);
  for (int round = 1; round <= kResampleRounds; ++round) {
    c.same("n_resampled", -1, round, draws.n_drawn[round], s.n_resampled.row(t)[round - 1]);
    totals.resampled += s.n_resampled.row(t)[round - 1];
  }
  for (int i = 0; i < s.world.n_agents(); ++i) {
    c.near("x", i, -1, s.world.view().x[i], s.x.row(t)[i]);
    c.near("y", i, -1, s.world.view().y[i], s.y.row(t)[i]);
    c.near("z", i, -1, s.world.view().z[i], s.z.row(t)[i]);
  }
  const size_t size = static_cast<size_t>(s.world.columns());
  for (int i = 0; i < s.world.n_agents(); ++i)
    compare_observation(c, s.world, i, s.obs.row(t) + static_cast<size_t>(i) * size, false);

  const std::string prefix = s.where + " record " + std::to_string(t);
  const bool close = s.margin.data[t] < kMarginLimit;
  if (!c.passed() && close && certain.passed()) {  // rounding decided whether somebody is placed anew
    std::printf("%s: compared loosely (margin %.2g)\n%s", prefix.c_str(), static_cast<double>(s.margin.data[t]),
                c.describe(prefix).c_str());
    ++totals.loose;
    c = certain;
  }
  if (c.passed()) {
    ++totals.passed;
    c.merge_into(totals.worst);
  } else {
    ADD_FAILURE() << c.describe(prefix) << "(margin " << s.margin.data[t] << ")";
  }
}

TEST(GoldenResets, EveryRecordedResetIsReproduced) {
  ResetTotals totals;
  for (const Recording& recording : recordings()) {
    if (!recording.root.has("reset")) continue;
    ++totals.files;
    const H5Group resets = recording.root.group("reset");
    for (const std::string& name : resets.children()) {
      ResetCase s(recording.file, resets.group(name), name);
      ASSERT_GT(s.n_records(), 0u) << s.where << " has no records";
      ++totals.cases;
      for (size_t t = 0; t < s.n_records(); ++t) check_reset(s, t, totals);
    }
  }
  std::printf("golden resets: %ld files, %ld cases, %ld records run, %ld passed, %ld of them compared loosely\n",
              totals.files, totals.cases, totals.records, totals.passed, totals.loose);
  std::printf("  %ld agents were placed anew\nworst difference by field:\n%s", totals.resampled,
              table_of(totals.worst).c_str());
  if (totals.records == 0 && foreign_folder()) GTEST_SKIP() << "no recorded resets in GIGASTEP_GOLDEN_DIR";
  EXPECT_GT(totals.records, 0);
  EXPECT_EQ(totals.passed, totals.records);
  EXPECT_LE(static_cast<double>(totals.loose), std::max(1.0, kMaxLooseResets * static_cast<double>(totals.records)));
}

}  // namespace
}  // namespace giga::golden
