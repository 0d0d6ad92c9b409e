#include "policy/optimizer.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include "math/step_gate.hpp"

namespace giga {

Adam::Adam(const ParameterSet& parameters, float epsilon)
    : epsilon_(epsilon),
      moment1_(at::zeros_like(parameters.values())),
      moment2_(at::zeros_like(parameters.values())),
      steps_(at::zeros({}, parameters.values().options())),
      norm_(at::zeros({1}, parameters.values().options())),
      decision_(
          at::zeros({static_cast<int64_t>(sizeof(StepDecision))}, parameters.values().options().dtype(at::kByte))) {}

StepGate Adam::gate(float max_norm, const StepFlags& flags) const {
  return {.norm = norm_.const_data_ptr<float>(),
          .max_norm = max_norm,
          .stop = flags.stop,
          .minibatch = flags.minibatch,
          .fault = flags.fault,
          .faults = flags.faults,
          .n_faults = flags.n_faults,
          .decision = static_cast<StepDecision*>(decision_.data_ptr()),
          .steps = steps_.data_ptr<float>(),
          .norm_sum = flags.norm_sum};
}

AdamStep Adam::adam(const ParameterSet& parameters, const float* step_size) const {
  return {.values = parameters.values().data_ptr<float>(),
          .gradient = parameters.gradient().data_ptr<float>(),
          .moment1 = moment1_.data_ptr<float>(),
          .moment2 = moment2_.data_ptr<float>(),
          .decision = static_cast<const StepDecision*>(decision_.const_data_ptr()),
          .step_size = step_size,
          .epsilon = epsilon_};
}

void Adam::step(const ParameterSet& parameters, const ParallelFor& parallel_for, const float* step_size, float max_norm,
                const StepFlags& flags) {
  at::NoGradGuard no_grad;
  norm_.copy_(parameters.gradient().norm());
  parallel_for.run(gate(max_norm, flags), 1);
  parallel_for.run(adam(parameters, step_size), parameters.size());
}

void Adam::save(const std::string& prefix, NamedArrays& out) const {
  out.push_back(to_array(prefix + "moment1", moment1_));
  out.push_back(to_array(prefix + "moment2", moment2_));
  out.push_back(to_array(prefix + "steps", steps_));
}

void Adam::load(const std::string& prefix, const NamedArrays& in) {
  from_array(find_array(in, prefix + "moment1"), moment1_);
  from_array(find_array(in, prefix + "moment2"), moment2_);
  from_array(find_array(in, prefix + "steps"), steps_);
}

}  // namespace giga
