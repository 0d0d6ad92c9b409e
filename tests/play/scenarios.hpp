// The base scenarios that a page plays, and those that are too large for it.
#pragma once

#include "scenario/loader.hpp"

namespace giga::test {

constexpr int kMostAgents = 200;  // as `gigastep play` has it

inline int agents_of(const Scenario& scenario) {
  int count = 0;
  for (const auto* team : {&scenario.team_0, &scenario.team_1})
    for (const TeamEntry& entry : *team) count += entry.count;
  return count;
}

}  // namespace giga::test
