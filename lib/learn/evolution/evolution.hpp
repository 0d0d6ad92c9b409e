// Evolution: two teams, each with a search distribution of its own, evolve against each other, a script or a frozen
// policy.
#pragma once

#include <memory>

#include "learn/evolution/strategy.hpp"
#include "learn/learner.hpp"

namespace giga {

/// `make_strategy` is called once for each team that learns.
std::unique_ptr<Learner> make_evolution(const LoadedRun& run, Device device, Ranks* ranks,
                                        const MakeStrategy& make_strategy);

}  // namespace giga
