// What the kernels of wide networks have in common (ppo_wide.hpp): tiles of 64 rows and 256 columns, of which each of
// 16 warps has 32 and 32; their way between registers, shared and global memory.
#pragma once

#include "cuda/async_copy.cuh"
#include "cuda/check.cuh"
#include "cuda/ppo_block_tiles.cuh"
#include "cuda/ppo_wide.hpp"

namespace giga {

/// The shape of a block's tiles, for BlockPart, LayerSums, BlockSlopes and StagedInputs: inputs padded to so many.
template <int kIn_>
struct WideShape {
  static constexpr int kIn = kIn_, kInStride = kIn + 8, kInDepth = kIn / 16;
  static constexpr int kWarps = 16, kThreads = kWarps * 32;
  static constexpr int kRows = WideLayers::kTileRows, kRowDepth = kRows / 16, kWarpRows = kRows / kWarps;
  static constexpr int kHidden = WideLayers::kWidth, kDepth = kHidden / 16, kStride = kHidden + 8;
  static constexpr int kLayerHalves = kRows * kStride;
  static constexpr int kRowTiles = 2, kTiles = 4, kColumnWarps = kHidden / 32;
  static_assert(kRows == 32 * kRowTiles && kWarps == 2 * kColumnWarps);
};
/// Of kernels that read no inputs.
using LayerTile = WideShape<64>;
constexpr int kWidePairs = WideLayers::kWidth / 2;

/// The order of a weight's rows and columns in shared memory.
enum class Order { columns, places };
/// Loads a matrix [out, in] into [kRows, kStride], padded with zeros; no matrix: zeros.
template <int kRows, int kStride, Order kOfRows, Order kOfColumns, int kThreads>
__device__ void load_ordered(const float* from, int out, int in, __half* to) {
  constexpr int kAtOnce = 8;  // reads on their way
  constexpr int kColumns = kStride - 8;
  for (int first = static_cast<int>(threadIdx.x); first < kRows * kColumns; first += kAtOnce * kThreads) {
    float x[kAtOnce];
#pragma unroll
    for (int j = 0; j < kAtOnce; ++j) {
      const int k = first + j * kThreads, o = k / kColumns, i = k % kColumns;
      x[j] = from && o < out && i < in ? __ldg(from + o * in + i) : 0.0f;
    }
#pragma unroll
    for (int j = 0; j < kAtOnce; ++j) {
      const int k = first + j * kThreads, o = k / kColumns, i = k % kColumns;
      if (k < kRows * kColumns)
        to[(kOfRows == Order::places ? wide_place(o) : o) * kStride +
           (kOfColumns == Order::places ? wide_place(i) : i)] = as_half(x[j]);
    }
  }
}

/// Begins the copy of kRows rows of kWidth halves, `stride` apart in global memory, to shared memory; of those from
/// `count` on zeros.
template <int kRows, int kWidth, int kStride, int kThreads>
__device__ void begin_rows(const __half* from, int64_t stride, int64_t count, __half* to) {
  constexpr int kHalves = 8, kChunks = kWidth / kHalves;  // of 16 bytes
#pragma unroll
  for (int k = static_cast<int>(threadIdx.x); k < kRows * kChunks; k += kThreads) {
    const int row = k / kChunks, column = k % kChunks * kHalves;
    __half* there = to + row * kStride + column;
    if (row < count)
      copy_16_bytes(there, from + row * stride + column);
    else
      *reinterpret_cast<uint4*>(there) = {0, 0, 0, 0};
  }
}
/// Of a tile's numbers of a hidden layer.
__device__ inline void begin_tile(const uint32_t* layer, int64_t tile, __half* to) {
  constexpr int kWidth = WideLayers::kWidth;
  begin_rows<LayerTile::kRows, kWidth, LayerTile::kStride, LayerTile::kThreads>(
      reinterpret_cast<const __half*>(layer) + tile * LayerTile::kRows * kWidth, kWidth, LayerTile::kRows, to);
}

/// A warp's numbers of a tile as they lie in global memory: f(m, i, place) with the place of the lane's four pairs in
/// row m * 16 + group + i * 8 of its 32.
template <class F>
__device__ __forceinline__ void each_lane_row(const BlockPart<LayerTile>& part, int64_t tile, F&& f) {
  const TileLane lane;
#pragma unroll
  for (int m = 0; m < LayerTile::kRowTiles; ++m)
#pragma unroll
    for (int i = 0; i < 2; ++i) {
      const int64_t row = tile * LayerTile::kRows + part.row + m * 16 + lane.group + i * 8;
      f(m, i, row * kWidePairs + part.column / 2 + lane.pair * 2);
    }
}
using WideFactors = Factor<LayerTile::kTiles / 2>[LayerTile::kRowTiles];
__device__ __forceinline__ void write_tile(const WideFactors& x, const BlockPart<LayerTile>& part, int64_t tile,
                                           uint32_t* layer) {
  each_lane_row(part, tile, [&](int m, int i, int64_t at) {
    *reinterpret_cast<uint4*>(layer + at) = {x[m].k[0][i], x[m].k[0][i + 2], x[m].k[1][i], x[m].k[1][i + 2]};
  });
}
__device__ __forceinline__ void read_tile(const uint32_t* layer, const BlockPart<LayerTile>& part, int64_t tile,
                                          WideFactors& x) {
  each_lane_row(part, tile, [&](int m, int i, int64_t at) {
    const uint4 w = *reinterpret_cast<const uint4*>(layer + at);
    x[m].k[0][i] = w.x;
    x[m].k[0][i + 2] = w.y;
    x[m].k[1][i] = w.z;
    x[m].k[1][i + 2] = w.w;
  });
}
/// To shared memory, in the order of columns.
__device__ __forceinline__ void store_tile(const WideFactors& x, const BlockPart<LayerTile>& part, __half* layer) {
#pragma unroll
  for (int m = 0; m < LayerTile::kRowTiles; ++m)
    store(x[m], part.at(layer) + m * 16 * LayerTile::kStride, LayerTile::kStride);
}

/// What the team product left of the states of a warp's rows: on its way while something else is computed.
struct TeamTerms {
  uint4 words[LayerTile::kRowTiles][2];

  __device__ void fetch(const uint32_t* of_team, int n, int states, const BlockPart<LayerTile>& part, int64_t tile) {
    const TileLane lane;
#pragma unroll
    for (int m = 0; m < LayerTile::kRowTiles; ++m)
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        const int state = (part.row + m * 16 + lane.group + i * 8) / n;
        words[m][i] = {0, 0, 0, 0};
        if (state < states)
          words[m][i] = __ldg(reinterpret_cast<const uint4*>(of_team + (tile * states + state) * kWidePairs +
                                                             part.column / 2 + lane.pair * 2));
      }
  }
  /// Adds them to each row, times share(row in the tile).
  template <class Share>
  __device__ void add(LayerSums<LayerTile>& y, const BlockPart<LayerTile>& part, Share&& share) const {
    const TileLane lane;
#pragma unroll
    for (int m = 0; m < LayerTile::kRowTiles; ++m)
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        const float by = share(part.row + m * 16 + lane.group + i * 8);
        const uint4 w = words[m][i];
        const uint32_t pairs[LayerTile::kTiles] = {w.x, w.y, w.z, w.w};
#pragma unroll
        for (int j = 0; j < LayerTile::kTiles; ++j) {
          const float2 x = __half22float2(reinterpret_cast<const __half2&>(pairs[j]));
          y.part[m].c[j][2 * i] += by * x.x;
          y.part[m].c[j][2 * i + 1] += by * x.y;
        }
      }
  }
};

/// tanh within 2^-20 of four numbers, with one reciprocal for all: powers and reciprocals leave a multiprocessor slower
/// than products do.
__device__ __forceinline__ void fast_tanh(float (&x)[4]) {
  constexpr float kTwoLog2E = 2.88539008177792681472f;
  constexpr float kMost = 30;  // tanh is 1 from there on, and the product of four powers is finite; a NaN stays one
  float p[4], inverse;
#pragma unroll
  for (int i = 0; i < 4; ++i) {
    const float exponent = x[i] * kTwoLog2E;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(p[i]) : "f"(exponent > kMost ? kMost : exponent));
    p[i] += 1.0f;
  }
  const float first = p[0] * p[1], second = p[2] * p[3];
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(first * second));
  const float of_first = inverse * second, of_second = inverse * first;
  x[0] = __fmaf_rn(-2.0f, of_first * p[1], 1.0f);
  x[1] = __fmaf_rn(-2.0f, of_first * p[0], 1.0f);
  x[2] = __fmaf_rn(-2.0f, of_second * p[3], 1.0f);
  x[3] = __fmaf_rn(-2.0f, of_second * p[2], 1.0f);
}
/// Sums become features, and `slopes` their derivatives.
__device__ __forceinline__ void activate_wide(Activation activation, TileSums<LayerTile::kTiles>& sums,
                                              SlopesOf<LayerTile::kTiles>& slopes) {
  if (activation != Activation::tanh) return activate(activation, sums, slopes);
#pragma unroll
  for (int j = 0; j < LayerTile::kTiles; ++j) {
    fast_tanh(sums.c[j]);
    const float(&y)[4] = sums.c[j];
#pragma unroll
    for (int k = 0; k < 2; ++k)
      slopes.by.k[j / 2][j % 2 * 2 + k] = half_pair(1.0f - y[2 * k] * y[2 * k], 1.0f - y[2 * k + 1] * y[2 * k + 1]);
  }
}

/// Sums over the n rows of each state of a tile [64, 256] in shared memory, each times share(row), to `to` [states,
/// 128 pairs].
template <int kThreads, class Share>
__device__ void sum_wide_states(const __half* tile, int n, int states, uint32_t* to, Share&& share) {
  const int pair = static_cast<int>(threadIdx.x) % kWidePairs;
  for (int s = static_cast<int>(threadIdx.x) / kWidePairs; s < states; s += kThreads / kWidePairs) {
    float2 sum{0, 0};
    for (int r = s * n; r < s * n + n; ++r) {
      const float2 x = __half22float2(*reinterpret_cast<const __half2*>(tile + r * LayerTile::kStride + 2 * pair));
      const float by = share(r);
      sum.x += by * x.x;
      sum.y += by * x.y;
    }
    to[s * kWidePairs + wide_place(2 * pair) / 2] = half_pair(sum.x, sum.y);
  }
}

/// Starts a kernel with so much shared memory.
template <class Memory, int kThreads = LayerTile::kThreads, class Kernel, class Parameter>
void start_wide(Kernel kernel, const Parameter& k, int blocks, void* stream) {
  static_assert(sizeof(Memory) <= kMostSharedAlone);
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(Memory)));
  kernel<<<blocks, kThreads, sizeof(Memory), static_cast<cudaStream_t>(stream)>>>(k);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
