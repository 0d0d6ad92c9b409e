#include "learn/learner.hpp"

#include <algorithm>

#include "learn/registry.hpp"

namespace giga {

std::unique_ptr<Learner> make_learner(const LoadedRun& run, Device device) {
  const auto row = std::find(algorithms().begin(), algorithms().end(), &algorithm_of(run.config));
  return Algorithms::makers().at(static_cast<size_t>(row - algorithms().begin()))(run, device);
}

}  // namespace giga
