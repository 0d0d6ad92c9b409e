// Policies that learned here as plain networks.
#pragma once

#include "play/plain_network.hpp"

namespace giga {

class Actor;

/// `inputs`: numbers of an observation without padding, as model_of takes them. Throws InputError for networks that
/// plain ones do not compute. The precisions tf32 and bf16 become fp32, which they approach.
PlainNetwork plain_network_of(const Actor& actor, int inputs, bool greedy);

}  // namespace giga
