// Matches: episodes between two teams, whoever moves them, and what came of them.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/memory.hpp"
#include "game/team_controller.hpp"
#include "sim/simulator.hpp"
#include "sim/state.hpp"

namespace giga {

class GameObserver;

struct MatchOptions {
  int episodes = 512;
  uint64_t seed = 0;  ///< of the stretch of draws (core/seeds.hpp)
  Device device;
  int n_threads = 0;
  std::function<void(const std::string&)> note = {};  ///< told what a user should know of how they are played
  Pairs pairs = Pairs::automatic;                     ///< where nobody watches who needs tables (GameObserver)
};

/// Sums over the episodes of a match, by side.
struct MatchResult {
  int episodes = 0;
  int wins[2] = {0, 0};  ///< by SimParams::win
  int ties = 0;
  double mean_return[2] = {0, 0};         ///< full return of the team
  double mean_return_masked[2] = {0, 0};  ///< the original evaluator's (rules 13.3)
  double mean_score[2] = {0, 0};          ///< waypoints collected
  double mean_length = 0;                 ///< steps
  double mean_survivors[2] = {0, 0};      ///< agents of the side that live at the end
  double mean_deaths[2][kNDeaths] = {};   ///< by side and cause (Death, kDeathNames)
  /// Of observation and action, in nats, by side; where somebody measured it (InformationMeter).
  std::array<std::optional<double>, kNTeams> mutual_information = {};
  /// By side, of a team that several policies share: what came of the episodes of each (play_match only).
  std::vector<MatchResult> of_each[2] = {};
};

/// Throws InputError where so many episodes are too few for each policy of a team that several share to play one.
void check_episodes(int episodes, int64_t n_sharing_0, int64_t n_sharing_1 = 1);

/// Plays `episodes` whole episodes, each in a world of its own: exactly one each, so that short ones do not count more.
/// Deterministic by seed. Scenarios without a time limit are cut off after kEpisodeLimit steps, which nobody wins by
/// living. The observers see all steps. Where several policies share a team each plays as many episodes as the others,
/// and, where there are enough of them, against each policy of the other team (check_episodes).
MatchResult play_match(const SimSpec& spec, std::shared_ptr<TeamController> side0,
                       std::shared_ptr<TeamController> side1, const MatchOptions& options,
                       std::vector<GameObserver*> observers = {});

/// Who plays on side 0 and on side 1.
struct Pairing {
  std::array<std::shared_ptr<TeamController>, kNTeams> side;
};

/// One more pair, whose games somebody watches: the first `episodes` of a match with the same options. The observer
/// finds them in the last worlds of its simulator.
struct WatchedPair {
  Pairing pair;
  int episodes = 0;
  GameObserver* observer = nullptr;
  bool alone = false;  ///< no other matches beside it
};

/// The matches of several pairs, of the same episodes: what play_match makes of each. Where many agents are at work a
/// GPU takes hardly longer for several matches than for one, so they are played side by side, as far as memory allows:
/// a controller that several pairs share is asked for all of them at once, neighbours in the list best. `watched` is
/// played beside the last ones where that can be.
std::vector<MatchResult> play_matches(const SimSpec& spec, const std::vector<Pairing>& pairs,
                                      const MatchOptions& options, const WatchedPair* watched = nullptr);

}  // namespace giga
