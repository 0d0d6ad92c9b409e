// Which keys of a scenario shape what a policy takes in and gives out.
#pragma once

#include <vector>

#include "config/settings.hpp"
#include "scenario/scenario.hpp"
#include "sim/spec.hpp"

namespace giga {

/// A scenario and what it was compiled to, but for an egocentric view that the policy is not given.
struct SeenScenario {
  const Scenario& scenario;
  const SimSpec& spec;
};

/// The keys in which two scenarios differ and by which a policy that was trained there does not fit here. None of those
/// that come to the same, as other teams where no more agents are observed. `reads_image`: the policy takes images in
/// the place of numbers.
std::vector<SettingChange> shape_changes(const SeenScenario& there, const SeenScenario& here, bool reads_image);

/// Path and value of every key, for people.
Settings settings_of(const Scenario& scenario);

}  // namespace giga
