// Elementwise operations (core/parallel_for.hpp) where a tensor lies: on LibTorch's threads, or queued on its stream.
#pragma once

#include <ATen/Parallel.h>
#include <ATen/core/Tensor.h>
#include <c10/core/impl/VirtualGuardImpl.h>

#include "core/parallel_for.hpp"
#include "cuda/elementwise.hpp"

namespace giga {

/// The stream on which LibTorch works on the GPU of `x`: a cudaStream_t.
inline void* libtorch_stream(const at::Tensor& x) {
  return c10::impl::VirtualGuardImpl(at::kCUDA).getStream(x.device()).native_handle();
}

/// op(0) ... op(n - 1) on the device of `x`; on a CPU a thread takes `grain` of them at least.
template <class Op>
void run_elementwise(const at::Tensor& x, const Op& op, int64_t n, int64_t grain = 4096) {
  if (x.is_cuda()) return launch_elementwise(op, n, static_cast<int>(x.device().index()), libtorch_stream(x));
  at::parallel_for(0, n, grain, [&op](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) op(row);
  });
}

}  // namespace giga
