#include "policy/optimizer.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include "math/step_gate.hpp"

namespace giga {

Adam::Adam(const ParameterSet& parameters, double epsilon)
    : epsilon_(epsilon),
      moment1_(at::zeros_like(parameters.values())),
      moment2_(at::zeros_like(parameters.values())),
      steps_(at::zeros({}, parameters.values().options())),
      skip_(at::zeros({1}, parameters.values().options())),
      scale_(at::zeros({1}, parameters.values().options())) {}

void Adam::step(const ParameterSet& parameters, const ParallelFor& parallel_for, float learning_rate, float max_norm,
                const StepFlags& flags) {
  at::NoGradGuard no_grad;
  const at::Tensor& gradient = parameters.gradient();
  const at::Tensor norm = gradient.norm();
  parallel_for.run(StepGate{.norm = norm.const_data_ptr<float>(),
                            .max_norm = max_norm,
                            .stop = flags.stop,
                            .minibatch = static_cast<float>(flags.minibatch),
                            .fault = flags.fault,
                            .faults = flags.faults,
                            .n_faults = flags.n_faults,
                            .skip = skip_.data_ptr<float>(),
                            .scale = scale_.data_ptr<float>(),
                            .steps = steps_.data_ptr<float>(),
                            .norm_sum = flags.norm_sum},
                   1);
  if (max_norm > 0) gradient.mul_(scale_);
  at::_fused_adam_({parameters.values()}, {gradient}, {moment1_}, {moment2_}, {}, {steps_},
                   static_cast<double>(learning_rate), 0.9, 0.999, 0.0, epsilon_, false, false, {}, skip_);
  gradient.zero_();
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
