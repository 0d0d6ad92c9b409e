// What is decided on the device around a gradient step: how far the gradient is scaled down, whether the step is taken,
// and whether a number was not finite. The host does not wait for any of it.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/host_device.hpp"

namespace giga {

/// Row k notes fault k where the tensor k, of which the least and the greatest number are given, holds a NaN or an
/// infinity (a NaN anywhere makes both NaN).
struct FiniteCheck {
  static constexpr int kMostTensors = 8;
  const float* least[kMostTensors];     // [1] each
  const float* greatest[kMostTensors];  // [1] each
  float* fault;                         // [tensors] 0 = finite; left alone where it is

  GIGA_HD void operator()(int64_t k) const {
    if (!(*greatest[k] - *least[k] < INFINITY)) fault[k] = 1;
  }
};

/// Before a step of one network (n = 1). A gradient that is not finite is a fault, and where there is any, nothing is
/// learned any more: the parameters stay as they were before the batch that caused it.
struct StepGate {
  const float* norm;    // [1] of the gradient
  float max_norm;       // the gradient is scaled down to this; 0 = never
  const float* stop;    // [1] 1 = take no step
  float minibatch;      // number within the update, from 1
  float* fault;         // [1] the first minibatch whose gradient of this network was not finite; 0 = none
  const float* faults;  // [n_faults] of the whole team, `fault` among them
  int n_faults;
  float* skip;      // [1] out: 1 = take no step
  float* scale;     // [1] out: factor of the gradient
  float* steps;     // [1] steps taken so far, for Adam's bias correction
  float* norm_sum;  // [1] norms are added up here

  GIGA_HD void operator()(int64_t) const {
    if (!(*norm < INFINITY) && *fault == 0) *fault = minibatch;
    bool skips = *stop > 0;
    for (int k = 0; k < n_faults; ++k) skips = skips || faults[k] > 0;
    *skip = skips ? 1.0f : 0.0f;
    *steps += skips ? 0.0f : 1.0f;
    const float least = max_norm / (*norm + 1e-6f);
    *scale = max_norm > 0 && least < 1 ? least : 1.0f;
    *norm_sum += *norm;
  }
};

}  // namespace giga
