// The layout of an agent's observation: which of its numbers mean what; and whether a policy fits a scenario.
#pragma once

#include <string>
#include <vector>

#include "sim/observation_text.hpp"
#include "sim/spec.hpp"

namespace giga {

/// `count` items of `size` numbers each, item k at first + k * size: "self", "neighbors", "walls" and so on.
struct ObservationBlock {
  std::string name;
  int first = 0, count = 0, size = 0;
  std::string meaning = {};
  std::vector<FeatureText> features = {};  ///< of an item; empty where the block was read from a manifest

  int end() const { return first + count * size; }
  /// The same numbers in the same places.
  bool operator==(const ObservationBlock& other) const {
    return name == other.name && first == other.first && count == other.count && size == other.size;
  }
};

/// The blocks of a row that holds all observations which a scenario offers an agent, from 0 to
/// SimSpec::observation_size() without gaps.
std::vector<ObservationBlock> observation_layout(const SimSpec& spec);

/// What a policy takes in and gives out, and the scenario in which it learned to.
struct PolicyInterface {
  std::string scenario;
  ActionKind actions = ActionKind::discrete;
  int inputs = 0;  ///< numbers of an observation
  std::vector<ObservationBlock> observation;
  int image_side = 0;  ///< pixels of a side of the image that it reads in the place of numbers; 0: it reads numbers

  /// Whether such policies can play each other's scenarios.
  bool fits(const PolicyInterface& other) const;
};
/// Of policies that learned in a scenario, from its images or from its numbers.
PolicyInterface interface_of(const SimSpec& spec, bool reads_image = false);

/// Throws InputError where a policy cannot play a scenario: `source` is where it is from.
void check_fits(const PolicyInterface& policy, const SimSpec& spec, const std::string& source,
                const std::string& reasons = "");

}  // namespace giga
