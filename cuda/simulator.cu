// The CUDA back end: one kernel per step, worlds spread over warps (small teams) or thread blocks.
#include <climits>

#include "cuda/check.cuh"
#include "cuda/lanes.cuh"
#include "cuda/runtime.hpp"
#include "cuda/scratch.hpp"
#include "sim/draws.hpp"
#include "sim/step.hpp"

namespace giga {
namespace {

constexpr int kWarp = 32;
constexpr int kTileWarps = 4;  // warps of a block of TileLanes
// Blocks of TileLanes per multiprocessor: 8 holds a thread to 64 registers, and hiding latency is worth the few spills.
// Measured on an H200, G agent-steps/s at 4, 5, 6 and 8 blocks: 2 vs 2 1.61, 1.79, 1.85, 1.89; 5 vs 5 0.72, 0.77, 0.82,
// 0.86.
constexpr int kTileBlocks = 8;
constexpr int kMaxBlockThreads = 512;  // threads of a block of BlockLanes

constexpr int kWorldsAlone = 1024;  // playing worlds up to which each has a warp for itself

// Steps after which the list of the worlds that still play is made anew (OnDone::freeze).
constexpr int kStepsPerList = 8;
// Lists after which the host looks how many worlds were on one: work enough that the device does not wait for it.
constexpr int64_t kListsLater = 2;

enum class Job { start, step, restart, play_on, observe };

/// Arguments of the kernel, by value.
struct Launch {
  SimParams params;
  StateView state;
  StepIo io;
  ScratchLayout layout;
  size_t copy_bytes;  // working copy of the agents' state, in front of a world's scratch in shared memory
  char* scratch;      // [W, layout.size]; null = shared memory, with the working copy
  uint64_t seed;
  int64_t first_world, draw_period;
  int n_worlds;
  OnDone on_done;
  int episodes;              // that a world plays, OnDone::freeze
  const int32_t* playing;    // [n_playing] the worlds to work on; null = all
  const int32_t* n_playing;  // [1]

  __device__ int count() const { return playing ? *n_playing : n_worlds; }
  __device__ int world(int k) const { return playing ? playing[k] : k; }
};

/// Points the agents' state to shared memory; `copy` moves it there or back.
__device__ WorldView working_copy(const WorldView& home, char* block, int n) {
  WorldView w = home;
  float* floats = reinterpret_cast<float*>(block);
  w.x = floats;
  w.y = floats + n;
  w.z = floats + 2 * n;
  w.v = floats + 3 * n;
  w.heading = floats + 4 * n;
  w.health = floats + 5 * n;
  w.tracked = reinterpret_cast<uint8_t*>(floats + 6 * n);
  w.alive = w.tracked + n * n;
  return w;
}
template <class Lanes>
__device__ void copy_agents(const Lanes& lanes, const WorldView& from, const WorldView& to, int n) {
  lanes.each(n, [&](int i) {
    to.x[i] = from.x[i];
    to.y[i] = from.y[i];
    to.z[i] = from.z[i];
    to.v[i] = from.v[i];
    to.heading[i] = from.heading[i];
    to.health[i] = from.health[i];
    to.alive[i] = from.alive[i];
  });
  if (n % 2 == 0)  // whole words
    lanes.each(n * n / 4, [&](int k) {
      reinterpret_cast<uint32_t*>(to.tracked)[k] = reinterpret_cast<const uint32_t*>(from.tracked)[k];
    });
  else
    lanes.each(n * n, [&](int k) { to.tracked[k] = from.tracked[k]; });
}

/// Runs the job for one world. `shared` = this world's block of shared memory; a template parameter says whether it is
/// used, so that the compiler knows which memory its pointers mean.
template <Job job, bool in_shared, class Lanes>
__device__ void run_world(const Lanes& lanes, const Launch& k, int world, char* shared) {
  const WorldView home = world_view(k.state, k.params, world);
  if ((job == Job::restart || job == Job::play_on) && !to_settle(lanes, home)) return;
  WorldView w = home;
  if constexpr (in_shared) {
    w = working_copy(home, shared, k.params.n_agents);
    attach_scratch(w, k.layout, shared + k.copy_bytes);
    copy_agents(lanes, home, w, k.params.n_agents);
  } else {
    attach_scratch(w, k.layout, k.scratch + static_cast<size_t>(world) * k.layout.size);
  }
  const auto draws_at = [&](uint32_t step) {
    return PhiloxDraws(k.seed, draw_world(k.first_world, k.draw_period, world), step);
  };
  if (job == Job::play_on) play_on(lanes, k.params, w, draws_at, k.io, world, k.episodes);
  // The step has counted itself already when an episode follows it.
  PhiloxDraws draws = draws_at(*w.draw_step - (job == Job::restart ? 1 : 0));
  if (job == Job::step) {
    step_world(lanes, k.params, w, draws, k.io, k.on_done, world);
    if (k.on_done == OnDone::freeze && k.episodes == 1 && to_settle(lanes, w))
      freeze_world(lanes, k.params, w, k.io, world);
  }
  if (job == Job::restart) restart_world(lanes, k.params, w, draws, k.io, world);
  if (job == Job::start) start_world(lanes, k.params, w, draws, k.io, world);
  if (job == Job::observe) write_observations(lanes, k.params, w, k.io, world);
  if constexpr (in_shared) copy_agents(lanes, w, home, k.params.n_agents);
}

template <Job job>
__global__ void __launch_bounds__(kTileWarps* kWarp, kTileBlocks) tile_kernel(const __grid_constant__ Launch k) {
  extern __shared__ char shared[];
  const int n = k.params.n_agents, count = k.count();
  // Few worlds take as long as one does: a warp for each is faster then.
  const bool alone = k.playing && count <= kWorldsAlone && count <= static_cast<int>(gridDim.x) * kTileWarps;
  const int width = alone ? kWarp : n, per_warp = kWarp / width;
  const int lane = threadIdx.x % kWarp, warp = threadIdx.x / kWarp;
  const int tile = lane / width;
  const int slot = warp * per_warp + (tile < per_warp ? tile : 0);
  const int at = blockIdx.x * (kTileWarps * per_warp) + slot;
  if (static_cast<int>(blockIdx.x) * (kTileWarps * per_warp) >= count) return;
  const bool idle = tile >= per_warp || at >= count;
  const TileLanes lanes{idle ? INT_MAX : lane % width, width};
  // An idle thread looks at some world of the launch, so that it can keep in step.
  run_world<job, true>(lanes, k, k.world(at < count ? at : count - 1), shared + slot * (k.copy_bytes + k.layout.size));
}

template <Job job, bool in_shared>
__global__ void __launch_bounds__(kMaxBlockThreads) block_kernel(const __grid_constant__ Launch k) {
  extern __shared__ char shared[];
  const BlockLanes lanes{static_cast<int>(threadIdx.x), static_cast<int>(blockDim.x)};
  if (static_cast<int>(blockIdx.x) >= k.count()) return;
  run_world<job, in_shared>(lanes, k, k.world(static_cast<int>(blockIdx.x)), shared);
}

// Lists the worlds that play, in any order: worlds do not depend on each other. `count` starts at 0.
__global__ void list_playing(const Phase* phase, int n_worlds, int32_t* playing, int32_t* count) {
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

class CudaSimulator final : public Simulator {
 public:
  CudaSimulator(SimSpec spec, const SimOptions& options, int index, void* stream)
      : Simulator(std::move(spec), options, cuda_memory(index)),
        index_(index),
        stream_(static_cast<cudaStream_t>(stream)),
        layout_(params()),
        partial_(memory(), static_cast<size_t>(kStatBlocks) * kNStatRows) {
    const int n = params().n_agents;
    per_world_ = shared_bytes(params());
    tiles_ = n <= kWarp && per_world_ * static_cast<size_t>(kTileWarps * (kWarp / n)) <= kSharedLimit;
    scratch_ = Buffer<char>(memory(), global_scratch_bytes(params(), options.n_worlds));
    if (options.on_done == OnDone::freeze) playing_ = Buffer<int32_t>(memory(), static_cast<size_t>(n_worlds()) + 1);
  }

  void start(const StepIo& io) override {
    launch<Job::start>(io, false);
    steps_ = lists_ = 0;
  }
  void step(const StepIo& io) override {
    // Worlds that wait have nothing to write but reward and done; where nobody wants these, they are left out.
    const bool listed = playing_.data() && !io.done && !io.team[0].reward && !io.team[1].reward;
    if (listed && steps_++ % kStepsPerList == 0) list_worlds();
    launch<Job::step>(io, listed);
    if (options_.on_done == OnDone::reset) launch<Job::restart>(io, false);
    if (options_.on_done == OnDone::freeze && options_.episodes > 1) launch<Job::play_on>(io, listed);
  }
  void observe(const StepIo& io) override { launch<Job::observe>(io, false); }

  bool over() override { return lists_ > kListsLater && counts_.at(lists_ - 1 - kListsLater) == 0; }

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

  void synchronize() override {
    GIGA_CUDA(cudaSetDevice(index_));
    GIGA_CUDA(cudaStreamSynchronize(stream_));
  }

 private:
  void list_worlds() {
    GIGA_CUDA(cudaSetDevice(index_));
    constexpr int kThreads = 256;
    int32_t* count = playing_.data() + n_worlds();
    GIGA_CUDA(cudaMemsetAsync(count, 0, sizeof *count, stream_));
    list_playing<<<(n_worlds() + kThreads - 1) / kThreads, kThreads, 0, stream_>>>(state_.view().phase, n_worlds(),
                                                                                   playing_.data(), count);
    GIGA_CUDA(cudaGetLastError());
    counts_.record(lists_++, count, stream_);
  }

  template <Job job>
  void launch(const StepIo& io, bool listed) {
    GIGA_CUDA(cudaSetDevice(index_));
    const int n = params().n_agents;
    const Launch k{params(),
                   state_.view(),
                   io,
                   layout_,
                   working_copy_bytes(n),
                   scratch_.data(),
                   options_.seed,
                   options_.first_world,
                   options_.draw_period,
                   options_.n_worlds,
                   options_.on_done,
                   options_.episodes,
                   listed ? playing_.data() : nullptr,
                   listed ? playing_.data() + n_worlds() : nullptr};
    if (tiles_) {
      const int worlds = kTileWarps * (kWarp / n);
      const int blocks = (n_worlds() + worlds - 1) / worlds;
      tile_kernel<job><<<blocks, kTileWarps * kWarp, per_world_* static_cast<size_t>(worlds), stream_>>>(k);
    } else {
      const int threads = std::min((n + kWarp - 1) / kWarp * kWarp, kMaxBlockThreads);
      if (scratch_.data())
        block_kernel<job, false><<<n_worlds(), threads, 0, stream_>>>(k);
      else
        block_kernel<job, true><<<n_worlds(), threads, per_world_, stream_>>>(k);
    }
    GIGA_CUDA(cudaGetLastError());
  }

  int index_;
  cudaStream_t stream_;
  ScratchLayout layout_;
  size_t per_world_ = 0;  // bytes of shared memory per world
  bool tiles_ = false;
  Buffer<char> scratch_;
  Buffer<double> partial_;
  Buffer<int32_t> playing_;        // [W + 1] OnDone::freeze: worlds that play, then their number
  int64_t steps_ = 0, lists_ = 0;  // since the start
  RecentCounts counts_;            // of the worlds that play, at the last lists
};

}  // namespace

std::unique_ptr<Simulator> make_cuda_simulator(SimSpec spec, const SimOptions& options, int index, void* stream) {
  GIGA_CHECK(index >= 0 && index < cuda_device_count(), "no GPU ", index);
  return std::make_unique<CudaSimulator>(std::move(spec), options, index, stream);
}

}  // namespace giga
