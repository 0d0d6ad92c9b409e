// The CUDA back end of worlds of many agents (rules 17): one kernel per job, a step may be several; the blocks of a
// world meet at the barriers of a cluster or, where they are more, at one in memory.
#include <algorithm>
#include <optional>
#include <type_traits>

#include "cuda/check.cuh"
#include "cuda/early_launch.cuh"
#include "cuda/grid_executor.hpp"
#include "cuda/recorded_work.hpp"
#include "cuda/runtime.hpp"
#include "cuda/worlds.cuh"

namespace giga {
namespace {

constexpr int kGridBlocks = 1;      // per multiprocessor at least, which bounds a thread's registers to 128
constexpr int kSureClustered = 8;   // blocks of a cluster on every GPU that has clusters
constexpr int kMostClustered = 16;  // where the GPU grants as many

constexpr size_t kMostSorted = 192 << 10;  // bytes that a block sorts for itself

/// Waits for all blocks of a group. A function of its own: there are some seventy barriers in a step, of fifty
/// instructions each where they are part of the kernel, and those that a step takes must fit into the instruction
/// cache.
__device__ __noinline__ void wait_for_group(uint32_t* arrivals, int blocks, bool first, bool clustered) {
  if (blocks == 1) return __syncthreads();
#if __CUDA_ARCH__ >= 900
  if (clustered) {
    asm volatile("barrier.cluster.arrive.release;" ::: "memory");
    asm volatile("barrier.cluster.wait.acquire;" ::: "memory");
    return;
  }
#endif
  // Every block adds 1, the first so much that the highest bit turns when all have; then the rest is 0 again.
  constexpr uint32_t kTurn = 0x80000000u;
  __syncthreads();
  if (threadIdx.x == 0) {
    // Released and acquired: __threadfence() would order more, and takes longer.
    const uint32_t arrival = first ? kTurn - static_cast<uint32_t>(blocks - 1) : 1u;
    uint32_t before, now;
    asm volatile("atom.add.acq_rel.gpu.u32 %0, [%1], %2;" : "=r"(before) : "l"(arrivals), "r"(arrival) : "memory");
    do asm volatile("ld.acquire.gpu.u32 %0, [%1];" : "=r"(now) : "l"(arrivals) : "memory");
    while (((before ^ now) & kTurn) == 0);
  }
  __syncthreads();
}

/// All blocks of a group. What any of them wrote before a barrier, all see behind it.
struct GroupSync {
  uint32_t* arrivals;
  int blocks;
  bool first, clustered;  // first: block of the group
  bool alone = false;     // only those of this block

  __device__ GroupSync of_block() const { return {nullptr, 1, true, false, true}; }
  __device__ void wait_for_warp() const { __syncwarp(); }
  __device__ bool any_of_warp(bool flag) const { return __any_sync(~0u, flag); }
  __device__ void wait() const {
    if (alone) return __syncthreads();
    wait_for_group(arrivals, blocks, first, clustered);
  }
};

/// A thread of a kernel whose blocks are groups, and the barriers of its group.
struct GroupThread {
  ThreadIndex at;
  GroupSync sync;
};
template <class P>
__device__ __forceinline__ GroupThread group_thread(const GridLaunchOf<P>& k, bool clustered) {
  const int block = static_cast<int>(blockIdx.x), group = block / k.blocks;
  return {{block, static_cast<int>(gridDim.x), static_cast<int>(threadIdx.x), kGridThreads},
          {&k.words[group].arrivals, k.blocks, block % k.blocks == 0, clustered}};
}

template <Job job, int kCrew, class P>
__global__ void __launch_bounds__(kGridThreads, kGridBlocks)
    grid_kernel(const __grid_constant__ GridLaunchOf<P> k, bool clustered) {
  const GroupThread thread = group_thread(k, clustered);
  extern __shared__ __align__(16) char shared[];
  run_grid_thread<job, kCrew>(k, thread.at, thread.sync, shared);
}

template <StepPart part, int kCrew, class P>
__global__ void __launch_bounds__(kGridThreads, kGridBlocks)
    part_kernel(const __grid_constant__ GridLaunchOf<P> k, bool clustered) {
  wait_for_last();
  let_next_begin();
  const GroupThread thread = group_thread(k, clustered);
  extern __shared__ __align__(16) char shared[];
  run_grid_part<part, kCrew>(k, thread.at, thread.sync, shared);
}

/// Parts of a step in which no block waits for another of its group: as many threads at a time as registers allow.
constexpr int kFreeThreads = 128, kFewFreeThreads = 64;  // with crews there is less than a block for a multiprocessor
template <int kCrew>
constexpr int free_threads = kCrew > 1 ? kFewFreeThreads : kFreeThreads;
static_assert(kFewFreeThreads == kSumBlock, "a thread for each agent of a block whose rewards a block sees to");
/// Blocks per multiprocessor at least: 70, 80 and 64 registers. With blocks of 256 threads, whose last warp to
/// end holds the registers of all, it is 2 % slower while most live; with eight blocks that look 469 M instead of 482 M
/// (a million agents, one H100). Six of those have 102 KiB of lists: GPUs with less hold five.
constexpr int kFightBlocks = 7, kLookBlocks = 6, kWriteBlocks = 8;
/// Of warps or halves of them that look for an agent each: 128 registers, so that those of 2,000 agents are there at
/// the same time. With 80 it is 47.6 M instead of 49.7 M agent-steps/s, crowded (one H200). Where there are more agents
/// than that, 96: of 20,000 crowded 248 M instead of 241 M with 80; looked for by four lanes, far apart, with policies
/// 275 M instead of 267 M with the 162 that they take else.
constexpr int kSearchBlocks = 8, kFullSearchBlocks = 10;
constexpr int free_blocks(StepPart part, int crew, bool full) {
  if (crew >= kWarp / 2) return full ? kFullSearchBlocks : kSearchBlocks;
  if (crew > 1) return part == StepPart::observe ? kFullSearchBlocks : 1;
  return part == StepPart::fight ? kFightBlocks : part == StepPart::look ? kLookBlocks : kWriteBlocks;
}

template <StepPart part, int kCrew, bool kFull, class P>
__global__ void __launch_bounds__(free_threads<kCrew>, free_blocks(part, kCrew, kFull))
    free_part_kernel(const __grid_constant__ GridLaunchOf<P> k) {
  wait_for_last();
  let_next_begin();
  // Rewards, which the last warps see to, begin first: their sums take long.
  const int block = static_cast<int>(part == StepPart::observe ? gridDim.x - 1 - blockIdx.x : blockIdx.x);
  const ThreadIndex at{block, static_cast<int>(gridDim.x), static_cast<int>(threadIdx.x), free_threads<kCrew>};
  extern __shared__ __align__(16) char shared[];
  run_grid_part<part, kCrew>(k, at, GroupSync{nullptr, 1, true, false, true}, shared);
}

/// Whether a GPU grants what it may refuse.
bool granted(cudaError_t error) {
  if (error != cudaSuccess) cudaGetLastError();
  return error == cudaSuccess;
}

/// What the kernels find room for on a GPU, in worlds of so many agents. One that holds the fewest blocks decides for
/// all.
GridDevice grid_device(int index, int n_agents, int in_parts) {
  GIGA_CUDA(cudaSetDevice(index));
  int processors = 0, major = 0, room = 0, resident = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, index));
  GIGA_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, index));
  GIGA_CUDA(cudaDeviceGetAttribute(&room, cudaDevAttrMaxSharedMemoryPerBlockOptin, index));
  GridDevice device{kGridThreads, 0, major >= 9 ? kMostClustered : 1};
  const size_t stage = grid_stage_bytes(kGridThreads), most = static_cast<size_t>(room);
  device.shared_bytes = most > stage ? std::min(most - stage, kMostSorted) : 0;
  device.in_parts = in_parts;
  if (in_parts > 0 && n_agents >= in_parts) device.shared_bytes = 0;  // as many agents need it; tests ask for few
  const size_t shared = stage + grid_sorted_bytes(n_agents, device);
  const auto look_at = [&]<class P>(void (*kernel)(GridLaunchOf<P>, bool)) {
    int blocks = 0;
    GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                   static_cast<int>(stage + device.shared_bytes)));
    if (device.most_clustered > kSureClustered &&
        !granted(cudaFuncSetAttribute(kernel, cudaFuncAttributeNonPortableClusterSizeAllowed, 1)))
      device.most_clustered = kSureClustered;
    GIGA_CUDA(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel, kGridThreads, shared));
    resident = resident == 0 ? blocks : std::min(resident, blocks);
  };
  look_at(grid_kernel<Job::start, 1, GridParams>);
  look_at(grid_kernel<Job::step, 1, GridParams>);
  look_at(grid_kernel<Job::step, 1, PlainCrowd>);
  look_at(grid_kernel<Job::step, kLanesOfAgent, PlainCrowd>);
  look_at(part_kernel<StepPart::play, kLanesOfAgent, PlainCrowd>);
  look_at(part_kernel<StepPart::play, 1, PlainCrowd>);
  look_at(part_kernel<StepPart::move, 1, GridParams>);
  look_at(part_kernel<StepPart::move, 1, PlainCrowd>);
  look_at(part_kernel<StepPart::settle, 1, GridParams>);
  look_at(part_kernel<StepPart::settle, 1, PlainCrowd>);
  look_at(grid_kernel<Job::restart, 1, GridParams>);
  look_at(grid_kernel<Job::play_on, 1, GridParams>);
  look_at(grid_kernel<Job::observe, 1, GridParams>);
  device.resident = resident * processors;
  for (int k = 1; (1 << k) <= device.most_clustered; ++k) {
    cudaLaunchAttribute attribute{};
    attribute.id = cudaLaunchAttributeClusterDimension;
    attribute.val.clusterDim = {1u << k, 1, 1};
    cudaLaunchConfig_t config{};
    config.gridDim = 1u << k;
    config.blockDim = kGridThreads;
    config.dynamicSmemBytes = shared;
    config.attrs = &attribute;
    config.numAttrs = 1;
    const auto error =
        cudaOccupancyMaxActiveClusters(&device.clusters[k], grid_kernel<Job::step, 1, GridParams>, &config);
    if ((1 << k) <= kSureClustered)
      GIGA_CUDA(error);
    else if (!granted(error) || device.clusters[k] == 0)
      device.most_clustered = kSureClustered;
  }
  return device;
}

class CudaGridSimulator final : public GridLaunchingSimulator {
 public:
  CudaGridSimulator(SimSpec spec, const SimOptions& options, int index, const GridDevice& device, void* stream)
      : GridLaunchingSimulator(std::move(spec), options, cuda_memory(index), device),
        index_(index),
        stream_(static_cast<cudaStream_t>(stream)),
        partial_(memory(), static_cast<size_t>(kStatBlocks) * kNStatRows) {}

  bool over() override { return n_lists() > kListsLater && counts_.at(n_lists() - 1 - kListsLater) == 0; }

  EpisodeStats take_stats() override {
    GIGA_CUDA(cudaSetDevice(index_));
    const EpisodeStats stats = take_device_stats(state_.view().stats, n_worlds(), partial_, stream_);
    check_full_lists();
    return stats;
  }

  bool step_lets_next_begin() const override { return launches() != StepLaunches::one; }

  void synchronize() override {
    GIGA_CUDA(cudaSetDevice(index_));
    GIGA_CUDA(cudaStreamSynchronize(stream_));
    check_full_lists();
  }

  std::unique_ptr<RecordedWork> record(size_t most_beside, const std::function<void(Recording&)>& work) override {
    // The default stream cannot be captured.
    return stream_ ? record_work(index_, stream_, most_beside, work) : nullptr;
  }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    GIGA_CUDA(cudaSetDevice(index_));
    const GridLaunch k = launch_of(io, worlds);
    for (const Job job : jobs)
      with_job(job, [&](auto constant) {
        constexpr Job kJob = decltype(constant)::value;
        if constexpr (kJob == Job::step)
          with_plain_crowd(k, lanes_of_agent(), [&]<class P>(const GridLaunchOf<P>& plain, auto lanes) {
            if (launches() != StepLaunches::one)
              step_in_parts<decltype(lanes)::value>(plain);
            else
              launch(grid_kernel<kJob, decltype(lanes)::value, P>, plain);
          });
        else if constexpr (kJob != Job::draw && kJob != Job::draw_final)
          launch(grid_kernel<kJob, 1, GridParams>, k);
      });
  }

  void list_playing() override {
    GIGA_CUDA(cudaSetDevice(index_));
    list_playing_worlds(state_.view().phase, n_worlds(), options().draw_period, playing(), n_playing(), stream_);
    counts_.record(n_lists(), n_playing(), stream_);
  }

 private:
  template <int kCrew, class P>
  void step_in_parts(const GridLaunchOf<P>& k) {
    for_launches<kCrew>(
        k, [&]<StepPart part>() { launch(part_kernel<part, kCrew, P>, k, true); },
        [&]<StepPart part, int kLanes, bool kFull>(const GridLaunchOf<P>& of, int threads_of_agent, int more) {
          constexpr int kThreads = free_threads<kLanes>;
          const GridLaunchOf<P> all = free_part_launch(of, kThreads, threads_of_agent, more);
          launch_kernel(free_part_kernel<part, kLanes, kFull, P>, true, static_cast<unsigned>(all.groups * all.blocks),
                        kThreads, free_part_bytes(part, kLanes, kThreads), stream_, {}, all);
        });
  }

  template <class P>
  void launch(void (*kernel)(GridLaunchOf<P>, bool), const GridLaunchOf<P>& k, bool early = false) {
    launch_kernel(kernel, early, static_cast<unsigned>(shape().groups * shape().blocks), kGridThreads, shared_bytes(),
                  stream_, together(), k, shape().clustered);
  }

  /// The blocks of a group at the same time.
  std::optional<cudaLaunchAttribute> together() const {
    if (shape().blocks == 1) return {};
    cudaLaunchAttribute attribute{};
    if (shape().clustered) {
      attribute.id = cudaLaunchAttributeClusterDimension;
      attribute.val.clusterDim = {static_cast<unsigned>(shape().blocks), 1, 1};
    } else {
      attribute.id = cudaLaunchAttributeCooperative;  // or an error
      attribute.val.cooperative = 1;
    }
    return attribute;
  }

  int index_;
  cudaStream_t stream_;
  Buffer<double> partial_;
  RecentCounts counts_;  // of the worlds that play, at the last lists
};

}  // namespace

std::unique_ptr<Simulator> make_cuda_grid_simulator(SimSpec spec, const SimOptions& options, int index, void* stream,
                                                    int in_parts) {
  GIGA_CHECK(index >= 0 && index < cuda_device_count(), "no GPU ", index);
  const GridDevice device = grid_device(index, spec.params.n_agents, in_parts);
  return std::make_unique<CudaGridSimulator>(std::move(spec), options, index, device, stream);
}

}  // namespace giga
