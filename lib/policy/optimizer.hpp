// Adam: Adam over a flat parameter buffer, clipped and skipped on the device.
#pragma once

#include <ATen/core/Tensor.h>

#include <string>

#include "core/named_array.hpp"
#include "core/parallel_for.hpp"
#include "math/step_gate.hpp"
#include "policy/parameters.hpp"

namespace giga {

/// The flags around a step, in the device's memory. See StepGate (math/step_gate.hpp).
struct StepFlags {
  const float* stop;    // [1] 1 = take no step
  float* fault;         // [1] becomes `minibatch` if this gradient is the first that is not finite
  const float* faults;  // [n_faults] if any is not 0, no step is taken
  int n_faults;
  const float* minibatch;  // [1] from 1
  float* norm_sum;         // [1] the norm before clipping is added to it
};

class Adam {
 public:
  Adam() = default;
  Adam(const ParameterSet& parameters, float epsilon);

  /// Clips the gradient to `max_norm` (0 = not), takes one step unless a flag forbids it, and clears the gradient. The
  /// host does not wait for the flags. `step_size`: [1] in the device's memory, so that a recorded step can be taken
  /// with another one.
  void step(const ParameterSet& parameters, const ParallelFor& parallel_for, const float* step_size, float max_norm,
            const StepFlags& flags);
  /// The two operations of a step, for kernels that do them: the gate wants the norm of the gradient first.
  StepGate gate(float max_norm, const StepFlags& flags) const;
  AdamStep adam(const ParameterSet& parameters, const float* step_size) const;
  const at::Tensor& norm() const { return norm_; }

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  float epsilon_ = 1e-5f;
  at::Tensor moment1_, moment2_, steps_;
  at::Tensor norm_;      // [1] of the gradient of the step at hand
  at::Tensor decision_;  // a StepDecision, of the same
};

}  // namespace giga
