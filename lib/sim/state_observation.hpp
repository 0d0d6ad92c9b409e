// The true state of a world as numbers for a centralized critic (critic.kind: state). Actors never see it.
#pragma once

#include "core/geometry.hpp"
#include "sim/vector_observation.hpp"
#include "sim/world.hpp"

namespace giga {

/// Per agent: alive, x, y, z, sine and cosine of the heading, v, health, health / max_health, thrust, range,
/// damage_range; all zero for the dead.
constexpr int kEntityFeatures = 12;
/// Per world: waypoint centre x and y, waypoint active, its remaining seconds / 10, share of the episode passed; then
/// four numbers per box of the map (six with obstacle_heights).
constexpr int kWorldFeatures = 5;

GIGA_HD int world_feature_count(const Parameters auto& p) { return kWorldFeatures + p.n_boxes * box_features(p); }
GIGA_HD int state_size(const Parameters auto& p) { return p.n_agents * kEntityFeatures + world_feature_count(p); }

GIGA_HD float entity_feature(const Parameters auto& p, const World auto& w, int i, int feature) {
  if (!w.alive[i]) return 0.0f;
  switch (feature) {
    case 0:
      return 1.0f;
    case 1:
      return w.x[i] * p.inv_limit_x;
    case 2:
      return w.y[i] * p.inv_limit_y;
    case 3:
      return w.z[i] * (1.0f / kAltitudeLimit);
    case 4:
      return sin_cos(w.heading[i]).sin;
    case 5:
      return sin_cos(w.heading[i]).cos;
    case 6:
      return w.v[i] * 0.2f;  // speeds lie between 1.3 and about 6
    case 7:
      return w.health[i];
    case 8:
      return w.health[i] / p.agents.max_health[i];
    case 9:
      return p.agents.thrust[i];
    case 10:
      return p.agents.range[i];
    default:
      return p.agents.damage_range[i];
  }
}

GIGA_HD float world_feature(const Parameters auto& p, const World auto& w, int column) {
  const bool active = p.waypoints && *w.waypoint_time > 0;
  switch (column) {
    case 0:
      return active ? (w.waypoint[0] + w.waypoint[2]) * 0.5f * p.inv_limit_x : 0.0f;
    case 1:
      return active ? (w.waypoint[1] + w.waypoint[3]) * 0.5f * p.inv_limit_y : 0.0f;
    case 2:
      return active ? 1.0f : 0.0f;
    case 3:
      return active ? *w.waypoint_time * 0.1f : 0.0f;
    case 4:
      return p.max_episode_length > 0 ? static_cast<float>(*w.episode_length) / static_cast<float>(p.max_episode_length)
                                      : 0.0f;
    default:
      break;
  }
  return table_value(features_of_boxes(p, w) + column - kWorldFeatures);
}

/// Number `column` of the world's state vector: the entities in the order of the agents, then the world.
GIGA_HD float state_value(const Parameters auto& p, const World auto& w, int column) {
  const int n_entity_columns = p.n_agents * kEntityFeatures;
  if (column >= n_entity_columns) return world_feature(p, w, column - n_entity_columns);
  return entity_feature(p, w, column / kEntityFeatures, column % kEntityFeatures);
}

/// The true state of a world; [state_size(p)].
struct StateObservation {
  static constexpr Observation id = Observation::state;
  static constexpr const char* name = "state";
  static constexpr ObservationOf of = ObservationOf::world;
  using Element = float;
  static constexpr ElementType type = ElementType::f32;

  GIGA_HD static bool offered(const Parameters auto&) { return true; }
  GIGA_HD static ObservationShape shape(const Parameters auto& p) { return state_size(p); }

  template <class Lanes, class RowOf>
  GIGA_HD static void write(const Lanes& lanes, const Parameters auto& p, const World auto& w, int n, RowOf&& row_of) {
    float* row = row_of(0);
    lanes.each(n > 0 ? state_size(p) : 0, [&](int k) { row[k] = state_value(p, w, k); });
  }
};

}  // namespace giga
