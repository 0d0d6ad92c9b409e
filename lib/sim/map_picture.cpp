#include "sim/map_picture.hpp"

#include <algorithm>

#include "sim/map_tables.hpp"

namespace giga {
namespace {

/// First pixel of a stretch of an obstacle, or the one behind its last. The original keeps both inside the image, so
/// that a box at the far border ends a pixel short (Q23).
int edge(float place, float limit, int side) {
  return std::clamp(static_cast<int>(place * static_cast<float>(side) / limit), 0, side - 1);
}

void draw_obstacles(const SimParams& p, const MapSpec& map, const ImageRows& image) {
  constexpr int kGray = 127;
  for (const Box& box : map.boxes) {
    const int x2 = edge(box.x2, p.limit_x, image.side), y2 = edge(box.y2, p.limit_y, image.side);
    for (int x = edge(box.x1, p.limit_x, image.side); x < x2; ++x)
      for (int y = edge(box.y1, p.limit_y, image.side); y < y2; ++y) set_pixel(image.at(x, y), kGray, kGray, kGray);
  }
}

/// A line is red, or all channels have their largest value.
void draw_border(const ImageRows& image, Picture picture) {
  const int last = image.side - 1, channels = picture == Picture::hurt ? 1 : kChannels;
  const auto draw = [&](int x, int y) { std::fill_n(image.at(x, y), channels, uint8_t{255}); };
  for (int k = 0; k <= last; ++k) {
    draw(0, k);
    draw(last, k);
    draw(k, 0);
    if (picture == Picture::global) draw(k, last);
  }
}

}  // namespace

std::vector<uint8_t> make_map_pictures(const SimParams& p, const std::vector<MapSpec>& maps) {
  if (p.resolution == 0) return {};
  const auto stride = static_cast<size_t>(picture_stride(p.resolution));
  std::vector<uint8_t> pictures(maps.size() * kNPictures * stride);
  for (size_t k = 0; k < maps.size() * kNPictures; ++k) {
    const ImageRows image{pictures.data() + k * stride, p.resolution, 0, p.resolution, false};
    draw_obstacles(p, maps[k / kNPictures], image);
    draw_border(image, static_cast<Picture>(k % kNPictures));
  }
  return pictures;
}

}  // namespace giga
