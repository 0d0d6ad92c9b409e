// Scenario: the rules and numbers of a game, as a user states them. The defaults of all keys live here.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "config/fields.hpp"
#include "core/geometry.hpp"
#include "scenario/agent_type.hpp"
#include "scenario/map.hpp"
#include "sim/params.hpp"

namespace giga {

constexpr std::array<const char*, 2> enum_names(Rules) { return {"corrected", "original"}; }
constexpr std::array<const char*, 2> enum_names(ActionKind) { return {"discrete", "continuous"}; }

enum class ObservationType : uint8_t { vector, rgb, rgb_vector };
constexpr std::array<const char*, 3> enum_names(ObservationType) { return {"vector", "rgb", "rgb_vector"}; }

/// So many agents of a type.
struct TeamEntry {
  std::string type = "default";
  int count = 1;

  bool operator==(const TeamEntry&) const = default;
};

template <class V>
void visit_fields(V& v, TeamEntry& c) {
  v("type", c.type, "agent type: a name, or the path of a file with one");
  v("count", c.count, "number of agents", range(1, 1e6));
}

/// The maps of which an episode draws one, all alike. As YAML: `all`, `empty`, one name or path, or a list of those.
struct MapSelection {
  std::vector<std::string> names;

  static MapSelection all();    ///< the eight that come with the original
  static MapSelection empty();  ///< no obstacles: `empty` and `empty_flipped`
  bool operator==(const MapSelection&) const = default;
};

template <>
struct FieldCodec<MapSelection> {
  static bool read(const Node& node, MapSelection& maps, const Allowed& allowed, const ReadSite& site);
  static std::string print(const MapSelection& maps);
  static std::string expected(const Allowed&) {
    return "all, empty, the name or path of a map, or a list of names and paths";
  }
  static ValueShape shape(const Allowed&);
};

struct SightConfig {
  float very_close_cone_depth = 1;
  float cone_depth = 3;
  float cone_angle = 0.75f * kPi;
  bool use_stochastic_obs = true;
  bool obstacles_block_sight = false;
  bool sight_3d = false;
};

template <class V>
void visit_fields(V& v, SightConfig& c) {
  v("very_close_cone_depth", c.very_close_cone_depth, "opponents nearer than this (units) are always detected",
    at_least(0));
  v("cone_depth", c.cone_depth, "how far an agent detects opponents (units)", at_least(0));
  v("cone_angle", c.cone_angle, "half angle of the sight cone (radians); pi or more = every direction", range(0, 6.3));
  v("use_stochastic_obs", c.use_stochastic_obs, "detection succeeds with probability 1 - (distance / depth)^2");
  v("obstacles_block_sight", c.obstacles_block_sight, "no detection through an obstacle (beyond the original)");
  v("sight_3d", c.sight_3d, "distances and cones of sight and damage use the altitude too (beyond the original)");
}

struct CommunicationConfig {
  float communication_range = 8;
  bool use_stochastic_comm = true;
};

template <class V>
void visit_fields(V& v, CommunicationConfig& c) {
  v("communication_range", c.communication_range, "distance from which a team mate cannot be heard (units)",
    greater_than(0));
  v("use_stochastic_comm", c.use_stochastic_comm, "team mates are heard with probability 1 - distance / range");
}

struct DamageConfig {
  float damage_cone_depth = 2.05f;
  float damage_cone_angle = kPi / 4;
  float damage_per_second = 1;
  float healing_per_second = 0.1f;
  int min_tracking_time = 3;
  int max_tracking_time = 10;
};

template <class V>
void visit_fields(V& v, DamageConfig& c) {
  v("damage_cone_depth", c.damage_cone_depth, "how far an agent shoots (units); 0 = nobody does", at_least(0));
  v("damage_cone_angle", c.damage_cone_angle, "half angle of the weapon cone (radians)", range(0, 6.3));
  v("damage_per_second", c.damage_per_second, "health lost a second for each step of tracking beyond the minimum",
    at_least(0));
  v("healing_per_second", c.healing_per_second, "health gained a second", at_least(0));
  v("min_tracking_time", c.min_tracking_time, "steps of unbroken tracking before damage starts", range(0, 255));
  v("max_tracking_time", c.max_tracking_time, "steps of unbroken tracking after which damage grows no more",
    range(0, 255));
}

struct CollisionConfig {
  float collision_range = 0.4f;
  float collision_altitude = 0.5f;
  bool obstacle_heights = false;
};

template <class V>
void visit_fields(V& v, CollisionConfig& c) {
  v("collision_range", c.collision_range, "agents nearer than this in the plane (units) collide; 0 = never",
    at_least(0));
  v("collision_altitude", c.collision_altitude, "and nearer than this in altitude (both conditions must hold)",
    at_least(0));
  v("obstacle_heights", c.obstacle_heights, "obstacles are solid between their z1 and z2 only (beyond the original)");
}

struct WaypointConfig {
  bool enable_waypoints = false;
  float waypoint_size = 0.6f;
  std::optional<int> shown_steps;
};

/// The longest that a waypoint stays.
constexpr int kWaypointSteps = 100;

template <class V>
void visit_fields(V& v, WaypointConfig& c) {
  v("enable_waypoints", c.enable_waypoints, "waypoints appear; they heal and reward those who reach them");
  v("waypoint_size", c.waypoint_size, "side of the square (units)", greater_than(0));
  v("shown_steps", c.shown_steps,
    "agents are shown a waypoint for so many steps after it appears, and it stays for 100: who is to reach it must "
    "remember it (beyond the original); none = as long as it stays, 50 to 100 steps",
    range(1, kWaypointSteps - 1));
}

constexpr std::array<const char*, 2> enum_names(WinBy) { return {"elimination", "waypoints"}; }
constexpr std::array<const char*, 3> enum_names(LimitWinner) { return {"tie", "team_0", "team_1"}; }

template <class V>
void visit_fields(V& v, WinRule& c) {
  v("by", c.by,
    "elimination: the team that is wiped out first loses; both in the same step is a tie. waypoints: the "
    "team that has collected more when the episode ends wins; equal numbers are a tie");
  v("at_time_limit", c.at_time_limit,
    "who wins if max_episode_length ends an undecided episode: both teams live or, by waypoints, have "
    "collected equally many");
}

struct RewardConfig {
  std::array<float, kNRewardTerms> weight;  ///< by RewardTerm; that of idle_reward is unused
  bool divide_reward_by_team_size = true;

  RewardConfig();
  float& operator[](RewardTerm term) { return weight[static_cast<size_t>(term)]; }
  float operator[](RewardTerm term) const { return weight[static_cast<size_t>(term)]; }
};

/// What a weight pays for, in one line.
const char* reward_doc(RewardTerm term);

template <class V>
void visit_fields(V& v, RewardConfig& c) {
  for (int t = 0; t < kNRewardTerms; ++t) {
    const RewardTerm term = static_cast<RewardTerm>(t);
    if (term != RewardTerm::idle_reward) v(kRewardTermNames[t], c[term], reward_doc(term), at_least(0));
  }
  v("divide_reward_by_team_size", c.divide_reward_by_team_size, "divide by the number of all agents");
}

struct ObservationConfig {
  ObservationType type = ObservationType::vector;
  int resolution = 84;
  int max_agents = 15;
  bool egocentric_view = false;
};

template <class V>
void visit_fields(V& v, ObservationConfig& c) {
  v("type", c.type, "what an agent's policy is given: numbers, an image (rgb), or both");
  v("resolution", c.resolution, "pixels of each side of an image; only with images", range(8, 512));
  v("max_agents", c.max_agents, "rows of agents in a vector observation, nearest first, the ego included", at_least(1));
  v.renamed("body_view", "egocentric_view");
  v("egocentric_view", c.egocentric_view,
    "add the egocentric view (beyond the original), relative to the agent's heading: walls in 12 "
    "directions, the waypoint, the nearest 3 opponents and 2 mates of those in its max_agents rows, and "
    "their kinds where a team mixes kinds");
}

struct Scenario {
  std::string name;  ///< not a key: the name of the file, or as asked for
  std::string description;
  Rules rules = Rules::corrected;
  ActionKind action = ActionKind::discrete;
  float limit_x = 10, limit_y = 10;
  std::optional<int> max_episode_length = 500;
  bool episode_ends_one_team_dead = true;
  std::vector<TeamEntry> team_0, team_1;
  MapSelection maps = MapSelection::all();
  SightConfig sight;
  CommunicationConfig communication;
  DamageConfig damage;
  CollisionConfig collision;
  WaypointConfig waypoints;
  WinRule win;
  RewardConfig rewards;
  ObservationConfig observation;
  std::map<std::string, AgentType> agent_types;  ///< loaded: those that the teams name
  std::map<std::string, Map> map_definitions;    ///< loaded: those that `maps` names, none of them `flipped_of`

  KeyPositions where;                  ///< not a key: where each key was given, for messages
  std::optional<Position> file_start;  ///< likewise, of the file that it is read from, for keys that nobody gives

  /// Where the first of the keys that some file gives stands.
  Position position_of(const std::vector<std::string>& keys) const;
};

template <class V>
void visit_fields(V& v, Scenario& c) {
  v("description", c.description, "one line for people");
  v("rules", c.rules,
    "original: the published JAX package with its quirks; corrected: without those listed in "
    "docs/rules.md, section 15");
  v("action", c.action, "discrete: 27 combinations of heading, dive, throttle in {-1, 0, 1}; continuous: [-1, 1]^3");
  v("limit_x", c.limit_x, "width of the world (units)", at_least(0.01));
  v("limit_y", c.limit_y, "height of the world (units)", at_least(0.01));
  v("max_episode_length", c.max_episode_length, "time limit (steps of 0.1 s)", range(1, 1e6));
  v("episode_ends_one_team_dead", c.episode_ends_one_team_dead,
    "true: an episode ends when one team is wiped out; false: when both are");
  v.list("team_0", c.team_0, "agents of team 0, as type and count");
  v.list("team_1", c.team_1, "agents of team 1");
  v("maps", c.maps, "each episode draws one of these maps");
  v.group("sight", c.sight, "who detects whom");
  v.group("communication", c.communication, "who tells whom what it sees");
  v.group("damage", c.damage, "shooting and healing");
  v.group("collision", c.collision, "agents and obstacles");
  v.group("waypoints", c.waypoints, "places to reach");
  v.group("win", c.win,
          "what counts as a win in eval, ratings and training; no step, reward or observation depends on it");
  v.group("rewards", c.rewards,
          "weights of the reward's terms; 0 switches a term off; those of penalties are above 0 too");
  v.group("observation", c.observation, "what a policy sees");
  v.table("agent_types", c.agent_types, "agent types by name, beside those of agent_types.yaml");
  v.table("map_definitions", c.map_definitions, "maps by name, beside those of maps/");
}

/// What is a win and what a tie, in two sentences; a time limit of 0 steps is none.
std::string describe_win(const WinRule& win, int time_limit);

/// The scenario as YAML with documentation, units and defaults; stands alone and loads again.
std::string print_scenario(const Scenario& scenario);

}  // namespace giga
