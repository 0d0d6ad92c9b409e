// The trials of a sweep: what each sets, drawn by its method.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "sweep/spec.hpp"

namespace giga {

/// Keys with values as YAML, in the order of the parameters.
using TrialSettings = std::vector<std::pair<std::string, std::string>>;

/// The first n points of a Sobol sequence in [0, 1)^d, one after the other.
using SobolPoints = std::function<std::vector<double>(int d, int n)>;

/// What each trial sets; it depends on nothing but the spec. Numbers have four digits, so that what is shown is what
/// was tried. Settings that came out twice are left out.
std::vector<TrialSettings> draw_trials(const SweepSpec& spec, const SobolPoints& sobol);

/// "KEY=VALUE" each, as --set takes it.
std::vector<std::string> assignments_of(const TrialSettings& settings);

}  // namespace giga
