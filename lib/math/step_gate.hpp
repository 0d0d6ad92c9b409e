// A gradient step of Adam, and what is decided on the device around it: how far the gradient is scaled down, whether
// the step is taken, and whether a number was not finite. The host does not wait for any of it.
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

constexpr double kAdamBeta1 = 0.9, kAdamBeta2 = 0.999;

/// Adam (Kingma and Ba 2015, algorithm 1).
struct AdamRule {
  static constexpr float kBeta1 = static_cast<float>(kAdamBeta1), kBeta2 = static_cast<float>(kAdamBeta2);
  static constexpr float kLogBeta1 = -0.105360515657826301227f, kLogBeta2 = -0.00100050033358353350142f;
  /// What a moment is divided by after so many steps: 1 - beta^steps.
  GIGA_HD static float correction(float log_beta, float steps) { return -std::expm1(steps * log_beta); }
};

/// How a step of one network is taken.
struct StepDecision {
  bool skip;                       // it is not
  float scale;                     // factor of the gradient
  float correction1, correction2;  // of Adam's moments
};

/// Before a step of one network (n = 1). A gradient that is not finite is a fault, and where there is any, nothing is
/// learned any more: the parameters stay as they were before the batch that caused it.
struct StepGate {
  const float* norm;       // [1] of the gradient
  float max_norm;          // the gradient is scaled down to this; 0 = never
  const float* stop;       // [1] 1 = take no step
  const float* minibatch;  // [1] its number within the update, from 1
  float* fault;            // [1] the first minibatch whose gradient of this network was not finite; 0 = none
  const float* faults;     // [n_faults] of the whole team, `fault` among them
  int n_faults;
  StepDecision* decision;  // [1] out
  float* steps;            // [1] steps taken so far
  float* norm_sum;         // [1] norms are added up here

  GIGA_HD void operator()(int64_t) const {
    if (!(*norm < INFINITY) && *fault == 0) *fault = *minibatch;
    bool skips = *stop > 0;
    for (int k = 0; k < n_faults; ++k) skips = skips || faults[k] > 0;
    *steps += skips ? 0.0f : 1.0f;
    const float least = max_norm / (*norm + 1e-6f);
    *decision = {skips, max_norm > 0 && least < 1 ? least : 1.0f, AdamRule::correction(AdamRule::kLogBeta1, *steps),
                 AdamRule::correction(AdamRule::kLogBeta2, *steps)};
    *norm_sum += *norm;
  }
};

/// The step of parameter i. The gradient is cleared, whether the step is taken or not.
struct AdamStep {
  float* values;    // [P]
  float* gradient;  // [P]
  float *moment1, *moment2;
  const StepDecision* decision;  // [1]
  const float* step_size;        // [1]
  float epsilon;

  GIGA_HD void operator()(int64_t i) const {
    const StepDecision d = *decision;
    const float g = gradient[i] * d.scale;
    gradient[i] = 0;
    if (d.skip) return;
    const float m = AdamRule::kBeta1 * moment1[i] + (1 - AdamRule::kBeta1) * g;
    const float v = AdamRule::kBeta2 * moment2[i] + (1 - AdamRule::kBeta2) * g * g;
    moment1[i] = m;
    moment2[i] = v;
    values[i] -= *step_size * (m / d.correction1) / (std::sqrt(v / d.correction2) + epsilon);
  }
};

}  // namespace giga
