// The scenarios of sim_specs.hpp.
#include "support/sim_specs.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "core/geometry.hpp"

namespace giga::test {
namespace {

MapSpec empty_map() {
  MapSpec map;
  map.name = "empty";
  map.start[0] = {6, 1, 9, 9, 0, 0, kPi, kPi};
  map.start[1] = {1, 1, 4, 9, 0, 0, 0, 0};
  return map;
}

/// Random numbers that are the same with every standard library.
class Dice {
 public:
  explicit Dice(uint64_t seed) : engine_(seed) {}
  int integer(int lo, int hi) { return lo + static_cast<int>(engine_() % static_cast<uint64_t>(hi - lo + 1)); }
  float real(float lo, float hi) {
    return lo + (hi - lo) * static_cast<float>(static_cast<double>(engine_() >> 11) * 0x1p-53);
  }
  bool chance(float p) { return real(0, 1) < p; }

 private:
  std::mt19937_64 engine_;
};

AgentSpec random_agent(Dice& dice, int team) {
  AgentSpec agent;
  agent.team = team;
  agent.sprite = dice.integer(1, 7);
  agent.thrust = dice.real(0.5f, 2.0f);
  const float health[4] = {1.0f, 3.0f, 0.5f, 1.0f};
  agent.max_health = health[dice.integer(0, 3)];
  agent.range = dice.real(0.5f, 2.0f);
  agent.damage_range = dice.chance(0.2f) ? 0.0f : dice.real(0.5f, 2.0f);
  agent.idle_reward = dice.chance(0.2f) ? 1.0f : 0.0f;
  return agent;
}

MapSpec random_map(Dice& dice, float limit_x, float limit_y) {
  MapSpec map;
  map.name = "random";
  for (int n_boxes = dice.integer(0, 3); n_boxes > 0; --n_boxes) {
    const float x = dice.real(0, 0.8f * limit_x), y = dice.real(0, 0.8f * limit_y), z = dice.real(0, 5);
    map.boxes.push_back(
        {x, y, x + dice.real(0.02f, 0.2f) * limit_x, y + dice.real(0.02f, 0.2f) * limit_y, z, z + dice.real(0.5f, 5)});
  }
  for (StartArea& area : map.start) {
    const float x = dice.real(0, 0.5f * limit_x), y = dice.real(0, 0.5f * limit_y);
    const float z = dice.chance(0.5f) ? 0.0f : dice.real(0, 5), heading = dice.real(-kPi, kPi - 1);
    area = {x,
            y,
            x + dice.real(0.1f, 0.45f) * limit_x,
            y + dice.real(0.1f, 0.45f) * limit_y,
            z,
            z * 1.5f,
            heading,
            heading + dice.real(0, 1)};
  }
  return map;
}

}  // namespace

void set_cone(SimParams& params, float depth, float half_angle) {
  params.cone_depth2 = depth * depth;
  params.cone_cos = std::cos(half_angle);
  params.cone_is_full = half_angle >= kPi;
}

void set_damage_cone(SimParams& params, float depth, float half_angle) {
  params.damage_cone_depth2 = depth * depth;
  params.damage_cone_cos = std::cos(half_angle);
  params.damage_cone_is_full = half_angle >= kPi;
}

void set_reward(SimSpec& spec, RewardTerm term, float weight) {
  spec.params.reward_weight[static_cast<int>(term)] = weight;
}

SimSpec plain_spec(int n_team_0, int n_team_1) {
  SimSpec spec;
  spec.name = "test";
  for (int i = 0; i < n_team_0 + n_team_1; ++i) {
    AgentSpec agent;
    agent.team = i < n_team_0 ? 0 : 1;
    spec.agents.push_back(agent);
  }
  spec.maps = {empty_map()};
  spec.params.actions = ActionKind::continuous;
  spec.params.stochastic_detection = false;
  spec.params.stochastic_communication = false;
  spec.params.divide_reward_by_team_size = false;
  set_cone(spec.params, 3.0f, 0.75f * kPi);
  set_damage_cone(spec.params, 2.05f, 0.25f * kPi);
  return spec;
}

SimSpec open_spec(int n_team_0, int n_team_1) {
  SimSpec spec = plain_spec(n_team_0, n_team_1);
  set_cone(spec.params, 100, kTwoPi);
  set_damage_cone(spec.params, 0, 1);
  spec.params.collision_range2 = 0;
  return spec;
}

void set_switches(SimSpec& spec, unsigned mask) {
  const auto bit = [mask](unsigned b) { return (mask >> b & 1u) != 0; };
  SimParams& p = spec.params;
  p.rules = bit(0) ? Rules::original : Rules::corrected;
  p.actions = bit(1) ? ActionKind::discrete : ActionKind::continuous;
  p.stochastic_detection = bit(2);
  p.stochastic_communication = bit(3);
  p.waypoints = bit(4);
  p.obstacle_heights = bit(5);
  p.obstacles_block_sight = bit(6);
  p.sight_3d = bit(7);
  p.divide_reward_by_team_size = bit(8);
  p.episode_ends_one_team_dead = bit(9);
  p.egocentric_view = bit(10);
}

SimSpec random_spec(uint64_t seed, int n_team_0, int n_team_1) {
  Dice dice(seed);
  SimSpec spec = plain_spec(1, 1);
  spec.name = "random " + std::to_string(seed);
  spec.agents.clear();
  const int size[kNTeams] = {n_team_0, n_team_1};
  const bool mixed = dice.chance(0.3f);  // the teams' agents in turn instead of one team after the other
  for (int k = 0; k < std::max(size[0], size[1]); ++k)
    for (int team = 0; mixed && team < kNTeams; ++team)
      if (k < size[team]) spec.agents.push_back(random_agent(dice, team));
  for (int team = 0; !mixed && team < kNTeams; ++team)
    for (int k = 0; k < size[team]; ++k) spec.agents.push_back(random_agent(dice, team));

  SimParams& p = spec.params;
  const float scale = std::max(1.0f, std::sqrt(static_cast<float>(n_team_0 + n_team_1) / 20));
  p.limit_x = dice.real(6, 20) * scale;
  p.limit_y = dice.real(6, 20) * scale;
  spec.maps.clear();
  for (int n_maps = dice.integer(1, 3); n_maps > 0; --n_maps)
    spec.maps.push_back(random_map(dice, p.limit_x, p.limit_y));
  p.very_close_depth2 = dice.real(0, 2);
  set_cone(p, dice.real(1, 8), dice.real(0.2f, 4));
  set_damage_cone(p, dice.real(0.5f, 5), dice.real(0.2f, 4));
  p.communication_range = dice.real(2, 12);
  p.damage_per_second = dice.real(0.2f, 3);
  p.healing_per_second = dice.real(0, 0.5f);
  p.min_tracking_time = dice.integer(0, 3);
  p.max_tracking_time = p.min_tracking_time + dice.integer(1, 8);
  const float collision = dice.chance(0.2f) ? 0.0f : dice.real(0.1f, 0.6f);
  p.collision_range2 = collision * collision;
  p.collision_altitude = dice.real(0.1f, 1);
  p.waypoint_size = dice.real(0.5f, 3);
  p.max_episode_length = dice.chance(0.2f) ? 0 : dice.integer(5, 60);
  for (float& weight : p.reward_weight) weight = dice.chance(0.7f) ? dice.real(0.1f, 10) : dice.real(-1, 0);
  spec.neighbor_limit = dice.integer(1, 16);
  set_switches(spec, static_cast<unsigned>(dice.integer(0, kNSwitchMasks - 1)));
  p.win = {static_cast<WinBy>(dice.integer(0, 1)), static_cast<LimitWinner>(dice.integer(0, 2))};
  spec.finish();
  return spec;
}

}  // namespace giga::test
