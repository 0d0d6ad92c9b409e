// Guests of the pool: policies from elsewhere that the teams may meet as long as the run goes on (opponents.policies),
// such as the best responses to an earlier one.
#pragma once

#include <torch/types.h>

#include <array>

#include "learn/run_config.hpp"
#include "policy/actor.hpp"

namespace giga {

/// The policies of opponents.policies, by the team that they play: [guests, row size] as GroupPolicy::row_of makes
/// them; an undefined tensor where there are none. `actors`: of the run, whose networks theirs must be like. Throws
/// InputError where a policy cannot be read, is none of a checkpoint, does not play the scenario, or has other
/// networks.
std::array<at::Tensor, kNTeams> load_guests(const LoadedRun& run, const std::array<const Actor*, kNTeams>& actors,
                                            Device device);

}  // namespace giga
