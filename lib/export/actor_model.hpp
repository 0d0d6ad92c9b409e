// An actor as plain data, and such data as an actor again.
#pragma once

#include "core/memory.hpp"
#include "export/policy_model.hpp"
#include "policy/actor.hpp"

namespace giga {

/// `inputs`: numbers of an observation without padding, or bytes of an image. The weights of the columns behind them
/// and of the logit that is not used are left out. `view`: what takes the place of the egocentric view among the
/// inputs.
PolicyModel model_of(const Actor& actor, int inputs, const std::optional<RowView>& view = {});

/// An actor whose `forward` gives the same as that of the actor which the model is of, save for the logit that is not
/// used. `padded_inputs`: what its observations are padded to with zeros. The tensors must have been checked.
Actor actor_of(const PolicyModel& model, int padded_inputs, Precision precision, Device device);

}  // namespace giga
