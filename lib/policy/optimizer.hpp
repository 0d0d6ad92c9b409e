// Adam over a flat parameter buffer: one fused call, skipped on the device where asked.
#pragma once

#include <ATen/core/Tensor.h>

#include <string>

#include "core/named_array.hpp"
#include "policy/parameters.hpp"

namespace giga {

class Adam {
 public:
  Adam() = default;
  Adam(const ParameterSet& parameters, double epsilon);

  /// Clips the gradient to `max_norm` (0 = not), takes one step and clears the gradient. Returns the norm before
  /// clipping [1]. Where `skip` [1] is 1, nothing but the clearing happens; the host does not wait to know.
  at::Tensor step(const ParameterSet& parameters, double learning_rate, double max_norm, const at::Tensor& skip);

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  double epsilon_ = 1e-5;
  at::Tensor moment1_, moment2_, steps_;
};

}  // namespace giga
