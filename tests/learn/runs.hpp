// What the learning tests share: small scenarios and configurations as text, and reading metrics and saved arrays.
#pragma once

#include <memory>
#include <string>

#include "learn/learner.hpp"

namespace giga::test {

/// 2 against 2 on an empty map of 6 x 6, where agents see, shoot, collide and fly out of bounds within 40 steps.
LoadedRun small_run(const std::string& train_and_mappo_keys = "", const std::string& scenario_keys = "");

/// A learner on the CPU with two threads, whatever the machine has.
std::unique_ptr<Learner> learner_of(const LoadedRun& run);

double metric(const Metrics& metrics, const std::string& name);

/// Everything that the learner saves.
NamedArrays saved(const Learner& learner);
/// Empty if all bytes are equal; else the names that differ.
std::string difference(const NamedArrays& a, const NamedArrays& b);

/// Fails where a figure that must be known in a self-play run, or one of a saved float array, is not finite.
void expect_finite(const Metrics& metrics, int team);
void expect_finite(const NamedArrays& arrays);

}  // namespace giga::test
