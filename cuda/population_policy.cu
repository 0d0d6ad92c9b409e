// The fused policies of a population. A block has one network and some worlds; a warp takes 16 rows through all layers
// by tensor cores (mma.sync m16n8k16, half precision in, fp32 out). Worlds that wait are left out before rows are made,
// and a block without worlds ends at once.
#include <cuda_fp16.h>

#include <algorithm>

#include "cuda/check.cuh"
#include "cuda/population_policy.hpp"

namespace giga {
namespace {

constexpr int kWarp = 32;
constexpr int kMinWarps = 4, kMaxWarps = 8;             // of a block
constexpr int kTileRows = 16, kTileK = 16, kTileN = 8;  // of one mma
constexpr int kMaxTilesN = SmallMlp::kMaxWidth / kTileN;
constexpr int kAhead = 2;  // tiles of inputs that are read before they are needed
static_assert(kMaxWarps * kTileRows == kMaxPopulationTeam);

__host__ __device__ constexpr int round_up(int n, int unit) { return (n + unit - 1) / unit * unit; }
/// Numbers from one row in shared memory to the next: the 8 rows x 4 pairs of columns that a warp reads at once lie in
/// 32 different banks.
__host__ __device__ constexpr int row_stride(int columns) { return round_up(columns, kTileK) + 8; }

/// Where things lie in shared memory, counted in half-precision numbers; rows of a matrix are followed by the biases.
struct SharedPlan {
  int weight[SmallMlp::kMaxLayers], bias[SmallMlp::kMaxLayers];
  int features, feature_stride;  // of warp 0; warps follow each other, kTileRows rows each
  int per_warp, total;

  __host__ __device__ SharedPlan(const SmallMlp& mlp, int warps) {
    int at = 0, widest = 0;
    for (int l = 0; l < mlp.n_layers; ++l) {
      const int n = round_up(mlp.width[l + 1], kTileN);
      weight[l] = at;
      at += n * row_stride(mlp.width[l]);
      bias[l] = at;
      at += round_up(n, 8);
      if (l + 1 < mlp.n_layers && mlp.width[l + 1] > widest) widest = mlp.width[l + 1];
    }
    features = at;
    feature_stride = row_stride(widest);
    // The head takes the place of the features, in fp32.
    const int head = 2 * kLogitStride;
    per_warp = kTileRows * (feature_stride > head ? feature_stride : head);
    total = at + warps * per_warp;
  }
  __host__ __device__ size_t bytes() const { return static_cast<size_t>(total) * sizeof(__half); }
};

/// Starts the copy of 8 numbers to shared memory without waiting for it.
__device__ void copy_async(__half* to, const __half* from) {
  const auto address = static_cast<uint32_t>(__cvta_generic_to_shared(to));
  asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(address), "l"(from) : "memory");
}

/// Copies a network's weights and biases to shared memory, all at once; what pads them to whole tiles is zero.
__device__ void load_network(const SmallMlp& mlp, const SharedPlan& plan, const __half* parameters, __half* shared) {
  const int thread = static_cast<int>(threadIdx.x), threads = static_cast<int>(blockDim.x);
  for (int l = 0; l < mlp.n_layers; ++l) {
    const int out = mlp.width[l + 1], in = mlp.width[l], stride = row_stride(in);
    const int rows = round_up(out, kTileN);
    __half* weight = shared + plan.weight[l];
    const __half* source = parameters + mlp.weight[l];
    const bool aligned = in % 8 == 0 && reinterpret_cast<uintptr_t>(source) % 16 == 0;
    if (aligned) {
      const int pieces = in / 8;
      for (int k = thread; k < out * pieces; k += threads)
        copy_async(weight + k / pieces * stride + k % pieces * 8, source + k * 8);
    }
    const int begin = aligned ? in : 0;  // of what is left to fill in a row of weights
    for (int k = thread; k < out * (stride - begin); k += threads) {
      const int row = k / (stride - begin), column = begin + k % (stride - begin);
      weight[row * stride + column] = column < in ? source[row * in + column] : __half(0.0f);
    }
    for (int k = thread; k < (rows - out) * stride; k += threads) weight[out * stride + k] = __half(0.0f);
    for (int k = thread; k < rows; k += threads)
      shared[plan.bias[l] + k] = k < out ? parameters[mlp.bias[l] + k] : __half(0.0f);
  }
  asm volatile("cp.async.wait_all;" ::: "memory");
}

__device__ uint32_t pair_of(float2 x) {
  const __half2 h = __float22half2_rn(x);
  return reinterpret_cast<const uint32_t&>(h);
}
__device__ uint32_t pair_at(const __half* p) { return *reinterpret_cast<const uint32_t*>(p); }

__device__ void multiply_add(float (&c)[4], const uint32_t (&a)[4], uint32_t b0, uint32_t b1) {
  asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, "
      "%3};"
      : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
      : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}

/// The lane's numbers of a tile of 16 rows x 16 columns: rows `group` and group + 8, columns 2 lane and 2 lane + 8,
/// pairs.
struct Lane {
  int group, pair;
  __device__ Lane() : group(static_cast<int>(threadIdx.x) % kWarp / 4), pair(static_cast<int>(threadIdx.x) % 4 * 2) {}
};

/// Inputs in fp32 in global memory: observations. A null row is one of zeros.
struct FarRows {
  const float* upper;
  const float* lower;
  int columns;
  __device__ uint32_t at(const float* row, int k) const {
    return pair_of(row && k < columns ? *reinterpret_cast<const float2*>(row + k) : float2{0, 0});
  }
  __device__ void read(int k, uint32_t (&a)[4]) const {
    a[0] = at(upper, k);
    a[1] = at(lower, k);
    a[2] = at(upper, k + 8);
    a[3] = at(lower, k + 8);
  }
};
/// Inputs in half precision in shared memory: features, with zeros behind.
struct NearRows {
  const __half* upper;
  const __half* lower;
  __device__ void read(int k, uint32_t (&a)[4]) const {
    a[0] = pair_at(upper + k);
    a[1] = pair_at(lower + k);
    a[2] = pair_at(upper + k + 8);
    a[3] = pair_at(lower + k + 8);
  }
};

/// c = input x weight^T + bias for 16 rows; `c` holds the lane's part of each tile of 8 columns.
template <class Rows>
__device__ void multiply(const Rows& input, int in, const __half* weight, const __half* bias, int tiles,
                         float (&c)[kMaxTilesN][4]) {
  const Lane lane;
  const int stride = row_stride(in);
#pragma unroll
  for (int j = 0; j < kMaxTilesN; ++j) {
    if (j >= tiles) break;
    c[j][0] = c[j][2] = __half2float(bias[j * kTileN + lane.pair]);
    c[j][1] = c[j][3] = __half2float(bias[j * kTileN + lane.pair + 1]);
  }
  uint32_t next[kAhead][4];
#pragma unroll
  for (int s = 0; s < kAhead; ++s)
    if (s * kTileK < in) input.read(s * kTileK + lane.pair, next[s]);
  for (int k = 0; k < in; k += kAhead * kTileK) {
#pragma unroll
    for (int s = 0; s < kAhead; ++s) {
      const int at = k + s * kTileK, later = at + kAhead * kTileK;
      if (at >= in) break;
      const uint32_t a[4] = {next[s][0], next[s][1], next[s][2], next[s][3]};
      if (later < in) input.read(later + lane.pair, next[s]);
      const __half* b = weight + lane.group * stride + at + lane.pair;
#pragma unroll
      for (int j = 0; j < kMaxTilesN; ++j) {
        if (j >= tiles) break;
        multiply_add(c[j], a, pair_at(b + j * kTileN * stride), pair_at(b + j * kTileN * stride + 8));
      }
    }
  }
}

/// tanh by the hardware: a relative error of 2^-11, the step of half precision.
__device__ float activate_fast(Activation activation, float x) {
  if (activation != Activation::tanh) return activate(activation, x);
  asm("tanh.approx.f32 %0, %0;" : "+f"(x));
  return x;
}

/// Writes the features of a hidden layer: 16 rows, whole tiles of columns and zeros up to the next tile of inputs.
__device__ void store_features(const float (&c)[kMaxTilesN][4], int tiles, Activation activation, __half* features,
                               int stride) {
  const Lane lane;
#pragma unroll
  for (int j = 0; j < kMaxTilesN; ++j) {
    if (j >= round_up(tiles, kTileK / kTileN)) break;
    const bool real = j < tiles;
    const auto f = [&](int k) { return real ? activate_fast(activation, c[j][k]) : 0.0f; };
    __half* at = features + lane.group * stride + j * kTileN + lane.pair;
    *reinterpret_cast<uint32_t*>(at) = pair_of({f(0), f(1)});
    *reinterpret_cast<uint32_t*>(at + 8 * stride) = pair_of({f(2), f(3)});
  }
}

/// Writes the head of 16 rows, as far as it fits into kLogitStride numbers.
__device__ void store_head(const float (&c)[kMaxTilesN][4], int tiles, float* head) {
  const Lane lane;
#pragma unroll
  for (int j = 0; j < kLogitStride / kTileN + 1; ++j) {
    if (j >= tiles) break;
#pragma unroll
    for (int k = 0; k < 4; ++k) {
      const int row = lane.group + k / 2 * 8, column = j * kTileN + lane.pair + k % 2;
      if (column < kLogitStride) head[row * kLogitStride + column] = c[j][k];
    }
  }
}

/// The worlds of a block.
struct BlockWorlds {
  int64_t world[kMaxPopulationTeam];
  int count;
};

/// Lists the worlds of the group that play, in their order.
__device__ void list_worlds(const NetworkGroups& part, const Phase* phase, int group, int begin, int end,
                            BlockWorlds& list) {
  if (threadIdx.x < kWarp) {  // one warp: the order is kept by ballots
    int count = 0;
    for (int k = begin; k < end; k += kWarp) {
      const int at = k + static_cast<int>(threadIdx.x);
      const int64_t world = part.first_world + group * part.group_step + at * part.world_step;
      const bool plays = at < end && phase[world] == Phase::plays;
      const unsigned mask = __ballot_sync(0xFFFFFFFFu, plays);
      if (plays) list.world[count + __popc(mask & ((1u << threadIdx.x) - 1u))] = world;
      count += __popc(mask);
    }
    if (threadIdx.x == 0) list.count = count;
  }
  __syncthreads();
}

/// 16 rows from observations to actions, by one warp.
__device__ void move_rows(const PopulationPolicy& policy, const NetworkGroups& part, const SharedPlan& plan,
                          const __half* parameters, const BlockWorlds& worlds, int first, __half* shared) {
  const Lane lane;
  const SmallMlp& mlp = policy.mlp;
  const int warp = static_cast<int>(threadIdx.x) / kWarp, n = part.act.draws.n, rows = worlds.count * n;
  const auto row_of = [&](int r) { return worlds.world[r / n] * n + r % n; };
  const auto obs_of = [&](int r) { return r < rows ? part.obs + row_of(r) * policy.obs_stride : nullptr; };
  __half* features = shared + plan.features + warp * plan.per_warp;
  float* head = reinterpret_cast<float*>(features);
  const FarRows obs{obs_of(first + lane.group), obs_of(first + lane.group + 8), mlp.width[0]};
  const NearRows near{features + lane.group * plan.feature_stride + 0,
                      features + (lane.group + 8) * plan.feature_stride};
  float c[kMaxTilesN][4];
  for (int l = 0; l < mlp.n_layers; ++l) {
    const int tiles = round_up(mlp.width[l + 1], kTileN) / kTileN;
    const __half *weight = shared + plan.weight[l], *bias = shared + plan.bias[l];
    if (l == 0)
      multiply(obs, mlp.width[0], weight, bias, tiles, c);
    else
      multiply(near, mlp.width[l], weight, bias, tiles, c);
    __syncwarp();  // all have read the features that are now replaced
    if (l + 1 < mlp.n_layers)
      store_features(c, tiles, mlp.activation, features, plan.feature_stride);
    else
      store_head(c, tiles, head);
    __syncwarp();
  }
  const int r = static_cast<int>(threadIdx.x) % kWarp;
  if (r >= kTileRows || first + r >= rows) return;
  float log_std[kActionSize] = {};
  if (part.act.actions == ActionKind::continuous)
    for (int k = 0; k < kActionSize; ++k) log_std[k] = __half2float(parameters[mlp.log_std + k]);
  part.act(row_of(first + r), head + r * kLogitStride, log_std);
}

/// Blocks of a part: so many per group, each with so many worlds.
struct PartShape {
  int blocks_per_group, worlds_per_block;
  __host__ __device__ PartShape(const NetworkGroups& part, int rows) {
    const int most = rows / part.act.draws.n;
    blocks_per_group = (part.worlds_per_group + most - 1) / most;
    worlds_per_block = (part.worlds_per_group + blocks_per_group - 1) / blocks_per_group;
  }
  __host__ __device__ int blocks(const NetworkGroups& part) const { return part.groups * blocks_per_group; }
};

/// A piece of work: some worlds of a group.
struct Piece {
  const NetworkGroups& part;
  int group, begin, end;  // worlds of the group
  int network;            // below 0: nothing to do

  __device__ static Piece number(const PopulationPolicy& policy, int piece, int most_rows) {
    int k = 0;
    PartShape shape(policy.part[0], most_rows);
    while (piece >= shape.blocks(policy.part[k])) {
      piece -= shape.blocks(policy.part[k]);
      shape = PartShape(policy.part[++k], most_rows);
    }
    const NetworkGroups& part = policy.part[k];
    const int group = piece / shape.blocks_per_group, begin = piece % shape.blocks_per_group * shape.worlds_per_block;
    return {part, group, begin, min(begin + shape.worlds_per_block, part.worlds_per_group),
            part.network ? part.network[group] : group};
  }
};

__device__ void move_piece(const PopulationPolicy& policy, int number, __half* shared, BlockWorlds& worlds) {
  const int warps = static_cast<int>(blockDim.x) / kWarp;
  const Piece piece = Piece::number(policy, number, warps * kTileRows);
  if (piece.network < 0) return;
  list_worlds(piece.part, policy.phase, piece.group, piece.begin, piece.end, worlds);
  const int rows = worlds.count * piece.part.act.draws.n;
  if (rows == 0) return;

  const SharedPlan plan(policy.mlp, warps);
  const __half* parameters =
      reinterpret_cast<const __half*>(piece.part.parameters) + piece.network * policy.parameter_stride;
  load_network(policy.mlp, plan, parameters, shared);
  __syncthreads();
  const int first = static_cast<int>(threadIdx.x) / kWarp * kTileRows;
  if (first < rows) move_rows(policy, piece.part, plan, parameters, worlds, first, shared);
}

__global__ void __launch_bounds__(kMaxWarps* kWarp, 2)
    population_kernel(const __grid_constant__ PopulationPolicy policy, int pieces) {
  extern __shared__ __align__(16) __half shared[];
  __shared__ BlockWorlds worlds;
  const int count = policy.work ? policy.work[pieces] : pieces;
  for (int k = static_cast<int>(blockIdx.x); k < count; k += static_cast<int>(gridDim.x)) {
    move_piece(policy, policy.work ? policy.work[k] : k, shared, worlds);
    __syncthreads();  // the next piece takes the same memory
  }
}

/// A warp per piece. `count` starts at 0.
__global__ void list_work(const __grid_constant__ PopulationPolicy policy, int pieces, int most_rows, int32_t* work,
                          int32_t* count) {
  const int thread = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x), number = thread / kWarp;
  if (number >= pieces) return;
  const Piece piece = Piece::number(policy, number, most_rows);
  bool plays = false;
  for (int k = piece.begin + thread % kWarp; k < piece.end && piece.network >= 0; k += kWarp)
    plays = plays ||
            policy.phase[piece.part.first_world + piece.group * piece.part.group_step + k * piece.part.world_step] ==
                Phase::plays;
  if (__any_sync(0xFFFFFFFFu, plays) && thread % kWarp == 0) work[atomicAdd(count, 1)] = number;
}

/// Warps of a block: enough for the worlds of most groups, or for one world.
int block_warps(const PopulationPolicy& policy) {
  int warps = kMinWarps;
  for (int k = 0; k < policy.n_parts; ++k) {
    const NetworkGroups& part = policy.part[k];
    const int n = part.act.draws.n, rows = part.network ? n : n * part.worlds_per_group;
    warps = std::max(warps, std::min((rows + kTileRows - 1) / kTileRows, kMaxWarps));
  }
  return warps;
}

}  // namespace

bool population_policy_fits(const SmallMlp& mlp, int largest_team, int index) {
  int limit = 0, major = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&limit, cudaDevAttrMaxSharedMemoryPerBlockOptin, index));
  GIGA_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, index));
  if (major < 8 || largest_team > kMaxPopulationTeam || mlp.n_layers < 1 || mlp.n_layers > SmallMlp::kMaxLayers)
    return false;
  for (int l = 0; l < mlp.n_layers; ++l)
    if (mlp.width[l + 1] > SmallMlp::kMaxWidth) return false;
  return SharedPlan(mlp, kMaxWarps).bytes() + sizeof(BlockWorlds) <= static_cast<size_t>(limit);
}

int population_work(const PopulationPolicy& policy) {
  const int most_rows = block_warps(policy) * kTileRows;
  int pieces = 0;
  for (int k = 0; k < policy.n_parts; ++k) pieces += PartShape(policy.part[k], most_rows).blocks(policy.part[k]);
  return pieces;
}

void list_population_work(const PopulationPolicy& policy, int32_t* work, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const int pieces = population_work(policy);
  if (pieces == 0) return;
  constexpr int kThreads = 256;
  GIGA_CUDA(cudaMemsetAsync(work + pieces, 0, sizeof *work, static_cast<cudaStream_t>(stream)));
  list_work<<<(pieces * kWarp + kThreads - 1) / kThreads, kThreads, 0, static_cast<cudaStream_t>(stream)>>>(
      policy, pieces, block_warps(policy) * kTileRows, work, work + pieces);
  GIGA_CUDA(cudaGetLastError());
}

int population_blocks(const PopulationPolicy& policy, int index) {
  GIGA_CUDA(cudaSetDevice(index));
  const int warps = block_warps(policy);
  const size_t bytes = SharedPlan(policy.mlp, warps).bytes();
  GIGA_CUDA(
      cudaFuncSetAttribute(population_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(bytes)));
  int per_multiprocessor = 0, multiprocessors = 0;
  GIGA_CUDA(
      cudaOccupancyMaxActiveBlocksPerMultiprocessor(&per_multiprocessor, population_kernel, warps * kWarp, bytes));
  GIGA_CUDA(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, index));
  return 2 * per_multiprocessor * multiprocessors;
}

void launch_population_policy(const PopulationPolicy& policy, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const int warps = block_warps(policy), pieces = population_work(policy);
  if (pieces == 0) return;
  const size_t bytes = SharedPlan(policy.mlp, warps).bytes();
  GIGA_CUDA(
      cudaFuncSetAttribute(population_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(bytes)));
  const int blocks = policy.blocks > 0 ? std::min(pieces, policy.blocks) : pieces;
  population_kernel<<<blocks, warps * kWarp, bytes, static_cast<cudaStream_t>(stream)>>>(policy, pieces);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
