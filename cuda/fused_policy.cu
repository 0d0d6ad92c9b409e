#include "cuda/fused_policy.hpp"

#include <algorithm>

#include "cuda/check.cuh"
#include "cuda/few_rows_policy.cuh"
#include "cuda/streamed_policy.cuh"
#include "cuda/warp_rows_policy.cuh"

namespace giga {
namespace {

/// Shared memory of a block, for inputs and hidden layers padded to so many. A warp takes 32 rows at a time, 16 after
/// 16 through the network and all to their actions; of wide networks, whose weights leave less room, 16.
template <int kIn, int kHidden>
struct PolicyMemory {
  static constexpr int kWarps = 8, kThreads = kWarps * 32;
  static constexpr int kInStride = kIn + 8, kHiddenStride = kHidden + 8;
  static constexpr int kBlocks =
      kHidden <= FusedMlp::kNarrowHidden && kIn <= PolicyShape::kCrowdInput ? 2 : 1;  // on a multiprocessor
  static constexpr int kRows = kHidden <= FusedMlp::kBlockHidden ? 32 : 16;           // of a warp at a time
  static constexpr int kFetched =  // as many rows as registers have room for
      kHidden > FusedMlp::kNarrowHidden || kIn <= MediumTiles::kIn ? 16 : 8;
  alignas(16) float head[kWarps][kRows * kLogitStride];
  __half x[kWarps][16 * kInStride];
  __half weight1[kHidden * kInStride];
  __half weight2[kHidden * kHiddenStride];
  __half weight3[kHead * kHiddenStride];
  float bias1[kHidden], bias2[kHidden], bias3[kHead];
};

/// Blocks [.., groups].
template <int kIn, int kHidden>
__global__ void __launch_bounds__(PolicyMemory<kIn, kHidden>::kThreads, PolicyMemory<kIn, kHidden>::kBlocks)
    policy_kernel(const __grid_constant__ FusedPolicy k) {
  using Memory = PolicyMemory<kIn, kHidden>;
  constexpr int kHiddenStride = Memory::kHiddenStride, kWarps = Memory::kWarps, kThreads = Memory::kThreads;
  extern __shared__ __align__(16) char shared[];
  Memory& m = *reinterpret_cast<Memory*>(shared);
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
  const int64_t group = blockIdx.y, offset = group * k.group_stride;
  if (!k.group_plays(group)) return;
  const float* parameters = k.parameters + offset;
  load_matrix<kHidden, Memory::kInStride, kThreads>(parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<kHidden, kHiddenStride, kThreads>(parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_matrix<kHead, kHiddenStride, kThreads>(parameters + net.weight[2], output, hidden2, m.weight3);
  load_vector(parameters + net.bias[0], hidden1, m.bias1, kHidden);
  load_vector(parameters + net.bias[1], hidden2, m.bias2, kHidden);
  load_vector(parameters + net.bias[2], output, m.bias3, kHead);
  const FusedRows rows = k.rows(offset);
  const SampleGaussian continuous = k.gaussian(offset);
  __syncthreads();

  constexpr int kRows = Memory::kRows;
  const int64_t first_row = group * k.rows_per_group, step = static_cast<int64_t>(gridDim.x) * kWarps * kRows;
  for (int64_t at = (static_cast<int64_t>(blockIdx.x) * kWarps + warp) * kRows; at < k.rows_per_group; at += step) {
#pragma unroll 1
    for (int half = 0; half < kRows / 16; ++half) {
#pragma unroll
      for (int part = 0; part < 16; part += Memory::kFetched) {
        FetchedInputs<kIn, Memory::kFetched> inputs;
        inputs.fetch(rows, input, [&](int i) {
          const int64_t row = at + half * 16 + part + i;
          return row < k.rows_per_group ? first_row + row : -1;
        });
        inputs.template store<Memory::kInStride>(rows, input, m.x[warp] + part * Memory::kInStride);
      }
      __syncwarp();
      TileSums<kHidden / 8> y;
      y.start(m.bias1);
      y.template add_by_rows<kIn / 16>(Halves<Memory::kInStride>(m.x[warp], 0, 0),
                                       Halves<Memory::kInStride>(m.weight1, 0, 0));
      SlopesOf<kHidden / 8> slopes;
      activate(net.activation, y, slopes);
      Factor<kHidden / 16> features = y.factor();
      y.start(m.bias2);
      y.add_by_rows(features, Halves<kHiddenStride>(m.weight2, 0, 0));
      activate(net.activation, y, slopes);
      features = y.factor();
      TileSums<kHead / 8> head;
      head.start(m.bias3);
      head.add_by_rows(features, Halves<kHiddenStride>(m.weight3, 0, 0));
      head.each([&](float value, int r, int c) {
        if (c < kLogitStride) m.head[warp][(half * 16 + r) * kLogitStride + c] = value;
      });
      __syncwarp();
    }
    if (const int64_t row = at + lane; lane < kRows && row < k.rows_per_group) {
      const float* head = m.head[warp] + lane * kLogitStride;
      k.sample(first_row + row, head, continuous);
    }
    __syncwarp();  // the next rows take the same memory
  }
}

/// A policy with as many blocks as its rows are for, of which a multiprocessor has so many.
template <class Memory>
void launch_many(void (*kernel)(FusedPolicy), const FusedPolicy& policy, int blocks_at_once, int processors,
                 cudaStream_t stream) {
  static_assert(sizeof(Memory) <= kMostShared);
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(Memory)));
  constexpr int kBlockRows = Memory::kWarps * Memory::kRows;
  const int64_t wanted = (policy.rows_per_group + kBlockRows - 1) / kBlockRows;
  const int64_t share = std::max(1, processors * blocks_at_once / policy.groups);
  const dim3 blocks(static_cast<unsigned>(std::min(wanted, share)), static_cast<unsigned>(policy.groups));
  kernel<<<blocks, Memory::kWarps * 32, sizeof(Memory), stream>>>(policy);
  GIGA_CUDA(cudaGetLastError());
}

template <int kIn, int kHidden>
void launch_each(std::span<const FusedPolicy> policies, int processors, cudaStream_t stream) {
  for (const FusedPolicy& policy : policies) {
    if (policy.rows_per_group == 0) continue;
    if (streams(policy)) {
      launch_many<StreamedBlock>(streamed_policy_kernel, policy, 1, processors, stream);
      continue;
    }
    using Memory = PolicyMemory<kIn, kHidden>;
    static_assert(sizeof(Memory) <= kMostShared / Memory::kBlocks);
    launch_many<Memory>(policy_kernel<kIn, kHidden>, policy, Memory::kBlocks, processors, stream);
  }
}

template <int kIn, int kHidden, FewRows kWay>
void launch_few(const FusedPolicies& few, dim3 blocks, cudaStream_t stream) {
  using Block = FewRowsBlock<kIn, kHidden, kWay>;
  launch_kernel(few_rows_kernel<kIn, kHidden, kWay>, kWay == FewRows::one_tile_early, blocks, Block::kThreads,
                sizeof(Block), stream, {}, few);
}

/// A warp for each tile of 16 rows, if they find warps in few turns.
template <int kIn>
bool launch_warp_rows(const FusedPolicies& policies, int64_t tiles, int most_blocks, dim3 of, bool behind_step,
                      cudaStream_t stream) {
  using Block = WarpRowsBlock<kIn>;
  static_assert(sizeof(Block) <= kMostShared);
  const int64_t wanted = (tiles + Block::kWarps - 1) / Block::kWarps;
  if (wanted > int64_t{Block::kMostTiles} * most_blocks) return false;
  const auto kernel = warp_rows_kernel<kIn>;
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(Block)));
  of.x = static_cast<unsigned>(std::min<int64_t>(wanted, most_blocks));
  launch_kernel(kernel, behind_step, of, Block::kThreads, sizeof(Block), stream, {}, policies);
  return true;
}

/// All in one launch, if they have so few rows (none: nothing is launched); else false.
template <int kIn, int kHidden>
bool launch_few(std::span<const FusedPolicy> policies, bool behind_step, int processors, cudaStream_t stream) {
  if constexpr (kHidden > FusedMlp::kBlockHidden) {
    return false;
  } else {
    FusedPolicies few{};
    int64_t tiles = 0;
    int groups = 0, all_groups = 0, n = 0;
    for (const FusedPolicy& policy : policies) {
      few.policy[n++] = policy;
      tiles = std::max(tiles, (policy.rows_per_group + 15) / 16);
      groups = std::max(groups, policy.groups);
      if (!policy.plays) all_groups += policy.groups;  // as a rule, none of the others plays
    }
    all_groups = std::max(all_groups, groups);
    if (tiles == 0) return true;
    dim3 blocks(1, static_cast<unsigned>(groups), static_cast<unsigned>(n));
    if constexpr (kHidden <= FusedMlp::kNarrowHidden)
      if (tiles <= processors * FewRowsBlock<kIn, kHidden, FewRows::one_tile>::kBlocks / all_groups) {
        blocks.x = static_cast<unsigned>(tiles);
        behind_step ? launch_few<kIn, kHidden, FewRows::one_tile_early>(few, blocks, stream)
                    : launch_few<kIn, kHidden, FewRows::one_tile>(few, blocks, stream);
        return true;
      }
    if constexpr (kIn == PolicyShape::kCrowdInput) {
      static_assert(kHidden == FusedMlp::kNarrowHidden);
      return launch_warp_rows<kIn>(few, tiles, processors / all_groups, blocks, behind_step, stream);
    } else {
      using Block = FewRowsBlock<kIn, kHidden, FewRows::many_tiles>;
      const int64_t share = processors * Block::kBlocks / all_groups;
      if (tiles > share * Block::kMostTiles) return false;
      blocks.x = static_cast<unsigned>(std::min(tiles, share));
      launch_few<kIn, kHidden, FewRows::many_tiles>(few, blocks, stream);
      return true;
    }
  }
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

void launch_fused_policies(std::span<const FusedPolicy> policies, bool behind_step, int index, void* stream) {
  static_assert(FusedPolicy::kWideInput == NarrowTiles::kIn && PolicyShape::kInputs[0] == NarrowTiles::kIn &&
                PolicyShape::kInputs[1] == MediumTiles::kIn && PolicyShape::kInputs[3] == WideTiles::kIn);
  for (const FusedPolicy& policy : policies)
    GIGA_CHECK(FusedPolicy::serves(policy.net), "no fused policy for this network");
  GIGA_CUDA(cudaSetDevice(index));
  const int processors = multiprocessors(index);
  for (size_t alike; !policies.empty(); policies = policies.subspan(alike)) {
    const PolicyShape shape(policies[0].net);
    for (alike = 1; alike < std::min<size_t>(policies.size(), FusedPolicies::kMost); ++alike)
      if (PolicyShape(policies[alike].net) != shape) break;
    with_shape(shape, [&]<int kIn, int kHidden>() {
      const auto together = policies.first(alike);
      if (!launch_few<kIn, kHidden>(together, behind_step, processors, static_cast<cudaStream_t>(stream)))
        launch_each<kIn, kHidden>(together, processors, static_cast<cudaStream_t>(stream));
    });
  }
}

}  // namespace giga
