#include "cuda/fused_policy.hpp"

#include <algorithm>

#include "cuda/check.cuh"
#include "cuda/ppo_tiles.cuh"

namespace giga {
namespace {

constexpr int kWarps = 8, kThreads = kWarps * 32;

/// Shared memory of a block, for inputs and hidden layers padded to so many. A warp takes 32 rows at a time, 16 after
/// 16 through the network and all to their actions; of wide networks, whose weights leave less room, 16.
template <int kIn, int kHidden>
struct PolicyMemory {
  static constexpr int kInStride = kIn + 8, kHiddenStride = kHidden + 8;
  static constexpr int kBlocks =
      kHidden <= FusedMlp::kNarrowHidden && kIn <= PolicyShape::kCrowdInput ? 2 : 1;  // on a multiprocessor
  static constexpr int kRows = kHidden <= FusedMlp::kBlockHidden ? 32 : 16;           // of a warp at a time
  static constexpr int kFetched = kIn <= MediumTiles::kIn ? 16 : 8;  // as many rows as registers have room for
  alignas(16) float head[kWarps][kRows * kLogitStride];
  __half x[kWarps][16 * kInStride];
  __half weight1[kHidden * kInStride];
  __half weight2[kHidden * kHiddenStride];
  __half weight3[kHead * kHiddenStride];
  float bias1[kHidden], bias2[kHidden], bias3[kHead];

  /// Of `kAtOnce` numbers on their way for each thread.
  template <int kAtOnce>
  __device__ void load(const FusedMlp& net, const float* parameters) {
    const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
    load_matrix<kHidden, kInStride, kThreads, kAtOnce>(parameters + net.weight[0], hidden1, input, weight1);
    load_matrix<kHidden, kHiddenStride, kThreads, kAtOnce>(parameters + net.weight[1], hidden2, hidden1, weight2);
    load_matrix<kHead, kHiddenStride, kThreads, kAtOnce>(parameters + net.weight[2], output, hidden2, weight3);
    load_vector(parameters + net.bias[0], hidden1, bias1, kHidden);
    load_vector(parameters + net.bias[1], hidden2, bias2, kHidden);
    load_vector(parameters + net.bias[2], output, bias3, kHead);
  }
  /// The warp's 16 rows in x to their logits.
  __device__ void compute(Activation activation, int warp, float* to) const {
    TileSums<kHidden / 8> y;
    y.start(bias1);
    y.template add_by_rows<kIn / 16>(Halves<kInStride>(x[warp], 0, 0), Halves<kInStride>(weight1, 0, 0));
    SlopesOf<kHidden / 8> slopes;
    activate(activation, y, slopes);
    Factor<kHidden / 16> features = y.factor();
    y.start(bias2);
    y.add_by_rows(features, Halves<kHiddenStride>(weight2, 0, 0));
    activate(activation, y, slopes);
    features = y.factor();
    TileSums<kHead / 8> logits;
    logits.start(bias3);
    logits.add_by_rows(features, Halves<kHiddenStride>(weight3, 0, 0));
    logits.each([&](float value, int r, int c) {
      if (c < kLogitStride) to[r * kLogitStride + c] = value;
    });
  }
};

/// The network of a group of a policy, the rows that it reads, and how it acts.
struct GroupOfRows {
  const FusedPolicy& k;
  int64_t first, offset;  // of its rows, of its parameters
  FusedRows rows;
  SampleGaussian continuous;

  __device__ GroupOfRows(const FusedPolicy& policy, int64_t group)
      : k(policy),
        first(group * k.rows_per_group),
        offset(group * k.group_stride),
        rows{.obs = k.obs,
             .obs_stride = k.obs_stride,
             .obs_mean = k.obs_mean ? k.obs_mean + offset : nullptr,
             .obs_std = k.obs_mean ? k.obs_std + offset : nullptr,
             .obs_limit = k.obs_limit},
        continuous(k.continuous) {
    if (k.actions == ActionKind::continuous) continuous.log_std += offset;
  }
  __device__ const float* parameters() const { return k.parameters + offset; }
  /// Of the rows from `at` on.
  template <class Inputs>
  __device__ void fetch(int64_t at, int from, Inputs& inputs) const {
    inputs.fetch(rows, k.net.width[0], [&](int i) {
      const int64_t row = at + from + i;
      return row < k.rows_per_group ? first + row : -1;
    });
  }
  __device__ void act(int64_t row, const float* logits) const {
    if (k.actions == ActionKind::discrete)
      k.discrete.sample(first + row, logits);
    else
      continuous.sample(first + row, logits);
  }
};

/// Blocks [.., groups].
template <int kIn, int kHidden>
__global__ void __launch_bounds__(kThreads, PolicyMemory<kIn, kHidden>::kBlocks)
    policy_kernel(const __grid_constant__ FusedPolicy k) {
  using Memory = PolicyMemory<kIn, kHidden>;
  constexpr int kRows = Memory::kRows, kFetched = Memory::kFetched, kStride = Memory::kInStride;
  extern __shared__ __align__(16) char shared[];
  Memory& m = *reinterpret_cast<Memory*>(shared);
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  m.template load<8>(k.net, k.parameters + blockIdx.y * k.group_stride);
  const GroupOfRows group(k, blockIdx.y);
  __syncthreads();

  const int64_t step = static_cast<int64_t>(gridDim.x) * kWarps * kRows;
  for (int64_t at = (static_cast<int64_t>(blockIdx.x) * kWarps + warp) * kRows; at < k.rows_per_group; at += step) {
#pragma unroll 1
    for (int half = 0; half < kRows / 16; ++half) {
#pragma unroll
      for (int part = 0; part < 16; part += kFetched) {
        FetchedInputs<kIn, kFetched> inputs;
        group.fetch(at, half * 16 + part, inputs);
        inputs.template store<kStride>(group.rows, k.net.width[0], m.x[warp] + part * kStride);
      }
      __syncwarp();
      m.compute(k.net.activation, warp, m.head[warp] + half * 16 * kLogitStride);
      __syncwarp();
    }
    if (lane < kRows && at + lane < k.rows_per_group) group.act(at + lane, m.head[warp] + lane * kLogitStride);
    __syncwarp();  // the next rows take the same memory
  }
}

/// Several policies in one launch, with so few rows that each warp has 16 at most: what counts is how long one takes.
/// Rows are on their way while weights are, and many of these. Blocks [.., most groups of a policy, policies].
template <int kIn, int kHidden>
__global__ void __launch_bounds__(kThreads, PolicyMemory<kIn, kHidden>::kBlocks)
    few_rows_kernel(const __grid_constant__ FusedPolicies policies) {
  using Memory = PolicyMemory<kIn, kHidden>;
  constexpr int kFetched = Memory::kFetched, kStride = Memory::kInStride, kAtOnce = 24;
  extern __shared__ __align__(16) char shared[];
  Memory& m = *reinterpret_cast<Memory*>(shared);
  const FusedPolicy& k = policies.policy[blockIdx.z];
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  // Warps take turns among the blocks, so that all multiprocessors have some.
  const int64_t at = (static_cast<int64_t>(warp) * gridDim.x + blockIdx.x) * 16;
  if (static_cast<int>(blockIdx.y) >= k.groups || static_cast<int64_t>(blockIdx.x) * 16 >= k.rows_per_group) return;
  const GroupOfRows group(k, blockIdx.y);
  FetchedInputs<kIn, kFetched> inputs;
  group.fetch(at, 0, inputs);
  m.template load<kAtOnce>(k.net, group.parameters());
  inputs.template store<kStride>(group.rows, k.net.width[0], m.x[warp]);
#pragma unroll
  for (int part = kFetched; part < 16; part += kFetched) {
    group.fetch(at, part, inputs);
    inputs.template store<kStride>(group.rows, k.net.width[0], m.x[warp] + part * kStride);
  }
  __syncthreads();
  if (at >= k.rows_per_group) return;
  m.compute(k.net.activation, warp, m.head[warp]);
  __syncwarp();
  if (lane < 16 && at + lane < k.rows_per_group) group.act(at + lane, m.head[warp] + lane * kLogitStride);
}

template <int kIn, int kHidden>
void launch_each(std::span<const FusedPolicy> policies, int multiprocessors, cudaStream_t stream) {
  using Memory = PolicyMemory<kIn, kHidden>;
  static_assert(sizeof(Memory) <= kMostShared / Memory::kBlocks);
  GIGA_CUDA(
      cudaFuncSetAttribute(policy_kernel<kIn, kHidden>, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(Memory)));
  for (const FusedPolicy& policy : policies) {
    if (policy.rows_per_group == 0) continue;
    constexpr int kBlockRows = kWarps * Memory::kRows;
    const int64_t wanted = (policy.rows_per_group + kBlockRows - 1) / kBlockRows;
    const int64_t share = std::max(1, multiprocessors * Memory::kBlocks / policy.groups);
    const dim3 blocks(static_cast<unsigned>(std::min(wanted, share)), static_cast<unsigned>(policy.groups));
    policy_kernel<kIn, kHidden><<<blocks, kThreads, sizeof(Memory), stream>>>(policy);
    GIGA_CUDA(cudaGetLastError());
  }
}

/// All in one launch, if they have so few rows (none: nothing is launched); else false.
template <int kIn, int kHidden>
bool launch_few(std::span<const FusedPolicy> policies, int multiprocessors, cudaStream_t stream) {
  using Memory = PolicyMemory<kIn, kHidden>;
  FusedPolicies few{};
  int64_t tiles = 0;
  int groups = 0, all_groups = 0, n = 0;
  for (const FusedPolicy& policy : policies) {
    few.policy[n++] = policy;
    tiles = std::max(tiles, (policy.rows_per_group + 15) / 16);
    groups = std::max(groups, policy.groups);
    all_groups += policy.groups;
  }
  const int64_t share = multiprocessors * Memory::kBlocks / all_groups;
  if (tiles > share * kWarps || tiles == 0) return tiles == 0;
  GIGA_CUDA(
      cudaFuncSetAttribute(few_rows_kernel<kIn, kHidden>, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(Memory)));
  const dim3 blocks(static_cast<unsigned>(std::min(tiles, share)), static_cast<unsigned>(groups),
                    static_cast<unsigned>(n));
  few_rows_kernel<kIn, kHidden><<<blocks, kThreads, sizeof(Memory), stream>>>(few);
  GIGA_CUDA(cudaGetLastError());
  return true;
}

/// Calls f.operator()<inputs, hidden>().
template <class F>
void with_shape(const PolicyShape& shape, F&& f) {
  constexpr int kNarrow = FusedMlp::kNarrowHidden, kBlock = FusedMlp::kBlockHidden;
  const auto with_hidden = [&]<int kIn>() {
    shape.hidden == kNarrow ? f.template operator()<kIn, kNarrow>() : f.template operator()<kIn, kBlock>();
  };
  if (shape.hidden == FusedMlp::kHidden) return f.template operator()<NarrowTiles::kIn, FusedMlp::kHidden>();
  if (shape.in == PolicyShape::kCrowdInput) return f.template operator()<PolicyShape::kCrowdInput, kNarrow>();
  if (shape.in == NarrowTiles::kIn) return with_hidden.template operator()<NarrowTiles::kIn>();
  if (shape.in == MediumTiles::kIn) return with_hidden.template operator()<MediumTiles::kIn>();
  with_hidden.template operator()<WideTiles::kIn>();
}

}  // namespace

void launch_fused_policies(std::span<const FusedPolicy> policies, int index, void* stream) {
  static_assert(FusedPolicy::kWideInput == NarrowTiles::kIn && PolicyShape::kInputs[0] == NarrowTiles::kIn &&
                PolicyShape::kInputs[1] == MediumTiles::kIn && PolicyShape::kInputs[3] == WideTiles::kIn);
  for (const FusedPolicy& policy : policies)
    GIGA_CHECK(FusedPolicy::serves(policy.net), "no fused policy for this network");
  GIGA_CUDA(cudaSetDevice(index));
  int multiprocessors = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, index));
  for (size_t alike; !policies.empty(); policies = policies.subspan(alike)) {
    const PolicyShape shape(policies[0].net);
    for (alike = 1; alike < std::min<size_t>(policies.size(), FusedPolicies::kMost); ++alike)
      if (PolicyShape(policies[alike].net) != shape) break;
    with_shape(shape, [&]<int kIn, int kHidden>() {
      const auto together = policies.first(alike);
      if (!launch_few<kIn, kHidden>(together, multiprocessors, static_cast<cudaStream_t>(stream)))
        launch_each<kIn, kHidden>(together, multiprocessors, static_cast<cudaStream_t>(stream));
    });
  }
}

}  // namespace giga
