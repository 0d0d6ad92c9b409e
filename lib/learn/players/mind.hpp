// Mind: the networks of a team, for those who ask them what they make of a state.
#pragma once

#include <array>

#include "sim/params.hpp"

namespace giga {

class Policy;
class ValueFunction;

/// Null: there is none, or nobody asks.
struct Mind {
  const Policy* policy = nullptr;
  const ValueFunction* values = nullptr;
  bool greedy = false;  ///< the policy plays its likeliest action
};
using Minds = std::array<Mind, kNTeams>;

}  // namespace giga
