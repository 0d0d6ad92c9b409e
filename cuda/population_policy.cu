// The fused policies of a population. A block has one network and some worlds; a warp takes 16 rows through all layers by
// tensor cores (mma.sync m16n8k8, TF32). Worlds that wait are left out before rows are made, and a block without worlds
// ends at once.
#include <algorithm>

#include "cuda/check.cuh"
#include "cuda/population_policy.hpp"

namespace giga {
namespace {

constexpr int kWarp = 32;
constexpr int kWarps = 8;
constexpr int kThreads = kWarps * kWarp;
constexpr int kTileRows = 16, kTileK = 8, kTileN = 8;  // of one mma
constexpr int kBlockRows = kWarps * kTileRows;
constexpr int kAhead = 4;  // tiles of inputs that are read before they are needed
constexpr int kMaxTilesN = SmallMlp::kMaxWidth / kTileN;
static_assert(kBlockRows == kMaxPopulationTeam);

/// Numbers from one row of a matrix in shared memory to the next: the 8 rows x 4 columns that a warp reads at once lie in
/// 32 different banks.
__host__ __device__ constexpr int row_stride(int columns) { return (columns + kTileK - 1) / kTileK * kTileK + 4; }

/// Where things lie in shared memory, in floats.
struct SharedPlan {
  int weight[SmallMlp::kMaxLayers], bias[SmallMlp::kMaxLayers];
  int features, feature_stride;  // of warp 0; warps follow each other, kTileRows rows each
  int total;

  __host__ __device__ explicit SharedPlan(const SmallMlp& mlp) {
    int at = 0, widest = kLogitStride;
    for (int l = 0; l < mlp.n_layers; ++l) {
      const int n = (mlp.width[l + 1] + kTileN - 1) / kTileN * kTileN;
      weight[l] = at;
      at += n * row_stride(mlp.width[l]);
      bias[l] = at;
      at += n;
      if (l + 1 < mlp.n_layers && mlp.width[l + 1] > widest) widest = mlp.width[l + 1];
    }
    features = at;
    feature_stride = row_stride(widest);
    total = at + kWarps * kTileRows * feature_stride;
  }
};

__device__ uint32_t to_tf32(float x) {
  uint32_t bits;
  asm("cvt.rna.tf32.f32 %0, %1;" : "=r"(bits) : "f"(x));
  return bits;
}

__device__ void multiply_add(float (&c)[4], const uint32_t (&a)[4], uint32_t b0, uint32_t b1) {
  asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
      : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
      : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}

/// Starts the copy of `kNumbers` floats to shared memory without waiting for it.
template <int kNumbers>
__device__ void copy_async(float* to, const float* from) {
  const auto address = static_cast<uint32_t>(__cvta_generic_to_shared(to));
  asm volatile("cp.async.ca.shared.global [%0], [%1], %2;" ::"r"(address), "l"(from), "n"(kNumbers * 4) : "memory");
}

/// Copies a matrix [out, in] to rows `row_stride(in)` apart, kNumbers at a time.
template <int kNumbers>
__device__ void copy_matrix(const float* source, int out, int in, float* weight) {
  const int pieces = in / kNumbers, stride = row_stride(in);
  for (int k = static_cast<int>(threadIdx.x); k < out * pieces; k += kThreads) {
    const int row = k / pieces, column = k % pieces * kNumbers;
    copy_async<kNumbers>(weight + row * stride + column, source + row * in + column);
  }
}

/// Copies a network's weights and biases to shared memory, all at once; what pads them to whole tiles is zero. Tensor
/// cores read the upper bits of a weight.
__device__ void load_network(const SmallMlp& mlp, const SharedPlan& plan, const float* parameters, float* shared) {
  for (int l = 0; l < mlp.n_layers; ++l) {
    const int out = mlp.width[l + 1], in = mlp.width[l], stride = row_stride(in);
    const int rows = (out + kTileN - 1) / kTileN * kTileN;
    float* weight = shared + plan.weight[l];
    const float* source = parameters + mlp.weight[l];
    if (in % 4 == 0 && reinterpret_cast<uintptr_t>(source) % 16 == 0)
      copy_matrix<4>(source, out, in, weight);
    else
      copy_matrix<1>(source, out, in, weight);
    for (int k = static_cast<int>(threadIdx.x); k < out; k += kThreads)
      copy_async<1>(shared + plan.bias[l] + k, parameters + mlp.bias[l] + k);
    for (int k = static_cast<int>(threadIdx.x); k < rows * stride; k += kThreads)
      if (k / stride >= out || k % stride >= in) weight[k] = 0;
    for (int k = out + static_cast<int>(threadIdx.x); k < rows; k += kThreads) shared[plan.bias[l] + k] = 0;
  }
  asm volatile("cp.async.wait_all;" ::: "memory");
}

/// The rows of a layer's input that a lane reads: those of its group and 8 further; null = a row of zeros.
struct LaneRows {
  const float* upper;
  const float* lower;
};

/// c = input x weight^T + bias for 16 rows; `c` holds the lane's part of each tile of 8 columns.
__device__ void multiply(const LaneRows& input, int in, const float* weight, const float* bias, int tiles,
                         float (&c)[kMaxTilesN][4]) {
  const int group = static_cast<int>(threadIdx.x) % kWarp / 4, lane = static_cast<int>(threadIdx.x) % 4;
  const int stride = row_stride(in);
#pragma unroll
  for (int j = 0; j < kMaxTilesN; ++j) {
    if (j >= tiles) break;
    c[j][0] = c[j][2] = bias[j * kTileN + 2 * lane];
    c[j][1] = c[j][3] = bias[j * kTileN + 2 * lane + 1];
  }
  // Inputs are read some tiles ahead: those of the first layer come from far away.
  float next[kAhead][4];
  const auto read = [&](int k) {
#pragma unroll
    for (int s = 0; s < kAhead; ++s) {
      const int k0 = k + s * kTileK + lane, k1 = k0 + 4;
      next[s][0] = input.upper && k0 < in ? input.upper[k0] : 0.0f;
      next[s][1] = input.lower && k0 < in ? input.lower[k0] : 0.0f;
      next[s][2] = input.upper && k1 < in ? input.upper[k1] : 0.0f;
      next[s][3] = input.lower && k1 < in ? input.lower[k1] : 0.0f;
    }
  };
  read(0);
  for (int k = 0; k < in; k += kAhead * kTileK) {
    uint32_t a[kAhead][4];
#pragma unroll
    for (int s = 0; s < kAhead; ++s)
#pragma unroll
      for (int i = 0; i < 4; ++i) a[s][i] = to_tf32(next[s][i]);
    read(k + kAhead * kTileK);
#pragma unroll
    for (int s = 0; s < kAhead; ++s) {
      if (k + s * kTileK >= in) break;
      const float* b = weight + group * stride + k + s * kTileK + lane;
#pragma unroll
      for (int j = 0; j < kMaxTilesN; ++j) {
        if (j >= tiles) break;
        multiply_add(c[j], a[s], __float_as_uint(b[j * kTileN * stride]), __float_as_uint(b[j * kTileN * stride + 4]));
      }
    }
  }
}

/// Writes the lane's part of 16 rows of features, `tiles` x 8 columns, as far as they fit into a row of `columns`.
template <class F>
__device__ void store(const float (&c)[kMaxTilesN][4], int tiles, int columns, float* features, int stride, F&& f) {
  const int group = static_cast<int>(threadIdx.x) % kWarp / 4, lane = static_cast<int>(threadIdx.x) % 4;
#pragma unroll
  for (int j = 0; j < kMaxTilesN; ++j) {
    if (j >= tiles) break;
#pragma unroll
    for (int k = 0; k < 4; ++k) {
      const int row = group + (k / 2) * 8, column = j * kTileN + 2 * lane + k % 2;
      if (column < columns) features[row * stride + column] = f(c[j][k]);
    }
  }
}

/// The worlds of a block.
struct BlockWorlds {
  int64_t world[kBlockRows];
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
                          const float* parameters, const BlockWorlds& worlds, int first, float* shared) {
  const SmallMlp& mlp = policy.mlp;
  const int lane = static_cast<int>(threadIdx.x) % kWarp, warp = static_cast<int>(threadIdx.x) / kWarp;
  const int n = part.act.draws.n, rows = worlds.count * n;
  const auto row_of = [&](int r) { return worlds.world[r / n] * n + r % n; };
  const auto obs_of = [&](int r) { return r < rows ? part.obs + row_of(r) * mlp.width[0] : nullptr; };
  float* features = shared + plan.features + warp * kTileRows * plan.feature_stride;
  LaneRows input{obs_of(first + lane / 4), obs_of(first + lane / 4 + 8)};
  float c[kMaxTilesN][4];
  for (int l = 0; l < mlp.n_layers; ++l) {
    const int out = mlp.width[l + 1], tiles = (out + kTileN - 1) / kTileN;
    multiply(input, mlp.width[l], shared + plan.weight[l], shared + plan.bias[l], tiles, c);
    __syncwarp();  // all have read the features that are now replaced
    if (l + 1 < mlp.n_layers)
      store(c, tiles, tiles * kTileN, features, plan.feature_stride,
            [&](float x) { return activate(mlp.activation, x); });
    else
      store(c, tiles, kLogitStride, features, kLogitStride, [](float x) { return x; });
    __syncwarp();
    input = {features + lane / 4 * plan.feature_stride, features + (lane / 4 + 8) * plan.feature_stride};
  }
  if (lane < kTileRows && first + lane < rows)
    part.act.by_head(row_of(first + lane), features + lane * kLogitStride, parameters + mlp.log_std);
  __syncwarp();
}

/// Blocks of a part: so many per group, each with so many worlds.
struct PartShape {
  int blocks_per_group, worlds_per_block;
};
__host__ __device__ PartShape shape_of(const NetworkGroups& part) {
  const int most = kBlockRows / part.act.draws.n;
  const int blocks = (part.worlds_per_group + most - 1) / most;
  return {blocks, (part.worlds_per_group + blocks - 1) / blocks};
}

__global__ void __launch_bounds__(kThreads, 2) population_kernel(const __grid_constant__ PopulationPolicy policy) {
  extern __shared__ __align__(16) float shared[];
  __shared__ BlockWorlds worlds;
  int block = static_cast<int>(blockIdx.x), k = 0;
  PartShape shape = shape_of(policy.part[0]);
  while (block >= policy.part[k].groups * shape.blocks_per_group) {
    block -= policy.part[k].groups * shape.blocks_per_group;
    shape = shape_of(policy.part[++k]);
  }
  const NetworkGroups& part = policy.part[k];
  const int group = block / shape.blocks_per_group, begin = block % shape.blocks_per_group * shape.worlds_per_block;
  const int end = min(begin + shape.worlds_per_block, part.worlds_per_group);
  list_worlds(part, policy.phase, group, begin, end, worlds);
  const int rows = worlds.count * part.act.draws.n;
  if (rows == 0) return;

  const int network = part.network ? part.network[group] : group;
  if (network < 0) {
    const int n = part.act.draws.n;
    for (int r = static_cast<int>(threadIdx.x); r < rows; r += kThreads)
      part.act.by_script(worlds.world[r / n] * n + r % n, script_of_network(network));
    return;
  }
  const SharedPlan plan(policy.mlp);
  const float* parameters = part.parameters + network * policy.n_parameters;
  load_network(policy.mlp, plan, parameters, shared);
  __syncthreads();
  const int first = static_cast<int>(threadIdx.x) / kWarp * kTileRows;
  if (first < rows) move_rows(policy, part, plan, parameters, worlds, first, shared);
}

}  // namespace

size_t population_policy_bytes(const SmallMlp& mlp) {
  return static_cast<size_t>(SharedPlan(mlp).total) * sizeof(float) + sizeof(BlockWorlds);
}

bool population_policy_fits(const SmallMlp& mlp, int largest_team, int index) {
  int limit = 0, major = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&limit, cudaDevAttrMaxSharedMemoryPerBlockOptin, index));
  GIGA_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, index));
  if (major < 8 || largest_team > kMaxPopulationTeam || mlp.n_layers < 1 || mlp.n_layers > SmallMlp::kMaxLayers)
    return false;
  for (int l = 0; l < mlp.n_layers; ++l)
    if (mlp.width[l + 1] > SmallMlp::kMaxWidth) return false;
  return population_policy_bytes(mlp) <= static_cast<size_t>(limit);
}

void launch_population_policy(const PopulationPolicy& policy, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  int blocks = 0;
  for (int k = 0; k < policy.n_parts; ++k) blocks += policy.part[k].groups * shape_of(policy.part[k]).blocks_per_group;
  if (blocks == 0) return;
  const size_t bytes = static_cast<size_t>(SharedPlan(policy.mlp).total) * sizeof(float);
  GIGA_CUDA(cudaFuncSetAttribute(population_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                 static_cast<int>(bytes)));
  population_kernel<<<blocks, kThreads, bytes, static_cast<cudaStream_t>(stream)>>>(policy);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
