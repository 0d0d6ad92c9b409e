// A group of threads has some worlds, as in the kernels of single steps (executor.hpp), and keeps them from the first
// step to the last: networks and scripts move the agents, the worlds step, the agents observe. Groups do not wait for
// each other; one whose worlds have all ended makes room for the next.
#include "cuda/check.cuh"
#include "cuda/executor.hpp"
#include "cuda/play_out.hpp"
#include "cuda/population_tiles.cuh"
#include "cuda/sync.cuh"
#include "sim/usual_params.hpp"

namespace giga {
namespace {

// Groups on a multiprocessor, which bounds a thread's registers to 128.
template <class P>
constexpr int kPlayGroups = kBlockIsGroup<P> ? 3 : 16;

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
__global__ void __launch_bounds__(kGroupThreads<P>, kPlayGroups<P>)
    play_kernel(const __grid_constant__ LaunchOf<P> k, const __grid_constant__ PlayOut plan, int n_steps) {
  extern __shared__ __align__(16) char shared[];
  __shared__ ActMemory act_memory[kGroupThreads<P> / kWarp];
  using Sync = std::conditional_t<kBlockIsGroup<P>, BlockSync, WarpSync>;
  const Sync sync{};
  const int n = k.params.n_agents, per_group = kGroupThreads<P> / n, thread = static_cast<int>(threadIdx.x);
  const int tile = thread / n, agent_number = thread % n, slot = tile < per_group ? tile : 0;
  const int index = static_cast<int>(blockIdx.x) * per_group + slot;
  const bool idle = tile >= per_group || index >= k.n_worlds;
  const int world = min(index, k.n_worlds - 1);
  const TileLanes<Sync> lanes{idle ? INT_MAX : agent_number, n, sync};

  char* const block = shared + static_cast<size_t>(slot) * (k.world_bytes / 16 * 16);
  const WorldView home = world_view(k.state, n, world);
  WorldView w = working_copy(home, block, n);
  attach_scratch(w, k.scratch_layout(), block + working_copy_bytes(n));
  copy_world(lanes, k.params, home, w);

  const int team = k.params.team_of(agent_number);
  const OwnMover mover(plan, team, world);
  OwnAgent agent{false, team, team_row(k.params, world, agent_number)};
  for (int step = 0; step < n_steps; ++step) {
    agent.plays = !idle && *w.phase == Phase::plays;
    if (!sync.any(agent.plays)) break;
    lanes.wait_delivered();  // the rows of the last observation
    sync.wait();
    if (plan.has_networks) act_by_networks(plan, mover, agent, act_memory[thread / kWarp]);
    if (agent.plays && mover.scripted) act_by_script(plan, mover.script, agent);
    sync.wait();
    PhiloxDraws draws(k.seed, draw_world(k.first_world, k.draw_period, world), *w.draw_step);
    step_world(lanes, k.params, w, draws, k.io, k.ending, world);
    // Actions are drawn by the state in global memory.
    lanes.each(1, [&](int) {
      *home.draw_step = *w.draw_step;
      *home.episode_length = *w.episode_length;
    });
  }
  copy_world(lanes, k.params, w, home);
  lanes.wait_sent();  // before the shared memory goes
}

}  // namespace

void launch_play_out(const LaunchOf<SimParams>& k, const PlayOut& plan, int64_t n_steps, void* stream) {
  with_usual_params(k.params, [&]<class P>(const P& p) {
    const int per_group = kGroupThreads<P> / p.n_agents, groups = (k.n_worlds + per_group - 1) / per_group;
    const size_t bytes = static_cast<size_t>(per_group) * (k.world_bytes / 16 * 16);
    GIGA_CUDA(cudaFuncSetAttribute(play_kernel<P>, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                   static_cast<int>(bytes)));
    play_kernel<P><<<groups, kGroupThreads<P>, bytes, static_cast<cudaStream_t>(stream)>>>(k.with(p), plan,
                                                                                          static_cast<int>(n_steps));
  });
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
