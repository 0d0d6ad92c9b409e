// What the learning tests share: a small scenario and configuration to be varied, and reading metrics and saved arrays.
#pragma once

#include <memory>
#include <string>

#include "core/memory.hpp"
#include "learn/learner.hpp"

namespace giga::test {

constexpr Device kCpu{};

/// 2 against 2 on an empty map of 6 x 6, where agents see, shoot, collide and fly out of bounds within 40 steps;
/// 24 worlds, rollouts of 8 steps, 2 epochs of 4 minibatches. YAML of what a test changes:
struct SmallRun {
  std::string train;  ///< keys in flow style, for example "opponent: circle"
  std::string mappo;  ///< likewise
  std::string critic = "hidden: [16, 16]";
  std::string scenario;  ///< whole lines, in place of those of the same keys
  int seed = 3;
  std::string actor = "hidden: [16, 16]";
  std::string precision = "fp32";
  int n_threads = 2;
  std::string more = {};  ///< whole lines of further keys of the config

  LoadedRun load() const;
  std::unique_ptr<Learner> learner(Device device = {}) const { return make_learner(load(), device); }
};

/// Writes a checkpoint of a freshly made learner, with its folder.
void save(const SmallRun& small, const std::string& file, int64_t updates = 0);

double metric(const Metrics& metrics, const std::string& name);

/// Everything that the learner saves.
NamedArrays saved(const Learner& learner);
/// Empty if all bytes are equal; else the names that differ.
std::string difference(const NamedArrays& a, const NamedArrays& b);
std::string difference(const Metrics& a, const Metrics& b);

/// Changes every number of an array to another valid one.
void disturb(NamedArray& array);

/// Fails where a figure of a learning team, or a number of a saved float array, is not finite.
void expect_finite(const Metrics& metrics, int team);
void expect_finite(const NamedArrays& arrays);

}  // namespace giga::test
