// The ratings of a report: what `gigastep rate` left in the run folders.
#pragma once

#include <vector>

#include "io/json.hpp"
#include "report/curves.hpp"

namespace giga {

/// Adds a section of kind `pictures` (a list of SVG with the x axis that each belongs to, and tables) for each run that
/// was rated.
void add_ratings_sections(const std::vector<RunGroup>& groups, Json& sections);

}  // namespace giga
