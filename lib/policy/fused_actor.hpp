// How an actor's actions are computed by the fused kernel (cuda/fused_policy.hpp, on a CPU cpu_kernels.hpp), where that
// serves its network.
#pragma once

#include <optional>
#include <span>

#include "core/parallel_for.hpp"
#include "cuda/fused_policy.hpp"
#include "policy/actor.hpp"

namespace giga {

/// Its network and normaliser; what it sees and where its actions go is for the caller to add. None where LibTorch has
/// to do.
std::optional<FusedPolicy> fused_policy(const Actor& actor);

/// Draws the actions of all rows of several: queued on a GPU, done on return on a CPU. `behind_step` as for
/// launch_fused_policies.
void act_fused(std::span<const FusedPolicy> policies, bool behind_step, const ParallelFor& parallel_for);

}  // namespace giga
