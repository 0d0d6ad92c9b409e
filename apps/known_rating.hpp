// known_rating: what `gigastep rate` left in a run's folder about one of its policies.
#pragma once

#include "rating/find_rating.hpp"

namespace giga {

/// As find_rating() has it; an empty object where the run was not rated. A file that cannot be read is told in a
/// warning, which ends with `consequence`.
Json known_rating(const RatedPolicy& policy, const char* consequence);

}  // namespace giga
