// A game that is on when its opponent is drawn anew is played to its end by the opponent that it began with.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "core/quotient.hpp"

namespace giga {

/// Whether the episode that is on began before a draw. `draw_step` counts the steps of a world, those of the episode
/// are `episode_length`, and at the draw the count was `drawn_at`. All counts wrap: what matters is how far they are
/// apart, and no draw may be 2^32 steps back (NoteEarlierGames).
GIGA_HD bool began_before(int32_t episode_length, uint32_t draw_step, uint32_t drawn_at) {
  return static_cast<uint32_t>(episode_length) > draw_step - drawn_at;
}

/// When the opponents of worlds were drawn.
struct OpponentDraws {
  const int32_t* episode_length;  // [W] of the simulator's state
  const uint32_t* draw_step;      // [W] likewise
  const uint32_t* drawn_at;       // [W] draw_step at the latest draw

  /// Whether the game of a world goes on against the opponent before that draw.
  GIGA_HD bool is_earlier(int64_t world) const {
    return began_before(episode_length[world], draw_step[world], drawn_at[world]);
  }
};

/// Row = world. In all others than those whose game is an earlier one the draw moves up to where the game began: then
/// it is never further back than a game is long, however rarely opponents are drawn.
struct NoteEarlierGames {
  const int32_t* episode_length;  // [W] as OpponentDraws
  const uint32_t* draw_step;      // [W]
  uint32_t* drawn_at;             // [W]
  uint8_t* is_earlier;            // [W] result

  GIGA_HD void operator()(int64_t world) const {
    const bool earlier = OpponentDraws{episode_length, draw_step, drawn_at}.is_earlier(world);
    is_earlier[world] = earlier ? 1 : 0;
    if (!earlier) drawn_at[world] = draw_step[world] - static_cast<uint32_t>(episode_length[world]);
  }
};

/// Row = one number of [W, per_world]. What the opponent before the draw makes, where it still plays.
template <class T>
struct TakeEarlier {
  OpponentDraws draws;
  const T* from;
  T* to;
  int64_t per_world;

  GIGA_HD void operator()(int64_t row) const {
    if (draws.is_earlier(quotient(row, per_world))) to[row] = from[row];
  }
};

}  // namespace giga
