// A replay made by hand: two against one, four steps, everything that a replay may have.
#pragma once

#include "io/replay.hpp"

namespace giga::test {

inline Replay sample_replay(ReplayActions actions = ReplayActions::discrete) {
  Replay r;
  r.gigastep_version = "0.1.0";
  r.scenario_name = "small";
  r.scenario = "description: \"two against one\"\nlimit_x: 10\n";
  r.seed = "18446744073709551615";
  r.actions = actions;
  r.players = {"runs/a", "<b>circle</b>"};
  r.origins = {"runs/a/best.h5, after 7 updates", ""};
  r.rules.sight_depth = 3;
  r.rules.sight_angle = 2.5f;
  r.rules.weapon_depth = 2;
  r.rules.weapon_angle = 0.75f;
  r.rules.hearing_range = 8;
  r.rules.min_tracking_time = 1;
  r.rules.max_tracking_time = 4;
  r.rules.waypoints = true;
  r.rules.max_episode_length = 4;
  r.flight = {4, 5, 1.5f, 0.04f, 4.905f, 1.3f};
  r.agents = {{0, "default", 1, 1, 1, 1, 1}, {0, "scout", 2, 0.5f, 2, 0, 1.5f}, {1, "default", 1, 1, 1, 1, 1}};
  r.maps = {{"block", {{4, 4, 6, 6, 0, 10}}}};

  ReplayEpisode e;
  e.steps = 4;
  e.winner = ReplayEnd::team_0;
  e.at_time_limit = true;
  e.returns = {1.5f, -2};
  e.score = {1, 0};
  e.died = {-1, 3, -1};
  e.cause = {ReplayDeath::none, ReplayDeath::damage, ReplayDeath::none};
  e.events = {{0, ReplayEventKind::contact, 2, 1},
              {1, ReplayEventKind::waypoint, -1, -1},
              {2, ReplayEventKind::collected, 0, -1},
              {2, ReplayEventKind::hit, 2, 1},
              {3, ReplayEventKind::death, 1, 2}};
  e.waypoints = {{1, 2, 1, 1, 1.5f, 1.5f}};
  // x, y, z, heading, speed of the first states; where agent 1 is said to be has nothing to do with its columns.
  e.start = {1, 77, 8, 1, -3, 10, 2, 0, 10, 0, 100, 0, 1, 1.3f, 1.8f};
  // [3 agents, 5 states] in units of 0.002: agent 0 flies from 1 to 1.4 by 0.1.
  e.x = {500, 550, 600, 650, 700, 1000, 1010, 1020, 1020, 1020, 4000, 3990, 3980, 3970, 3960};
  e.y = {500, 500, 500, 500, 500, -1, 0, 1, 1, 1, 5000, 4000, 3000, 2000, 1000};
  e.z = {100, 125, 150, 150, 125, 0, 0, 0, 0, 0, 500, 475, 450, 425, 400};
  e.heading = {0, 64, 128, 64, 0, 32704, -32768, -32704, -32704, -32704, 0, 0, 0, 0, 0};
  e.speed = {20, 26, 30, 32, 33, 26, 26, 26, 26, 26, 36, 36, 36, 36, 36};
  e.health = {100, 100, 100, 100, 100, 50, 50, 30, 0, 0, 100, 100, 100, 100, 100};
  if (actions == ReplayActions::discrete) {
    e.action = {22, 13, 25, 19, 10, 13, 0, 0, 13, 26, 16, 13};
  } else {
    e.action.assign(3 * 4 * 3 * 4, 0);  // bytes of floats
    e.action[3] = 0x3f;                 // 0.5
  }
  // Pairs [target, opponent]: 0 by 2, 1 by 2, 2 by 0, 2 by 1; states from the lowest bit.
  e.sees = {0b00000, 0b00111, 0b11100, 0b00000};
  e.fires = {0b00000, 0b00110, 0b00000, 0b00000};
  e.hears = {0b00101, 0b00111};  // 0 hears 1, 1 hears 0
  const bool discrete = actions == ReplayActions::discrete;
  e.mind[0].low = -1;
  e.mind[0].high = 30;  // a value is its number less 1
  e.mind[0].value = {0, 1, 2, 3, 31, 10, 20, 30, 4, 5};
  e.mind[0].top = discrete ? 2 : 1;
  e.mind[0].likely = discrete ? std::vector<uint8_t>{22, 13, 25, 19, 0, 10, 13, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10}
                              : std::vector<uint8_t>(3 * 2 * 5, 255);
  if (discrete) e.mind[0].probability = {15, 10, 12, 8, 8, 15, 14, 15, 15, 15, 0, 5, 2, 1, 1, 1, 1, 1, 0, 0};
  e.action_check = action_checksum(r, e);
  e.state_check = 12345;
  r.episodes = {e};
  return r;
}

/// A crowd: 1,000 scouts and 50 others of team 0 against 100, two steps, so three states.
inline Replay sample_crowd() {
  Replay r = sample_replay();
  r.rules.limit_x = 900;
  r.rules.limit_y = 600;
  const ReplayAgent scout = r.agents[1], other = r.agents[0], opponent = r.agents[2];
  r.agents.assign(1000, scout);
  r.agents.insert(r.agents.end(), 50, other);
  r.agents.insert(r.agents.end(), 100, opponent);
  constexpr size_t kAgents = 1150, kStates = 3, kSteps = 2;

  ReplayEpisode e;
  e.steps = kSteps;
  e.winner = ReplayEnd::team_1;
  e.died.assign(kAgents, -1);
  e.cause.assign(kAgents, ReplayDeath::none);
  e.died[7] = 1;
  e.cause[7] = ReplayDeath::damage;
  e.died[1049] = 1;
  e.cause[1049] = ReplayDeath::agent;
  // The deaths of a step behind what else happens in it.
  e.events = {{0, ReplayEventKind::contact, 1050, 7},
              {1, ReplayEventKind::waypoint, -1, -1},
              {1, ReplayEventKind::death, 7, 1149},
              {1, ReplayEventKind::death, 1049, -1}};
  e.waypoints = {{1, 2, 1, 1, 1.5f, 1.5f}};
  e.start.assign(5 * kAgents, 1);
  for (std::vector<int16_t>* column : {&e.x, &e.y, &e.z, &e.heading, &e.speed, &e.health})
    for (size_t k = 0; k < kAgents * kStates; ++k) column->push_back(static_cast<int16_t>(10 * k));
  e.action.assign(kAgents * kSteps, 13);
  e.sees.assign(kAgents, 0);  // a byte each for three states
  e.sees[7] = 0b011;
  e.fire = {{0, 1, 7, 1149}, {1, 2, 1149, 3}, {1, 2, 1149, 999}};
  e.mind[1].low = -1;
  e.mind[1].high = 30;
  e.mind[1].top = 1;
  const size_t told = static_cast<size_t>(kMostMinds) * kStates;  // of 100 agents the first 64
  e.mind[1].value.assign(told, 20);
  e.mind[1].likely.assign(told, 26);
  e.mind[1].probability.assign(told, 15);
  e.action_check = action_checksum(r, e);
  r.episodes = {e};
  return r;
}

}  // namespace giga::test
