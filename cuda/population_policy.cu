// The fused policies of a population. A warp has one network and some worlds, and takes their rows through all layers
// by tensor cores (population_tiles.cuh); a network is used for few rows. Warps do not wait for each other. Worlds that
// wait are left out before rows are made.
#include <algorithm>

#include "cuda/check.cuh"
#include "cuda/population_policy.hpp"
#include "cuda/population_tiles.cuh"

namespace giga {
namespace {

constexpr int kWarp = 32;
constexpr int kWarps = 4;                // of a block
constexpr int kMaxRows = 2 * kTileRows;  // that a warp takes at a time

/// What a warp has in shared memory.
struct WarpMemory {
  alignas(16) float head[kMaxRows * kLogitStride];
  int64_t world[kWarp];  // that play, of its piece
};

/// The rows of the worlds in `memory`: one for each agent of the team, world after world.
struct Rows {
  const WarpMemory& memory;
  int n, count;  // agents of a world; rows
  __device__ int64_t number(int r) const { return memory.world[r / n] * n + r % n; }
};

/// Pieces of a part: so many per group, each with so many worlds.
struct PartShape {
  int pieces_per_group, worlds_per_piece;
  __host__ __device__ explicit PartShape(const NetworkGroups& part) {
    const int fit = kMaxRows / part.act.draws.n, most = fit > 1 ? fit : 1;
    pieces_per_group = (part.worlds_per_group + most - 1) / most;
    worlds_per_piece = (part.worlds_per_group + pieces_per_group - 1) / pieces_per_group;
  }
  __host__ __device__ int pieces(const NetworkGroups& part) const { return part.groups * pieces_per_group; }
};

/// A piece of work: some worlds of a group, at most a warp's lanes of them.
struct Piece {
  const NetworkGroups& part;
  int group, begin, end;  // worlds of the group
  int network;            // below 0: nothing to do

  __device__ static Piece number(const PopulationPolicy& policy, int piece) {
    int k = 0;
    PartShape shape(policy.part[0]);
    while (piece >= shape.pieces(policy.part[k])) {
      piece -= shape.pieces(policy.part[k]);
      shape = PartShape(policy.part[++k]);
    }
    const NetworkGroups& part = policy.part[k];
    const int group = piece / shape.pieces_per_group, begin = piece % shape.pieces_per_group * shape.worlds_per_piece;
    return {part, group, begin, min(begin + shape.worlds_per_piece, part.worlds_per_group),
            part.network ? part.network[group] : group};
  }
  /// The lanes whose world plays; `world` is this lane's.
  __device__ unsigned playing(const Phase* phase, int64_t& world) const {
    const int at = begin + static_cast<int>(threadIdx.x) % kWarp;
    world = part.first_world + group * part.group_step + at * part.world_step;
    return __ballot_sync(0xFFFFFFFFu, network >= 0 && at < end && phase[world] == Phase::plays);
  }
};

template <int kTiles>
__device__ void move_piece(const PopulationPolicy& policy, int number, WarpMemory& memory) {
  const Piece piece = Piece::number(policy, number);
  int64_t world;
  const unsigned mask = piece.playing(policy.phase, world);
  if (mask == 0) return;
  const int lane = static_cast<int>(threadIdx.x) % kWarp, n = piece.part.act.draws.n;
  if (mask & (1u << lane)) memory.world[__popc(mask & ((1u << lane) - 1u))] = world;
  __syncwarp();

  const Rows rows{memory, n, __popc(mask) * n};
  const PackedMlp& packed = policy.packed;
  const __half* network =
      reinterpret_cast<const __half*>(piece.part.networks) + static_cast<int64_t>(piece.network) * packed.size;
  float log_std[kActionSize] = {};
  if (piece.part.act.actions == ActionKind::continuous)
    for (int k = 0; k < kActionSize; ++k) log_std[k] = __half2float(network[packed.log_std + k]);
  for (int first = 0; first < rows.count; first += kMaxRows) {
    const auto row_of = [&](int r) {
      r += first;
      return r < rows.count ? piece.part.obs + rows.number(r) * policy.obs_stride : nullptr;
    };
    if (kTiles == kNarrow && rows.count - first > kTileRows) {
      make_heads<2, kNarrow>(packed, network, row_of, memory.head);
    } else {
      make_heads<1, kTiles>(packed, network, row_of, memory.head);
      if (kTiles != kNarrow && rows.count - first > kTileRows)
        make_heads<1, kTiles>(
            packed, network, [&](int r) { return row_of(r + kTileRows); }, memory.head + kTileRows * kLogitStride);
    }
    __syncwarp();
    if (first + lane < rows.count)
      piece.part.act(rows.number(first + lane), memory.head + lane * kLogitStride, log_std);
    __syncwarp();  // the next rows take the same memory
  }
}

template <int kTiles>
__global__ void __launch_bounds__(kWarps* kWarp, kTiles == kNarrow ? 3 : 2)
    population_kernel(const __grid_constant__ PopulationPolicy policy, int pieces) {
  __shared__ WarpMemory memory[kWarps];
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const int count = policy.work ? policy.work[pieces] : pieces;
  // Neighbouring pieces often have the same network: warps of a block find it in their cache.
  for (int k = static_cast<int>(blockIdx.x) * kWarps + warp; k < count; k += static_cast<int>(gridDim.x) * kWarps)
    move_piece<kTiles>(policy, policy.work ? policy.work[k] : k, memory[warp]);
}

/// A warp per piece. `count` starts at 0.
__global__ void list_work(const __grid_constant__ PopulationPolicy policy, int pieces, int32_t* work, int32_t* count) {
  const int thread = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x), number = thread / kWarp;
  if (number >= pieces) return;
  int64_t world;
  const unsigned mask = Piece::number(policy, number).playing(policy.phase, world);
  if (mask != 0 && thread % kWarp == 0) work[atomicAdd(count, 1)] = number;
}

/// Number i of a network, from its parameters.
__device__ float packed_number(const PackedMlp& packed, const float* parameters, int i) {
  const SmallMlp& mlp = packed.mlp;
  if (i >= packed.log_std) return i < packed.log_std + kActionSize ? parameters[mlp.log_std + i - packed.log_std] : 0;
  int l = mlp.n_layers - 1;
  while (i < packed.weight[l]) --l;
  const int in = mlp.width[l], out = mlp.width[l + 1];
  if (i >= packed.bias[l]) return i - packed.bias[l] < out ? parameters[mlp.bias[l] + i - packed.bias[l]] : 0;
  const int at = i - packed.weight[l], fragment = at / PackedMlp::kFragment, lane = at % PackedMlp::kFragment / 8;
  const int row = fragment % packed.tiles(l) * PackedMlp::kTile + lane / 4;
  const int column =
      fragment / packed.tiles(l) * PackedMlp::kSlab + at % 8 / 2 * PackedMlp::kTile + lane % 4 * 2 + at % 2;
  return row < out && column < in ? parameters[mlp.weight[l] + row * in + column] : 0;
}

__global__ void pack_networks(const __grid_constant__ PackedMlp packed, const float* networks, int64_t stride,
                              int64_t numbers, __half* out) {
  const int64_t k = static_cast<int64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
  if (k >= numbers) return;
  out[k] = __float2half(packed_number(packed, networks + k / packed.size * stride, static_cast<int>(k % packed.size)));
}

}  // namespace

bool population_policy_runs(int index) {
  int major = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, index));
  return major >= 8;
}

void pack_population(const PackedMlp& layout, const float* networks, int64_t n, int64_t stride, uint16_t* packed,
                     int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const int64_t numbers = n * layout.size;
  if (numbers == 0) return;
  constexpr int kThreads = 256;
  pack_networks<<<static_cast<unsigned>((numbers + kThreads - 1) / kThreads), kThreads, 0,
                  static_cast<cudaStream_t>(stream)>>>(layout, networks, stride, numbers,
                                                       reinterpret_cast<__half*>(packed));
  GIGA_CUDA(cudaGetLastError());
}

int population_work(const PopulationPolicy& policy) {
  int pieces = 0;
  for (int k = 0; k < policy.n_parts; ++k) pieces += PartShape(policy.part[k]).pieces(policy.part[k]);
  return pieces;
}

void list_population_work(const PopulationPolicy& policy, int32_t* work, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const int pieces = population_work(policy);
  if (pieces == 0) return;
  constexpr int kThreads = 256;
  GIGA_CUDA(cudaMemsetAsync(work + pieces, 0, sizeof *work, static_cast<cudaStream_t>(stream)));
  list_work<<<(pieces + kThreads / kWarp - 1) / (kThreads / kWarp), kThreads, 0, static_cast<cudaStream_t>(stream)>>>(
      policy, pieces, work, work + pieces);
  GIGA_CUDA(cudaGetLastError());
}

void launch_population_policy(const PopulationPolicy& policy, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const int pieces = population_work(policy);
  if (pieces == 0) return;
  const auto kernel = policy.packed.mlp.widest() <= kNarrow * PackedMlp::kTile ? population_kernel<kNarrow> : population_kernel<kWide>;
  int resident = 0, multiprocessors = 0;
  GIGA_CUDA(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, kernel, kWarps * kWarp, 0));
  GIGA_CUDA(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, index));
  // As many blocks as the GPU holds share the pieces.
  const int blocks = std::min((pieces + kWarps - 1) / kWarps, resident * multiprocessors);
  kernel<<<blocks, kWarps * kWarp, 0, static_cast<cudaStream_t>(stream)>>>(policy, pieces);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
