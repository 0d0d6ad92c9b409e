// Settings that mean nothing in a run: to its algorithm, or because another setting switches them off.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "learn/run_config.hpp"

namespace giga {

/// Why a setting does nothing in a run, as "with train.algorithm snes" or "unless mappo.value_loss is huber"; empty: of
/// no reason is known.
std::string why_idle(const RunConfig& config, std::string_view key);

/// Warns of each `--set` of such a setting. It is no error: trials of a sweep may have them.
void warn_of_idle(const std::vector<std::string>& overrides, const RunConfig& config);

}  // namespace giga
