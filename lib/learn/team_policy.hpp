// The policies of a run's teams: who learns, how its actor is made, and where a checkpoint keeps it.
#pragma once

#include <cstdint>
#include <string>

#include "learn/run_config.hpp"
#include "policy/actor.hpp"

namespace giga {

/// Whether a team learns, or plays the scripted opponent.
bool learns(const TrainConfig& config, int team);

/// The actor of a team as the configuration describes it, freshly initialised.
Actor make_actor(const LoadedRun& run, int team, Device device);

/// Where a checkpoint keeps the actor of a team: "team_0/actor/".
std::string actor_prefix(int team);

/// With what seed a network starts, by team and role: 0 actor, 1 critic, 2 what teaches the encoder of images.
uint64_t network_seed(const LoadedRun& run, int team, int role);

/// Reduced precision is for the GPU; CPUs run fp32.
Precision precision_on(const LoadedRun& run, Device device);
/// Throws InputError where a GPU of this machine is too old for it.
void check_precision(const LoadedRun& run, Device device);

}  // namespace giga
