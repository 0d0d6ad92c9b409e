// What the simulators of a GPU do with all their worlds, whatever steps them: listing those that play, statistics.
// Kernels of each file that includes this.
#pragma once

#include <vector>

#include "cuda/check.cuh"
#include "cuda/executor.hpp"

namespace giga {
namespace {

// After so many lists the host looks how many worlds one had: enough work that the device does not wait for it.
constexpr int64_t kListsLater = 2;

// Lists the worlds that play, in any order: worlds do not depend on each other. `count` starts at 0. Those that draw
// the same numbers, which are `period` apart (0: none), come one behind the other: they begin alike, and those of a
// population meet the same opponent, so that threads side by side do much the same.
__global__ void list_worlds(const Phase* phase, int n_worlds, int period, int32_t* playing, int32_t* count) {
  const int at = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x), alike = period > 0 ? n_worlds / period : 0;
  const int world = at < alike * period ? at % alike * period + at / alike : at;
  const bool plays = world < n_worlds && phase[world] == Phase::plays;
  const unsigned mask = __ballot_sync(0xFFFFFFFFu, plays);
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  int first = 0;
  if (lane == 0 && mask) first = atomicAdd(count, __popc(mask));
  first = __shfl_sync(0xFFFFFFFFu, first, 0);
  if (plays) playing[first + __popc(mask & ((1u << lane) - 1u))] = world;
}

// Sums the statistics of a slice of worlds per block and clears them: threads [worlds y][rows x], blocks [slices x][32
// rows y].
constexpr int kStatBlocks = 64, kStatY = 1024 / kWarp, kStatRowBlocks = (kNStatRows + kWarp - 1) / kWarp;
__global__ void sum_stats(float* stats, int n_worlds, double* partial) {  // partial [kStatBlocks, kNStatRows]
  __shared__ double sums[kStatY][kWarp];
  const int row = blockIdx.y * kWarp + threadIdx.x;
  const int end = row < kNStatRows ? n_worlds : 0;  // a thread beyond the rows only keeps in step
  double sum = 0;
  for (int w = blockIdx.x * kStatY + threadIdx.y; w < end; w += kStatBlocks * kStatY) {
    sum += static_cast<double>(stats[static_cast<int64_t>(w) * kNStatRows + row]);
    stats[static_cast<int64_t>(w) * kNStatRows + row] = 0;
  }
  sums[threadIdx.y][threadIdx.x] = sum;
  __syncthreads();
  if (threadIdx.y == 0 && row < kNStatRows) {
    for (int y = 1; y < kStatY; ++y) sum += sums[y][threadIdx.x];
    partial[blockIdx.x * kNStatRows + row] = sum;
  }
}

/// Numbers that the device counts, read by the host some counts later, when it need not wait for long.
class RecentCounts {
 public:
  RecentCounts() = default;
  RecentCounts(const RecentCounts&) = delete;
  RecentCounts& operator=(const RecentCounts&) = delete;
  ~RecentCounts() {
    for (cudaEvent_t event : done_)
      if (event) cudaEventDestroy(event);
    if (count_) cudaFreeHost(count_);
  }
  /// Queues the reading of count k.
  void record(int64_t k, const int32_t* count, cudaStream_t stream) {
    if (!count_) {
      GIGA_CUDA(cudaMallocHost(&count_, kSlots * sizeof *count_));
      for (cudaEvent_t& event : done_) GIGA_CUDA(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
    }
    GIGA_CUDA(cudaMemcpyAsync(count_ + k % kSlots, count, sizeof *count_, cudaMemcpyDeviceToHost, stream));
    GIGA_CUDA(cudaEventRecord(done_[k % kSlots], stream));
  }
  /// Count k, one of the last kSlots; waits until it is read.
  int32_t at(int64_t k) const {
    GIGA_CUDA(cudaEventSynchronize(done_[k % kSlots]));
    return count_[k % kSlots];
  }

 private:
  static constexpr int64_t kSlots = kListsLater + 1;
  int32_t* count_ = nullptr;  // [kSlots] of the host
  cudaEvent_t done_[kSlots] = {};
};

/// Queues a list of the worlds that play, [W], and their number.
void list_playing_worlds(const Phase* phase, int n_worlds, int64_t period, int32_t* playing, int32_t* count,
                         cudaStream_t stream) {
  constexpr int kThreads = 256;
  GIGA_CUDA(cudaMemsetAsync(count, 0, sizeof(int32_t), stream));
  list_worlds<<<(n_worlds + kThreads - 1) / kThreads, kThreads, 0, stream>>>(phase, n_worlds, static_cast<int>(period),
                                                                             playing, count);
  GIGA_CUDA(cudaGetLastError());
}

/// Reads the statistics and clears them; waits for the stream. `partial`: [kStatBlocks, kNStatRows].
EpisodeStats take_device_stats(float* stats, int n_worlds, const Buffer<double>& partial, cudaStream_t stream) {
  sum_stats<<<dim3(kStatBlocks, kStatRowBlocks), dim3(kWarp, kStatY), 0, stream>>>(stats, n_worlds, partial.data());
  GIGA_CUDA(cudaGetLastError());
  GIGA_CUDA(cudaStreamSynchronize(stream));
  const std::vector<double> sums = partial.to_host();
  EpisodeStats total;
  for (int b = 0; b < kStatBlocks; ++b)
    for (size_t row = 0; row < kNStatRows; ++row) total.rows[row] += sums[static_cast<size_t>(b) * kNStatRows + row];
  return total;
}

}  // namespace
}  // namespace giga
