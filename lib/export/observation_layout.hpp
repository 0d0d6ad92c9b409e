// The layout of an agent's observation: which of its numbers mean what; and whether a policy fits a scenario.
#pragma once

#include <string>
#include <vector>

#include "sim/params.hpp"

namespace giga {

/// `count` items of `size` numbers each, item k at first + k * size: "self", "neighbors", "waypoint" or "boxes".
struct ObservationBlock {
  std::string name;
  int first = 0, count = 0, size = 0;

  int end() const { return first + count * size; }
  bool operator==(const ObservationBlock&) const = default;
};

/// One of the numbers of an item.
struct ObservationFeature {
  std::string name, meaning;
};

/// The blocks of an observation of a compiled scenario, from 0 to SimSpec::observation_size() without gaps; those
/// without items are left out.
std::vector<ObservationBlock> observation_layout(const SimSpec& spec);

/// What the items of a block are and how they are ordered.
std::string block_meaning(const std::string& block);

/// The numbers of an item of a block, in order; empty for a name that is none of a block. `size` as in the block: boxes
/// have two numbers more where their heights count.
std::vector<ObservationFeature> block_features(const std::string& block, int size);

/// What a policy takes in and gives out, and the scenario in which it learned to.
struct PolicyInterface {
  std::string scenario;
  ActionKind actions = ActionKind::discrete;
  int inputs = 0;  ///< numbers of an observation
  std::vector<ObservationBlock> observation;

  /// Whether such policies can play each other's scenarios.
  bool fits(const PolicyInterface& other) const;
};
PolicyInterface interface_of(const SimSpec& spec);

/// Throws InputError where a policy cannot play a scenario: `source` is where it is from.
void check_fits(const PolicyInterface& policy, const SimSpec& spec, const std::string& source);

}  // namespace giga
