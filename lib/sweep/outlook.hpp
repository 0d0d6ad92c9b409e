// SweepOutlook: what is left of a sweep, in agent-steps.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "sweep/progress.hpp"

namespace giga {

/// How many trials come to each rung, as far as that can be told beforehand: all to the first, of these one in
/// `halving.factor` to the next, one at least, and those that have begun there.
std::vector<int> trials_expected(const SweepSpec& spec, const SweepProgress& progress, size_t n_rungs);

struct SweepOutlook {
  double all = 0, left = 0;  ///< agent-steps of all runs, and of what they have still to do
};

/// A run that failed does no more. `open`: agent-steps of runs that have begun and have no result yet, from the
/// beginning of the run.
SweepOutlook outlook_of(const SweepSpec& spec, const SweepProgress& progress, const std::vector<int64_t>& rungs,
                        const std::map<SweepRun, double>& open);

}  // namespace giga
