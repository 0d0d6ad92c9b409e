// Adam over a flat parameter buffer: one fused call, clipped and skipped on the device.
#pragma once

#include <ATen/core/Tensor.h>

#include <string>

#include "core/named_array.hpp"
#include "core/parallel_for.hpp"
#include "policy/parameters.hpp"

namespace giga {

/// The flags around a step, in the device's memory. See StepGate (math/step_gate.hpp).
struct StepFlags {
  const float* stop;    // [1] 1 = take no step
  float* fault;         // [1] becomes `minibatch` if this gradient is the first that is not finite
  const float* faults;  // [n_faults] if any is not 0, no step is taken
  int n_faults;
  int minibatch;    // from 1
  float* norm_sum;  // [1] the norm before clipping is added to it
};

class Adam {
 public:
  Adam() = default;
  Adam(const ParameterSet& parameters, double epsilon);

  /// Clips the gradient to `max_norm` (0 = not), takes one step unless a flag forbids it, and clears the gradient. The
  /// host does not wait for the flags.
  void step(const ParameterSet& parameters, const ParallelFor& parallel_for, float learning_rate, float max_norm,
            const StepFlags& flags);

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  double epsilon_ = 1e-5;
  at::Tensor moment1_, moment2_, steps_;
  at::Tensor skip_, scale_;  // [1] of the step at hand
};

}  // namespace giga
