// What is worked out once for each map of a scenario: ways round its obstacles, and its pictures.
#pragma once

#include <cstdint>
#include <vector>

#include "sim/spec.hpp"

namespace giga {

/// Lengths of the shortest ways between the centres of all cells, [kPathGrid, kPathGrid] row = from (sim/paths.hpp);
/// counted in path_unit, at most 65535. Moves lead to the eight neighbors.
std::vector<uint16_t> make_path_table(float limit_x, float limit_y, const std::vector<Box>& boxes);

/// All pictures of the maps, [n_maps, kNPictures, picture_stride] (sim/map_picture.hpp); empty where a scenario has no
/// images.
std::vector<uint8_t> make_map_pictures(const SimParams& p, const std::vector<MapSpec>& maps);

}  // namespace giga
