// The memory plan of a run of an evolution strategy.
#pragma once

#include "core/memory.hpp"
#include "learn/memory/plan.hpp"

namespace giga {

MemoryPlan plan_population(const LoadedRun& run, Device device);

}  // namespace giga
