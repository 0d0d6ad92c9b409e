#include "learn/learner.hpp"

#include <algorithm>

#include "learn/registry.hpp"
#include "ranks/ranks.hpp"

namespace giga {

std::unique_ptr<Learner> make_learner(const LoadedRun& run, Device device, Ranks* ranks) {
  if (ranks) algorithm_of(run.config).expect_divides(run.config, ranks->size());
  const auto row = std::find(algorithms().begin(), algorithms().end(), &algorithm_of(run.config));
  return Algorithms::makers().at(static_cast<size_t>(row - algorithms().begin()))(run, device, ranks);
}

}  // namespace giga
