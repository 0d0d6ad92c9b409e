// What the fused kernels do (cuda/fused_policy.hpp, cuda/ppo_gradients.hpp), on a CPU: blocks of rows go through a
// network, the loss and back while they lie in the cache.
#pragma once

#include "core/thread_pool.hpp"
#include "cuda/fused_policy.hpp"
#include "cuda/ppo_gradients.hpp"

namespace giga {

/// Parts of a minibatch, and rows of `partial`. Always so many, and added up in their order, so that the number of
/// threads changes no bit.
constexpr int kCpuParts = 16;

/// As the launch_ functions there, but done on return, and in fp32 throughout; tanh and exp are Eigen's, within a few
/// units in the last place. The dead are left out of gradients, where they count for nothing.
void run_fused_policy(const FusedPolicy& policy, const ThreadPool& pool);
void run_moments(const FusedRows& rows, MinibatchPieces pieces, const float* advantage, double* moments);
void run_actor_gradient(const FusedActor& actor, const ThreadPool& pool);
void run_critic_gradient(const FusedCritic& critic, const ThreadPool& pool);
void run_gradient_sums(const FusedStep& step);
void run_adam(const FusedStep& step);

}  // namespace giga
