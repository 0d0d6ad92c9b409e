// SumOverRanks: makes a sum over the worlds of this process that of all processes which learn together (lib/ranks).
#pragma once

#include <ATen/core/Tensor.h>

#include <functional>
#include <initializer_list>

namespace giga {

struct SumOverRanks {
  /// Adds a tensor up over all ranks, in place; all get the same bits, and call it in the same order. On a GPU that is
  /// queued on a stream (a cudaStream_t); null: that of LibTorch's work. No function: this process learns alone.
  std::function<void(const at::Tensor&, void* stream)> add;

  bool alone() const { return !add; }
  void operator()(const at::Tensor& x, void* stream = nullptr) const {
    if (add) add(x, stream);
  }
  /// Several tensors of one type in one message, but for those that are undefined.
  void together(std::initializer_list<at::Tensor> tensors) const;
};

}  // namespace giga
