// The fused policies of a population. A warp has one network and some worlds, and takes their rows through all layers
// by tensor cores (mma.sync m16n8k16, half precision in, fp32 out). A network is used for few rows, so its weights go
// from global memory straight into the registers that multiply them; features never leave the registers. Warps do not
// wait for each other. Worlds that wait are left out before rows are made.
#include <cuda_fp16.h>

#include <algorithm>

#include "cuda/check.cuh"
#include "cuda/half_tiles.cuh"
#include "cuda/population_policy.hpp"

namespace giga {
namespace {

constexpr int kWarp = 32;
constexpr int kWarps = 4;                                                   // of a block
constexpr int kTileRows = 16;                                               // of one mma
constexpr int kMaxRows = 2 * kTileRows;                                     // that a warp takes at a time
constexpr int kNarrow = 8, kWide = SmallMlp::kMaxWidth / PackedMlp::kTile;  // tiles of the widest layer
constexpr int kTilesAtOnce = 8;                                             // whose weights are read together

/// What a warp has in shared memory.
struct WarpMemory {
  alignas(16) float head[kMaxRows * kLogitStride];
  int64_t world[kWarp];   // that play, of its piece
  int64_t row[kMaxRows];  // of those that are taken at a time; below 0: none
};

/// What is too large becomes infinite, as in `rounded_to_half` on a CPU.
__device__ uint32_t pair_of(float2 x) {
  const __half2 h = __float22half2_rn(x);
  return reinterpret_cast<const uint32_t&>(h);
}

/// Of a tile of 16 columns a lane holds its columns of 8, and these + 8.
struct Lane : TileLane {
  int number = static_cast<int>(threadIdx.x) % kWarp;
};

/// tanh by the hardware: off by up to 2^-11 of its value (PTX), as much as the rounding to half precision that follows.
__device__ float tanh_fast(float x) {
  asm("tanh.approx.f32 %0, %0;" : "+f"(x));
  return x;
}
/// Not inlined: else the code would be repeated for each number that a lane holds.
__device__ __noinline__ float activate_other(Activation activation, float x) { return activate(activation, x); }

/// What a lane holds of the sums of 16 kM rows x 8 kTiles columns.
template <int kM, int kTiles>
struct Sums {
  float c[kM][kTiles][4];

  __device__ void start(const __half* bias, int tiles) {
    const Lane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j) {
      const float2 b =
          j < tiles ? __half22float2(*reinterpret_cast<const __half2*>(bias + j * 8 + lane.pair)) : float2{0, 0};
#pragma unroll
      for (int m = 0; m < kM; ++m) {
        c[m][j][0] = c[m][j][2] = b.x;
        c[m][j][1] = c[m][j][3] = b.y;
      }
    }
  }

  /// Adds the products of inputs 32 s and after, tiles of 16 columns, with their slab of the weights.
  template <int kTilesIn>
  __device__ void add(const uint32_t (&a)[kM][kTilesIn][4], int s, const __half* slab, int tiles) {
    const uint4* fragments = reinterpret_cast<const uint4*>(slab) + Lane().number;
#pragma unroll
    for (int first = 0; first < kTiles; first += kTilesAtOnce) {
      uint4 b[kTilesAtOnce];
#pragma unroll
      for (int j = 0; j < kTilesAtOnce; ++j)
        b[j] = first + j < tiles ? __ldg(fragments + (first + j) * kWarp) : uint4{0, 0, 0, 0};
#pragma unroll
      for (int j = 0; j < kTilesAtOnce; ++j) {
        if (first + j >= tiles) break;
#pragma unroll
        for (int m = 0; m < kM; ++m) {
          multiply_add(c[m][first + j], a[m][2 * s], b[j].x, b[j].y);
          multiply_add(c[m][first + j], a[m][2 * s + 1], b[j].z, b[j].w);
        }
      }
    }
  }

  template <class F>
  __device__ void each(const F& f) {
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int j = 0; j < kTiles; ++j)
#pragma unroll
        for (int k = 0; k < 4; ++k) c[m][j][k] = f(c[m][j][k]);
  }
  __device__ void activate(Activation activation) {
    if (activation == Activation::tanh)
      each(tanh_fast);
    else
      each([activation](float x) { return activate_other(activation, x); });
  }

  /// As inputs of the next layer: two tiles of 8 columns lie in a lane as one tile of 16 does there.
  __device__ void inputs(uint32_t (&a)[kM][kTiles / 2][4]) const {
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int t = 0; t < kTiles / 2; ++t)
#pragma unroll
        for (int k = 0; k < 4; ++k) {
          const float* tile = c[m][2 * t + k / 2];
          a[m][t][k] = pair_of({tile[k % 2 * 2], tile[k % 2 * 2 + 1]});
        }
  }

  /// Writes the head, as far as it fits into kLogitStride numbers.
  __device__ void store(float* head, int tiles) const {
    const Lane lane;
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int j = 0; j < (kLogitStride + 7) / 8; ++j) {
        if (j >= tiles) break;
#pragma unroll
        for (int k = 0; k < 4; ++k) {
          const int row = m * kTileRows + lane.group + k / 2 * 8, column = j * 8 + lane.pair + k % 2;
          if (column < kLogitStride) head[row * kLogitStride + column] = c[m][j][k];
        }
      }
  }
};

/// Inputs in global memory: observations. A null row is one of zeros.
__device__ uint32_t observed(const float* row, int column, int columns) {
  return pair_of(row && column < columns ? *reinterpret_cast<const float2*>(row + column) : float2{0, 0});
}

/// The rows of the worlds in `memory`: one for each agent of the team, world after world.
struct Rows {
  const WarpMemory& memory;
  int n, count;  // agents of a world; rows
  __device__ int64_t number(int r) const { return memory.world[r / n] * n + r % n; }
};

/// The heads of 16 kM rows, from observations to shared memory. `rows`: their numbers, below 0 where there is none.
template <int kM, int kTiles>
__device__ void make_heads(const PopulationPolicy& policy, const NetworkGroups& part, const __half* network,
                           const int64_t* rows, float* head) {
  const Lane lane;
  const PackedMlp& packed = policy.packed;
  const float* row[kM][2];
#pragma unroll
  for (int m = 0; m < kM; ++m)
#pragma unroll
    for (int k = 0; k < 2; ++k) {
      const int64_t r = rows[m * kTileRows + k * 8 + lane.group];
      row[m][k] = r >= 0 ? part.obs + r * policy.obs_stride : nullptr;
    }
  const int columns = packed.mlp.width[0];
  Sums<kM, kTiles> sums;
  sums.start(network + packed.bias[0], packed.tiles(0));
  for (int s = 0; s < packed.slabs(0); ++s) {
    uint32_t a[kM][2][4];
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int half = 0; half < 2; ++half)
#pragma unroll
        for (int k = 0; k < 4; ++k)
          a[m][half][k] = observed(row[m][k % 2], s * 32 + half * 16 + k / 2 * 8 + lane.pair, columns);
    sums.add(a, 0, network + packed.weight[0] + s * packed.tiles(0) * PackedMlp::kFragment, packed.tiles(0));
  }
  for (int l = 1; l < packed.mlp.n_layers; ++l) {
    sums.activate(packed.mlp.activation);
    uint32_t features[kM][kTiles / 2][4];
    sums.inputs(features);
    sums.start(network + packed.bias[l], packed.tiles(l));
#pragma unroll
    for (int s = 0; s < kTiles / 4; ++s) {
      if (s >= packed.slabs(l)) break;
      sums.add(features, s, network + packed.weight[l] + s * packed.tiles(l) * PackedMlp::kFragment, packed.tiles(l));
    }
  }
  sums.store(head, packed.tiles(packed.mlp.n_layers - 1));
}

/// How the worlds of a part are listed: a group's in stretches, each by one warp. At the end of a stretch a piece may
/// be short, so one has many pieces.
struct PartShape {
  static constexpr int kStretch = 192;  // worlds, a multiple of a warp
  int worlds_per_piece, stretches_per_group, pieces_per_stretch;
  __host__ __device__ explicit PartShape(const NetworkGroups& part) {
    const int fit = kMaxRows / part.act.draws.n,
              longest = part.worlds_per_group < kStretch ? part.worlds_per_group : kStretch;
    worlds_per_piece = fit > 1 ? fit : 1;
    stretches_per_group = (part.worlds_per_group + kStretch - 1) / kStretch;
    pieces_per_stretch = (longest + worlds_per_piece - 1) / worlds_per_piece;
  }
  __host__ __device__ int stretches(const NetworkGroups& part) const { return part.groups * stretches_per_group; }
  __host__ __device__ int pieces(const NetworkGroups& part) const { return stretches(part) * pieces_per_stretch; }
};

/// Where the list of a policy lies: its pieces, their number, its worlds.
struct WorkList {
  PopulationPiece* pieces;  // [most pieces]
  int32_t* count;           // [1]
  int32_t* worlds;          // [worlds of all parts], each stretch in a place of its own
  __host__ __device__ WorkList(int32_t* work, int most_pieces)
      : pieces(reinterpret_cast<PopulationPiece*>(work)), count(work + most_pieces * kPieceWords), worlds(count + 1) {}
  static constexpr int kPieceWords = sizeof(PopulationPiece) / sizeof(int32_t);
};

template <int kTiles>
__device__ void move_piece(const PopulationPolicy& policy, const PopulationPiece& piece, const int32_t* worlds,
                           WarpMemory& memory) {
  const NetworkGroups& part = policy.part[piece.part];
  const int lane = static_cast<int>(threadIdx.x) % kWarp, n = part.act.draws.n;
  const int64_t world = lane < piece.count ? worlds[piece.first + lane] : 0;
  const unsigned mask = __ballot_sync(0xFFFFFFFFu, lane < piece.count && policy.phase[world] == Phase::plays);
  if (mask == 0) return;
  if (mask & (1u << lane)) memory.world[__popc(mask & ((1u << lane) - 1u))] = world;
  __syncwarp();

  const Rows rows{memory, n, __popc(mask) * n};
  const PackedMlp& packed = policy.packed;
  const __half* network =
      reinterpret_cast<const __half*>(part.networks) + static_cast<int64_t>(piece.network) * packed.size;
  float log_std[kActionSize] = {};
  if (part.act.actions == ActionKind::continuous)
    for (int k = 0; k < kActionSize; ++k) log_std[k] = __half2float(network[packed.log_std + k]);
  for (int first = 0; first < rows.count; first += kMaxRows) {
    const int64_t row = first + lane < rows.count ? rows.number(first + lane) : -1;
    memory.row[lane] = row;
    __syncwarp();
    if (kTiles == kNarrow && rows.count - first > kTileRows) {
      make_heads<2, kNarrow>(policy, part, network, memory.row, memory.head);
    } else {
      make_heads<1, kTiles>(policy, part, network, memory.row, memory.head);
      if (kTiles != kNarrow && rows.count - first > kTileRows)
        make_heads<1, kTiles>(policy, part, network, memory.row + kTileRows, memory.head + kTileRows * kLogitStride);
    }
    __syncwarp();
    if (row >= 0) part.act(row, memory.head + lane * kLogitStride, log_std);
    __syncwarp();  // the next rows take the same memory
  }
}

template <int kTiles>
__global__ void __launch_bounds__(kWarps* kWarp, kTiles == kNarrow ? 3 : 2)
    population_kernel(const __grid_constant__ PopulationPolicy policy, int most_pieces) {
  __shared__ WarpMemory memory[kWarps];
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const WorkList list(policy.work, most_pieces);
  const int count = *list.count;
  // Neighbouring pieces often have the same network: warps of a block find it in their cache.
  for (int k = static_cast<int>(blockIdx.x) * kWarps + warp; k < count; k += static_cast<int>(gridDim.x) * kWarps)
    move_piece<kTiles>(policy, list.pieces[k], list.worlds, memory[warp]);
}

/// A warp per stretch: its worlds that play, close together, and their pieces, as even as they can be. `count` starts
/// at 0.
__global__ void list_work(const __grid_constant__ PopulationPolicy policy, int most_pieces) {
  int stretch = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x) / kWarp, k = 0, place = 0;
  PartShape shape(policy.part[0]);
  for (; stretch >= shape.stretches(policy.part[k]); shape = PartShape(policy.part[k])) {
    stretch -= shape.stretches(policy.part[k]);
    place += policy.part[k].groups * policy.part[k].worlds_per_group;
    if (++k == policy.n_parts) return;
  }
  const NetworkGroups& part = policy.part[k];
  const int group = stretch / shape.stretches_per_group, network = part.network ? part.network[group] : group;
  if (network < 0) return;
  const int begin = stretch % shape.stretches_per_group * PartShape::kStretch;
  const int end = min(begin + PartShape::kStretch, part.worlds_per_group);
  place += group * part.worlds_per_group + begin;

  const WorkList list(policy.work, most_pieces);
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  int listed = 0;
  for (int at = begin + lane; at - lane < end; at += kWarp) {
    const int64_t world = part.first_world + group * part.group_step + at * part.world_step;
    const bool plays = at < end && policy.phase[world] == Phase::plays;
    const unsigned mask = __ballot_sync(0xFFFFFFFFu, plays);
    if (plays) list.worlds[place + listed + __popc(mask & ((1u << lane) - 1u))] = static_cast<int32_t>(world);
    listed += __popc(mask);
  }
  const int pieces = (listed + shape.worlds_per_piece - 1) / shape.worlds_per_piece;
  if (pieces == 0) return;
  int first = lane == 0 ? atomicAdd(list.count, pieces) : 0;
  first = __shfl_sync(0xFFFFFFFFu, first, 0);
  for (int piece = lane; piece < pieces; piece += kWarp) {
    const int from = piece * listed / pieces, to = (piece + 1) * listed / pieces;
    list.pieces[first + piece] = {k, network, place + from, to - from};
  }
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

bool is_narrow(const SmallMlp& mlp) {
  return *std::max_element(mlp.width + 1, mlp.width + 1 + mlp.n_layers) <= kNarrow * PackedMlp::kTile;
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

int population_pieces(const PopulationPolicy& policy) {
  int pieces = 0;
  for (int k = 0; k < policy.n_parts; ++k) pieces += PartShape(policy.part[k]).pieces(policy.part[k]);
  return pieces;
}

int64_t population_work(const PopulationPolicy& policy) {
  int64_t words = int64_t{population_pieces(policy)} * WorkList::kPieceWords + 1;
  for (int k = 0; k < policy.n_parts; ++k) words += int64_t{policy.part[k].groups} * policy.part[k].worlds_per_group;
  return words;
}

void list_population_work(const PopulationPolicy& policy, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  int warps = 0;
  for (int k = 0; k < policy.n_parts; ++k) warps += PartShape(policy.part[k]).stretches(policy.part[k]);
  if (warps == 0) return;
  constexpr int kThreads = 256;
  const int pieces = population_pieces(policy);
  GIGA_CUDA(
      cudaMemsetAsync(WorkList(policy.work, pieces).count, 0, sizeof(int32_t), static_cast<cudaStream_t>(stream)));
  list_work<<<(warps + kThreads / kWarp - 1) / (kThreads / kWarp), kThreads, 0, static_cast<cudaStream_t>(stream)>>>(
      policy, pieces);
  GIGA_CUDA(cudaGetLastError());
}

void launch_population_policy(const PopulationPolicy& policy, int index, void* stream) {
  GIGA_CHECK(policy.packed.mlp.fits_population(), "no kernel of populations for these networks");
  GIGA_CUDA(cudaSetDevice(index));
  const int pieces = population_pieces(policy);
  if (pieces == 0) return;
  const auto kernel = is_narrow(policy.packed.mlp) ? population_kernel<kNarrow> : population_kernel<kWide>;
  int resident = 0;
  GIGA_CUDA(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, kernel, kWarps * kWarp, 0));
  // As many blocks as the GPU holds share the pieces.
  const int blocks = std::min((pieces + kWarps - 1) / kWarps, resident * multiprocessors(index));
  kernel<<<blocks, kWarps * kWarp, 0, static_cast<cudaStream_t>(stream)>>>(policy, pieces);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
