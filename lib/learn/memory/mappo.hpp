// The memory plan of a run of mappo.
#pragma once

#include "core/memory.hpp"
#include "learn/memory/plan.hpp"

namespace giga {

MemoryPlan plan_mappo(const LoadedRun& run, Device device);

}  // namespace giga
