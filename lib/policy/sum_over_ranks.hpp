// SumOverRanks: makes a sum over the worlds of this process that of all processes which learn together (lib/ranks).
#pragma once

#include <ATen/core/Tensor.h>

#include <functional>

namespace giga {

struct SumOverRanks {
  /// Adds a tensor up over all ranks, in place; all get the same bits, and call it in the same order. Null: this
  /// process learns alone.
  std::function<void(const at::Tensor&)> add;

  bool alone() const { return !add; }
  void operator()(const at::Tensor& x) const {
    if (add) add(x);
  }
};

}  // namespace giga
