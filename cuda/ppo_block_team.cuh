// What the team weight of a critic with hidden layers of up to 128 adds to the rows of its states, and its gradient.
//
// What a team weight T gets of the rows h of a layer is mean(h) T^T, once for each state; the way back takes sums over
// the team first: G = sum(d), whence d_h = G T / living and d_T = G^T mean(h). The registers do not hold d_T beside the
// other gradients, so means and G of all states of a block are kept, and make d_T after the last tile (KeptStates).
#pragma once

#include "cuda/ppo_block_critic_memory.cuh"

namespace giga {

/// Sums over the agents of each state of matrix [rows, 128] become rows of m.of.states: of all agents; or of the living
/// ones, divided by their number. They are also written to `kept`, if any: [states, 64 pairs].
template <bool kMean, class S>
__device__ void sum_states(BlockCriticMemory<S, true>& m, const __half* matrix, int n, int states, uint32_t* kept) {
  const int pair = static_cast<int>(threadIdx.x) % kPairs;
  for (int s = static_cast<int>(threadIdx.x) / kPairs; s < states; s += S::kThreads / kPairs) {
    float2 sum{0, 0};
    int living = 0;
    for (int r = s * n; r < s * n + n; ++r) {
      if (kMean && !m.alive[r]) continue;
      const float2 x = __half22float2(*reinterpret_cast<const __half2*>(matrix + r * S::kStride + 2 * pair));
      sum.x += x.x;
      sum.y += x.y;
      ++living;
    }
    if constexpr (kMean) {
      const float share = living > 0 ? 1.0f / static_cast<float>(living) : 0.0f;
      sum.x *= share;
      sum.y *= share;
      if (pair == 0) m.team.inv_living[s] = share;
    }
    const uint32_t both = half_pair(sum.x, sum.y);
    *reinterpret_cast<uint32_t*>(m.of.states + s * S::kStride + 2 * pair) = both;
    if (kept) kept[s * kPairs + pair] = both;
  }
}

/// A warp's 16 columns of the products of all states with the team weight, to shared memory.
template <class S>
__device__ void keep_products(BlockCriticMemory<S, true>& m, BlockSums<2, 2>& product) {
  const TileLane lane;
  float* to = m.of.products + lane.group * kTeamStride + static_cast<int>(threadIdx.x) / 32 * 16 + lane.pair;
#pragma unroll
  for (int t = 0; t < 2; ++t)
#pragma unroll
    for (int j = 0; j < 2; ++j)
#pragma unroll
      for (int i = 0; i < 2; ++i)
        *reinterpret_cast<float2*>(to + (t * 16 + i * 8) * kTeamStride + j * 8) = {product.part[t].c[j][2 * i],
                                                                                   product.part[t].c[j][2 * i + 1]};
}
/// Adds to each row the products of its state; of the gradient each living agent has its share.
template <bool kShare, class S>
__device__ void add_products(BlockCriticMemory<S, true>& m, const BlockPart<S>& part, LayerSums<S>& y) {
  const TileLane lane;
#pragma unroll
  for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
    for (int i = 0; i < 2; ++i) {
      const int row = part.row + t * 16 + lane.group + i * 8, state = m.state[row];
      if (state < 0) continue;
      const float share = !kShare ? 1.0f : m.alive[row] ? m.team.inv_living[state] : 0.0f;
      const float* from = m.of.products + state * kTeamStride + part.column + lane.pair;
#pragma unroll
      for (int j = 0; j < S::kTiles; ++j) {
        const float2 x = *reinterpret_cast<const float2*>(from + j * 8);
        y.part[t].c[j][2 * i] += share * x.x;
        y.part[t].c[j][2 * i + 1] += share * x.y;
      }
    }
}

/// The gradient of the second layer's team weight, from what was kept of `count` states.
template <class S>
__device__ void write_team_gradient(BlockCriticMemory<S, true>& m, const uint32_t* means, const uint32_t* sums,
                                    int64_t count, float factor, int out, int in, float* to) {
  constexpr int kWords = 4, kChunks = kPairs / kWords;  // 16 bytes at a time
  BlockWeightGradient<S::kWeightTiles> gradient(4);
  for (int64_t first = 0; first < count; first += S::kRows) {
#pragma unroll
    for (int i = static_cast<int>(threadIdx.x); i < S::kRows * kChunks; i += S::kThreads) {
      const int row = i / kChunks, chunk = i % kChunks;
      uint4 mean{0, 0, 0, 0}, sum{0, 0, 0, 0};
      if (first + row < count) {
        const int64_t at = (first + row) * kPairs + chunk * kWords;
        mean = *reinterpret_cast<const uint4*>(means + at);
        sum = *reinterpret_cast<const uint4*>(sums + at);
      }
      *reinterpret_cast<uint4*>(m.of.hidden1 + row * S::kStride + chunk * kWords * 2) = mean;
      *reinterpret_cast<uint4*>(m.of.hidden2 + row * S::kStride + chunk * kWords * 2) = sum;
    }
    __syncthreads();
    gradient.template add<S::kRowDepth, S::kStride, S::kStride>(m.of.hidden2, m.of.hidden1,
                                                                [](int, const uint32_t(&)[4]) {});
    __syncthreads();
  }
  gradient.write(factor, out, in, to);
}

}  // namespace giga
