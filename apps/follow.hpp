// follow(): what a rank other than 0 does in a training.
#pragma once

#include <string>

#include "apps/training.hpp"

namespace giga {

/// The updates of a run together with rank 0, which alone evaluates, writes and speaks. Returns as train_in does, with
/// the same code.
int follow(TrainingSetup setup);

/// Throws Error where a rank has come to another state than rank 0. Collective; no effect where `ranks` is null.
void expect_same_state(Ranks* ranks, const NamedArrays& arrays);

/// "training diverged: the gradient of the actor of team 0 held a NaN or an infinity at update 7, minibatch 3, in rank
/// 1 of 2". `ranks` null: this process is alone.
std::string told(const Divergence& what, const Ranks* ranks);

}  // namespace giga
