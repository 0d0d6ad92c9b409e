// The fused gradients of networks with up to 128 numbers in a hidden layer, where they have more than 64, and of
// critics of the true state: what launch_actor_gradient() and launch_critic_gradient() call for them.
#pragma once

#include "cuda/ppo_gradients.hpp"

namespace giga {

/// On the current GPU.
void launch_block_actor_gradient(const FusedActor& actor, void* stream);
void launch_block_critic_gradient(const FusedCritic& critic, void* stream);
void launch_state_critic_gradient(const FusedCritic& critic, void* stream);

}  // namespace giga
