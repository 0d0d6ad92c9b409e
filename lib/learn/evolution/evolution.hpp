// Evolution: two teams, each with a search distribution of its own, evolve against each other.
#pragma once

#include <memory>

#include "learn/learner.hpp"

namespace giga {

/// The learner of algorithms openai_es, snes and des.
std::unique_ptr<Learner> make_evolution(const LoadedRun& run, Device device);

}  // namespace giga
