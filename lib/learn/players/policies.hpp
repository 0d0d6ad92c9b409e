// The learned policies of a checkpoint, ready to play.
#pragma once

#include <memory>
#include <string>

#include "core/memory.hpp"
#include "core/named_array.hpp"
#include "learn/run_config.hpp"

namespace giga {

class Actor;

struct LoadedPolicies {
  LoadedRun run;                    ///< configuration and scenario of the checkpoint
  std::unique_ptr<Actor> actor[2];  ///< by team; null where the team did not learn

  LoadedPolicies();
  LoadedPolicies(LoadedPolicies&&) noexcept;
  ~LoadedPolicies();
};

/// Makes the actors that the texts describe and loads their parameters; throws InputError where they do not fit.
LoadedPolicies load_policies(const std::string& config_yaml, const std::string& scenario_yaml,
                             const NamedArrays& arrays, Device device);

}  // namespace giga
