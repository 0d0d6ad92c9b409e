#include "sim/paths.hpp"

#include <algorithm>
#include <cstdlib>

#include "sim/map_tables.hpp"
#include "sim/segment_box.hpp"

namespace giga {
namespace {

struct Place {
  float x, y;
};

/// Whether the straight way crosses an obstacle, grown by kPathMargin.
bool crosses(const Place& a, const Place& b, const Box& box) {
  if (!(box.x1 < box.x2 && box.y1 < box.y2)) return false;
  const float from[2] = {a.x, a.y}, delta[2] = {b.x - a.x, b.y - a.y};
  const float lo[2] = {box.x1 - kPathMargin, box.y1 - kPathMargin},
              hi[2] = {box.x2 + kPathMargin, box.y2 + kPathMargin};
  return segment_meets_box(from, delta, lo, hi, 2);
}

}  // namespace

std::vector<uint16_t> make_path_table(float limit_x, float limit_y, const std::vector<Box>& boxes) {
  constexpr size_t n = kPathGrid;
  const auto centre = [&](int cell) {
    const auto at = [](int k) { return (static_cast<float>(k) + 0.5f) / kPathCells; };
    return Place{at(cell % kPathCells) * limit_x, at(cell / kPathCells) * limit_y};
  };
  std::vector<float> way(n * n, INFINITY);
  for (int a = 0; a < kPathGrid; ++a) {
    for (int b = 0; b < kPathGrid; ++b) {
      const int columns = std::abs(a % kPathCells - b % kPathCells), rows = std::abs(a / kPathCells - b / kPathCells);
      if (columns > 1 || rows > 1) continue;
      const Place from = centre(a), to = centre(b);
      const bool blocked = std::any_of(boxes.begin(), boxes.end(), [&](const Box& x) { return crosses(from, to, x); });
      const float length = std::hypot(to.x - from.x, to.y - from.y);
      way[static_cast<size_t>(a) * n + static_cast<size_t>(b)] = blocked ? kPathThroughObstacle * length : length;
    }
  }
  for (size_t via = 0; via < n; ++via)  // Floyd and Warshall
    for (size_t a = 0; a < n; ++a) {
      const float first = way[a * n + via];
      if (!(first < INFINITY)) continue;
      for (size_t b = 0; b < n; ++b) way[a * n + b] = std::min(way[a * n + b], first + way[via * n + b]);
    }
  std::vector<uint16_t> table(n * n);
  const float unit = path_unit(limit_x, limit_y);
  for (size_t k = 0; k < table.size(); ++k) table[k] = static_cast<uint16_t>(std::min(way[k] / unit + 0.5f, 65535.0f));
  return table;
}

}  // namespace giga
