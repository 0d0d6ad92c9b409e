// ObservationReader: the numbers of one agent's observation by name. The layout is written by
// sim/vector_observation.hpp; this is the one place that scripts read it through.
#pragma once

#include "core/geometry.hpp"
#include "sim/params.hpp"
#include "sim/vector_observation.hpp"

namespace giga {

/// The agent that observes. Units of the map, units a second, radians. All zero for the dead where communication is
/// stochastic: they do not hear themselves.
struct OwnState {
  float x, y, z, speed, heading, health;
};

/// Another agent: its place relative to the observer.
struct SeenAgent {
  bool seen;  ///< false: there is nobody in this row, nor in those behind it; the rest is zero
  bool same_team;
  float dx, dy, dz;
  float heading, speed;  ///< its own, not relative
  float health;

  GIGA_HD float distance() const { return std::sqrt(dx * dx + dy * dy); }
};

/// The waypoint: its centre relative to the observer and the seconds that it will last. active = false: there is none.
struct SeenWaypoint {
  bool active;
  float dx, dy;
  float seconds;
};

/// An obstacle in the plane.
struct SeenBox {
  float x1, y1, x2, y2;
  GIGA_HD bool exists() const { return x1 < x2 && y1 < y2; }
};

/// Reads one row of observations. Beside the row it knows what the rules tell everybody: the size of the map and which
/// numbers the observation has.
class ObservationReader {
 public:
  /// Both must outlive the reader. `row` [observation_size(p)].
  GIGA_HD ObservationReader(const SimParams& p, const float* row) : p_(p), row_(row) {}

  GIGA_HD const SimParams& rules() const { return p_; }

  GIGA_HD OwnState own() const {
    return {row_[kX] * p_.limit_x,          row_[kY] * p_.limit_y, row_[kZ] * kAltitudeLimit,
            row_[kSpeed] / p_.inv_diagonal, row_[kHeading],        row_[kHealth]};
  }

  /// Rows of other agents, the nearest first.
  GIGA_HD int n_others() const { return p_.n_neighbors - 1; }
  GIGA_HD SeenAgent other(int index) const {
    const float* f = row_ + (index + 1) * kNeighborFeatures;
    if (f[kSeen] == 0) return {};
    return {true,
            f[kSameTeam] != 0,
            f[kX] * p_.limit_x,
            f[kY] * p_.limit_y,
            f[kZ] * kAltitudeLimit,
            row_[kHeading] + f[kHeading],
            (row_[kSpeed] + f[kSpeed]) / p_.inv_diagonal,
            f[kHealth]};
  }
  /// The nearest opponent that is seen; not `seen` where there is none.
  GIGA_HD SeenAgent nearest_enemy() const {
    for (int k = 0; k < n_others(); ++k) {
      const SeenAgent a = other(k);
      if (!a.seen || !a.same_team) return a;
    }
    return {};
  }

  GIGA_HD SeenWaypoint waypoint() const {
    if (!p_.waypoints) return {};
    const float* f = row_ + neighbor_columns(p_);
    return {f[4] > 0, 0.5f * (f[0] + f[2]) * p_.limit_x, 0.5f * (f[1] + f[3]) * p_.limit_y, f[4]};
  }

  /// Obstacles of the map; maps with fewer than others of their set have some that do not exist.
  GIGA_HD int n_boxes() const { return p_.n_boxes; }
  GIGA_HD SeenBox box(int index) const {
    const float* f = row_ + neighbor_columns(p_) + (p_.waypoints ? kWaypointFeatures : 0) + index * box_features(p_);
    return {f[0] * p_.limit_x, f[1] * p_.limit_y, f[2] * p_.limit_x, f[3] * p_.limit_y};
  }

 private:
  const SimParams& p_;
  const float* row_;
};

}  // namespace giga
