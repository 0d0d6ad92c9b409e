// compile(): a Scenario into the plain numbers and tables that a simulator reads.
#pragma once

#include "scenario/scenario.hpp"
#include "sim/spec.hpp"

namespace giga {

/// Checks what only the whole scenario tells (empty teams, start areas, limits of this version) and throws InputError
/// with all findings. Agents stand in the order of the original: team 0 first, types as listed.
SimSpec compile(const Scenario& scenario);
/// The same, with the findings added to `errors`. What depends on keys that are already among them is not looked at.
/// Where there are errors at the end, the result is not to be used.
SimSpec compile(const Scenario& scenario, Errors& errors);

}  // namespace giga
