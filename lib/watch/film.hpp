// Films: the pictures of a game, step by step, from above.
#pragma once

#include "io/replay.hpp"
#include "watch/canvas.hpp"

namespace giga {

struct FilmOptions {
  int episode = 0;
  int side = 480;  ///< pixels of the longer side of the world
  int every = 2;   ///< steps from one picture to the next
};

/// Of that number, counted from 0; an InputError where there is none.
const ReplayEpisode& episode_of(const Replay& replay, int episode);

/// Pictures that the film has: those of state 0, `every`, 2 `every`, ... and the last.
int film_length(const Replay& replay, const FilmOptions& options);
/// Picture number k of it.
Canvas film_picture(const Replay& replay, const FilmOptions& options, int k);

}  // namespace giga
