// Vector observations: 9 numbers a row, then waypoint and boxes.
#include "golden/observation_check.hpp"

#include <array>
#include <cmath>
#include <vector>

#include "sim/vector_observation.hpp"

namespace giga::golden {
namespace {

constexpr std::array<const char*, kNeighborFeatures> kFeatureNames = {
    "vec.seen", "vec.team", "vec.x", "vec.y", "vec.z", "vec.heading", "vec.v", "vec.health", "vec.sprite"};
constexpr int kHeadingFeature = 5;

void compare_row(Comparison& c, int agent, int row, const float* got, const float* want, bool modulo_turn) {
  for (int f = 0; f < kNeighborFeatures; ++f) {
    const char* name = kFeatureNames[static_cast<size_t>(f)];
    const int column = row * kNeighborFeatures + f;
    if (f == kHeadingFeature) {
      c.angle(name, agent, column, got[f], want[f], modulo_turn);
    } else {
      c.near(name, agent, column, got[f], want[f]);
    }
  }
}

void compare_tail(Comparison& c, const GoldenWorld& world, int agent, const float* recorded) {
  const float* got = world.observation(agent);
  const int first = world.params().n_neighbors * kNeighborFeatures, end = world.columns();
  for (int k = first; k < end; ++k) {
    const bool waypoint = world.params().waypoints && k < first + 5;
    c.near(waypoint ? "vec.waypoint" : "vec.boxes", agent, k, got[k], recorded[k]);
  }
}

bool rows_match(const float* got, const float* want) {
  Comparison c;
  compare_row(c, 0, 0, got, want, true);
  return c.passed();
}

}  // namespace

void compare_observation(Comparison& c, const GoldenWorld& world, int agent, const float* recorded, bool modulo_turn) {
  for (int row = 0; row < world.params().n_neighbors; ++row) {
    const int at = row * kNeighborFeatures;
    compare_row(c, agent, row, world.observation(agent) + at, recorded + at, modulo_turn && row > 0);
  }
  compare_tail(c, world, agent, recorded);
}

void compare_observation_as_set(Comparison& c, const GoldenWorld& world, int agent, const float* recorded) {
  const float* got = world.observation(agent);
  const int n = world.params().n_neighbors;
  std::vector<bool> taken(static_cast<size_t>(n), false);
  compare_row(c, agent, 0, got, recorded, false);
  const auto distance = [&](const float* row) {
    return std::hypot(row[2] * world.params().limit_x, row[3] * world.params().limit_y);
  };
  for (int row = 1; row < n; ++row) {
    const float* want = recorded + row * kNeighborFeatures;
    int match = 0;
    for (int k = 1; k < n && !match; ++k)
      if (!taken[static_cast<size_t>(k)] && rows_match(got + k * kNeighborFeatures, want)) match = k;
    if (match) {
      taken[static_cast<size_t>(match)] = true;
      compare_row(c, agent, row, got + match * kNeighborFeatures, want, true);
      continue;
    }
    // Nobody matches: that is only right where the row limit cut one of two equally distant agents off.
    const float* last = got + (n - 1) * kNeighborFeatures;
    const bool cut = n < world.n_agents() && want[0] == 1 && last[0] == 1;
    if (cut) {
      c.near("vec.distance_of_last", agent, row, distance(last), distance(want));
    } else {
      compare_row(c, agent, row, got + row * kNeighborFeatures, want, true);
    }
  }
  compare_tail(c, world, agent, recorded);
}

}  // namespace giga::golden
