// The CUDA back end: one kernel per job, worlds spread over warps (small teams) or thread blocks as executor.hpp says.
#include "cuda/check.cuh"
#include "cuda/draw.hpp"
#include "cuda/executor.hpp"
#include "cuda/recorded_work.hpp"
#include "cuda/runtime.hpp"
#include "cuda/worlds.cuh"
#include "sim/usual_params.hpp"

namespace giga {
namespace {

// Blocks of TileLanes per multiprocessor, which bounds a thread's registers. With the staged rows of teams of five the
// shared memory holds five blocks, of larger teams four. Measured on an H200, G agent-steps/s of 2 vs 2 at 5 and 6
// blocks: 3.83, 4.30; before, at 5 and 8: 3.45, 3.04. Four blocks of five warps leave a thread 96 registers, five 72.
template <class P>
constexpr int kTileBlocks = kBlockIsGroup<P> ? 4
                            : P::kTeam == 2  ? 6
                            : P::kTeam > 0   ? 5
                                             : 8;

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
__global__ void __launch_bounds__(kTileThreads<P>, kTileBlocks<P>) tile_kernel(const __grid_constant__ LaunchOf<P> k) {
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
    return take_device_stats(state_.view().stats, n_worlds(), partial_, stream_);
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

  std::unique_ptr<RecordedWork> record(size_t most_beside, const std::function<void(Recording&)>& work) override {
    // The default stream cannot be captured.
    return stream_ ? record_work(index_, stream_, most_beside, work) : nullptr;
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
    list_playing_worlds(state_.view().phase, n_worlds(), playing(), n_playing(), stream_);
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
    constexpr bool kStep = job == Job::step;
    const LaunchShape& s = shape(kStep);
    if (s.tiles)
      with_usual_params<kStep>(k.params, [&]<class P>(const P& p) {
        tile_kernel<job, P><<<s.blocks, s.threads, s.shared_bytes, stream_>>>(k.with(p, s));
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
