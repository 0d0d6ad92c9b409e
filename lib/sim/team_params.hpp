// TeamParams: parameters of which the sizes of the teams are constants of the compiler.
#pragma once

#include "sim/params.hpp"

namespace giga {

/// SimParams of teams of `kSize0` and `kSize1` agents, one behind the other.
template <int kSize0, int kSize1>
struct TeamParams : SimParams {
  explicit TeamParams(const SimParams& p) : SimParams(p) {}
  static constexpr int kTeam0 = kSize0, kTeam1 = kSize1, kTeam = kTeam0 > kTeam1 ? kTeam0 : kTeam1;
  static constexpr bool kTeamsEqual = kTeam0 == kTeam1;
  static constexpr int kAgents = kTeam0 + kTeam1, n_agents = kAgents;
  GIGA_HD static constexpr int team_of(int i) { return i >= kTeam0 ? 1 : 0; }
  GIGA_HD static constexpr int first_of(int team) { return team == 0 ? 0 : kTeam0; }
  GIGA_HD static constexpr int size_of(int team) { return kTeamsEqual || team == 0 ? kTeam0 : kTeam1; }
  GIGA_HD static constexpr int end_of(int team) { return first_of(team) + size_of(team); }
  GIGA_HD static constexpr int slot_of(int i) { return i - first_of(team_of(i)); }
};

}  // namespace giga
