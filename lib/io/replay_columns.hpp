// The columns of a replay's episodes as bytes, and their numbers (docs/replays.md).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "io/replay.hpp"

namespace giga {

/// Of an agent of a crowd: when it died, of what, by whom; of a line of fire; and of their number.
constexpr size_t kDeathBytes = 4 + 1 + 4, kFireBytes = 4 * 4, kCountBytes = 4;
/// Lines of fire for which room is kept: one for so many steps of an agent. (In a recorded game of pursuers against
/// circling agents in swarm_1000_vs_1000 one began in 23 steps of living agents.)
constexpr size_t kStepsPerFire = 4;

/// Columns of states, and what is kept of an agent's first state.
constexpr size_t kStateColumns = 6, kStartBytes = 5 * sizeof(float);

/// Number of bytes of each part of an episode, from what the header says; without the lines of fire of a crowd.
struct EpisodeSizes {
  size_t states, agents, steps, state_numbers, deaths, action_bytes, sees, fires, mates;

  EpisodeSizes(const Replay& replay, const ReplayEpisode& episode)
      : states(static_cast<size_t>(episode.steps) + 1),
        agents(replay.agents.size()),
        steps(static_cast<size_t>(episode.steps)),
        state_numbers(agents * states),
        deaths(replay.is_crowd() ? agents * kDeathBytes : 0),
        action_bytes(agents * steps *
                     (replay.actions == ReplayActions::discrete ? 1 : sizeof(float) * kReplayControls)),
        sees((replay.is_crowd() ? agents : static_cast<size_t>(ReplayPairs(replay).n_opponents())) * bit_bytes()),
        fires(replay.is_crowd() ? 0 : sees),
        mates(replay.has_hearing() ? static_cast<size_t>(ReplayPairs(replay).n_mates()) * bit_bytes() : 0) {}

  size_t bit_bytes() const { return (states + 7) / 8; }
  size_t mind(const Replay& replay, const ReplayEpisode& episode, int team) const {
    const ReplayMind& mind = episode.mind[static_cast<size_t>(team)];
    const size_t rows = static_cast<size_t>(replay.n_minds(team)) * states;
    return values(mind, rows) + likely(replay, mind, rows) + probabilities(replay, mind, rows);
  }
  static size_t values(const ReplayMind& mind, size_t rows) { return mind.low < mind.high ? rows : 0; }
  static size_t likely(const Replay& replay, const ReplayMind& mind, size_t rows) {
    const size_t per_row = replay.actions == ReplayActions::discrete ? static_cast<size_t>(mind.top)
                           : mind.top                                ? kReplayControls
                                                                     : 0;
    return rows * per_row;
  }
  static size_t probabilities(const Replay& replay, const ReplayMind& mind, size_t rows) {
    return replay.actions == ReplayActions::discrete ? rows * static_cast<size_t>(mind.top) : 0;
  }
  size_t all(const Replay& replay, const ReplayEpisode& episode) const {
    return kStateColumns * 2 * state_numbers + kStartBytes * agents + deaths + action_bytes + sees + fires + mates +
           mind(replay, episode, 0) + mind(replay, episode, 1);
  }
};

/// Appends all columns of an episode, and where each of them ends.
void put_columns(const Replay& replay, const ReplayEpisode& e, std::string& out, std::vector<size_t>& ends);
/// Reads them from `bytes`, of which there are EpisodeSizes::all. Returns what is wrong with them; empty: nothing.
std::string read_columns(const Replay& replay, std::string_view bytes, ReplayEpisode& e);
/// The same of the lines of fire of a crowd, which follow their number.
std::string read_fire(const Replay& replay, size_t count, std::string_view bytes, ReplayEpisode& e);
/// A number whose lowest byte comes first.
size_t number_of(std::string_view bytes);

}  // namespace giga
