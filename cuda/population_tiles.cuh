// Small networks by tensor cores (mma.sync m16n8k16, half precision in, fp32 out), a warp for some rows: weights go from
// global memory straight into the registers that multiply them, and features never leave the registers. Code of each
// file that includes this.
#pragma once

#include <cuda_fp16.h>

#include "cuda/population_policy.hpp"
#include "math/distributions.hpp"

namespace giga {
namespace {

constexpr int kTileRows = 16;                                               // of one mma
constexpr int kNarrow = 8, kWide = SmallMlp::kMaxWidth / PackedMlp::kTile;  // tiles of the widest layer
constexpr int kTilesAtOnce = 8;                                             // whose weights are read together

__device__ uint32_t pair_of(float2 x) {
  const __half2 h = __float22half2_rn(x);
  return reinterpret_cast<const uint32_t&>(h);
}

__device__ void multiply_add(float (&c)[4], const uint32_t (&a)[4], uint32_t b0, uint32_t b1) {
  asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, "
      "%3};"
      : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
      : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}

/// The lane's numbers of a tile of 16 rows x 16 columns: rows `group` and group + 8, columns `pair`, pair + 1 and these
/// + 8.
struct Lane {
  int number, group, pair;
  __device__ Lane() : number(static_cast<int>(threadIdx.x) % 32), group(number / 4), pair(number % 4 * 2) {}
};

/// tanh by the hardware: off by up to 2^-11 of its value (PTX), as much as the rounding to half precision that follows.
__device__ float tanh_fast(float x) {
  asm("tanh.approx.f32 %0, %0;" : "+f"(x));
  return x;
}
/// Not inlined: else the code would be repeated for each number that a lane holds.
__device__ __noinline__ float activate_other(Activation activation, float x) { return activate(activation, x); }

/// What a lane holds of the sums of 16 kM rows x 8 kTiles columns.
template <int kM, int kTiles>
struct Sums {
  float c[kM][kTiles][4];

  __device__ void start(const __half* bias, int tiles) {
    const Lane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j) {
      const float2 b =
          j < tiles ? __half22float2(*reinterpret_cast<const __half2*>(bias + j * 8 + lane.pair)) : float2{0, 0};
#pragma unroll
      for (int m = 0; m < kM; ++m) {
        c[m][j][0] = c[m][j][2] = b.x;
        c[m][j][1] = c[m][j][3] = b.y;
      }
    }
  }

  /// Adds the products of inputs 32 s and after, tiles of 16 columns, with their slab of the weights.
  template <int kTilesIn>
  __device__ void add(const uint32_t (&a)[kM][kTilesIn][4], int s, const __half* slab, int tiles) {
    const uint4* fragments = reinterpret_cast<const uint4*>(slab) + Lane().number;
#pragma unroll
    for (int first = 0; first < kTiles; first += kTilesAtOnce) {
      uint4 b[kTilesAtOnce];
#pragma unroll
      for (int j = 0; j < kTilesAtOnce; ++j)
        b[j] = first + j < tiles ? __ldg(fragments + (first + j) * 32) : uint4{0, 0, 0, 0};
#pragma unroll
      for (int j = 0; j < kTilesAtOnce; ++j) {
        if (first + j >= tiles) break;
#pragma unroll
        for (int m = 0; m < kM; ++m) {
          multiply_add(c[m][first + j], a[m][2 * s], b[j].x, b[j].y);
          multiply_add(c[m][first + j], a[m][2 * s + 1], b[j].z, b[j].w);
        }
      }
    }
  }

  template <class F>
  __device__ void each(const F& f) {
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int j = 0; j < kTiles; ++j)
#pragma unroll
        for (int k = 0; k < 4; ++k) c[m][j][k] = f(c[m][j][k]);
  }
  __device__ void activate(Activation activation) {
    if (activation == Activation::tanh)
      each(tanh_fast);
    else
      each([activation](float x) { return activate_other(activation, x); });
  }

  /// As inputs of the next layer: two tiles of 8 columns lie in a lane as one tile of 16 does there.
  __device__ void inputs(uint32_t (&a)[kM][kTiles / 2][4]) const {
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int t = 0; t < kTiles / 2; ++t)
#pragma unroll
        for (int k = 0; k < 4; ++k) {
          const float* tile = c[m][2 * t + k / 2];
          a[m][t][k] = pair_of({tile[k % 2 * 2], tile[k % 2 * 2 + 1]});
        }
  }

  /// Writes the head, as far as it fits into kLogitStride numbers.
  __device__ void store(float* head, int tiles) const {
    const Lane lane;
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int j = 0; j < (kLogitStride + 7) / 8; ++j) {
        if (j >= tiles) break;
#pragma unroll
        for (int k = 0; k < 4; ++k) {
          const int row = m * kTileRows + lane.group + k / 2 * 8, column = j * 8 + lane.pair + k % 2;
          if (column < kLogitStride) head[row * kLogitStride + column] = c[m][j][k];
        }
      }
  }
};

/// Inputs in global memory: observations. A null row is one of zeros. They are read once, and may have been written by
/// a bulk copy while this kernel ran, so the first-level cache is passed by.
__device__ uint32_t observed(const float* row, int column, int columns) {
  return pair_of(row && column < columns ? __ldcg(reinterpret_cast<const float2*>(row + column)) : float2{0, 0});
}

/// The heads of 16 kM rows, from observations to shared memory. row_of(r): where the inputs of row r lie, or null.
template <int kM, int kTiles, class RowOf>
__device__ void make_heads(const PackedMlp& packed, const __half* network, RowOf&& row_of, float* head) {
  const Lane lane;
  const float* row[kM][2];
#pragma unroll
  for (int m = 0; m < kM; ++m)
#pragma unroll
    for (int k = 0; k < 2; ++k) row[m][k] = row_of(m * kTileRows + k * 8 + lane.group);
  const int columns = packed.mlp.width[0];
  Sums<kM, kTiles> sums;
  sums.start(network + packed.bias[0], packed.tiles(0));
  for (int s = 0; s < packed.slabs(0); ++s) {
    uint32_t a[kM][2][4];
#pragma unroll
    for (int m = 0; m < kM; ++m)
#pragma unroll
      for (int half = 0; half < 2; ++half)
#pragma unroll
        for (int k = 0; k < 4; ++k)
          a[m][half][k] = observed(row[m][k % 2], s * 32 + half * 16 + k / 2 * 8 + lane.pair, columns);
    sums.add(a, 0, network + packed.weight[0] + s * packed.tiles(0) * PackedMlp::kFragment, packed.tiles(0));
  }
  for (int l = 1; l < packed.mlp.n_layers; ++l) {
    sums.activate(packed.mlp.activation);
    uint32_t features[kM][kTiles / 2][4];
    sums.inputs(features);
    sums.start(network + packed.bias[l], packed.tiles(l));
#pragma unroll
    for (int s = 0; s < kTiles / 4; ++s) {
      if (s >= packed.slabs(l)) break;
      sums.add(features, s, network + packed.weight[l] + s * packed.tiles(l) * PackedMlp::kFragment, packed.tiles(l));
    }
  }
  sums.store(head, packed.tiles(packed.mlp.n_layers - 1));
}

}  // namespace
}  // namespace giga
