// Policy: what can move a team: from an agent's observation to the parameters of its action distribution.
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
  /// [3], continuous actions only.
  virtual at::Tensor log_std() const = 0;
};

}  // namespace giga
