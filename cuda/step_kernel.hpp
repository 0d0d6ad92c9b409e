// StepKernel: the step of one scenario as a kernel that was compiled for it (step_compiler.hpp), loaded into a GPU.
#pragma once

#include <memory>
#include <string>

#include "cuda/executor.hpp"

namespace giga {

class StepKernel {
 public:
  /// For the worlds of a simulator on GPU `index`. Null where there is none; the general kernel serves then. `report`
  /// says how it was come by, or why not.
  static std::unique_ptr<StepKernel> make(const SimParams& p, int n_worlds, int index, std::string& report);

  virtual ~StepKernel() = default;
  /// Queues a step on a stream (a cudaStream_t).
  virtual void launch(const Launch& k, void* stream) const = 0;
};

}  // namespace giga
