// A thread has eight neighbouring columns of every so many rows; a block adds up what its threads have of a column, in
// a fixed order.
#include "cuda/relu_gradient.hpp"

#include "cuda/bfloat16_tiles.cuh"
#include "cuda/check.cuh"

namespace giga {
namespace {

constexpr int kThreads = 256, kBlocks = 4;  // on a multiprocessor
constexpr int kWide = 8;                    // numbers that a thread reads at once
constexpr int kAtOnce = 2;                  // rows on their way

__global__ void __launch_bounds__(kThreads, kBlocks) relu_gradient_kernel(const __grid_constant__ ReluGradient g) {
  __shared__ float sums[kThreads][kWide + 1];                      // one more, for the banks
  const int across = g.columns / kWide, rows = kThreads / across;  // threads of a row, rows of a block
  const int thread = static_cast<int>(threadIdx.x), column = thread % across * kWide;
  const int64_t step = int64_t{gridDim.x} * rows;
  float sum[kWide] = {};
  for (int64_t first = int64_t{blockIdx.x} * rows + thread / across; first < g.rows; first += kAtOnce * step) {
    uint4 output[kAtOnce], d_output[kAtOnce];
#pragma unroll
    for (int k = 0; k < kAtOnce; ++k) {
      const int64_t row = first + k * step;
      if (row >= g.rows) continue;
      output[k] = __ldg(reinterpret_cast<const uint4*>(g.output + row * g.columns + column));
      d_output[k] = __ldg(reinterpret_cast<const uint4*>(g.d_output + row * g.columns + column));
    }
#pragma unroll
    for (int k = 0; k < kAtOnce; ++k) {
      const int64_t row = first + k * step;
      if (row >= g.rows) continue;
      uint32_t pairs[kWide / 2];
#pragma unroll
      for (int j = 0; j < kWide / 2; ++j) {
        pairs[j] = through_relu(word_of(output[k], j), word_of(d_output[k], j));
        sum[2 * j] += low(pairs[j]);
        sum[2 * j + 1] += high(pairs[j]);
      }
      *reinterpret_cast<uint4*>(g.d_input + row * g.columns + column) = {pairs[0], pairs[1], pairs[2], pairs[3]};
    }
  }
#pragma unroll
  for (int j = 0; j < kWide; ++j) sums[thread][j] = sum[j];
  __syncthreads();
  for (int c = thread; c < g.columns; c += kThreads) {
    float total = 0;
    for (int k = 0; k < rows; ++k) total += sums[k * across + c / kWide][c % kWide];
    g.parts[int64_t{blockIdx.x} * g.columns + c] = total;
  }
}

}  // namespace

int relu_gradient_parts(int index) { return kBlocks * multiprocessors(index); }

void launch_relu_gradient(const ReluGradient& gradient, int index, void* stream) {
  GIGA_CHECK(ReluGradient::serves(gradient.columns), gradient.columns, " columns");
  GIGA_CUDA(cudaSetDevice(index));
  const auto blocks = static_cast<unsigned>(relu_gradient_parts(index));
  relu_gradient_kernel<<<blocks, kThreads, 0, static_cast<cudaStream_t>(stream)>>>(gradient);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
