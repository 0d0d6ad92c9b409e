// What the rows of a state read alike, in critics of the true state: the means of codes and the world, once for each
// state through the second layer, back, and to the gradient of that layer's weight.
//
// Going back, G = sum(d) over the rows of a state has all that this part needs: d_mean = G T for a team's weight T, of
// which each living agent has its share, and d_T = G^T mean. The registers do not hold d_T beside the other gradients,
// so means, worlds and G of all states of a block are kept, and make it after the last tile (KeptTrueStates).
#pragma once

#include "cuda/ppo_state_critic_memory.cuh"

namespace giga {

/// A warp's part of the gradient of a weight [kHidden, ..], a quarter of its rows and kColumns of its columns.
template <class S, int kColumns>
using StateWeightGradient = WeightGradientOf<BlockSums<S::kRowTiles, kColumns / 8>>;

/// The mean codes of both teams' living; `kept` [2][stride] words, if any, from the tile's first state on.
template <class S>
__device__ void take_means(const StateTiles& tiles, StateMemory<S>& m, uint32_t* kept, int64_t stride) {
  for (int i = static_cast<int>(threadIdx.x); i < 2 * tiles.states * S::kPairs; i += S::kThreads) {
    const int pair = i % S::kPairs, team = i / S::kPairs >= tiles.states ? 1 : 0;
    const int s = i / S::kPairs - team * tiles.states, n = team == 0 ? tiles.n[0] : tiles.n[1];
    float2 sum{0, 0};
    for (int r = s * n; r < s * n + n; ++r) {
      const float share = m.share[team][r];
      const float2 x = __half22float2(*reinterpret_cast<const __half2*>(m.codes[team] + r * S::kStride + 2 * pair));
      sum.x += share * x.x;
      sum.y += share * x.y;
    }
    const uint32_t both = half_pair(sum.x, sum.y);
    *reinterpret_cast<uint32_t*>(m.mean[team] + s * S::kStride + 2 * pair) = both;
    if (kept) kept[team * stride + s * S::kPairs + pair] = both;
  }
}

/// The sums of the gradient over the rows of each state.
template <class S>
__device__ void take_totals(const StateTiles& tiles, StateMemory<S>& m, uint32_t* kept) {
  for (int i = static_cast<int>(threadIdx.x); i < tiles.states * S::kPairs; i += S::kThreads) {
    const int pair = i % S::kPairs, s = i / S::kPairs, n = tiles.n[0];
    float2 sum{0, 0};
    for (int r = s * n; r < s * n + n; ++r) {
      const float2 x = __half22float2(*reinterpret_cast<const __half2*>(m.gradient + r * S::kStride + 2 * pair));
      sum.x += x.x;
      sum.y += x.y;
    }
    const uint32_t both = half_pair(sum.x, sum.y);
    *reinterpret_cast<uint32_t*>(m.totals + s * S::kStride + 2 * pair) = both;
    kept[s * S::kPairs + pair] = both;
  }
}

/// 16 columns of a product [16 states, ..], to shared memory.
template <class S>
__device__ void keep_product(TileSums<2>& product, int column, float* to) {
  const TileLane lane;
#pragma unroll
  for (int j = 0; j < 2; ++j)
#pragma unroll
    for (int i = 0; i < 2; ++i)
      *reinterpret_cast<float2*>(to + (lane.group + i * 8) * S::kProductStride + column + j * 8 + lane.pair) = {
          product.c[j][2 * i], product.c[j][2 * i + 1]};
}

/// What the states add to the sums of their rows.
template <class S>
__device__ void multiply_states(StateMemory<S>& m) {
  for (int p = static_cast<int>(threadIdx.x) / 32; p < S::kHidden / 16; p += S::kWarps) {
    TileSums<2> product;
    product.clear();
    for (int team = 0; team < 2; ++team)
      product.template add_by_rows<S::kDepth>(Halves<S::kStride>(m.mean[team], 0, 0),
                                              Halves<S::kStride>(m.of_mean[team], p * 16, 0));
    product.template add_by_rows<S::kWorld / 16>(Halves<S::kWorldStride>(m.world, 0, 0),
                                                 Halves<S::kWorldStride>(m.of_world, p * 16, 0));
    keep_product<S>(product, p * 16, m.products[0]);
  }
}
/// The gradients by both teams' means.
template <class S>
__device__ void multiply_totals(StateMemory<S>& m) {
  constexpr int kParts = S::kHidden / 16;
  for (int p = static_cast<int>(threadIdx.x) / 32; p < 2 * kParts; p += S::kWarps) {
    const int team = p / kParts, column = p % kParts * 16;
    TileSums<2> product;
    product.clear();
    product.template add_by_columns<S::kDepth>(Halves<S::kStride>(m.totals, 0, 0),
                                               Halves<S::kStride>(m.of_mean[team], 0, column));
    keep_product<S>(product, column, m.products[team]);
  }
}

/// The gradient by the sums of the others' first layer, in the place of their slopes.
template <class S>
__device__ void take_others_gradient(StateMemory<S>& m) {
#pragma unroll 4
  for (int i = static_cast<int>(threadIdx.x); i < S::kRows * S::kPairs; i += S::kThreads) {
    const int pair = i % S::kPairs, row = i / S::kPairs, state = m.state[kOtherTeam][row];
    const float share = m.share[kOtherTeam][row];
    float2 by{0, 0};
    if (state >= 0)
      by = *reinterpret_cast<const float2*>(m.products[kOtherTeam] + state * S::kProductStride + 2 * pair);
    uint32_t* at = reinterpret_cast<uint32_t*>(m.codes[kOtherTeam] + row * S::kStride + 2 * pair);
    *at = multiply_pairs(half_pair(share * by.x, share * by.y), *at);
  }
}

/// The gradients of what the rows of a state read alike, from what was kept of `count` states: rows of m.codes[0] and
/// m.gradient, which nobody reads any more.
template <class S>
__device__ void write_kept_gradients(const FusedMlp& net, StateMemory<S>& m, const uint32_t* kept, int64_t stride,
                                     int64_t count, float* out) {
  constexpr int kWords = 4, kChunks = S::kPairs / kWords;  // 16 bytes at a time
  const int codes = net.width[1], hidden = net.width[2], reads = net.state.inputs(codes);
  const float unscale = m.unscale;
  for (int which = 0; which < KeptTrueStates::kTotal; ++which) {
    const bool world = which == KeptTrueStates::kWorld;
    StateWeightGradient<S, S::kHidden / 2> gradient(4);
    for (int64_t first = 0; first < count; first += S::kRows) {
      for (int i = static_cast<int>(threadIdx.x); i < S::kRows * kChunks; i += S::kThreads) {
        const int row = i / kChunks, word = i % kChunks * kWords;
        uint4 read{0, 0, 0, 0}, total{0, 0, 0, 0};
        if (first + row < count) {
          const int64_t at = (first + row) * S::kPairs + word;
          if (!world || word < S::kWorld / 2) read = *reinterpret_cast<const uint4*>(kept + which * stride + at);
          total = *reinterpret_cast<const uint4*>(kept + KeptTrueStates::kTotal * stride + at);
        }
        *reinterpret_cast<uint4*>(m.codes[0] + row * S::kStride + word * 2) = read;
        *reinterpret_cast<uint4*>(m.gradient + row * S::kStride + word * 2) = total;
      }
      __syncthreads();
      gradient.template add<S::kRowDepth, S::kStride, S::kStride>(m.gradient, m.codes[0],
                                                                  [](int, const uint32_t(&)[4]) {});
      __syncthreads();
    }
    const int columns = world ? net.state.world : codes;
    gradient.each([&](float value, int r, int c) {
      r += gradient.row;
      c += gradient.column;
      if (r >= hidden) return;
      if (c < columns) out[net.weight[1] + r * reads + (1 + which) * codes + c] = value * unscale;
      if (world && c == columns) out[net.bias[1] + r] = value * unscale;  // of the 1 behind the world
    });
  }
}

}  // namespace giga
