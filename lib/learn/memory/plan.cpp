#include "learn/memory/plan.hpp"

#include <algorithm>
#include <numeric>

#include "learn/memory/mappo.hpp"
#include "learn/memory/population.hpp"

namespace giga {
namespace {

/// The sizes that a configuration allows: multiples of `unit` from `least` to `most`.
struct AllowedSizes {
  int64_t unit = 1, least = 1, most = 1;
};

AllowedSizes allowed_sizes(const RunConfig& c) {
  if (is_evolution(c.train)) {
    const int64_t most = kMostWorlds / (2 * static_cast<int64_t>(c.population.n_worlds()));
    return {c.population.antithetic ? 2 : 1, 2, std::min<int64_t>(most, kMostMembers)};
  }
  // n_worlds x horizon must be a multiple of n_minibatches.
  const int64_t minibatches = c.mappo.n_minibatches;
  const int64_t unit = minibatches / std::gcd(minibatches, static_cast<int64_t>(c.mappo.horizon));
  return {unit, unit, kMostWorlds};
}

void set_size(RunConfig& c, int64_t size) {
  (is_evolution(c.train) ? c.population.population_size : c.train.n_worlds) = static_cast<int>(size);
}

}  // namespace

int64_t MemoryPlan::total() const {
  int64_t bytes = 0;
  for (const MemoryItem& item : items) bytes += item.bytes;
  return bytes;
}

MemoryPlan plan_memory(const LoadedRun& run, Device device) {
  return is_evolution(run.config.train) ? plan_population(run, device) : plan_mappo(run, device);
}

RunSize run_size(const RunConfig& c) {
  if (is_evolution(c.train)) return {"population", "population_size", "member", c.population.population_size};
  return {"train", "n_worlds", "world", c.train.n_worlds};
}

int64_t largest_size(const LoadedRun& run, Device device, int64_t available_bytes) {
  LoadedRun trial = run;
  const auto fits = [&](int64_t size) {
    set_size(trial.config, size);
    return plan_memory(trial, device).total() <= available_bytes;
  };
  const AllowedSizes sizes = allowed_sizes(run.config);
  int64_t low = (sizes.least - 1) / sizes.unit, high = sizes.most / sizes.unit + 1;  // low fits, high does not
  while (high - low > 1) {
    const int64_t middle = low + (high - low) / 2;
    (fits(middle * sizes.unit) ? low : high) = middle;
  }
  return low * sizes.unit < sizes.least ? 0 : low * sizes.unit;
}

}  // namespace giga
