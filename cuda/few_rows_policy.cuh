// The fused policy of few rows, where what counts is how long one row takes: the warps of a block take the same 16 rows
// through a layer together, each some of its numbers. A warp's weights come from global memory once, all at a time, and
// stay in its registers. A row takes few instructions: what a step runs once is found in no cache for instructions.
#pragma once

#include "cuda/early_launch.cuh"
#include "cuda/fused_policy.hpp"
#include "cuda/lane_logits.cuh"
#include "cuda/ppo_tiles.cuh"

namespace giga {

/// A warp's 8 or 16 numbers of a layer: their weights, as a right factor, and biases.
template <int kDepth, int kNumbers>
struct LayerOfWarp {
  static constexpr int kTiles = kNumbers / 8;
  uint32_t weight[kDepth][2 * kTiles];
  float2 bias[kTiles];

  /// Numbers from `first` on, of a matrix [out, in]; zeros beyond.
  __device__ LayerOfWarp(const float* from, const float* biases, int first, int out, int in) {
    const TileLane lane;
    // Decided once, not for each number.
    if ((reinterpret_cast<uintptr_t>(from) % 8 | static_cast<uintptr_t>(in % 2)) == 0)
      fetch(from, first, out, in, [](const float* at, bool) { return __ldg(reinterpret_cast<const float2*>(at)); });
    else
      fetch(from, first, out, in, [](const float* at, bool second) {
        return float2{__ldg(at), second ? __ldg(at + 1) : 0.0f};
      });
#pragma unroll
    for (int j = 0; j < kTiles; ++j) {
      const int b = first + j * 8 + lane.pair;
      bias[j] = {b < out ? __ldg(biases + b) : 0.0f, b + 1 < out ? __ldg(biases + b + 1) : 0.0f};
    }
  }
  /// Of 16 rows in shared memory. Where the warp has 8 numbers, the other tile is not there, and the compiler drops
  /// what is done to it.
  template <int kStride>
  __device__ TileSums<2> of(const __half* rows) const {
    TileSums<2> y;
    y.clear();
#pragma unroll
    for (int j = 0; j < kTiles; ++j) {
      y.c[j][0] = y.c[j][2] = bias[j].x;
      y.c[j][1] = y.c[j][3] = bias[j].y;
    }
    const uint32_t left = Halves<kStride>(rows, 0, 0).below();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) {
      uint32_t a[4];
      load(a, left + apart<kStride>(0, k * 16));
#pragma unroll
      for (int j = 0; j < kTiles; ++j) multiply_add(y.c[j], a, weight[k][2 * j], weight[k][2 * j + 1]);
    }
    return y;
  }

 private:
  /// two(at, whether there is a second one): the numbers from `at` on.
  template <class Two>
  __device__ void fetch(const float* from, int first, int out, int in, Two&& two) {
    const TileLane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j) {
      const int o = first + j * 8 + lane.group, left = o < out ? in - lane.pair : 0;
      const float* row = from + o * in + lane.pair;
      asm("" : "+l"(row));  // in a register: else ptxas computes it anew for each number
#pragma unroll
      for (int k = 0; k < 2 * kDepth; ++k) {
        float2 x{0, 0};
        if (k * 8 < left) x = two(row + k * 8, k * 8 + 1 < left);
        weight[k / 2][j * 2 + k % 2] = half_pair(x.x, x.y);
      }
    }
  }
};

/// Of a layer's numbers that a warp has at a time: half as many take half as long, where a block has 16 rows once;
/// where it has more, as many warps wait for each other at each layer (5 vs 5 with 8,192 worlds: 741 M instead of 844
/// M).
enum class FewRows {
  many_tiles,     ///< 16 numbers
  one_tile,       ///< 8
  one_tile_early  ///< 8, launched early behind the step that writes the rows
};

template <int kIn, int kHidden, FewRows kWay>
struct FewRowsBlock {
  static constexpr int kNumbers = kWay == FewRows::many_tiles ? 16 : 8;  // of a warp
  static constexpr int kWarps = kHidden / kNumbers, kThreads = kWarps * 32, kRowsOfWarp = 16 / kWarps;
  // On a multiprocessor: as many as registers have room for.
  static constexpr int kBlocks = kHidden > FusedMlp::kNarrowHidden                   ? 1
                                 : kNumbers == 16 && kIn <= PolicyShape::kCrowdInput ? 3
                                                                                     : 2;
  // Of 16 rows, one after the other. More rows have warps of their own: from about 26 on they are the faster.
  static constexpr int kMostTiles = 20;
  static constexpr int kInStride = kIn + 8, kHiddenStride = kHidden + 8;
  alignas(16) __half x[16 * kInStride];
  alignas(16) __half hidden[2][16 * kHiddenStride];
  alignas(16) float head[16 * kLogitStride];
  float uniform[16];
};

/// A warp's numbers of the 16 rows of a layer, to shared memory.
template <int kNumbers>
__device__ void store_numbers(const TileSums<2>& y, __half* to, int stride) {
  if constexpr (kNumbers == 16) {
    store(y.factor(), to, stride);
  } else {
    const TileLane lane;
#pragma unroll
    for (int half = 0; half < 2; ++half)
      *reinterpret_cast<uint32_t*>(to + (lane.group + half * 8) * stride + lane.pair) =
          half_pair(y.c[0][2 * half], y.c[0][2 * half + 1]);
  }
}

/// Several policies in one launch. Blocks [.., most groups of a policy, policies].
template <int kIn, int kHidden, FewRows kWay>
__global__ void __launch_bounds__(FewRowsBlock<kIn, kHidden, kWay>::kThreads, FewRowsBlock<kIn, kHidden, kWay>::kBlocks)
    few_rows_kernel(const __grid_constant__ FusedPolicies policies) {
  using Block = FewRowsBlock<kIn, kHidden, kWay>;
  constexpr int kNumbers = Block::kNumbers;
  constexpr bool kEarly = kWay == FewRows::one_tile_early;
  extern __shared__ __align__(16) char shared[];
  Block& m = *reinterpret_cast<Block*>(shared);
  const FusedPolicy& k = policies.policy[blockIdx.z];
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  const int64_t step = static_cast<int64_t>(gridDim.x) * 16;
  int64_t at = static_cast<int64_t>(blockIdx.x) * 16;
  // A kernel that is launched early behind this one relies on what this one waits for, with nothing to do too.
  if (static_cast<int>(blockIdx.y) >= k.groups || at >= k.rows_per_group || !k.group_plays(blockIdx.y))
    return wait_for_last();
  const FusedMlp& net = k.net;
  const int64_t offset = blockIdx.y * k.group_stride, first_row = blockIdx.y * k.rows_per_group;
  const FusedRows rows = k.rows(offset);
  const int first = warp * Block::kRowsOfWarp;
  FetchedInputs<kIn, Block::kRowsOfWarp> inputs;
  const auto fetch = [&](int64_t from) {
    inputs.template fetch<kEarly>(rows, net.width[0], [&](int i) {
      const int64_t row = from + first + i;
      return row < k.rows_per_group ? first_row + row : -1;
    });
  };
  if constexpr (!kEarly) fetch(at);
  const bool discrete = k.actions == ActionKind::discrete;
  const auto layer = [&]<int kDepth>(int l) {
    return LayerOfWarp<kDepth, kNumbers>(k.parameters + offset + net.weight[l], k.parameters + offset + net.bias[l],
                                         warp * kNumbers, net.width[l + 1], net.width[l]);
  };
  const auto layer1 = layer.template operator()<kIn / 16>(0);
  const auto layer2 = layer.template operator()<kHidden / 16>(1);
  const auto layer3 = layer.template operator()<kHidden / 16>(2);
  if constexpr (kEarly) {
    wait_for_last();
    fetch(at);
  }
#pragma unroll 1
  for (; at < k.rows_per_group; at += step) {
    inputs.template store<Block::kInStride>(rows, net.width[0], m.x + first * Block::kInStride);
    fetch(at + step);  // on their way meanwhile
    __syncthreads();
    SlopesOf<2> slopes;
    TileSums<2> y = layer1.template of<Block::kInStride>(m.x);
    activate(net.activation, y, slopes);
    store_numbers<kNumbers>(y, m.hidden[0] + warp * kNumbers, Block::kHiddenStride);
    __syncthreads();
    y = layer2.template of<Block::kHiddenStride>(m.hidden[0]);
    activate(net.activation, y, slopes);
    store_numbers<kNumbers>(y, m.hidden[1] + warp * kNumbers, Block::kHiddenStride);
    __syncthreads();
    if (warp < kHead / kNumbers)
      layer3.template of<Block::kHiddenStride>(m.hidden[1]).each([&](float value, int r, int c) {
        if (c < kNumbers && warp * kNumbers + c < kLogitStride) m.head[r * kLogitStride + warp * kNumbers + c] = value;
      });
    else if (warp == Block::kWarps - 1 && lane < 16 && at + lane < k.rows_per_group && discrete)
      m.uniform[lane] = k.discrete.uniform(first_row + at + lane);
    __syncthreads();
    constexpr int kLogitLanes = 4;
    // Of a row four lanes choose a discrete action, one the continuous one.
    const int row = discrete ? static_cast<int>(threadIdx.x) / kLogitLanes : static_cast<int>(threadIdx.x);
    if (warp * 32 >= (discrete ? 16 * kLogitLanes : 16)) continue;
    const bool lives = row < 16 && at + row < k.rows_per_group;
    if (discrete) {
      const auto choice =
          k.discrete.choose(LaneLogits<kLogitLanes>(m.head + row * kLogitStride), [&] { return m.uniform[row]; });
      if (lives && lane % kLogitLanes == 0) k.discrete.keep(first_row + at + row, choice);
    } else if (lives) {
      k.gaussian(offset).sample(first_row + at + row, m.head + row * kLogitStride);
    }
  }
}

}  // namespace giga
