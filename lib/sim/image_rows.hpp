// ImageRows: rows of an image of bytes, where a place of the world lies on it, and how bytes get there.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/geometry.hpp"
#include "sim/params.hpp"

namespace giga {

constexpr int kChannels = 3;  ///< red, green, blue

GIGA_HD int row_bytes(int side) { return side * kChannels; }
GIGA_HD int image_bytes(int side) { return side * row_bytes(side); }

/// Rows [x0, x1) of an image of side x side pixels; its first index is x, its second y (rules 8.1).
struct ImageRows {
  uint8_t* bytes;  // [x1 - x0, side, kChannels]
  int side;
  int x0, x1;
  bool wraps;  // the original's: an index from -side to -1 counts from the end

  /// The pixel, or null where it is not among the rows.
  GIGA_HD uint8_t* at(int x, int y) const {
    if (wraps && x < 0) x += side;
    if (wraps && y < 0) y += side;
    if (x < x0 || x >= x1 || y < 0 || y >= side) return nullptr;
    return bytes + ((x - x0) * side + y) * kChannels;
  }
};

/// Pixel of a coordinate. Beyond the far border lies a pixel that the image has not: under `corrected` agents there are
/// drawn on the last one (Q20).
GIGA_HD int pixel_of(const Parameters auto& p, float place, float limit) {
  const int pixel = static_cast<int>(std::rint(place * static_cast<float>(p.resolution) / limit));
  if (p.original()) return pixel;
  return pixel < 0 ? 0 : (pixel < p.resolution ? pixel : p.resolution - 1);
}

/// Pixels of a length, one at least.
GIGA_HD int pixels_of(float length, float limit, int side) {
  const int pixels = static_cast<int>(length * static_cast<float>(side) / limit);
  return pixels > 1 ? pixels : 1;
}

/// *byte = f(*byte), also where several lanes change the same bytes: f must come to the same in any order.
template <class F>
GIGA_HD void change_byte(uint8_t* byte, F&& f) {
#if defined(__CUDA_ARCH__)
  const auto address = reinterpret_cast<uintptr_t>(byte);
  auto* word = reinterpret_cast<uint32_t*>(address & ~uintptr_t{3});
  const uint32_t shift = static_cast<uint32_t>(address & 3) * 8;
  uint32_t known, now = *word;
  do {
    known = now;
    const uint32_t changed = static_cast<uint32_t>(f(static_cast<int>(known >> shift & 255u)));
    now = atomicCAS(word, known, (known & ~(255u << shift)) | changed << shift);
  } while (now != known);
#else
  *byte = static_cast<uint8_t>(f(*byte));
#endif
}

/// Tails add up: modulo 256 in the original, and up to 255 under `corrected` (Q20).
GIGA_HD void add_to(uint8_t* byte, int value, bool wraps) {
  change_byte(byte, [&](int old) { return wraps || old + value < 256 ? (old + value) & 255 : 255; });
}
GIGA_HD void raise_to(uint8_t* byte, int value) {
  change_byte(byte, [&](int old) { return old < value ? value : old; });
}

GIGA_HD void set_pixel(uint8_t* pixel, int red, int green, int blue) {
  if (!pixel) return;
  pixel[0] = static_cast<uint8_t>(red);
  pixel[1] = static_cast<uint8_t>(green);
  pixel[2] = static_cast<uint8_t>(blue);
}

/// What one lane moves at a time where addresses allow it.
struct alignas(16) WideBytes {
  uint32_t words[4];
};

/// Copies `count` bytes, neighboring lanes neighboring ones. A lane reads four places before it writes any: on the GPU
/// it waits for memory once instead of four times.
template <class Lanes>
GIGA_HD void copy_bytes(const Lanes& lanes, const uint8_t* from, uint8_t* to, int count) {
  const auto as = [&]<class T>(const T*) {
    const T* in = reinterpret_cast<const T*>(from);
    T* out = reinterpret_cast<T*>(to);
    const int n = count / static_cast<int>(sizeof(T)), quarter = n / 4, rest = n - 4 * quarter;
    lanes.each(quarter + rest, [&](int k) {
      if (k >= quarter) {
        out[k + 3 * quarter] = in[k + 3 * quarter];
        return;
      }
      const T a = in[k], b = in[k + quarter], c = in[k + 2 * quarter], d = in[k + 3 * quarter];
      out[k] = a;
      out[k + quarter] = b;
      out[k + 2 * quarter] = c;
      out[k + 3 * quarter] = d;
    });
  };
  const auto bits = reinterpret_cast<uintptr_t>(from) | reinterpret_cast<uintptr_t>(to) | static_cast<uintptr_t>(count);
  if (bits % sizeof(WideBytes) == 0)
    as(static_cast<const WideBytes*>(nullptr));
  else if (bits % sizeof(uint32_t) == 0)
    as(static_cast<const uint32_t*>(nullptr));
  else
    as(static_cast<const uint8_t*>(nullptr));
}

}  // namespace giga
