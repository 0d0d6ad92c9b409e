// The CUDA back end: one kernel per job, worlds spread over warps (small teams) or thread blocks as executor.hpp says.
#include "cuda/check.cuh"
#include "cuda/draw.hpp"
#include "cuda/executor.hpp"
#include "cuda/recorded_work.hpp"
#include "cuda/runtime.hpp"
#include "cuda/step_kernel.hpp"
#include "cuda/tile_kernel.cuh"
#include "cuda/worlds.cuh"
#include "sim/usual_params.hpp"

namespace giga {
namespace {

template <Job job, class P>
__global__ void __launch_bounds__(kTileThreads<P>, kTileBlocks<P>) tile_kernel(const __grid_constant__ LaunchOf<P> k) {
  extern __shared__ __align__(16) char shared[];
  run_tile_thread<job>(k, this_thread(), shared, TileSync<P>{});
}

template <Job job, bool in_shared>
__global__ void __launch_bounds__(kMaxBlockThreads) block_kernel(const __grid_constant__ Launch k) {
  extern __shared__ __align__(16) char shared[];
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
        partial_(memory(), static_cast<size_t>(kStatBlocks) * kNStatRows) {
    GIGA_CUDA(cudaSetDevice(index_));
    choose_step();
  }

  std::string step_way() const override { return step_way_; }
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
    list_playing_worlds(state_.view().phase, n_worlds(), options().draw_period, playing(), n_playing(), stream_);
    counts_.record(n_lists(), n_playing(), stream_);
  }

 private:
  /// Decides by which kernel worlds step.
  void choose_step() {
    bool usual = false;
    with_usual_params<true>(params(), [&]<class P>(const P&) { usual = P::kTeam > 0 && shape(true).tiles; });
    if (shape(true).shared_bytes > kSharedLimit)
      with_usual_params<true>(params(), []<class P>(const P&) {
        GIGA_CUDA(cudaFuncSetAttribute(tile_kernel<Job::step, P>, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                       static_cast<int>(kStepSharedLimit)));
      });
    const bool compiles =
        options_.compile_step == CompileStep::always || (options_.compile_step == CompileStep::automatic && !usual);
    std::string report = "none was to be compiled for this scenario";
    if (compiles) step_kernel_ = StepKernel::make(params(), n_worlds(), index_, report);
    if (step_kernel_)
      step_way_ = cat("a kernel for this scenario (", report, ")");
    else if (usual)
      step_way_ = compiles ? cat("a kernel for usual scenarios (", report, ")") : "a kernel for usual scenarios";
    else
      step_way_ = cat("the general kernel (", report, ")");
  }

  template <Job job>
  void draw(const Launch& k) {
    const DrawShape s = draw_shape(params(), n_worlds());
    draw_kernel<job><<<s.blocks, kDrawThreads, s.shared_bytes, stream_>>>(k, s);
    GIGA_CUDA(cudaGetLastError());
  }

  template <Job job>
  void launch(const Launch& k) {
    constexpr bool kStep = job == Job::step;
    if (kStep && step_kernel_) return step_kernel_->launch(k, stream_);
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
  std::unique_ptr<StepKernel> step_kernel_;  // null: one of those below
  std::string step_way_;
  Buffer<double> partial_;
  RecentCounts counts_;  // of the worlds that play, at the last lists
};

}  // namespace

std::unique_ptr<Simulator> make_cuda_simulator(SimSpec spec, const SimOptions& options, int index, void* stream) {
  GIGA_CHECK(index >= 0 && index < cuda_device_count(), "no GPU ", index);
  return std::make_unique<CudaSimulator>(std::move(spec), options, index, stream);
}

}  // namespace giga
