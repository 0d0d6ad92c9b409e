// compile(): checks, squares and cosines, tables of agents and maps.
#include "scenario/compile.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>

#include "core/error.hpp"
#include "scenario/coverage.hpp"
#include "sim/map_tables.hpp"
#include "sim/movement.hpp"
#include "sim/physics.hpp"
#include "sim/rewards.hpp"

namespace giga {
namespace {

/// Collects findings with the place in the file that caused them.
class Checker {
 public:
  Checker(const Scenario& scenario, Errors& errors)
      : scenario_(scenario), errors_(errors), has_errors_(!errors.empty()) {}

  /// Are the keys as the user meant them? Where not, a finding about them would only repeat an error.
  bool can_judge(const std::vector<std::string>& keys) const {
    return !has_errors_ || std::none_of(keys.begin(), keys.end(), [&](const std::string& key) {
      return is_wrong(key, scenario_.where, errors_);
    });
  }

  /// Adds a finding at the first of the keys that some file gives.
  void fail(const std::vector<std::string>& keys, const std::string& message) {
    errors_.add(scenario_.position_of(keys), message);
  }

 private:
  const Scenario& scenario_;
  Errors& errors_;
  const bool has_errors_;  // before the first finding
};

float squared(float v) { return v * v; }

float cosine(float angle) { return static_cast<float>(std::cos(static_cast<double>(angle))); }

bool is_full_turn(float half_angle) { return static_cast<double>(half_angle) >= static_cast<double>(kPi) - 1e-6; }

SimParams numbers_of(const Scenario& s) {
  SimParams p;
  p.rules = s.rules;
  p.actions = s.action;
  p.limit_x = s.limit_x;
  p.limit_y = s.limit_y;

  p.very_close_depth2 = squared(s.sight.very_close_cone_depth);
  p.cone_depth2 = squared(s.sight.cone_depth);
  p.cone_cos = cosine(s.sight.cone_angle);
  p.cone_is_full = is_full_turn(s.sight.cone_angle);
  p.damage_cone_depth2 = squared(s.damage.damage_cone_depth);
  p.damage_cone_cos = cosine(s.damage.damage_cone_angle);
  p.damage_cone_is_full = is_full_turn(s.damage.damage_cone_angle);
  p.stochastic_detection = s.sight.use_stochastic_obs;
  p.stochastic_communication = s.communication.use_stochastic_comm;
  p.communication_range = s.communication.communication_range;

  p.damage_per_second = s.damage.damage_per_second;
  p.healing_per_second = s.damage.healing_per_second;
  p.min_tracking_time = s.damage.min_tracking_time;
  p.max_tracking_time = s.damage.max_tracking_time;

  p.collision_range2 = squared(s.collision.collision_range);
  p.collision_altitude = s.collision.collision_altitude;

  p.waypoints = s.waypoints.enable_waypoints;
  p.waypoint_size = s.waypoints.waypoint_size;
  // Half a step less, so that rounding does not count.
  if (s.waypoints.shown_steps)
    p.waypoint_unseen_time = (static_cast<float>(kWaypointSteps - *s.waypoints.shown_steps) + 0.5f) * kDt;

  p.max_episode_length = s.max_episode_length.value_or(0);
  p.episode_ends_one_team_dead = s.episode_ends_one_team_dead;
  p.win = s.win;

  for (int t = 0; t < kNRewardTerms; ++t) p.reward_weight[t] = s.rewards[static_cast<RewardTerm>(t)];
  p.reward_weight[static_cast<int>(RewardTerm::idle_reward)] = 0;
  p.divide_reward_by_team_size = s.rewards.divide_reward_by_team_size;

  p.obstacle_heights = s.collision.obstacle_heights;
  p.obstacles_block_sight = s.sight.obstacles_block_sight;
  p.sight_3d = s.sight.sight_3d;
  p.egocentric_view = s.observation.egocentric_view;
  p.resolution = s.observation.type == ObservationType::vector ? 0 : s.observation.resolution;
  p.images_only = s.observation.type == ObservationType::rgb;
  return p;
}

/// Places are 32-bit floats (rules 17.6). On the largest side they tell apart 1 / 512 of a unit: on one of twice that
/// even a first step without brakes, 0.096 units, would be less than kGapsOfStep of them.
constexpr float kLargestSide = 32768, kGapsOfStep = 32;
/// Up to here they tell apart 1 / 16,384 of a unit, and an agent may be as slow as it likes.
constexpr float kFineSide = 1024;

/// What places tell apart at the far end of a side.
float gap_of_places(float side) { return side - std::nextafter(side, 0.0f); }

/// The shortest step of a living agent: the first, with full brakes. It starts slower than it flies ever after
/// (reset.hpp). One that could be pushed backwards can also be brought to a stand.
float slowest_step(float thrust) {
  constexpr float kStartSpeed = 1;
  const Flight braked = flown(SimParams(), {0, 0, 0, kStartSpeed, 0, {}}, true, {0, 0, -1}, thrust);
  return std::max(braked.x, 0.0f);
}

/// Is every step well above what places tell apart?
bool steps_count(float thrust, float side) {
  return side <= kFineSide || slowest_step(thrust) >= kGapsOfStep * gap_of_places(side);
}

void check_steps(const Scenario& s, Checker& check) {
  const float side = std::max(s.limit_x, s.limit_y);
  if (side > kLargestSide || !check.can_judge({"agent_types", "limit_x", "limit_y"})) return;
  std::set<std::string> types;
  for (const auto* team : {&s.team_0, &s.team_1})
    for (const TeamEntry& entry : *team) types.insert(entry.type);
  for (const std::string& name : types) {
    const auto found = s.agent_types.find(name);
    if (found == s.agent_types.end() || steps_count(found->second.thrust, side)) continue;
    const float thrust = found->second.thrust;
    int hundredths = 0;
    while (steps_count(static_cast<float>(hundredths + 1) / 100, side)) ++hundredths;
    float longest = kFineSide;
    while (steps_count(thrust, 2 * longest)) longest *= 2;
    const std::string key = cat("agent_types.", name, ".thrust");
    check.fail({key, s.limit_x == side ? "limit_x" : "limit_y"},
               cat(key, ": with ", thrust, " the slowest step is ", slowest_step(thrust), " units, and in a world of ",
                   side, " units places are ", gap_of_places(side), " apart, more than 1 / ", kGapsOfStep,
                   " of that; allowed: at most ", static_cast<float>(hundredths) / 100,
                   " in this world, or sides of at most ", longest));
  }
}

void check_numbers(const Scenario& s, Checker& check) {
  for (const auto& [key, limit] : {std::pair{"limit_x", s.limit_x}, {"limit_y", s.limit_y}})
    if (limit > kLargestSide && check.can_judge({key}))
      check.fail({key}, cat(key, ": in a world of ", limit,
                            " units places are too coarse for the slowest step; allowed: at most ", kLargestSide));
  if (s.damage.min_tracking_time > s.damage.max_tracking_time && check.can_judge({"damage"}))
    check.fail({"damage.min_tracking_time", "damage.max_tracking_time"},
               cat("damage.min_tracking_time: ", s.damage.min_tracking_time, " is more than max_tracking_time, ",
                   s.damage.max_tracking_time));
  if (s.waypoints.enable_waypoints && s.waypoints.waypoint_size > std::min(s.limit_x, s.limit_y) &&
      check.can_judge({"waypoints", "limit_x", "limit_y"}))
    check.fail({"waypoints.waypoint_size", "waypoints.enable_waypoints"},
               cat("waypoints.waypoint_size: ", s.waypoints.waypoint_size, " does not fit into a world of ", s.limit_x,
                   " x ", s.limit_y));
  if (s.waypoints.shown_steps && check.can_judge({"waypoints", "rules"})) {
    if (!s.waypoints.enable_waypoints)
      check.fail({"waypoints.shown_steps", "waypoints.enable_waypoints"},
                 "waypoints.shown_steps: this means nothing without waypoints.enable_waypoints: true");
    else if (s.rules == Rules::original)
      check.fail({"waypoints.shown_steps", "rules"},
                 "waypoints.shown_steps: the original shows waypoints as long as they stay; it needs rules: corrected");
  }
  if (s.win.by == WinBy::waypoints && !s.waypoints.enable_waypoints && check.can_judge({"win", "waypoints"}))
    check.fail({"win.by", "waypoints.enable_waypoints"}, "win.by: waypoints needs waypoints.enable_waypoints: true");
  if (s.win.at_time_limit != LimitWinner::tie && !s.max_episode_length &&
      check.can_judge({"win", "max_episode_length"}))
    check.fail({"win.at_time_limit", "max_episode_length"},
               cat("win.at_time_limit: ", FieldCodec<LimitWinner>::print(s.win.at_time_limit),
                   " needs a time limit, and max_episode_length is none"));
}

void check_observation(const Scenario& s, Checker& check) {
  const ObservationConfig& o = s.observation;
  if (o.type == ObservationType::rgb && o.egocentric_view && check.can_judge({"observation"}))
    check.fail({"observation.egocentric_view", "observation.type"},
               "observation.egocentric_view: these are numbers, and observation.type rgb gives images alone; "
               "rgb_vector gives both");
  if (o.type == ObservationType::vector && o.resolution != ObservationConfig{}.resolution &&
      check.can_judge({"observation"}))
    check.fail(
        {"observation.resolution"},
        "observation.resolution: there are no images with observation.type vector; rgb and rgb_vector have them");
}

void add_team(const Scenario& s, int team, std::vector<AgentSpec>& agents, Checker& check) {
  const std::string key = cat("team_", team);
  const std::vector<TeamEntry>& entries = team == 0 ? s.team_0 : s.team_1;
  if (entries.empty())
    check.fail({key}, cat(key,
                          ": the team is empty; it needs at least one entry such as "
                          "{type: default, count: 5}"));
  for (size_t k = 0; k < entries.size(); ++k) {
    const auto found = s.agent_types.find(entries[k].type);
    if (found == s.agent_types.end()) {
      check.fail({cat(key, "[", k, "].type"), key}, cat(key, ": unknown agent type '", entries[k].type, "'"));
      continue;
    }
    const AgentType& type = found->second;
    const AgentSpec agent{team,       type.sprite,       type.thrust,     type.max_health,
                          type.range, type.damage_range, type.idle_reward};
    agents.insert(agents.end(), static_cast<size_t>(entries[k].count), agent);
  }
}

/// What worlds whose pairs are found by place do not have (rules 17).
void check_many(const Scenario& s, int64_t count, Checker& check) {
  const std::string many = cat(count, " agents in a world; above ", kMaxAgents, " ");
  if (s.observation.type != ObservationType::vector && check.can_judge({"observation"}))
    check.fail({"observation.type", "team_0", "team_1"},
               cat("observation.type: ", many, "there are no images; allowed: vector"));
  const auto has_boxes = [&](const std::string& name) {
    const auto map = s.map_definitions.find(name);
    return map != s.map_definitions.end() && !map->second.boxes.empty();
  };
  if (s.rewards[RewardTerm::approach] > 0 && std::any_of(s.maps.names.begin(), s.maps.names.end(), has_boxes) &&
      check.can_judge({"rewards", "maps"}))
    check.fail({"rewards.approach", "maps"},
               cat("rewards.approach: ", many, "ways are straight; allowed: 0, or maps without obstacles"));
}

std::vector<AgentSpec> agents_of(const Scenario& s, Checker& check) {
  int64_t count = 0;
  for (const auto* team : {&s.team_0, &s.team_1})
    for (const TeamEntry& entry : *team) count += entry.count;
  std::vector<AgentSpec> agents;
  if (!check.can_judge({"agent_types"})) return agents;
  if (count > kMaxGridAgents && check.can_judge({"team_0", "team_1"})) {
    check.fail({"team_0", "team_1"},
               cat("team_0, team_1: ", count, " agents in a world; allowed: at most ", kMaxGridAgents));
    return agents;
  }
  if (count > kMaxAgents && check.can_judge({"team_0", "team_1"})) check_many(s, count, check);
  for (int team = 0; team < kNTeams; ++team)
    if (check.can_judge({cat("team_", team)})) add_team(s, team, agents, check);
  return agents;
}

/// Stretches coordinates from the frame of the map to the world. The original divides by 10, which its compiler turns
/// into a multiplication by 0.1 where several maps are stacked; start areas then differ in the last bit (recorded maps
/// of 12 x 8 units), so we round as it does.
struct Stretch {
  const Map& map;
  const Scenario& scenario;

  float x(float v) const { return scaled(v, map.size[0], scenario.limit_x); }
  float y(float v) const { return scaled(v, map.size[1], scenario.limit_y); }
  float scaled(float v, float frame, float limit) const {
    if (v == frame) return limit;  // exactly the border
    const bool stacked = scenario.maps.names.size() > 1;
    return (stacked ? v * (1.0f / frame) : v / frame) * limit;
  }
};

void check_start(const std::string& name, int team, const Scenario& s, const MapSpec& map, Checker& check) {
  const StartArea& start = map.start[team];
  const std::string key = cat("map_definitions.", name, ".team_", team);
  const std::vector<std::string> keys = {key + ".area", key, "map_definitions." + name, "maps"};
  const std::string what = cat("map '", name, "': the start area of team ", team, ", ",
                               FieldCodec<std::array<float, 4>>::print({start.x1, start.y1, start.x2, start.y2}));
  const auto rises = [&](const char* of, float low, float high) {
    if (low <= high) return;
    check.fail({cat(key, ".", of), key}, cat(what, ": the ", of, " goes from low to high, and is ",
                                             FieldCodec<std::array<float, 2>>::print({low, high})));
  };
  rises("height", start.z_lo, start.z_hi);
  rises("heading", start.heading_lo, start.heading_hi);
  if (start.x1 > start.x2 || start.y1 > start.y2) return check.fail(keys, what + ", needs x1 <= x2 and y1 <= y2");
  if (start.x1 < 0 || start.y1 < 0 || start.x2 > s.limit_x || start.y2 > s.limit_y)
    check.fail(keys, cat(what, ", reaches outside the world of ", s.limit_x, " x ", s.limit_y));
  // Boxes may cover a part of the area (agents are drawn again), but not the whole.
  if (covers(map.boxes, {start.x1, start.y1, start.x2, start.y2, start.z_lo, start.z_hi}, s.collision.obstacle_heights))
    check.fail(keys, what + (map.boxes.size() > 1 ? ", lies inside obstacles" : ", lies inside an obstacle"));
}

/// A box outside the frame stands in nobody's way: it was meant elsewhere.
void check_box(const std::string& name, size_t k, const Map& map, bool with_heights, Checker& check) {
  const auto& [x1, y1, x2, y2] = map.boxes[k].area;
  const auto& [width, height] = map.size;
  const auto& [z1, z2] = map.boxes[k].height;
  const bool on_map = x2 > 0 && y2 > 0 && x1 < width && y1 < height;
  if (on_map && (!with_heights || (z2 >= 0 && z1 <= kAltitudeLimit))) return;
  const std::string of_map = "map_definitions." + name;
  check.fail({cat(of_map, ".boxes[", k, "]"), of_map + ".boxes", of_map, "maps"},
             cat("map '", name, "': the box ", FieldCodec<MapBox>::print(map.boxes[k]), ", lies outside ",
                 on_map ? cat("the altitudes, 0 to ", kAltitudeLimit)
                        : cat("the map, whose size is ", FieldCodec<std::array<float, 2>>::print(map.size))));
}

MapSpec map_of(const std::string& name, const Map& map, const Scenario& s, Checker& check) {
  const Stretch stretch{map, s};
  MapSpec spec;
  spec.name = name;
  for (size_t k = 0; k < map.boxes.size(); ++k) {
    const MapBox& box = map.boxes[k];
    const auto& [x1, y1, x2, y2] = box.area;
    check_box(name, k, map, s.collision.obstacle_heights, check);
    spec.boxes.push_back({stretch.x(x1), stretch.y(y1), stretch.x(x2), stretch.y(y2), box.height[0], box.height[1]});
  }
  for (int team = 0; team < kNTeams; ++team) {
    const MapStart& start = team == 0 ? map.team_0 : map.team_1;
    const auto& [x1, y1, x2, y2] = start.area;
    spec.start[team] = {stretch.x(x1),   stretch.y(y1),   stretch.x(x2),    stretch.y(y2),
                        start.height[0], start.height[1], start.heading[0], start.heading[1]};
    check_start(name, team, s, spec, check);
  }
  return spec;
}

}  // namespace

SimSpec compile(const Scenario& scenario) {
  Errors errors;
  SimSpec spec = compile(scenario, errors);
  errors.throw_if_any();
  return spec;
}

SimSpec compile(const Scenario& scenario, Errors& errors) {
  Checker check(scenario, errors);
  check_numbers(scenario, check);
  check_steps(scenario, check);
  check_observation(scenario, check);

  SimSpec spec;
  spec.name = scenario.name;
  spec.params = numbers_of(scenario);
  spec.neighbor_limit = scenario.observation.max_agents;
  spec.agents = agents_of(scenario, check);
  const bool maps_known = check.can_judge({"maps", "limit_x", "limit_y", "collision.obstacle_heights"});
  for (const std::string& name : maps_known ? scenario.maps.names : std::vector<std::string>()) {
    if (!check.can_judge({"map_definitions." + name})) continue;
    const auto map = scenario.map_definitions.find(name);
    if (map == scenario.map_definitions.end())
      check.fail({"maps"}, cat("maps: unknown map '", name, "'"));
    else
      spec.maps.push_back(map_of(name, map->second, scenario, check));
  }
  if (errors.empty()) spec.finish();
  if (errors.empty() && spec.params.n_boxes > 0 && term_active(spec.params, RewardTerm::approach))
    for (MapSpec& map : spec.maps) map.paths = make_path_table(scenario.limit_x, scenario.limit_y, map.boxes);
  return spec;
}

}  // namespace giga
