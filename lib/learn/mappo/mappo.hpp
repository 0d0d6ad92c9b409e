// MAPPO: self-play proximal policy optimisation with a centralized critic per team (Yu et al. 2022, arXiv 2103.01955).
#pragma once

#include <memory>
#include <string>

#include "learn/learner.hpp"

namespace giga {

std::unique_ptr<Learner> make_mappo(const LoadedRun& run, Device device);

}  // namespace giga
