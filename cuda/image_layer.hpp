// The first layer of networks that read images, relu(convolution + bias), and the gradient of its weights, in one
// kernel each: from the bytes of images, without numbers or patches in memory in between.
#pragma once

#include <cstdint>

#include "math/bfloat16.hpp"
#include "math/image_patches.hpp"

namespace giga {

/// A convolution of windows of size x size pixels by a stride of kPatch, without padding.
struct ImageLayer {
  static constexpr int kOutputs = 32;
  static constexpr int kMaxImage = 48 << 10;  // bytes: 128 x 128 pixels. Shared memory has room for three of them

  const uint8_t* images = nullptr;  // [n, side, side, 3]
  int64_t n = 0;
  int side = 0, size = 0;         // pixels of an image, of a window
  bool centred = false;           // each image is moved first: its agent comes to lie in the middle (ImagePatches)
  const float* weight = nullptr;  // [kOutputs, size, size, 3], for pixels in [0, 1]
  const float* bias = nullptr;    // [kOutputs]

  int window() const { return size * size * kChannels; }
  int across() const { return (side - size) / kPatch + 1; }
  /// Numbers of the gradient: of the weight, then of the bias.
  int64_t gradients() const { return int64_t{kOutputs} * (window() + 1); }
  /// Whether there are kernels for such images and windows. A row of pixels has to fill whole words.
  static bool serves(int64_t side, int64_t size, int64_t outputs) {
    return outputs == kOutputs && (size == kPatch || size == 2 * kPatch) && side % kPatch == 0 && side >= size &&
           side * side * kChannels <= kMaxImage;
  }
};

/// Queues output [n, across, across, kOutputs]. Weights are rounded to half precision, sums are fp32.
void launch_image_layer(const ImageLayer& layer, BFloat16* output, int index, void* stream);

/// Parts of the gradient that a launch leaves, one for each of its blocks.
int image_layer_parts(int index);
/// Queues parts [image_layer_parts, gradients] of the gradient, which add up to it, for the output and its gradient.
void launch_image_layer_gradient(const ImageLayer& layer, const BFloat16* output, const BFloat16* d_output,
                                 float* parts, int index, void* stream);

/// Whether the GPU can run them and those of halving_layer.hpp: compute capability 8.0 or more, and 160 KB of shared
/// memory for a block (A100, H100, H200).
bool image_layer_runs(int index);

}  // namespace giga
