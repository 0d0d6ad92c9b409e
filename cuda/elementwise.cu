// Elementwise operations on the GPU: one thread per element.
#include "core/parallel_for.hpp"
#include "cuda/check.cuh"
#include "cuda/elementwise.hpp"

namespace giga {
namespace {

constexpr int kThreads = 128;

template <class Op>
__global__ void __launch_bounds__(kThreads) elementwise_kernel(const __grid_constant__ Op op, int64_t n) {
  const int64_t row = static_cast<int64_t>(blockIdx.x) * kThreads + threadIdx.x;
  if (row < n) op(row);
}

}  // namespace

template <class Op>
void launch_elementwise(const Op& op, int64_t n, int index, void* stream) {
  if (n <= 0) return;
  GIGA_CUDA(cudaSetDevice(index));
  const auto blocks = static_cast<unsigned>((n + kThreads - 1) / kThreads);
  elementwise_kernel<<<blocks, kThreads, 0, static_cast<cudaStream_t>(stream)>>>(op, n);
  GIGA_CUDA(cudaGetLastError());
}

#define GIGA_INSTANTIATE(Op) template void launch_elementwise(const Op&, int64_t, int, void*);
GIGA_ELEMENTWISE(GIGA_INSTANTIATE)
#undef GIGA_INSTANTIATE

}  // namespace giga
