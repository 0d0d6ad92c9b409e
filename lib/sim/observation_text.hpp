// What the numbers of an observation mean: for manifests of exported policies and for pages.
#pragma once

#include <string>
#include <vector>

#include "sim/params.hpp"

namespace giga {

/// One of the numbers of an item.
struct FeatureText {
  std::string name, meaning;
};

/// `count` items of equally many numbers one behind the other: "neighbors", "walls".
struct ObservationPart {
  std::string name, meaning;
  int count = 0;
  std::vector<FeatureText> features;  ///< of an item, in order

  int size() const { return static_cast<int>(features.size()); }
};

/// The parts of an observation of a scenario, without gaps; parts without items are left out.
std::vector<ObservationPart> describe(Observation kind, const SimParams& p);

}  // namespace giga
