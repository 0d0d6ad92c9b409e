// Pictures of behaviour: the paths of whole games, from above.
#pragma once

#include <string>

#include "io/replay.hpp"
#include "watch/canvas.hpp"

namespace giga {

/// The paths of all episodes side by side, at most four in a row (of crowds two): where each agent began, went and
/// died. `first`: the number of the first episode, as the picture tells it.
std::string trajectories_svg(const Replay& replay, int first = 0);
/// The same as pixels, without text.
Canvas trajectories_pixels(const Replay& replay);

}  // namespace giga
