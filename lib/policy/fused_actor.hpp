// How an actor's actions are computed by the fused kernel (cuda/fused_policy.hpp), where that serves its network.
#pragma once

#include <optional>

#include "cuda/fused_policy.hpp"
#include "policy/actor.hpp"

namespace giga {

/// Its network and normaliser; what it sees and where its actions go is for the caller to add. None where LibTorch has
/// to do.
std::optional<FusedPolicy> fused_policy(const Actor& actor);

}  // namespace giga
