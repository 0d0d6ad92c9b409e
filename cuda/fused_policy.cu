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
      kHidden <= FusedMlp::kNarrowHidden && kIn <= MediumTiles::kIn ? 2 : 1;  // on a multiprocessor
  static constexpr int kRows = kHidden <= FusedMlp::kBlockHidden ? 32 : 16;   // of a warp at a time
  alignas(16) float head[kWarps][kRows * kLogitStride];
  __half x[kWarps][16 * kInStride];
  __half weight1[kHidden * kInStride];
  __half weight2[kHidden * kHiddenStride];
  __half weight3[kHead * kHiddenStride];
  float bias1[kHidden], bias2[kHidden], bias3[kHead];
};

/// Blocks [.., groups].
template <int kIn, int kHidden>
__global__ void __launch_bounds__(kThreads, PolicyMemory<kIn, kHidden>::kBlocks)
    policy_kernel(const __grid_constant__ FusedPolicy k) {
  using Memory = PolicyMemory<kIn, kHidden>;
  constexpr int kHiddenStride = Memory::kHiddenStride;
  extern __shared__ __align__(16) char shared[];
  Memory& m = *reinterpret_cast<Memory*>(shared);
  const int lane_number = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  const TileLane lane;
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
  const int64_t group = blockIdx.y, offset = group * k.group_stride;
  const float* parameters = k.parameters + offset;
  load_matrix<kHidden, Memory::kInStride, kThreads>(parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<kHidden, kHiddenStride, kThreads>(parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_matrix<kHead, kHiddenStride, kThreads>(parameters + net.weight[2], output, hidden2, m.weight3);
  load_vector(parameters + net.bias[0], hidden1, m.bias1, kHidden);
  load_vector(parameters + net.bias[1], hidden2, m.bias2, kHidden);
  load_vector(parameters + net.bias[2], output, m.bias3, kHead);
  const FusedRows rows{.obs = k.obs,
                       .obs_stride = k.obs_stride,
                       .obs_mean = k.obs_mean ? k.obs_mean + offset : nullptr,
                       .obs_std = k.obs_mean ? k.obs_std + offset : nullptr,
                       .obs_limit = k.obs_limit};
  SampleGaussian continuous = k.continuous;
  if (k.actions == ActionKind::continuous) continuous.log_std += offset;
  __syncthreads();

  constexpr int kRows = Memory::kRows;
  const int64_t first_row = group * k.rows_per_group, step = static_cast<int64_t>(gridDim.x) * kWarps * kRows;
  for (int64_t at = (static_cast<int64_t>(blockIdx.x) * kWarps + warp) * kRows; at < k.rows_per_group; at += step) {
#pragma unroll 1
    for (int half = 0; half < kRows / 16; ++half) {
      FetchedInputs<kIn> inputs;
      inputs.fetch(rows, input, [&](int i) {
        const int64_t row = at + half * 16 + i;
        return row < k.rows_per_group ? first_row + row : -1;
      });
      inputs.template store<Memory::kInStride>(rows, input, m.x[warp]);
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
    if (const int64_t row = at + lane_number; lane_number < kRows && row < k.rows_per_group) {
      const float* head = m.head[warp] + lane_number * kLogitStride;
      if (k.actions == ActionKind::discrete)
        k.discrete.sample(first_row + row, head);
      else
        continuous.sample(first_row + row, head);
    }
    __syncwarp();  // the next rows take the same memory
  }
}

template <int kIn, int kHidden>
void launch(const FusedPolicy& policy, int index, void* stream) {
  static_assert(sizeof(PolicyMemory<kIn, kHidden>) <= kMostShared / PolicyMemory<kIn, kHidden>::kBlocks);
  GIGA_CUDA(cudaFuncSetAttribute(policy_kernel<kIn, kHidden>, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                 sizeof(PolicyMemory<kIn, kHidden>)));
  int multiprocessors = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, index));
  constexpr int kBlockRows = kWarps * PolicyMemory<kIn, kHidden>::kRows;
  const int64_t wanted = (policy.rows_per_group + kBlockRows - 1) / kBlockRows;
  const int64_t share = std::max(1, multiprocessors * PolicyMemory<kIn, kHidden>::kBlocks / policy.groups);
  const dim3 blocks(static_cast<unsigned>(std::min(wanted, share)), static_cast<unsigned>(policy.groups));
  policy_kernel<kIn, kHidden>
      <<<blocks, kThreads, sizeof(PolicyMemory<kIn, kHidden>), static_cast<cudaStream_t>(stream)>>>(policy);
  GIGA_CUDA(cudaGetLastError());
}
template <int kHidden>
void launch(const FusedPolicy& policy, int index, void* stream) {
  const int input = policy.net.width[0];
  if (input <= NarrowTiles::kIn) return launch<NarrowTiles::kIn, kHidden>(policy, index, stream);
  if constexpr (kHidden <= FusedMlp::kBlockHidden)
    input <= MediumTiles::kIn ? launch<MediumTiles::kIn, kHidden>(policy, index, stream)
                              : launch<WideTiles::kIn, kHidden>(policy, index, stream);
}

}  // namespace

void launch_fused_policy(const FusedPolicy& policy, int index, void* stream) {
  if (policy.rows_per_group == 0) return;
  GIGA_CUDA(cudaSetDevice(index));
  static_assert(FusedPolicy::kWideInput == NarrowTiles::kIn);
  GIGA_CHECK(FusedPolicy::serves(policy.net), "no fused policy for this network");
  if (policy.net.is_narrow()) return launch<FusedMlp::kNarrowHidden>(policy, index, stream);
  if (!policy.net.is_wide()) return launch<FusedMlp::kBlockHidden>(policy, index, stream);
  launch<FusedMlp::kHidden>(policy, index, stream);
}

}  // namespace giga
