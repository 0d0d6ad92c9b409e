// The fused policy of many rows of narrow networks that read many numbers, as those of crowds: a warp takes 32 rows at
// a time through the network, and those that it takes next are on their way to shared memory meanwhile. Each weight
// that a warp reads serves both of its tiles of 16 rows: reading them is what a multiprocessor has most to do of
// otherwise.
#pragma once

#include "cuda/async_copy.cuh"
#include "cuda/fused_policy.hpp"
#include "cuda/ppo_tiles.cuh"

namespace giga {

/// Shared memory of a block.
struct StreamedBlock {
  static constexpr int kIn =
      144;  // inputs, padded: for more there is no room, and fewer are as fast as in policy_kernel
  static constexpr int kLeastInput = 97;
  static constexpr int kWarps = 8, kThreads = kWarps * 32, kRows = 32;  // kRows: of a warp at a time
  // Numbers from one row to the next: eight rows, of which a lane each reads two numbers, lie on different banks.
  static constexpr int kPitch = kIn + 8, kInStride = kIn + 8;
  alignas(16) float rows[kWarps][kRows * kPitch];
  alignas(16) float head[kWarps][kRows * kLogitStride];
  alignas(16) __half weight1[kHidden * kInStride];
  alignas(16) __half weight2[kHidden * kHiddenStride];
  alignas(16) __half weight3[kHead * kHiddenStride];
  float bias1[kHidden], bias2[kHidden], bias3[kHead];
};

/// Whether the kernel serves a policy: rows are copied 16 bytes at a time, as they are. Where they begin at 16 bytes
/// and lie a multiple of these apart, none ends between them.
inline bool streams(const FusedPolicy& k) {
  return k.net.is_narrow() && k.net.width[0] >= StreamedBlock::kLeastInput && k.net.width[0] <= StreamedBlock::kIn &&
         (reinterpret_cast<uintptr_t>(k.obs) % 16 | static_cast<uintptr_t>(k.obs_stride % 4)) == 0 && !k.obs_mean;
}

/// 32 rows as two tiles, of which each takes the same weights.
template <int kTiles>
struct TilePair {
  TileSums<kTiles> of[2];

  __device__ explicit TilePair(const float* bias) {
    of[0].start(bias);
    of[1] = of[0];
  }
  /// += a b^T, one tile of the depth; b [8 kTiles, 16] in shared memory.
  template <int kStride>
  __device__ void add(const uint32_t (&a0)[4], const uint32_t (&a1)[4], uint32_t b) {
#pragma unroll
    for (int j = 0; j < kTiles; j += 2) {
      uint32_t by[4];
      load(by, b + apart<kStride>(j * 8, 0));
      multiply_add(of[0].c[j], a0, by[0], by[1]);
      multiply_add(of[1].c[j], a1, by[0], by[1]);
      multiply_add(of[0].c[j + 1], a0, by[2], by[3]);
      multiply_add(of[1].c[j + 1], a1, by[2], by[3]);
    }
  }
  template <int kDepth, int kStride>
  __device__ void add(const Factor<kDepth> (&a)[2], const __half* weight) {
    const uint32_t from = Halves<kStride>(weight, 0, 0).beside();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) add<kStride>(a[0].k[k], a[1].k[k], from + apart<kStride>(0, k * 16));
  }
  /// As the left factor of the next layer.
  __device__ void activate_to(Activation activation, Factor<kTiles / 2> (&to)[2]) {
#pragma unroll
    for (int t = 0; t < 2; ++t) {
      SlopesOf<kTiles> slopes;
      activate(activation, of[t], slopes);
      to[t] = of[t].factor();
    }
  }
};

/// A warp's rows in shared memory.
struct StreamedRows {
  static constexpr int kIn = StreamedBlock::kIn, kPitch = StreamedBlock::kPitch;
  float* at;  // [32, kPitch]
  int input;  // numbers of a row that are read

  /// Zeros behind what is copied, to the end of the last tile.
  __device__ void clear_ends(int copied) const {
    const int lane = static_cast<int>(threadIdx.x) % 32;
    for (int c = copied; c < kIn; ++c) at[lane * kPitch + c] = 0;
  }
  /// Begins to copy so many rows, at most 32, each in so many pieces of 4 numbers: a row by all lanes, and what is
  /// left of eight rows once more.
  __device__ void copy(const float* from, int64_t stride, int pieces, int rows) const {
    static_assert(kIn <= 4 * (32 + 4));
    const int lane = static_cast<int>(threadIdx.x) % 32;
#pragma unroll 4
    for (int row = 0; row < rows; ++row)
      if (lane < pieces) copy_16_bytes(at + row * kPitch + lane * 4, from + row * stride + lane * 4);
    if (const int piece = 32 + lane % 4; piece < pieces)
      for (int row = lane / 4; row < rows; row += 8)
        copy_16_bytes(at + row * kPitch + piece * 4, from + row * stride + piece * 4);
  }
  /// 16 numbers of the 16 rows of a tile, from column k * 16 on, as a left factor. What is copied beyond those that are
  /// read counts as zero.
  __device__ void factor(int tile, int k, uint32_t (&a)[4]) const {
    const TileLane lane;
    const int column = k * 16 + lane.pair;
    const float* from = at + (tile * 16 + lane.group) * kPitch + column;
    const bool whole = (k + 1) * 16 <= input;
#pragma unroll
    for (int j = 0; j < 4; ++j) {
      float2 two = *reinterpret_cast<const float2*>(from + j % 2 * 8 * kPitch + j / 2 * 8);
      if (!whole) {
        const int c = column + j / 2 * 8;
        two = {c < input ? two.x : 0.0f, c + 1 < input ? two.y : 0.0f};
      }
      a[j] = half_pair(two.x, two.y);
    }
  }
};

/// Blocks [.., groups].
__global__ void __launch_bounds__(StreamedBlock::kThreads, 1)
    streamed_policy_kernel(const __grid_constant__ FusedPolicy k) {
  using Block = StreamedBlock;
  constexpr int kIn = Block::kIn, kRows = Block::kRows;
  extern __shared__ __align__(16) char shared[];
  Block& m = *reinterpret_cast<Block*>(shared);
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
  const int64_t group = blockIdx.y, offset = group * k.group_stride, first_row = group * k.rows_per_group;
  if (!k.group_plays(group)) return;
  const int64_t step = static_cast<int64_t>(gridDim.x) * Block::kWarps * kRows;
  int64_t at = (static_cast<int64_t>(blockIdx.x) * Block::kWarps + warp) * kRows;

  const int pieces = (input + 3) / 4;
  const StreamedRows rows{m.rows[warp], input};
  const auto copy = [&](int64_t from) {
    const int64_t left = k.rows_per_group - from;
    if (left > 0)
      rows.copy(k.obs + (first_row + from) * k.obs_stride, k.obs_stride, pieces, left < kRows ? left : kRows);
  };
  copy(at);
  rows.clear_ends(pieces * 4);
  const float* parameters = k.parameters + offset;
  load_matrix<kHidden, Block::kInStride, Block::kThreads>(parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<kHidden, kHiddenStride, Block::kThreads>(parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_matrix<kHead, kHiddenStride, Block::kThreads>(parameters + net.weight[2], output, hidden2, m.weight3);
  load_vector(parameters + net.bias[0], hidden1, m.bias1, kHidden);
  load_vector(parameters + net.bias[1], hidden2, m.bias2, kHidden);
  load_vector(parameters + net.bias[2], output, m.bias3, kHead);
  const SampleGaussian continuous = k.gaussian(offset);
  __syncthreads();

#pragma unroll 1
  for (; at < k.rows_per_group; at += step) {
    wait_for_copies();
    __syncwarp();
    Factor<kHiddenDepth> features[2];
    {
      TilePair<kHiddenTiles> y(m.bias1);
      const uint32_t from = Halves<Block::kInStride>(m.weight1, 0, 0).beside();
#pragma unroll
      for (int d = 0; d < kIn / 16; ++d) {
        uint32_t a0[4], a1[4];
        rows.factor(0, d, a0);
        rows.factor(1, d, a1);
        y.template add<Block::kInStride>(a0, a1, from + apart<Block::kInStride>(0, d * 16));
      }
      __syncwarp();  // all have read the rows
      copy(at + step);
      y.activate_to(net.activation, features);
    }
    {
      TilePair<kHiddenTiles> y(m.bias2);
      y.template add<kHiddenDepth, kHiddenStride>(features, m.weight2);
      y.activate_to(net.activation, features);
    }
    TilePair<kHead / 8> head(m.bias3);
    head.template add<kHiddenDepth, kHiddenStride>(features, m.weight3);
#pragma unroll
    for (int t = 0; t < 2; ++t)
      head.of[t].each([&](float value, int r, int c) {
        if (c < kLogitStride) m.head[warp][(t * 16 + r) * kLogitStride + c] = value;
      });
    __syncwarp();
    if (const int64_t row = at + lane; row < k.rows_per_group) {
      const float* logits = m.head[warp] + lane * kLogitStride;
      k.sample(first_row + row, logits, continuous);
    }
    __syncwarp();  // the next ones take the same memory
  }
}

}  // namespace giga
