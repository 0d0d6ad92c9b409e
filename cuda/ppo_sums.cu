// What surrounds the fused gradients: the moments of minibatches before them; the sums over blocks and the step behind.
#include "cuda/check.cuh"
#include "cuda/ppo_gradients.hpp"

namespace giga {
namespace {

constexpr int kMomentThreads = 256;

/// Blocks [pieces, parts]: of the second, a grid has 65,535 at most.
__global__ void __launch_bounds__(kMomentThreads)
    moments_kernel(const __grid_constant__ FusedRows rows, MinibatchPieces pieces, const float* advantage,
                   double* moments) {
  __shared__ double sums[kMoments][kMomentThreads];
  const int thread = static_cast<int>(threadIdx.x), piece = static_cast<int>(blockIdx.x);
  double count = 0, sum = 0, squares = 0;
  const int64_t end = pieces.begin(piece + 1) * rows.n, step = static_cast<int64_t>(kMomentParts) * kMomentThreads;
  for (int64_t row = pieces.begin(piece) * rows.n + blockIdx.y * kMomentThreads + thread; row < end; row += step) {
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
  __syncthreads();
  if (thread < kMoments)
    moments[(static_cast<int64_t>(piece) * kMomentParts + blockIdx.y) * kMoments + thread] = sums[thread][0];
}

// A block has 32 columns; each of its rows of threads adds up some of the blocks' rows.
constexpr int kSumColumns = 32, kSumRows = 16, kSumThreads = kSumColumns * kSumRows;
int sum_blocks(int64_t size) { return static_cast<int>((size + kFusedSums + kSumColumns - 1) / kSumColumns); }

/// Sum of numbers from first to last, in the same order each time. All threads call it; thread 0 has the sum.
__device__ double sum_in_order(const double* from, const double* to, double* work) {
  const int thread = static_cast<int>(threadIdx.y * kSumColumns + threadIdx.x);
  double sum = 0;
  for (const double* x = from + thread; x < to; x += kSumThreads) sum += *x;
  __syncthreads();
  work[thread] = sum;
  for (int half = kSumThreads / 2; half > 0; half /= 2) {
    __syncthreads();
    if (thread < half) work[thread] += work[thread + half];
  }
  __syncthreads();
  return work[0];
}

/// The sum of one column over the rows of a network's blocks, for the threads of row 0. All threads of the block call
/// it.
__device__ float column_sum(const FusedStep::Network& net, int64_t column, float (&work)[kSumRows][kSumColumns]) {
  const int64_t stride = net.size + kFusedSums;
  float sum = 0;
  if (column < stride)
    for (int row = static_cast<int>(threadIdx.y); row < net.n_partial; row += kSumRows)
      sum += net.partial[row * stride + column];
  work[threadIdx.y][threadIdx.x] = sum;
  __syncthreads();
  if (threadIdx.y == 0 && column < stride)
    for (int row = 1; row < kSumRows; ++row) sum += work[row][threadIdx.x];
  return sum;
}

/// Blocks of the actor's columns, then of the critic's.
__global__ void __launch_bounds__(kSumThreads)
    block_sums_kernel(const __grid_constant__ FusedStep step, int actor_blocks, float* to) {
  __shared__ float work[kSumRows][kSumColumns];
  const bool of_actor = static_cast<int>(blockIdx.x) < actor_blocks;
  const FusedStep::Network& net = of_actor ? step.actor : step.critic;
  const int block = static_cast<int>(blockIdx.x) - (of_actor ? 0 : actor_blocks);
  const int64_t column = static_cast<int64_t>(block) * kSumColumns + threadIdx.x;
  const float sum = column_sum(net, column, work);
  if (threadIdx.y == 0 && column < net.size + kFusedSums)
    to[(of_actor ? 0 : step.actor.size + kFusedSums) + column] = sum;
}

/// The same blocks. The last one to finish takes the norms, notes and gates.
__global__ void __launch_bounds__(kSumThreads)
    gradient_sums_kernel(const __grid_constant__ FusedStep step, int actor_blocks) {
  __shared__ float work[kSumRows][kSumColumns];
  __shared__ double wide[kSumThreads];
  __shared__ bool last;
  const bool of_actor = static_cast<int>(blockIdx.x) < actor_blocks;
  const FusedStep::Network& net = of_actor ? step.actor : step.critic;
  const int block = static_cast<int>(blockIdx.x) - (of_actor ? 0 : actor_blocks);
  const int64_t column = static_cast<int64_t>(block) * kSumColumns + threadIdx.x, stride = net.size + kFusedSums;
  const float sum = column_sum(net, column, work);
  if (threadIdx.y == 0) {
    double square = 0;
    if (column < stride) {
      (column < net.size ? net.adam.gradient[column] : net.sums[column - net.size]) = sum;
      if (column < net.size) square = static_cast<double>(sum) * static_cast<double>(sum);
    }
    for (int apart = 1; apart < kSumColumns; apart *= 2) square += __shfl_xor_sync(0xFFFFFFFFu, square, apart);
    if (threadIdx.x == 0) step.squares[blockIdx.x] = square;
    __threadfence();  // what this warp has written is read by the last block
    __syncwarp();
    if (threadIdx.x == 0) last = atomicAdd(step.finished, 1u) == gridDim.x - 1;
  }
  __syncthreads();
  if (!last) return;
  __threadfence();
  const double actor = sum_in_order(step.squares, step.squares + actor_blocks, wide);
  const double critic = sum_in_order(step.squares + actor_blocks, step.squares + gridDim.x, wide);
  if (threadIdx.x + threadIdx.y > 0) return;
  *step.actor.norm = static_cast<float>(sqrt(actor));
  *step.critic.norm = static_cast<float>(sqrt(critic));
  step.note(0);
  *step.value_loss += step.critic.sums[0];
  step.actor.gate(0);
  step.critic.gate(0);
  *step.finished = 0;
}

constexpr int kAdamThreads = 256;
__global__ void __launch_bounds__(kAdamThreads) adam_kernel(const __grid_constant__ FusedStep step) {
  const int64_t i = static_cast<int64_t>(blockIdx.x) * kAdamThreads + threadIdx.x;
  if (i < step.actor.size)
    step.actor.adam(i);
  else if (i < step.actor.size + step.critic.size)
    step.critic.adam(i - step.actor.size);
}

}  // namespace

bool fused_gradients_run(int index) {
  int major = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, index));
  int shared = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&shared, cudaDevAttrMaxSharedMemoryPerBlockOptin, index));
  return major >= 8 && shared >= 227 * 1024;
}

int fused_blocks(int index) { return multiprocessors(index); }

int fused_step_blocks(int64_t actor_size, int64_t critic_size) {
  return sum_blocks(actor_size) + sum_blocks(critic_size);
}

void launch_moments(const FusedRows& rows, MinibatchPieces pieces, const float* advantage, double* moments, int index,
                    void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const dim3 blocks(static_cast<unsigned>(pieces.n_pieces), kMomentParts);
  moments_kernel<<<blocks, kMomentThreads, 0, static_cast<cudaStream_t>(stream)>>>(rows, pieces, advantage, moments);
  GIGA_CUDA(cudaGetLastError());
}

void launch_block_sums(const FusedStep& step, float* to, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const auto blocks = static_cast<unsigned>(fused_step_blocks(step.actor.size, step.critic.size));
  block_sums_kernel<<<blocks, dim3(kSumColumns, kSumRows), 0, static_cast<cudaStream_t>(stream)>>>(
      step, sum_blocks(step.actor.size), to);
  GIGA_CUDA(cudaGetLastError());
}

void launch_gradient_sums(const FusedStep& step, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const auto blocks = static_cast<unsigned>(fused_step_blocks(step.actor.size, step.critic.size));
  gradient_sums_kernel<<<blocks, dim3(kSumColumns, kSumRows), 0, static_cast<cudaStream_t>(stream)>>>(
      step, sum_blocks(step.actor.size));
  GIGA_CUDA(cudaGetLastError());
}

void launch_adam(const FusedStep& step, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const int64_t n = step.actor.size + step.critic.size;
  adam_kernel<<<static_cast<unsigned>((n + kAdamThreads - 1) / kAdamThreads), kAdamThreads, 0,
                static_cast<cudaStream_t>(stream)>>>(step);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
