// The CUDA back end: one kernel per job, worlds spread over warps (small teams) or thread blocks as executor.hpp says.
#include "cuda/check.cuh"
#include "cuda/draw.hpp"
#include "cuda/executor.hpp"
#include "cuda/runtime.hpp"
#include "sim/usual_params.hpp"

namespace giga {
namespace {

// Blocks of TileLanes per multiprocessor, which bounds a thread's registers. With the staged rows of teams of five the
// shared memory holds five blocks. Measured on an H200, G agent-steps/s of 2 vs 2 at 5 and 8 blocks: 3.45, 3.04.
template <class P>
constexpr int kTileBlocks = kBlockIsGroup<P> ? 4 : P::kTeam == 2 ? 6 : P::kTeam > 0 ? 5 : 8;

// After so many lists the host looks how many worlds one had: enough work that the device does not wait for it.
constexpr int64_t kListsLater = 2;

// Bulk copies of the tensor memory accelerator, compute capability 9.0 and later.
struct BulkCopies {
#if __CUDA_ARCH__ >= 900
  __device__ void before_sending() const { asm volatile("fence.proxy.async.shared::cta;" ::: "memory"); }
  __device__ void send(float* to, const float* from, int count) const {
    asm volatile("cp.async.bulk.global.shared::cta.bulk_group [%0], [%1], %2;" ::"l"(__cvta_generic_to_global(to)),
                 "r"(static_cast<uint32_t>(__cvta_generic_to_shared(from))),
                 "r"(count * static_cast<int>(sizeof(float)))
                 : "memory");
    asm volatile("cp.async.bulk.commit_group;" ::: "memory");
  }
  __device__ void wait_sent() const { asm volatile("cp.async.bulk.wait_group.read 0;" ::: "memory"); }
  __device__ void wait_delivered() const {
    asm volatile("cp.async.bulk.wait_group 0;" ::: "memory");
    asm volatile("fence.proxy.async.global;" ::: "memory");
  }
#else
  __device__ void before_sending() const {}
  __device__ void send(float* to, const float* from, int count) const {
    for (int k = 0; k < count; k += 4) *reinterpret_cast<float4*>(to + k) = *reinterpret_cast<const float4*>(from + k);
  }
  __device__ void wait_sent() const {}
  __device__ void wait_delivered() const {}
#endif
};
struct WarpSync : BulkCopies {
  __device__ void wait() const { __syncwarp(); }
  __device__ bool any(bool flag) const { return __any_sync(0xFFFFFFFFu, flag); }
};
struct BlockSync : BulkCopies {
  __device__ void wait() const { __syncthreads(); }
  __device__ bool any(bool flag) const { return __syncthreads_or(flag); }
};

__device__ ThreadIndex this_thread() {
  return {static_cast<int>(blockIdx.x), static_cast<int>(gridDim.x), static_cast<int>(threadIdx.x),
          static_cast<int>(blockDim.x)};
}

template <Job job, class P>
__global__ void __launch_bounds__(kTileThreads<P>, kTileBlocks<P>)
    tile_kernel(const __grid_constant__ LaunchOf<P> k) {
  extern __shared__ __align__(16) char shared[];
  run_tile_thread<job>(k, this_thread(), shared, std::conditional_t<kBlockIsGroup<P>, BlockSync, WarpSync>{});
}

template <Job job, bool in_shared>
__global__ void __launch_bounds__(kMaxBlockThreads) block_kernel(const __grid_constant__ Launch k) {
  extern __shared__ char shared[];
  run_block_thread<job, in_shared>(k, this_thread(), shared, BlockSync{});
}

template <Job job>
__global__ void __launch_bounds__(kDrawThreads) draw_kernel(const __grid_constant__ Launch k, DrawShape shape) {
  extern __shared__ __align__(16) char strip[];
  run_draw_thread<job>(k, shape, this_thread(), strip, BlockSync{});
}

__global__ void __launch_bounds__(kDrawThreads)
    redraw_kernel(const __grid_constant__ SimParams p, Redraw request, DrawShape shape) {
  extern __shared__ __align__(16) char strip[];
  run_redraw_thread(p, request, shape, this_thread(), strip, BlockSync{});
}

// Lists the worlds that play, in any order: worlds do not depend on each other. `count` starts at 0.
__global__ void list_worlds(const Phase* phase, int n_worlds, int32_t* playing, int32_t* count) {
  const int world = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
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

class CudaSimulator final : public LaunchingSimulator {
 public:
  CudaSimulator(SimSpec spec, const SimOptions& options, int index, void* stream)
      : LaunchingSimulator(std::move(spec), options, cuda_memory(index)),
        index_(index),
        stream_(static_cast<cudaStream_t>(stream)),
        partial_(memory(), static_cast<size_t>(kStatBlocks) * kNStatRows) {}

  bool over() override { return n_lists() > kListsLater && counts_.at(n_lists() - 1 - kListsLater) == 0; }

  EpisodeStats take_stats() override {
    GIGA_CUDA(cudaSetDevice(index_));
    sum_stats<<<dim3(kStatBlocks, kStatRowBlocks), dim3(kWarp, kStatY), 0, stream_>>>(state_.view().stats, n_worlds(),
                                                                                      partial_.data());
    GIGA_CUDA(cudaGetLastError());
    GIGA_CUDA(cudaStreamSynchronize(stream_));
    const std::vector<double> partial = partial_.to_host();
    EpisodeStats stats;
    for (int b = 0; b < kStatBlocks; ++b)
      for (size_t row = 0; row < kNStatRows; ++row)
        stats.rows[row] += partial[static_cast<size_t>(b) * kNStatRows + row];
    return stats;
  }

  void redraw(const Redraw& request) override {
    if (request.count == 0) return;
    GIGA_CUDA(cudaSetDevice(index_));
    const DrawShape s = redraw_shape(params(), request);
    redraw_kernel<<<s.blocks, kDrawThreads, s.shared_bytes, stream_>>>(params(), request, s);
    GIGA_CUDA(cudaGetLastError());
  }

  void synchronize() override {
    GIGA_CUDA(cudaSetDevice(index_));
    GIGA_CUDA(cudaStreamSynchronize(stream_));
  }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    GIGA_CUDA(cudaSetDevice(index_));
    const Launch k = launch_of(io, worlds);
    for (const Job job : jobs)
      with_job(job, [&](auto constant) {
        constexpr Job kJob = decltype(constant)::value;
        if constexpr (kJob == Job::draw || kJob == Job::draw_final)
          draw<kJob>(k);
        else
          launch<kJob>(k);
      });
  }

  void list_playing() override {
    GIGA_CUDA(cudaSetDevice(index_));
    constexpr int kThreads = 256;
    GIGA_CUDA(cudaMemsetAsync(n_playing(), 0, sizeof(int32_t), stream_));
    list_worlds<<<(n_worlds() + kThreads - 1) / kThreads, kThreads, 0, stream_>>>(state_.view().phase, n_worlds(),
                                                                                  playing(), n_playing());
    GIGA_CUDA(cudaGetLastError());
    counts_.record(n_lists(), n_playing(), stream_);
  }

 private:
  template <Job job>
  void draw(const Launch& k) {
    const DrawShape s = draw_shape(params(), n_worlds());
    draw_kernel<job><<<s.blocks, kDrawThreads, s.shared_bytes, stream_>>>(k, s);
    GIGA_CUDA(cudaGetLastError());
  }

  template <Job job>
  void launch(const Launch& k) {
    const LaunchShape& s = shape();
    if (s.tiles)
      with_usual_params(k.params, [&]<class P>(const P& p) {
        tile_kernel<job, P><<<s.blocks, s.threads, s.shared_bytes, stream_>>>(k.with(p));
      });
    else if (s.in_shared)
      block_kernel<job, true><<<s.blocks, s.threads, s.shared_bytes, stream_>>>(k);
    else
      block_kernel<job, false><<<s.blocks, s.threads, 0, stream_>>>(k);
    GIGA_CUDA(cudaGetLastError());
  }

  int index_;
  cudaStream_t stream_;
  Buffer<double> partial_;
  RecentCounts counts_;  // of the worlds that play, at the last lists
};

}  // namespace

std::unique_ptr<Simulator> make_cuda_simulator(SimSpec spec, const SimOptions& options, int index, void* stream) {
  GIGA_CHECK(index >= 0 && index < cuda_device_count(), "no GPU ", index);
  return std::make_unique<CudaSimulator>(std::move(spec), options, index, stream);
}

}  // namespace giga
