// What the tests of recorders share: a small run, and games of its policies that were recorded.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "eval/record.hpp"
#include "learn/players/value_function.hpp"
#include "policy/actor.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"

namespace giga::test {

/// Episodes are as long as their limit on a map on which nobody meets anybody.
inline std::string long_games(int steps) {
  return cat("max_episode_length: ", steps, "\nlimit_x: 60\nlimit_y: 60\ndamage: {damage_cone_depth: 0}\n");
}

inline SmallRun recorded_run() {
  SmallRun small;
  small.actor = "hidden: [16, 16], output_gain: 3";
  return small;
}

constexpr uint64_t kGamesSeed = 5;
inline MatchOptions three_games(Device device) { return {3, kGamesSeed, device, 2}; }

/// Three games of the policies of a learner.
inline void play_games(const LoadedRun& run, Learner& learner, const std::vector<GameObserver*>& observers,
                       Device device = {}) {
  play_match(run.spec, policy_controller(*learner.actor(0)), policy_controller(*learner.actor(1)), three_games(device),
             observers);
}

/// The critic of a team.
inline std::unique_ptr<ValueFunction> values_of(const LoadedRun& run, Learner& learner, int team, Device device) {
  NamedArrays critics;
  learner.save_critics(critics);
  return ValueFunction::load(run, team, critics, *learner.actor(team), device);
}

/// These games, and what the networks of team 0 say of them.
struct Recorded {
  explicit Recorded(const SmallRun& small = recorded_run(), Device device = {})
      : run(small.load()), learner(small.learner(device)), values(values_of(run, *learner, 0, device)) {
    const std::array<RecordedTeam, kNTeams> teams = {RecordedTeam{policy_controller(*learner->actor(0)), mind(), "a"},
                                                     RecordedTeam{policy_controller(*learner->actor(1)), {}, "b"}};
    replay = record_match(run.scenario, run.spec, teams, three_games(device), "0.1.0").replay;
  }
  Mind mind() const { return {learner->actor(0), values.get()}; }
  /// The same games once more, on the CPU.
  void play_again(GameObserver& observer) const { play_games(run, *learner, {&observer}); }

  LoadedRun run;
  std::unique_ptr<Learner> learner;
  std::unique_ptr<ValueFunction> values;
  Replay replay;
};

}  // namespace giga::test
