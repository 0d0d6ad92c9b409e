// RecurrentCell: the memory of a network, between its encoder and its output layer. GRU or LSTM (math/recurrent.hpp).
#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <string>

#include "policy/config.hpp"
#include "policy/network_state.hpp"
#include "policy/parameters.hpp"

namespace giga {

/// Features x [..., F] and H numbers that are remembered -> features [..., H]. A row of its state has these H numbers;
/// of an LSTM the H of its cell follow. Everything but the product with x is in fp32.
class RecurrentCell {
 public:
  /// Adds `name`/input_weight [G H, F], input_bias [G H], hidden_weight [G H, H], hidden_bias [G H]; G gates: of a GRU
  /// reset, update, candidate, of an LSTM in, forget, candidate, out.
  RecurrentCell(ParameterSet& parameters, const std::string& name, MemoryKind kind, int64_t input, int64_t size);

  int64_t features() const { return size_; }
  int64_t state_size() const { return kind_ == MemoryKind::lstm ? 2 * size_ : size_; }

  /// x [..., F] of L R rows -> [L R, H]. The products with x are one for all steps. Differentiable in x and the
  /// parameters.
  at::Tensor forward(const ParameterSet& p, const at::Tensor& x, const Sequence& sequence) const;
  /// One step of each member of a population [M, P] on rows of its own: x [M, R, F] -> [M, R, H]. No gradient.
  at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, const at::Tensor& x,
                             NetworkState& state) const;

 private:
  MemoryKind kind_;
  int64_t size_;
  int input_weight_, input_bias_, hidden_weight_, hidden_bias_;
};

}  // namespace giga
