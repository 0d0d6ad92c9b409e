// A MemoryPlan for people and for programs, and the refusal of runs that do not fit.
#pragma once

#include <cstdint>
#include <string>

#include "io/host_memory.hpp"
#include "io/json.hpp"
#include "learn/memory/plan.hpp"

namespace giga {

/// A table: each item with its bytes, share and bytes per world (of mappo) or member (of an evolution strategy); the
/// total; of an evolution strategy in what precision the members' networks are computed and by what (MemberNetworks);
/// the device's memory; whether it fits; the largest train.n_worlds or population.population_size.
std::string plan_table(const LoadedRun& run, Device device, const MemorySpace& space);
/// The same, in bytes, with the precision of all networks.
Json plan_json(const LoadedRun& run, Device device, const MemorySpace& space);

/// Throws InputError where the run needs more than is free: what it needs, what is free, the largest items, and the
/// largest size that fits.
void check_fits(const LoadedRun& run, Device device, const MemorySpace& space);

/// "1.50 GiB".
std::string print_bytes(int64_t bytes);

}  // namespace giga
