// What surrounds the fused gradients: the moments of a minibatch before them, the sum over blocks behind them.
#include "cuda/check.cuh"
#include "cuda/ppo_gradients.hpp"

namespace giga {
namespace {

constexpr int kMomentThreads = 256;
__global__ void __launch_bounds__(kMomentThreads)
    moments_kernel(const __grid_constant__ FusedRows rows, const float* advantage, double* moments) {
  __shared__ double sums[kMoments][kMomentThreads];
  const int thread = static_cast<int>(threadIdx.x);
  double count = 0, sum = 0, squares = 0;
  const int64_t n_rows = rows.n_states * rows.n, step = static_cast<int64_t>(kMomentParts) * kMomentThreads;
  for (int64_t row = blockIdx.x * kMomentThreads + thread; row < n_rows; row += step) {
    const int64_t source = RowIndex{rows.states, rows.n}.source(row);
    if (!rows.alive[source]) continue;
    const double a = static_cast<double>(advantage[source]);
    count += 1;
    sum += a;
    squares += a * a;
  }
  sums[0][thread] = count;
  sums[1][thread] = sum;
  sums[2][thread] = squares;
  for (int half = kMomentThreads / 2; half > 0; half /= 2) {
    __syncthreads();
    if (thread < half)
      for (int k = 0; k < kMoments; ++k) sums[k][thread] += sums[k][thread + half];
  }
  if (thread < kMoments) moments[blockIdx.x * kMoments + thread] = sums[thread][0];
}

// A block has 32 columns; each of its rows of threads adds up some of the blocks' rows.
constexpr int kSumColumns = 32, kSumRows = 16;
__global__ void __launch_bounds__(kSumColumns* kSumRows)
    gradient_sum_kernel(const float* partial, int n_partial, int64_t size, float* gradient, float* sums) {
  __shared__ float work[kSumRows][kSumColumns];
  const int64_t column = static_cast<int64_t>(blockIdx.x) * kSumColumns + threadIdx.x, stride = size + kFusedSums;
  float sum = 0;
  if (column < stride)
    for (int row = static_cast<int>(threadIdx.y); row < n_partial; row += kSumRows)
      sum += partial[row * stride + column];
  work[threadIdx.y][threadIdx.x] = sum;
  __syncthreads();
  if (threadIdx.y == 0 && column < stride) {
    for (int row = 1; row < kSumRows; ++row) sum += work[row][threadIdx.x];
    (column < size ? gradient[column] : sums[column - size]) = sum;
  }
}

}  // namespace

bool fused_gradients_run(int index) {
  int major = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, index));
  int shared = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&shared, cudaDevAttrMaxSharedMemoryPerBlockOptin, index));
  return major >= 8 && shared >= 227 * 1024;
}

int fused_blocks(int index) {
  int multiprocessors = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, index));
  return multiprocessors;
}

void launch_moments(const FusedRows& rows, const float* advantage, double* moments, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  moments_kernel<<<kMomentParts, kMomentThreads, 0, static_cast<cudaStream_t>(stream)>>>(rows, advantage, moments);
  GIGA_CUDA(cudaGetLastError());
}

void launch_gradient_sum(const float* partial, int64_t size, float* gradient, float* sums, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const auto blocks = static_cast<unsigned>((size + kFusedSums + kSumColumns - 1) / kSumColumns);
  gradient_sum_kernel<<<blocks, dim3(kSumColumns, kSumRows), 0, static_cast<cudaStream_t>(stream)>>>(
      partial, fused_blocks(index), size, gradient, sums);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
