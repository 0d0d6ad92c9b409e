// RecordedWorld: what a recorder notes of one world while a game is played, and the episode that it becomes.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "io/replay.hpp"
#include "sim/spec.hpp"
#include "sim/world.hpp"

namespace giga {

/// Likeliest actions that are kept of each agent and state.
constexpr int kLikelyActions = 3;

/// Also of worlds of any number of agents: those of team 0 come first.
inline int team_of(const SimParams& p, int agent) { return agent < p.n_team[0] ? 0 : 1; }
inline bool is_crowd(const SimParams& p) { return p.n_agents > kMostPaired; }
/// Agents of a team of which it is kept what their networks say.
inline int n_minds(const SimParams& p, int team) {
  return is_crowd(p) ? std::min(p.n_team[team], kMostMinds) : p.n_team[team];
}

/// Bits of pairs, or of agents, over states, of which `most` may come.
class PairBits {
 public:
  PairBits() = default;
  PairBits(int64_t pairs, int64_t most) : row_((most + 7) / 8), bytes_(static_cast<size_t>(pairs * row_)) {}

  void set(int64_t pair, int64_t state) {
    bytes_[static_cast<size_t>(pair * row_ + state / 8)] |= static_cast<uint8_t>(1u << (state & 7));
  }
  /// [pairs, states] with rows of whole bytes.
  std::vector<uint8_t> cut(int64_t states) const {
    const int64_t row = (states + 7) / 8;
    std::vector<uint8_t> out;
    for (size_t at = 0; at < bytes_.size(); at += static_cast<size_t>(row_))
      out.insert(out.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at),
                 bytes_.begin() + static_cast<std::ptrdiff_t>(at) + row);
    return out;
  }

 private:
  int64_t row_ = 0;
  std::vector<uint8_t> bytes_;
};

/// What a crowd keeps of pairs, of one world: PairLists and the length of a list of fire.
struct RecordedLists {
  const uint32_t *fire, *neighbors;
  int shooters;
};

/// Replay::place_unit and ReplayRules::health_unit.
struct RecordedUnits {
  float place, health;
};

/// Of an agent.
float most_health(const SimSpec& spec);

/// What is known of one world so far. Histories are [states, agents] until the end.
struct RecordedWorld {
  RecordedWorld(const SimParams& p, int64_t most_states)
      : pairs(p.n_team[0], p.n_team[1]),
        died(static_cast<size_t>(p.n_agents), -1),
        cause(died.size()),
        sees(is_crowd(p) ? p.n_agents : pairs.n_opponents(), most_states),
        fires(is_crowd(p) ? 0 : pairs.n_opponents(), most_states),
        hears(p.n_agents <= kMostListeners ? pairs.n_mates() : 0, most_states),
        burning(is_crowd(p) ? died.size() : 0) {}

  /// One more state.
  void note(const SimSpec& spec, const WorldView& w, const RecordedLists& lists, RecordedUnits units);
  void note_pairs(const SimParams& p, const WorldView& w);
  void note_lists(const SimParams& p, const WorldView& w, const RecordedLists& lists);
  void note_fire(int target, const uint32_t* entries, int most);
  void note_death(const WorldView& w, int agent, int shooter);
  void note_scores(const SimParams& p, const WorldView& w);
  void note_waypoints(const SimParams& p, const WorldView& w);
  void event(ReplayEventKind what, int agent = -1, int other = -1) { events.push_back({states, what, agent, other}); }

  ReplayPairs pairs;
  bool over = false;
  int states = 0, map = 0;
  uint32_t check = 0;
  std::vector<float> start;  // [5, N]
  std::vector<int16_t> x, y, z, heading, speed, health;
  std::vector<uint8_t> action;  // [T, N, bytes of one]
  std::vector<int> died;
  std::vector<ReplayDeath> cause;
  std::vector<ReplayEvent> events;
  std::vector<ReplayWaypoint> waypoints;
  PairBits sees, fires, hears;
  std::vector<std::vector<ReplayFire>> burning;  // of a crowd, by target: fire that goes on, by shooter
  std::vector<ReplayFire> fire;                  // and that which has ended
  bool contact[kNTeams] = {};
  float score[kNTeams] = {}, returns[kNTeams] = {};
  bool at_time_limit = false;
  ReplayEnd winner = ReplayEnd::tie;
  std::vector<float> values[kNTeams];                          // [states, n]
  std::vector<uint8_t> likely[kNTeams], probability[kNTeams];  // [states, n, K]
};

/// The episode of a world, after its end. `seed`: of the simulator, as in Replay.
ReplayEpisode episode_of(const RecordedWorld& w, const SimParams& p, const std::string& seed);

}  // namespace giga
