// Replay: games as they were played, in a file that outlives versions: where everybody was, who saw and hit whom, what
// each agent did, and what its networks said. docs/replays.md describes the format.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "config/fields.hpp"

namespace giga {

/// Of worlds in which pairs are kept, and of crowds: those of more agents.
constexpr int kReplayFormat = 3, kCrowdFormat = 4;
/// The most agents of a world of which it is kept of each pair who detects and who shoots at whom; the most of all.
constexpr int kMostPaired = 1024, kMostReplayAgents = 20'000;
/// Agents of each team of a crowd, the first ones, of which it is kept what their networks said.
constexpr int kMostMinds = 64;
constexpr const char* kReplayEnding = ".replay";
/// Numbers of an action, and actions of those that are discrete (rules 3).
constexpr int kReplayControls = 3, kReplayActions = 27;
/// The most agents of a world of which it is also kept who hears whom.
constexpr int kMostListeners = 64;
/// States are kept in whole multiples of these; of x and y the longer side of the world is 5,000, of a crowd 30,000,
/// but not less than kCrowdPlace each; that of health is told in
/// ReplayRules::health_unit. A turn is 65,536 headings, so that those of 16 bits go round; only every 64th is used.
constexpr float kReplayPlaces = 5000, kCrowdPlaces = 30000, kCrowdPlace = 0.01f, kReplayAltitude = 0.02f,
                kReplayTurn = 65536, kReplaySpeed = 0.05f, kReplayHealth = 0.01f, kReplayHealths = 32000;

/// Steps in which values and probabilities are kept.
constexpr int kReplayValues = 31, kReplayShares = 15;

enum class ReplayActions : uint8_t { discrete, continuous };
constexpr std::array<const char*, 2> enum_names(ReplayActions) { return {"discrete", "continuous"}; }

enum class ReplayEnd : uint8_t { tie, team_0, team_1 };
constexpr std::array<const char*, 3> enum_names(ReplayEnd) { return {"tie", "team_0", "team_1"}; }

/// What may happen, and who are `agent` and `other` then.
enum class ReplayEventKind : uint8_t {
  contact,   ///< the first time that a team detects an opponent: who did, and whom
  hit,       ///< fire begins to do damage: shooter and target
  death,     ///< who, and of a collision or shot by whom
  waypoint,  ///< one appears
  collected  ///< an agent reaches it
};
constexpr std::array<const char*, 5> enum_names(ReplayEventKind) {
  return {"contact", "hit", "death", "waypoint", "collected"};
}

enum class ReplayDeath : uint8_t { none, damage, agent, obstacle, out_of_bounds };
constexpr std::array<const char*, 5> enum_names(ReplayDeath) {
  return {"none", "damage", "agent", "obstacle", "out_of_bounds"};
}

struct ReplayAgent {
  int team = 0;
  std::string kind = "default";
  int sprite = 1;
  float max_health = 1, range = 1, damage_range = 1, thrust = 1;
};

struct ReplayMap {
  std::string name;
  std::vector<std::array<float, 6>> boxes;  ///< x1 y1 x2 y2 z1 z2
};

/// The numbers of a scenario that a reader needs for pictures. Lengths in map units, angles in radians.
struct ReplayRules {
  float limit_x = 10, limit_y = 10, limit_z = 10;
  float seconds_per_step = 0.1f;
  int max_episode_length = 0;
  float close_depth = 0;                     ///< nearer opponents are always detected
  float sight_depth = 0, sight_angle = 0;    ///< of a type with range 1; half angle
  float weapon_depth = 0, weapon_angle = 0;  ///< likewise
  float hearing_range = 0;                   ///< 0: all hear all
  int min_tracking_time = 0, max_tracking_time = 0;
  bool waypoints = false;
  bool obstacle_heights = false;
  float health_unit = kReplayHealth;  ///< that of all files from before it was told
};

/// The numbers of flight by which a reader expects the next state (replay_flight.hpp). Angles in radians, times in
/// seconds; see Physics.
struct ReplayFlight {
  float turn_rate = 0, climb_rate = 0, thrust = 0, drag = 0, half_gravity = 0, min_speed = 0;
};

struct ReplayEvent {
  int step = 0;
  ReplayEventKind what = ReplayEventKind::contact;
  int agent = -1, other = -1;
};

/// A waypoint, in the states `from` to `to`.
struct ReplayWaypoint {
  int from = 0, to = 0;
  float x1 = 0, y1 = 0, x2 = 0, y2 = 0;
};

/// Unbroken fire at a target, in the states `from` to `to`: the shooter tracks it in all of them.
struct ReplayFire {
  int from = 0, to = 0, target = 0, shooter = 0;

  bool operator==(const ReplayFire&) const = default;
};

/// What a team's networks said, by agent of the team (of a crowd: by those of Replay::n_minds). Zeros for the dead.
struct ReplayMind {
  float low = 0, high = 0;           ///< of the values; equal: there are none
  int top = 0;                       ///< likeliest actions that are kept; continuous: 1, the means; 0: nothing
  std::vector<uint8_t> value;        ///< [n, states] low + (high - low) value / kReplayValues
  std::vector<uint8_t> likely;       ///< [top, n, states] actions; continuous: [3, n, states] means, 128 + 127 mean
  std::vector<uint8_t> probability;  ///< [top, n, states] in units of 1 / kReplayShares; discrete only
};

/// One episode. T steps have T + 1 states; state 0 is the start. Rows are of agents, one behind the other.
struct ReplayEpisode {
  int map = 0, steps = 0;
  ReplayEnd winner = ReplayEnd::tie;
  bool at_time_limit = false;
  std::array<float, 2> returns{}, score{};  ///< by team
  std::vector<int> died;                    ///< by agent: the first state in which it is dead; -1: it lived
  std::vector<ReplayDeath> cause;           ///< by agent
  /// In each step the hits last, by target and shooter (add_hits). Of a crowd without hits, and with the deaths last,
  /// by agent.
  std::vector<ReplayEvent> events;
  std::vector<ReplayWaypoint> waypoints;
  std::array<ReplayMind, 2> mind;
  int64_t action_check = 0, state_check = 0;  ///< action_checksum; crc32_of all states, bit for bit (docs/replays.md)

  std::vector<float> start;                              ///< [5, N] x, y, z, heading and speed of state 0, exactly
  std::vector<int16_t> x, y, z, heading, speed, health;  ///< [N, states] see kReplayPlaces
  std::vector<uint8_t> action;  ///< [N, T] indices, or [N, T, 3] floats of 4 bytes; the dead do nothing
  /// Bits [pairs, states], those of a pair filled up to whole bytes. Pairs by target and opponent, by target and
  /// shooter, by listener and mate (ReplayPairs). Of a crowd `sees` are bits [N, states], whether a living opponent's
  /// observation has the agent, and the others are empty.
  std::vector<uint8_t> sees, fires, hears;
  std::vector<ReplayFire> fire;  ///< of a crowd, by `from`, target and shooter
};

struct Replay {
  std::string gigastep_version;
  std::string scenario_name;
  std::string scenario;  ///< YAML that stands alone
  std::string seed;      ///< of the draws, as digits; episode k was played in world k
  ReplayActions actions = ReplayActions::discrete;
  std::array<std::string, 2> players, origins;  ///< by side: as the user names them; which file that was
  ReplayRules rules;
  ReplayFlight flight;
  std::vector<ReplayAgent> agents;  ///< team 0 first
  std::vector<ReplayMap> maps;
  std::vector<ReplayEpisode> episodes;

  int n_agents() const { return static_cast<int>(agents.size()); }
  int n_team(int team) const;
  bool is_crowd() const { return n_agents() > kMostPaired; }
  int n_minds(int team) const { return is_crowd() ? std::min(n_team(team), kMostMinds) : n_team(team); }
  bool has_hearing() const { return n_agents() <= kMostListeners; }
  float place_unit() const;  ///< of x and y
};

/// Numbers of pairs of opponents [target, opponent], by target and then by opponent, and of mates [listener, mate].
class ReplayPairs {
 public:
  explicit ReplayPairs(const Replay& replay) : n_{replay.n_team(0), replay.n_team(1)} {}
  ReplayPairs(int n_0, int n_1) : n_{n_0, n_1} {}
  int n_team(int team) const { return n_[team]; }
  int64_t n_opponents() const { return int64_t{2} * n_[0] * n_[1]; }
  int64_t n_mates() const { return int64_t{n_[0]} * (n_[0] - 1) + int64_t{n_[1]} * (n_[1] - 1); }
  int64_t opponents(int target, int opponent) const {
    if (target < n_[0]) return int64_t{target} * n_[1] + opponent - n_[0];
    return int64_t{n_[0]} * n_[1] + int64_t{target - n_[0]} * n_[0] + opponent;
  }
  int64_t mates(int listener, int mate) const {
    const int team = listener < n_[0] ? 0 : 1, first = team * n_[0];
    const int64_t row = int64_t{listener - first} * (n_[team] - 1) + (mate - first) - (mate > listener ? 1 : 0);
    return row + (team ? int64_t{n_[0]} * (n_[0] - 1) : 0);
  }

 private:
  int n_[2];
};

/// Replay::place_unit of a world of that longer side.
float place_unit(float longer_side, int n_agents);
/// ReplayRules::health_unit where that is the most health of an agent: 32,000 of them, but not less than kReplayHealth.
float health_unit(float most_health);
/// CRC-32 (zlib's) over the seed's digits and the bytes of the actions.
int64_t action_checksum(const Replay& replay, const ReplayEpisode& episode);
/// zlib's CRC-32 of bytes, going on from that of bytes before.
uint32_t crc32_of(std::string_view bytes, uint32_t before = 0);

/// Adds the hits to the events, as `fires` tells them: fire does damage from the step after `min_tracking_time` on.
/// False where they are more than a reader can be asked to hold.
bool add_hits(const ReplayPairs& pairs, int min_tracking_time, ReplayEpisode& e);

/// Why games of this kind, `frame`, may have no room in one replay; empty: they have. To be asked before they are
/// played.
std::string too_large_to_keep(const Replay& frame, int64_t episodes, int most_steps);

/// The bytes of a file. Throws Error where the parts do not fit each other.
std::string encode_replay(const Replay& replay);
/// Throws InputError where the bytes are no replay, of another format, damaged, or make no sense; `name` is for
/// messages.
Replay decode_replay(std::string_view bytes, const std::string& name);

template <class V>
void visit_fields(V& v, ReplayAgent& c) {
  v("team", c.team, "0 or 1", range(0, 1));
  v("kind", c.kind, "name of its type");
  v("sprite", c.sprite, "drawn shape", range(0, 7));
  v("max_health", c.max_health, "health limit", greater_than(0));
  v("range", c.range, "factor on the squared sight depth", at_least(0));
  v("damage_range", c.damage_range, "factor on the squared weapon depth", at_least(0));
  v("thrust", c.thrust, "factor on acceleration", at_least(0));
}
template <class V>
void visit_fields(V& v, ReplayMap& c) {
  v("name", c.name, "of the map");
  v("boxes", c.boxes, "obstacles: x1 y1 x2 y2 z1 z2");
}
template <class V>
void visit_fields(V& v, ReplayRules& c) {
  v("limit_x", c.limit_x, "width", greater_than(0).at_most(1e6));
  v("limit_y", c.limit_y, "height", greater_than(0).at_most(1e6));
  v("limit_z", c.limit_z, "highest altitude", greater_than(0).at_most(1e6));
  v("seconds_per_step", c.seconds_per_step, "", greater_than(0).at_most(1e6));
  v("max_episode_length", c.max_episode_length, "steps; 0: none", at_least(0));
  v("close_depth", c.close_depth, "", at_least(0));
  v("sight_depth", c.sight_depth, "", at_least(0));
  v("sight_angle", c.sight_angle, "", at_least(0));
  v("weapon_depth", c.weapon_depth, "", at_least(0));
  v("weapon_angle", c.weapon_angle, "", at_least(0));
  v("hearing_range", c.hearing_range, "", at_least(0));
  v("min_tracking_time", c.min_tracking_time, "", at_least(0));
  v("max_tracking_time", c.max_tracking_time, "", at_least(0));
  v("waypoints", c.waypoints, "");
  v("obstacle_heights", c.obstacle_heights, "");
  v("health_unit", c.health_unit, "of which states have whole multiples", greater_than(0).at_most(1e6));
}
template <class V>
void visit_fields(V& v, ReplayFlight& c) {
  v("turn_rate", c.turn_rate, "radians a second at full heading control");
  v("climb_rate", c.climb_rate, "altitude a second at full dive control");
  v("thrust", c.thrust, "speed a second at full throttle, times that of the agent");
  v("drag", c.drag, "speed lost in a step, times speed^2");
  v("half_gravity", c.half_gravity, "of altitude lost, what is gained in speed^2");
  v("min_speed", c.min_speed, "");
}
template <class V>
void visit_fields(V& v, ReplayEvent& c) {
  v("step", c.step, "", at_least(0));
  v("what", c.what, "");
  v("agent", c.agent, "", at_least(-1));
  v("other", c.other, "", at_least(-1));
}
template <class V>
void visit_fields(V& v, ReplayWaypoint& c) {
  v("from", c.from, "", at_least(0));
  v("to", c.to, "", at_least(0));
  v("x1", c.x1, "");
  v("y1", c.y1, "");
  v("x2", c.x2, "");
  v("y2", c.y2, "");
}
template <class V>
void visit_fields(V& v, ReplayMind& c) {
  v("low", c.low, "the least value");
  v("high", c.high, "the greatest; as low: no values");
  v("top", c.top, "likeliest actions that are kept", range(0, kReplayActions));
}
template <class V>
void visit_fields(V& v, ReplayEpisode& c) {
  v("map", c.map, "index into maps", at_least(0));
  v("steps", c.steps, "", range(1, 1'000'000));  // the longest time limit of a scenario
  v("winner", c.winner, "");
  v("at_time_limit", c.at_time_limit, "");
  v("returns", c.returns, "by team");
  v("score", c.score, "waypoints collected, by team");
  v("died", c.died, "by agent: its first dead state, or -1", at_least(-1));
  v("cause", c.cause, "by agent");
  v.list("events", c.events, "in their order");
  v.list("waypoints", c.waypoints, "");
  v.group("mind_0", c.mind[0], "networks of team 0");
  v.group("mind_1", c.mind[1], "of team 1");
  v("action_check", c.action_check, "CRC-32 of seed and actions", range(0, 4294967295.0));
  v("state_check", c.state_check, "CRC-32 of all states", range(0, 4294967295.0));
}
/// `agents`: in the place of `c.agents`.
template <class V, class Agents>
void visit_header(V& v, Replay& c, Agents& agents) {
  v("gigastep_version", c.gigastep_version, "that wrote it");
  v("scenario_name", c.scenario_name, "");
  v("scenario", c.scenario, "as YAML");
  v("seed", c.seed, "of the draws");
  v("actions", c.actions, "");
  v("players", c.players, "by side");
  v("origins", c.origins, "by side: file");
  v.group("rules", c.rules, "");
  v.group("flight", c.flight, "");
  v.list("agents", agents, "team 0 first");
  v.list("maps", c.maps, "");
  v.list("episodes", c.episodes, "");
}
template <class V>
void visit_fields(V& v, Replay& c) {
  visit_header(v, c, c.agents);
}

}  // namespace giga
