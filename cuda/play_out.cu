// Groups of threads hold some worlds each, as in the kernels of single steps (executor.hpp), and keep a world from its
// first step to its last: networks and scripts move the agents, the world steps, the agents observe. Where a world has
// ended, the next that nobody has begun takes its place, until none is left. The groups of a block keep in step, so that
// they run the same code at the same time: it is more than the caches for instructions hold. Measured on an H200, groups
// that did not wait for each other stood still for it 45 % of the time.
#include <algorithm>

#include "cuda/check.cuh"
#include "cuda/executor.hpp"
#include "cuda/play_out.hpp"
#include "cuda/population_tiles.cuh"
#include "cuda/sync.cuh"
#include "sim/usual_params.hpp"

namespace giga {
namespace {

// Threads of a block at most, and blocks on a multiprocessor: they bound a thread's registers to 128.
template <class P>
constexpr int kPlayThreads = kBlockIsGroup<P> ? kGroupThreads<P> : 16 * kWarp;
template <class P>
constexpr int kPlayBlocks = kBlockIsGroup<P> ? 3 : 1;

constexpr size_t kRoom = 190 << 10;  // bytes of shared memory for the worlds of a block

/// What the agents of a warp have in shared memory while networks move them.
struct ActMemory {
  alignas(16) float head[kTileRows * kLogitStride];
  const float* row[kWarp];  // where the inputs of the agents of one network lie
};

/// Who moves the agent of this thread, found once for the whole game.
struct OwnMover {
  const __half* network = nullptr;
  Scripted script = Scripted::noop;
  bool scripted = false, greedy = false;

  OwnMover() = default;
  __device__ OwnMover(const PlayOut& plan, int team, int64_t world) {
    for (int k = 0; k < plan.n_parts; ++k) {
      const MoverPart& part = plan.part[k];
      if (!part.has(team, world)) continue;
      const Mover mover = part.mover(world);
      if (mover.network >= 0)
        network = reinterpret_cast<const __half*>(part.networks) + mover.network * plan.packed.size;
      script = mover.script;
      scripted = mover.scripted;
      greedy = part.greedy;
    }
  }
};

/// The agent of a thread. Threads without one only keep in step.
struct OwnAgent {
  bool plays;
  int team;
  int64_t row;  // among those of its team
};

__device__ const __half* network_of_lane(const __half* network, int lane) {
  const auto address = reinterpret_cast<unsigned long long>(network);
  return reinterpret_cast<const __half*>(__shfl_sync(0xFFFFFFFFu, address, lane));
}

/// Not inlined: the code of the scripts would take registers from that of the networks.
__device__ __noinline__ void act_by_script(const PlayOut& plan, Scripted script, const OwnAgent& agent) {
  (agent.team == 0 ? plan.team[0] : plan.team[1]).script.act(script, agent.row);
}

/// Moves the agents of a warp that networks move, those of one network at a time.
__device__ void act_by_networks(const PlayOut& plan, const OwnMover& mover, const OwnAgent& agent, ActMemory& memory) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  unsigned left = __ballot_sync(0xFFFFFFFFu, agent.plays && mover.network);
  while (left) {
    const __half* network = network_of_lane(mover.network, __ffs(left) - 1);
    const bool here = (left >> lane & 1u) != 0 && mover.network == network;
    const unsigned mask = __ballot_sync(0xFFFFFFFFu, here);
    left &= ~mask;
    const int count = __popc(mask), rank = __popc(mask & ((1u << lane) - 1u));
    const PlayOut::Team& team = agent.team == 0 ? plan.team[0] : plan.team[1];
    if (here) memory.row[rank] = team.obs + agent.row * team.obs_stride + plan.first_input;
    __syncwarp();
    for (int first = 0; first < count; first += kTileRows) {
      make_heads<1, kNarrow>(
          plan.packed, network, [&](int r) { return first + r < count ? memory.row[first + r] : nullptr; },
          memory.head);
      __syncwarp();
      if (here && rank >= first && rank < first + kTileRows) {
        PopulationAct act = team.act;
        act.greedy = mover.greedy;
        float log_std[kActionSize] = {};
        if (act.actions == ActionKind::continuous)
          for (int k = 0; k < kActionSize; ++k) log_std[k] = __half2float(network[plan.packed.log_std + k]);
        act(agent.row, memory.head + (rank - first) * kLogitStride, log_std);
      }
      __syncwarp();  // the next rows take the same memory
    }
  }
}

template <class P>
__global__ void __launch_bounds__(kPlayThreads<P>, kPlayBlocks<P>)
    play_kernel(const __grid_constant__ LaunchOf<P> k, const __grid_constant__ PlayOut plan, int n_steps,
                int32_t* n_taken) {
  extern __shared__ __align__(16) char shared[];
  __shared__ ActMemory act_memory[kPlayThreads<P> / kWarp];
  __shared__ int32_t taken[kPlayThreads<P> / kNTeams];  // [tiles of the block] the world that each takes
  using Sync = std::conditional_t<kBlockIsGroup<P>, BlockSync, WarpSync>;
  constexpr int kGroup = kGroupThreads<P>;
  const Sync sync{};
  const int n = k.params.n_agents, per_group = kGroup / n, thread = static_cast<int>(threadIdx.x);
  const int tile = thread % kGroup / n, agent_number = thread % kGroup % n, team = k.params.team_of(agent_number);
  const int slots = static_cast<int>(blockDim.x) / kGroup * per_group;
  const int slot = thread / kGroup * per_group + (tile < per_group ? tile : 0);
  char* const block = shared + static_cast<size_t>(slot) * (k.world_bytes / 16 * 16);
  const auto lanes_if = [&](bool wanted) { return TileLanes<Sync>{wanted ? agent_number : INT_MAX, n, sync}; };

  OwnMover mover;
  int world = -1, left = 0;  // the tile's world, and how many steps that may still play
  bool open = tile < per_group, plays = false;
  for (bool first = true;; first = false) {
    const bool vacant = open && !plays;
    if (sync.any(vacant)) {
      const WorldView ended = world_view(k.state, n, max(world, 0));
      copy_world(lanes_if(vacant && world >= 0), k.params, working_copy(ended, block, n), ended);
      if (vacant && agent_number == 0)
        taken[slot] = first ? static_cast<int>(blockIdx.x) * slots + slot
                            : static_cast<int>(gridDim.x) * slots + atomicAdd(n_taken, 1);
      sync.wait();
      if (vacant) {
        open = taken[slot] < k.n_worlds;
        world = open ? taken[slot] : -1;
        left = n_steps;
        mover = OwnMover(plan, team, world);
      }
      const WorldView begun = world_view(k.state, n, max(world, 0));
      copy_world(lanes_if(vacant && open), k.params, begun, working_copy(begun, block, n));
    }
    if (!__syncthreads_or(open)) break;
    const WorldView home = world_view(k.state, n, max(world, 0));
    WorldView w = working_copy(home, block, n);
    attach_scratch(w, k.scratch_layout(), block + working_copy_bytes(n));
    plays = open && left > 0 && *w.phase == Phase::plays;
    const TileLanes<Sync> lanes = lanes_if(plays);

    lanes.wait_delivered();  // the rows of the last observation
    sync.wait();
    const OwnAgent agent{plays, team, team_row(k.params, world, agent_number)};
    if (plan.has_networks) act_by_networks(plan, mover, agent, act_memory[thread / kWarp]);
    if (plays && mover.scripted) act_by_script(plan, mover.script, agent);
    __syncthreads();
    PhiloxDraws draws(k.seed, draw_world(k.first_world, k.draw_period, max(world, 0)), *w.draw_step);
    step_world(lanes, k.params, w, draws, k.io, k.ending, max(world, 0));
    // Actions are drawn by the state in global memory.
    lanes.each(1, [&](int) {
      *home.draw_step = *w.draw_step;
      *home.episode_length = *w.episode_length;
    });
    --left;
    plays = plays && left > 0 && *w.phase == Phase::plays;
  }
  BulkCopies{}.wait_sent();  // before the shared memory goes
}

}  // namespace

void launch_play_out(const LaunchOf<SimParams>& k, const PlayOut& plan, int64_t n_steps, int32_t* n_taken, void* stream) {
  with_usual_params(k.params, [&]<class P>(const P& p) {
    int device = 0, processors = 0, fit = 0;
    GIGA_CUDA(cudaGetDevice(&device));
    GIGA_CUDA(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device));
    const int per_group = kGroupThreads<P> / p.n_agents, groups = (k.n_worlds + per_group - 1) / per_group;
    const size_t group_bytes = static_cast<size_t>(per_group) * (k.world_bytes / 16 * 16);
    // As many groups in a block as there are for each multiprocessor, and as have room.
    const int room = std::max(1, static_cast<int>(kRoom / group_bytes));
    const int in_block = std::clamp((groups + processors - 1) / processors, 1,
                                    std::min(room, kPlayThreads<P> / kGroupThreads<P>));
    const int threads = in_block * kGroupThreads<P>;
    const size_t bytes = static_cast<size_t>(in_block) * group_bytes;
    GIGA_CUDA(cudaFuncSetAttribute(play_kernel<P>, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(bytes)));
    GIGA_CUDA(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&fit, play_kernel<P>, threads, bytes));
    const int blocks = std::min((groups + in_block - 1) / in_block, std::max(fit, 1) * processors);
    const auto on = static_cast<cudaStream_t>(stream);
    GIGA_CUDA(cudaMemsetAsync(n_taken, 0, sizeof *n_taken, on));
    play_kernel<P><<<blocks, threads, bytes, on>>>(k.with(p), plan, static_cast<int>(n_steps), n_taken);
  });
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
