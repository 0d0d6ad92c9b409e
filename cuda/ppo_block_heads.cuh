// What the fused kernels of networks with 65 to 256 numbers in a hidden layer have in common behind the last of these
// layers: an actor's head with its loss, and a critic's value with its gradient by the features.
#pragma once

#include "cuda/ppo_block_tiles.cuh"
#include "cuda/ppo_policy_loss.cuh"
#include "cuda/ppo_value_loss.cuh"

namespace giga {

/// A warp's part of an actor's head, of eight warps: two of them compute the same 16 rows, and each the loss of 8: four
/// lanes have one.
struct HeadPart {
  TileLane lane;
  int warp = static_cast<int>(threadIdx.x) / 32;
  int rows = warp % 4 * 16, loss_row = rows + lane.group + warp / 4 * 8;
};

/// From the features of a tile [64, hidden] in shared memory to their logits or means, the loss, and its gradient in
/// m.head.
template <class S, class Memory>
__device__ __forceinline__ void head_gradient(const FusedActor& k, Memory& m, const HeadPart& part,
                                              const __half* hidden2, float (&sums)[kLaneSums]) {
  BlockSums<1, kHead / 8> logits;
  logits.start(m.bias3);
  logits.template add_by_rows<S::kDepth>(Halves<S::kStride>(hidden2, part.rows, 0),
                                         Halves<S::kStride>(m.weight3, 0, 0));
  QuadLogits of;
  of.pair = part.lane.pair;
#pragma unroll
  for (int i = 0; i < QuadLogits::kNumbers; ++i) {
    const float(&c)[4] = logits.part[0].c[i / 2];
    of.x[i] = part.warp < 4 ? c[i % 2] : c[2 + i % 2];
  }
  policy_gradient(k, m, m.row[part.loss_row], of, sums);
  uint32_t* to = reinterpret_cast<uint32_t*>(m.head + part.loss_row * kHeadStride + part.lane.pair);
#pragma unroll
  for (int j = 0; j < kHead / 8; ++j) to[j * 4] = half_pair(of.x[2 * j], of.x[2 * j + 1]);
}

/// A value's weights [hidden] in shared memory: of the own features and, with kTeam, of the team's mean.
template <bool kTeam>
struct ValueWeights {
  const float *own, *team;
};

/// A warp's features times these, added up over its columns, in m.dots [own or team, row, warps of columns].
template <class S, bool kTeam, class Memory>
__device__ __forceinline__ void keep_dots(const LayerSums<S>& features, const BlockPart<S>& part, const TileLane& lane,
                                          const ValueWeights<kTeam>& weights, Memory& m) {
#pragma unroll
  for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
    for (int d = 0; d < (kTeam ? 2 : 1); ++d) {
      float dots[2] = {};
      const float* weight = d == 0 ? weights.own : weights.team;
#pragma unroll
      for (int j = 0; j < S::kTiles; ++j) {
        const float2 w = *reinterpret_cast<const float2*>(weight + part.column + j * 8 + lane.pair);
        const float(&x)[4] = features.part[t].c[j];
#pragma unroll
        for (int i = 0; i < 2; ++i) dots[i] += x[2 * i] * w.x + x[2 * i + 1] * w.y;
      }
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        dots[i] += __shfl_xor_sync(0xFFFFFFFFu, dots[i], 1);
        dots[i] += __shfl_xor_sync(0xFFFFFFFFu, dots[i], 2);
        if (lane.pair == 0) m.dots[d][part.row + t * 16 + lane.group + i * 8][part.column / 32] = dots[i];
      }
    }
}

/// The gradient by a warp's features. by(t, i): that by the own part of the value of row t * 16 + group + i * 8, and by
/// the team's.
template <class S, bool kTeam, class By>
__device__ __forceinline__ void feature_gradient(LayerSums<S>& gradient, const BlockPart<S>& part, const TileLane& lane,
                                                 const ValueWeights<kTeam>& weights, By&& by) {
#pragma unroll
  for (int j = 0; j < S::kTiles; ++j) {
    const int column = part.column + j * 8 + lane.pair;
    const float2 own = *reinterpret_cast<const float2*>(weights.own + column);
    float2 team{0, 0};
    if constexpr (kTeam) team = *reinterpret_cast<const float2*>(weights.team + column);
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        const float2 of_row = by(t, i);
        gradient.part[t].c[j][2 * i] = of_row.x * own.x + of_row.y * team.x;
        gradient.part[t].c[j][2 * i + 1] = of_row.x * own.y + of_row.y * team.y;
      }
  }
}

}  // namespace giga
