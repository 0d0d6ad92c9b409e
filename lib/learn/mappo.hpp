// MAPPO: self-play proximal policy optimisation with a centralized critic per team (Yu et al. 2022, arXiv 2103.01955).
#pragma once

#include <memory>
#include <string>

#include "learn/learner.hpp"

namespace giga {

std::unique_ptr<Learner> make_mappo(const LoadedRun& run, Device device);

/// Whether a team learns, or plays the scripted opponent.
bool learns(const TrainConfig& config, int team);

/// The actor of a team as the configuration describes it, freshly initialised.
Actor make_actor(const LoadedRun& run, int team, Device device);

/// Where a checkpoint keeps the actor of a team: "team_0/actor/".
std::string actor_prefix(int team);

}  // namespace giga
