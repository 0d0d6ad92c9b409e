#include "policy/optimizer.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

namespace giga {

Adam::Adam(const ParameterSet& parameters, double epsilon)
    : epsilon_(epsilon),
      moment1_(at::zeros_like(parameters.values())),
      moment2_(at::zeros_like(parameters.values())),
      steps_(at::zeros({}, parameters.values().options())) {}

at::Tensor Adam::step(const ParameterSet& parameters, double learning_rate, double max_norm, const at::Tensor& skip) {
  at::NoGradGuard no_grad;
  const at::Tensor& gradient = parameters.gradient();
  const at::Tensor norm = gradient.norm();
  if (max_norm > 0) gradient.mul_((max_norm / (norm + 1e-6)).clamp_max(1.0));
  steps_.add_(1.0 - skip.reshape({}));
  const at::Tensor skip_scalar = skip.reshape({1});
  at::_fused_adam_({parameters.values()}, {gradient}, {moment1_}, {moment2_}, {}, {steps_}, learning_rate, 0.9, 0.999,
                   0.0, epsilon_, false, false, {}, skip_scalar);
  gradient.zero_();
  return norm.reshape({1});
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
