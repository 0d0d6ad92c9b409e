// Settings that mean nothing in a run: to its algorithm, or because another setting switches them off.
#pragma once

#include <string>
#include <vector>

#include "learn/run_config.hpp"

namespace giga {

/// Warns of each `--set` that does nothing in a run, and says why, where that is known. It is no error: trials of a
/// sweep may have them.
void warn_of_idle(const std::vector<std::string>& overrides, const LoadedRun& run);

}  // namespace giga
