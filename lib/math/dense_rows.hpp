// DenseRows: a dense layer on rows of numbers, as an elementwise operation. For a few thousand rows of small networks.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "math/activation.hpp"

namespace giga {

/// Row r * outputs + o: y[r, o] = activation(bias[o] + sum of weight[o, i] x[r, i] over the inputs, in their order).
struct DenseRows {
  const float* x;  // [R, stride]
  int64_t stride;
  const float *mean, *std;  // [inputs] of x, by which it is normalised and clamped to +- limit; null: it is not
  float limit;
  const float *weight, *bias;  // [outputs, inputs], [outputs]
  int inputs, outputs;
  bool activated;  // by
  Activation activation;
  float* y;  // [R, outputs]

  GIGA_HD void operator()(int64_t row) const {
    const int64_t r = row / outputs;
    const int o = static_cast<int>(row - r * outputs);
    float sum = bias[o];
    for (int i = 0; i < inputs; ++i) {
      float number = x[r * stride + i];
      if (mean) {
        number = (number - mean[i]) / std[i];
        number = number < -limit ? -limit : number > limit ? limit : number;
      }
      sum += weight[int64_t{o} * inputs + i] * number;
    }
    y[row] = activated ? activate(activation, sum) : sum;
  }
};

}  // namespace giga
