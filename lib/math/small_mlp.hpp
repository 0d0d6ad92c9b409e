// SmallMlp: where the numbers of a small network are; what the fused kernel of populations has room for.
#pragma once

#include <cstddef>
#include <span>

#include "math/activation.hpp"

namespace giga {

/// A small multilayer perceptron as a row of parameters holds it: every layer a matrix [out, in] row by row, and a
/// bias.
struct SmallMlp {
  static constexpr int kMaxLayers = 4;
  static constexpr int kMaxWidth = 128;  ///< most numbers of a hidden layer that the kernel of populations has room for
  int n_layers = 0;
  int width[kMaxLayers + 1] = {};                      ///< input, hidden ..., output
  int weight[kMaxLayers] = {}, bias[kMaxLayers] = {};  ///< first number of each in a row of parameters
  int log_std = 0;                                     ///< first of the three; continuous actions only
  Activation activation = Activation::tanh;

  /// Whether the fused kernel of populations has room for it.
  bool fits_population() const {
    return n_layers > 0 && n_layers <= kMaxLayers &&
           has_room_for(std::span(width).subspan(1, static_cast<size_t>(n_layers - 1)));
  }
  /// Whether it has room for a network with these hidden layers.
  static bool has_room_for(std::span<const int> hidden) {
    for (const int size : hidden)
      if (size > kMaxWidth) return false;
    return hidden.size() < kMaxLayers;
  }
};

}  // namespace giga
