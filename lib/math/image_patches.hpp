// Images as the first layer of a network reads them: squares of pixels in the place of pixels, of so many more
// channels; and, where that is wanted, the agent that sees in the middle of its image.
#pragma once

#include <cstring>
#include <type_traits>

#include "math/bfloat16.hpp"
#include "sim/image_rows.hpp"

namespace giga {

/// Pixels along a patch.
constexpr int kPatch = 4;

/// A pixel that only the agent's own sprite has: (255 - pz, 255, 255 - pz), not white and not green (rules 8.3).
template <class T>
GIGA_HD bool is_own_pixel(T red, T green, T blue) {
  return green == T(255) && red == blue && red > T(0) && red < T(255);
}

/// How far an image is moved: pixel (x, y) of the result is pixel (x + shift.x, y + shift.y) of the image. `place`: of
/// the agent, x * side + y + 1; it comes to lie at (side / 2, side / 2).
struct ImageShift {
  int x, y;
  GIGA_HD ImageShift(int place, int side) : x((place - 1) / side - side / 2), y((place - 1) % side - side / 2) {}
};

/// Row r * side + x: the last pixel in column x of image r that is the agent's own. `T`: uint8_t, float or BFloat16.
template <class T>
struct OwnPixels {
  const T* images;  // [R, side, side, 3]
  int side;
  int32_t* place;  // [R, side] x * side + y + 1; 0: none in this column

  GIGA_HD void operator()(int64_t row) const {
    const T* pixel = images + row * side * kChannels;
    const int x = static_cast<int>(row % side);
    int found = 0;
    for (int y = 0; y < side; ++y, pixel += kChannels) {
      if (is_own_pixel(static_cast<float>(pixel[0]), static_cast<float>(pixel[1]), static_cast<float>(pixel[2])))
        found = x * side + y + 1;
    }
    place[row] = found;
  }
};

/// Row ((r * across + i) * across + j) * kPatch + k: pixels of column k of patch (i, j) of image r. With `own` pixel
/// (x, y) of an image is moved to its middle, (side / 2, side / 2); what comes in from outside is black.
template <class T>
struct ImagePatches {
  using Out = std::conditional_t<std::is_same_v<T, BFloat16>, BFloat16, float>;
  static constexpr int kNumbers = kPatch * kChannels;

  const T* images;     // [R, side, side, 3]
  const int32_t* own;  // [R] as OwnPixels tells it, of the image; 0: it stays as it is; null: all do
  int side, across;    // pixels of an image, patches of the result
  Out* patches;        // [R, across, across, kPatch * kPatch * 3]

  GIGA_HD void operator()(int64_t row) const {
    const int64_t patch = row / kPatch, line = patch / across, image = line / across;
    int x = static_cast<int>(line - image * across) * kPatch + static_cast<int>(row - patch * kPatch);
    int y = static_cast<int>(patch - line * across) * kPatch;
    if (const int place = own ? own[image] : 0; place > 0) {
      const ImageShift shift(place, side);
      x += shift.x;
      y += shift.y;
    }
    const T* from = images + (image * side + x) * side * kChannels;
    alignas(8) Out numbers[kNumbers];
    for (int k = 0; k < kPatch; ++k) {
      const bool inside = x >= 0 && x < side && y + k >= 0 && y + k < side;
      for (int c = 0; c < kChannels; ++c)
        numbers[k * kChannels + c] =
            inside ? static_cast<Out>(static_cast<float>(from[(y + k) * kChannels + c])) : Out(0.0f);
    }
    // Eight bytes at a time.
    constexpr int kWords = static_cast<int>(kNumbers * sizeof(Out) / sizeof(uint64_t));
    static_assert(kWords * sizeof(uint64_t) == kNumbers * sizeof(Out));
    auto* to = reinterpret_cast<uint64_t*>(patches + row * kNumbers);
    for (int k = 0; k < kWords; ++k) {
      uint64_t word;
      std::memcpy(&word, reinterpret_cast<const char*>(numbers) + k * sizeof word, sizeof word);
      to[k] = word;
    }
  }
};

}  // namespace giga
