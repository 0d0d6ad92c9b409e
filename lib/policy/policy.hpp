// Policy: what chooses the actions of a team from its agents' observations, wherever it comes from.
#pragma once

#include <ATen/core/Tensor.h>

#include "sim/params.hpp"

namespace giga {

class Policy {
 public:
  virtual ~Policy() = default;
  /// obs [R, padded D] fp32 -> logits [R, kLogitStride], the last not used, or means before squashing [R, 3]; fp32.
  virtual at::Tensor forward(const at::Tensor& obs) const = 0;
  virtual ActionKind actions() const = 0;
  /// [3] fp32, logarithm of the deviations before squashing; continuous actions only.
  virtual at::Tensor log_std() const = 0;

 protected:
  Policy() = default;
  Policy(const Policy&) = default;
  Policy(Policy&&) = default;
  Policy& operator=(const Policy&) = default;
  Policy& operator=(Policy&&) = default;
};

}  // namespace giga
