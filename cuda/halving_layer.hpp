// The gradient of relu(convolution + bias) of 3 x 3 by a stride of 2 with a padding of 1, 32 channels to 32, in one
// kernel: by the input, the weight and the bias. It is what the encoder `compact` has behind its first layer.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "math/bfloat16.hpp"

namespace giga {

struct HalvingLayer {
  static constexpr int kChannels = 32, kSize = 3, kTaps = kSize * kSize;
  static constexpr int kGradients = kChannels * (kTaps * kChannels + 1);  // of the weight, then of the bias
  static constexpr int kMaxSide = 24;                                     // two images have room in shared memory

  int64_t n = 0;
  int side = 0;
  const BFloat16* input = nullptr;     // [n, side, side, 32]
  const BFloat16* weight = nullptr;    // [32 outputs, 3, 3, 32]
  const BFloat16* output = nullptr;    // [n, across, across, 32]
  const BFloat16* d_output = nullptr;  // [n, across, across, 32]
  BFloat16* d_input = nullptr;         // [n, side, side, 32]
  float* parts = nullptr;              // [halving_layer_parts, kGradients] of the sum over all images

  GIGA_HD int across() const { return (side + 1) / 2; }
  static bool serves(int64_t side, int64_t input, int64_t output, int64_t size, int64_t stride, int64_t padding) {
    return side >= 2 && side <= kMaxSide && input == kChannels && output == kChannels && size == kSize && stride == 2 &&
           padding == 1;
  }
};

/// Parts of the gradient that a launch leaves, one for each of its blocks.
int halving_layer_parts(int index);
void launch_halving_layer_gradient(const HalvingLayer& layer, int index, void* stream);

}  // namespace giga
