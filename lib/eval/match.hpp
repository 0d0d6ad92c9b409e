// Matches: episodes between two policies, learned or scripted, and what came out.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/memory.hpp"
#include "math/wilson.hpp"
#include "rollout/player.hpp"
#include "sim/simulator.hpp"

namespace giga {

struct MatchOptions {
  int episodes = 512;
  uint64_t seed = 0;
  Device device;
  int n_threads = 0;
};

/// Sums over the episodes of a match, by side.
struct MatchResult {
  int episodes = 0;
  int wins[2] = {0, 0};
  int ties = 0;
  double mean_return[2] = {0, 0};         ///< full return of the team
  double mean_return_masked[2] = {0, 0};  ///< the original evaluator's (SPEC section 13)
  double mean_score[2] = {0, 0};          ///< waypoints collected
  double mean_length = 0;                 ///< steps
};

/// Plays `episodes` whole episodes, each in a world of its own: exactly one each, so that short ones do not count more.
/// Deterministic by seed. Scenarios without a time limit are cut off after kMatchStepLimit steps (a tie).
constexpr int kMatchStepLimit = 10'000;
MatchResult play_match(const SimSpec& spec, const Player& side0, const Player& side1, const MatchOptions& options);

/// Parses the name of a scripted policy; throws InputError with the allowed names.
Scripted parse_scripted(const std::string& name);

}  // namespace giga
