// Which settings of a run may change when it goes on, and the config that results.
#pragma once

#include <string>
#include <vector>

#include "learn/run_config.hpp"

namespace giga {

struct ResumedRun {
  LoadedRun run;
  std::vector<std::string> changes;  ///< "train.total_agent_steps: 300000 -> 600000", a line each
};

/// The run of a checkpoint with `--set` assignments. Throws InputError with all mistakes: those of a config, and each
/// setting that may not change, with the reason.
ResumedRun resume_config(const std::string& config_yaml, const std::string& scenario_yaml,
                         const std::vector<std::string>& overrides);

/// The settings that may change, a line each with what it does to the run; for --help and the docs.
std::string resumable_settings();

}  // namespace giga
