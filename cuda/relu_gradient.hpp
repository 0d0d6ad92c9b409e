// The gradient through relu(x + bias) of many rows in bfloat16, and that of the bias, in one pass.
#pragma once

#include <cstdint>

#include "math/bfloat16.hpp"

namespace giga {

struct ReluGradient {
  int64_t rows = 0;
  int columns = 0;
  const BFloat16* output = nullptr;    // [rows, columns] of the ReLU
  const BFloat16* d_output = nullptr;  // [rows, columns]
  BFloat16* d_input = nullptr;         // [rows, columns] d_output where the output is not 0, else 0
  float* parts = nullptr;              // [relu_gradient_parts, columns] of the sum of d_input over all rows

  /// Whether the kernel has threads for so many columns.
  static bool serves(int64_t columns) { return columns >= 8 && columns <= 512 && (columns & (columns - 1)) == 0; }
};

/// Parts of the sum that a launch leaves, one for each of its blocks.
int relu_gradient_parts(int index);
void launch_relu_gradient(const ReluGradient& gradient, int index, void* stream);

}  // namespace giga
