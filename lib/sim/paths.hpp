// Ways round the obstacles of a map, between the cells of a grid laid over it: what the reward for approaching
// measures.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/geometry.hpp"
#include "sim/world.hpp"

namespace giga {

constexpr int kPathCells = 16;  ///< along a side of the world
constexpr int kPathGrid = kPathCells * kPathCells;
constexpr float kPathMargin = 0.25f;          ///< obstacles are grown by this: agents cannot turn on the spot
constexpr float kPathThroughObstacle = 8.0f;  ///< how much longer a way through an obstacle counts than one beside it

GIGA_HD float path_unit(float limit_x, float limit_y) { return (limit_x + limit_y) * (1.0f / 16384.0f); }

/// The cell, counted along one side, whose centre is the nearest or next smaller one, and how far behind it a place
/// lies.
struct PathCell {
  int low;
  float share;  // of the next cell, 0 to 1
  GIGA_HD PathCell(float at, float inv_limit) {
    const float cells = at * inv_limit * static_cast<float>(kPathCells) - 0.5f;
    const float inside = clamp(cells, 0.0f, static_cast<float>(kPathCells - 1));
    low = static_cast<int>(inside) < kPathCells - 1 ? static_cast<int>(inside) : kPathCells - 2;
    share = inside - static_cast<float>(low);
  }
  GIGA_HD int nearest() const { return share < 0.5f ? low : low + 1; }
};

/// Length of the way from (x, y) to agent a: straight on a map set without obstacles, else by the table, between the
/// centres of four cells by proportion.
GIGA_HD float way_to(const Parameters auto& p, const World auto& w, float x, float y, int a) {
  if (!p.maps.paths) {
    const float dx = w.x[a] - x, dy = w.y[a] - y;
    return std::sqrt(dx * dx + dy * dy);
  }
  const int to = PathCell(w.y[a], p.inv_limit_y).nearest() * kPathCells + PathCell(w.x[a], p.inv_limit_x).nearest();
  const PathCell column(x, p.inv_limit_x), row(y, p.inv_limit_y);
  // Ways are as long there as back.
  const uint16_t* from_target = p.maps.paths + (static_cast<int64_t>(*w.map) * kPathGrid + to) * kPathGrid;
  const uint16_t* cell = from_target + row.low * kPathCells + column.low;
  const auto between = [](uint16_t a0, uint16_t a1, float share) {
    return static_cast<float>(a0) + share * (static_cast<float>(a1) - static_cast<float>(a0));
  };
  const float upper = between(cell[0], cell[1], column.share);
  const float lower = between(cell[kPathCells], cell[kPathCells + 1], column.share);
  return (upper + row.share * (lower - upper)) * path_unit(p.limit_x, p.limit_y);
}

}  // namespace giga
