// Scenarios for simulator tests: plain ones to be varied inline, and random ones.
#pragma once

#include <cstdint>

#include "sim/spec.hpp"

namespace giga::test {

/// Two teams of default agents (team 0 first) on an empty 10 x 10 map, `corrected` rules, continuous actions, cones of
/// the original's defaults, nothing stochastic, all reward weights zero, no division, at most 500 steps. Not finished.
SimSpec plain_spec(int n_team_0, int n_team_1);

/// Depth and half angle (radians) of the sight cone, and of the weapon cone.
void set_cone(SimParams& params, float depth, float half_angle);
void set_damage_cone(SimParams& params, float depth, float half_angle);
void set_reward(SimSpec& spec, RewardTerm term, float weight);

/// plain_spec where everybody sees everybody, nobody shoots and nobody collides: for what agents observe.
SimSpec open_spec(int n_team_0, int n_team_1);

/// A random scenario with teams of these sizes: agent types and their order, maps with boxes, size of the world (it
/// grows with the teams), cones, damage, rewards, rules, options, what a win is. Finished. A function of the arguments
/// alone.
SimSpec random_spec(uint64_t seed, int n_team_0, int n_team_1);

/// Sets every switch of a spec by the bits of `mask`: rules, actions, both stochastic flags, waypoints, options beyond
/// the original, division, one-team-dead, egocentric view. With all 2,048 masks every combination occurs.
void set_switches(SimSpec& spec, unsigned mask);
constexpr unsigned kNSwitches = 11, kNSwitchMasks = 1u << kNSwitches;

}  // namespace giga::test
