// Whether boxes together cover an area.
#pragma once

#include <vector>

#include "sim/params.hpp"

namespace giga {

/// Do the boxes leave nothing of `area`? A border of width 0 counts as nothing; an area may be a line or a point, which
/// a box covers that touches it. `with_heights`: along z too.
bool covers(const std::vector<Box>& boxes, const Box& area, bool with_heights);

}  // namespace giga
