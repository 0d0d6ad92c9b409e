// Policy: chooses the actions of a team from the observations of its agents.
#pragma once

#include <ATen/core/Tensor.h>

#include "policy/network_state.hpp"
#include "sim/params.hpp"
#include "sim/row_layout.hpp"

namespace giga {

class Policy {
 public:
  virtual ~Policy() = default;
  /// obs [R, padded D] fp32, or images [R, side side 3] bytes -> logits [R, kLogitStride], the last not used, or means
  /// before squashing [R, 3]; fp32. `state` is that of the rows: read, and replaced by what they remember now.
  virtual at::Tensor forward(const at::Tensor& obs, NetworkState& state) const = 0;
  /// The same for the first step of an episode, or without memory.
  at::Tensor forward(const at::Tensor& obs) const {
    NetworkState state;
    return forward(obs, state);
  }
  /// Numbers that a row remembers; 0 = no memory.
  virtual int64_t state_size() const { return 0; }
  /// The observations that it reads, of those that a scenario offers.
  virtual ObservationSet reads() const { return all_numbers(); }
  bool reads_image() const { return reads().has(Observation::image); }
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
