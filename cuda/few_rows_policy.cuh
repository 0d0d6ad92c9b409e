// The fused policy of few rows, where what counts is how long one row takes: the warps of a block take the same 16 rows
// through a layer together, each some of its numbers. A warp's weights come from global memory once, all at a time, and
// stay in its registers. A row takes few instructions: what a step runs once is found in no cache for instructions.
#pragma once

#include "cuda/fused_policy.hpp"
#include "cuda/ppo_tiles.cuh"

namespace giga {

/// A warp's numbers of a layer, 8 for each of its tiles, of 16 rows.
template <int kTiles>
struct NumbersOfWarp {
  float c[kTiles][4];

  __device__ void activate(Activation activation) {
    with_activation(activation, [&](auto&& f) {
#pragma unroll
      for (int j = 0; j < kTiles; ++j)
#pragma unroll
        for (int k = 0; k < 4; ++k) c[j][k] = f(c[j][k]).value;
    });
  }
  /// two(row, column, that number and the next one).
  template <class Two>
  __device__ void each_two(Two&& two) const {
    const TileLane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int k = 0; k < 2; ++k) two(lane.group + k * 8, j * 8 + lane.pair, float2{c[j][2 * k], c[j][2 * k + 1]});
  }
};

/// What a warp's numbers of a layer are made with: weights, as a right factor, and biases.
template <int kDepth, int kTiles>
struct LayerOfWarp {
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
  /// Of 16 rows in shared memory.
  template <int kStride>
  __device__ NumbersOfWarp<kTiles> of(const __half* rows) const {
    NumbersOfWarp<kTiles> y;
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

/// A row of logits of which eight lanes that lie side by side have four each, in order. Sums are taken in the order of
/// Logits, so that both choose the same action. All lanes of the warp call it.
struct OctetLogits {
  static constexpr int kLanes = 8, kNumbers = 4;
  static constexpr uint32_t kWarp = 0xFFFFFFFFu;
  float x[kNumbers] = {};
  int lane = static_cast<int>(threadIdx.x) % kLanes;

  __device__ explicit OctetLogits(const float* row) {
    if (lane * kNumbers >= kLogitStride) return;
    const Quad q = reinterpret_cast<const Quad*>(row)[lane];
#pragma unroll
    for (int k = 0; k < kNumbers; ++k) x[k] = q.v[k];
  }
  __device__ int column(int k) const { return lane * kNumbers + k; }
  __device__ bool is_action(int k) const { return column(k) < kNDiscreteActions; }
  __device__ float greatest(float top) const {
#pragma unroll
    for (int apart = 1; apart < kLanes; apart *= 2) top = fmaxf(top, __shfl_xor_sync(kWarp, top, apart));
    return top;
  }
  /// The sum of the numbers of the lanes before this one.
  __device__ float before(const float (&p)[kNumbers]) const {
    float sum = 0;
#pragma unroll
    for (int turn = 1; turn < kLanes; ++turn) {
      sum = of_lane(lane - 1, through(sum, p));
      if (lane == 0) sum = 0;
    }
    return sum;
  }
  __device__ float total_of(const float (&p)[kNumbers], float) const {
    return of_lane(kLanes - 1, through(before(p), p));
  }
  /// NaNs are never the largest, unless the first number is one, as in Logits.
  __device__ int largest() const {
    float top = lane == 0 ? x[0] : -INFINITY;
    int chosen = 0;
#pragma unroll
    for (int k = 0; k < kNumbers; ++k)
      if (is_action(k) && x[k] > top) {
        top = x[k];
        chosen = column(k);
      }
#pragma unroll
    for (int apart = 1; apart < kLanes; apart *= 2) {
      const float other = __shfl_xor_sync(kWarp, top, apart);
      const int others = __shfl_xor_sync(kWarp, chosen, apart);
      if (other > top || (other == top && others < chosen)) {
        top = other;
        chosen = others;
      }
    }
    return of_lane(0, chosen);
  }
  __device__ int draw(const float (&p)[kNumbers], float u) const {
    float below = before(p);
    int chosen = 0;
#pragma unroll
    for (int k = 0; k < kNumbers; ++k) {
      below += p[k];
      chosen += column(k) < kNDiscreteActions - 1 && u >= below ? 1 : 0;
    }
#pragma unroll
    for (int apart = 1; apart < kLanes; apart *= 2) chosen += __shfl_xor_sync(kWarp, chosen, apart);
    return chosen;
  }
  __device__ float at(int index) const {
    const int k = index % kNumbers;
    const float mine = k == 0 ? x[0] : k == 1 ? x[1] : k == 2 ? x[2] : x[3];
    return of_lane(index / kNumbers, mine);
  }

 private:
  template <class T>
  __device__ T of_lane(int number, T x) const {
    return __shfl_sync(kWarp, x, (static_cast<int>(threadIdx.x) - lane + number) & 31);
  }
  __device__ static float through(float sum, const float (&p)[kNumbers]) {
#pragma unroll
    for (int k = 0; k < kNumbers; ++k) sum += p[k];
    return sum;
  }
};

template <int kIn, int kHidden>
struct FewRowsBlock {
  static constexpr int kTiles = kHidden > FusedMlp::kNarrowHidden ? 2 : 1;  // of 8 numbers, that a warp has of a layer
  static constexpr int kNumbers = 8 * kTiles, kWarps = kHidden / kNumbers, kThreads = kWarps * 32;
  static constexpr int kRowsOfWarp = 16 / kWarps;
  // On a multiprocessor: as many as registers have room for.
  static constexpr int kBlocks = kHidden > FusedMlp::kNarrowHidden ? 1 : 2;
  // Of 16 rows, one after the other. More rows have warps of their own: from about 26 on they are the faster.
  static constexpr int kMostTiles = 20;
  static constexpr int kInStride = kIn + 8, kHiddenStride = kHidden + 8;
  alignas(16) __half x[16 * kInStride];
  alignas(16) __half hidden[2][16 * kHiddenStride];
  alignas(16) float head[16 * kLogitStride];
  float uniform[16];
};

/// Several policies in one launch. Blocks [.., most groups of a policy, policies].
template <int kIn, int kHidden>
__global__ void __launch_bounds__(FewRowsBlock<kIn, kHidden>::kThreads, FewRowsBlock<kIn, kHidden>::kBlocks)
    few_rows_kernel(const __grid_constant__ FusedPolicies policies) {
  using Block = FewRowsBlock<kIn, kHidden>;
  extern __shared__ __align__(16) char shared[];
  Block& m = *reinterpret_cast<Block*>(shared);
  const FusedPolicy& k = policies.policy[blockIdx.z];
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  const int64_t step = static_cast<int64_t>(gridDim.x) * 16;
  int64_t at = static_cast<int64_t>(blockIdx.x) * 16;
  if (static_cast<int>(blockIdx.y) >= k.groups || at >= k.rows_per_group) return;
  const FusedMlp& net = k.net;
  const int64_t offset = blockIdx.y * k.group_stride, first_row = blockIdx.y * k.rows_per_group;
  const FusedRows rows = k.rows(offset);
  const int first = warp * Block::kRowsOfWarp, first_number = warp * Block::kNumbers;
  FetchedInputs<kIn, Block::kRowsOfWarp> inputs;
  const auto fetch = [&](int64_t from) {
    inputs.fetch(rows, net.width[0], [&](int i) {
      const int64_t row = from + first + i;
      return row < k.rows_per_group ? first_row + row : -1;
    });
  };
  fetch(at);
  const bool discrete = k.actions == ActionKind::discrete;
  const auto layer = [&]<int kDepth>(int l) {
    return LayerOfWarp<kDepth, Block::kTiles>(k.parameters + offset + net.weight[l],
                                              k.parameters + offset + net.bias[l], first_number, net.width[l + 1],
                                              net.width[l]);
  };
  const auto layer1 = layer.template operator()<kIn / 16>(0);
  const auto layer2 = layer.template operator()<kHidden / 16>(1);
  const auto layer3 = layer.template operator()<kHidden / 16>(2);
#pragma unroll 1
  for (; at < k.rows_per_group; at += step) {
    inputs.template store<Block::kInStride>(rows, net.width[0], m.x + first * Block::kInStride);
    fetch(at + step);  // on their way meanwhile
    __syncthreads();
    const auto keep = [&](auto& y, __half* to) {
      y.activate(net.activation);
      y.each_two([&](int r, int c, float2 two) {
        *reinterpret_cast<uint32_t*>(to + r * Block::kHiddenStride + first_number + c) = half_pair(two.x, two.y);
      });
      __syncthreads();
    };
    auto y = layer1.template of<Block::kInStride>(m.x);
    keep(y, m.hidden[0]);
    y = layer2.template of<Block::kHiddenStride>(m.hidden[0]);
    keep(y, m.hidden[1]);
    if (first_number < kHead)
      layer3.template of<Block::kHiddenStride>(m.hidden[1]).each_two([&](int r, int c, float2 two) {
        if (first_number + c >= kLogitStride) return;
        *reinterpret_cast<float2*>(m.head + r * kLogitStride + first_number + c) = two;
      });
    else if (warp == Block::kWarps - 1 && lane < 16 && at + lane < k.rows_per_group && discrete)
      m.uniform[lane] = k.discrete.uniform(first_row + at + lane);
    __syncthreads();
    // Of a row eight lanes choose a discrete action, one the continuous one.
    const int row = discrete ? static_cast<int>(threadIdx.x) / OctetLogits::kLanes : static_cast<int>(threadIdx.x);
    if (warp * 32 >= (discrete ? 16 * OctetLogits::kLanes : 16)) continue;
    const bool lives = row < 16 && at + row < k.rows_per_group;
    if (discrete) {
      const auto choice = k.discrete.choose(OctetLogits(m.head + row * kLogitStride), [&] { return m.uniform[row]; });
      if (lives && lane % OctetLogits::kLanes == 0) k.discrete.keep(first_row + at + row, choice);
    } else if (lives) {
      k.gaussian(offset).sample(first_row + at + row, m.head + row * kLogitStride);
    }
  }
}

}  // namespace giga
