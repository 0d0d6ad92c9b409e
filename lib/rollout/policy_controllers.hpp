// Controllers of learned teams: one policy, or one for each group of worlds.
#pragma once

#include <memory>

#include "game/team_controller.hpp"

namespace giga {

class Actor;
class Policy;
struct TwoGenerations;

/// The policy must outlive the controller. `greedy`: it takes its most likely action instead of a drawn one.
std::unique_ptr<TeamController> policy_controller(const Policy& policy, bool greedy = false);
/// The same for code that does not know the LibTorch headers.
std::unique_ptr<TeamController> policy_controller(const Actor& actor, bool greedy = false);
/// Both teams by one controller, each by a policy of its own: where they have few agents, a GPU then moves them in one
/// launch.
std::unique_ptr<TeamController> policies_controller(const Actor& actor0, const Actor& actor1);

/// The policies of groups of worlds in a row, of equally many each. Nobody learns from them, so no
/// log-probabilities are kept. Networks and flags stay where they are: steps may be recorded.
std::unique_ptr<TeamController> group_controller(const TwoGenerations& policies);

}  // namespace giga
