// Products of matrices in shared memory by tensor cores: factors in TF32, sums in fp32. A warp holds tiles of 16 rows x
// 8 columns of a result (PTX, mma.m16n8k8). Matrices lie row by row; strides that are 8 more than a multiple of 32 keep
// the lanes on different banks.
#pragma once

#include <cstdint>

namespace giga {

/// The nearest number with the 10 bits of mantissa that a product takes in.
__device__ __forceinline__ float to_tf32(float x) {
  uint32_t bits;
  asm("cvt.rna.tf32.f32 %0, %1;" : "=r"(bits) : "f"(x));
  return __uint_as_float(bits);
}

/// Which numbers of a tile a lane holds: rows `group` and group + 8, columns `pair` and pair + 1.
struct TileLane {
  int group, pair;
  __device__ TileLane() : group(static_cast<int>(threadIdx.x) % 32 / 4), pair(static_cast<int>(threadIdx.x) % 4 * 2) {}
};

__device__ __forceinline__ void multiply_add(float (&c)[4], const float (&a)[4], float b0, float b1) {
  asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, "
      "%3};"
      : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
      : "r"(__float_as_uint(a[0])), "r"(__float_as_uint(a[1])), "r"(__float_as_uint(a[2])), "r"(__float_as_uint(a[3])),
        "r"(__float_as_uint(b0)), "r"(__float_as_uint(b1)));
}

/// A matrix in shared memory from a given row and column on.
struct Tiled {
  const float* at;
  int stride;
  __device__ float2 two(int row, int column) const {
    return *reinterpret_cast<const float2*>(at + row * stride + column);
  }
  __device__ float one(int row, int column) const { return at[row * stride + column]; }
};

/// A warp's 16 rows x 8 kTiles columns of a result.
template <int kTiles>
struct TileSums {
  float c[kTiles][4];

  __device__ void clear() {
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int k = 0; k < 4; ++k) c[j][k] = 0;
  }
  /// Every row starts as these numbers, one for each column.
  __device__ void start(const float* columns) {
    const TileLane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j) {
      const float2 b = *reinterpret_cast<const float2*>(columns + j * 8 + lane.pair);
      c[j][0] = c[j][2] = b.x;
      c[j][1] = c[j][3] = b.y;
    }
  }

  /// += a b^T: a [16, kDepth], b [8 kTiles, kDepth]. The lanes take neighboring numbers of the depth as its numbers
  /// i and i + 4: the sum is the same, and one read serves two.
  template <int kDepth>
  __device__ void add_by_rows(Tiled a, Tiled b) {
    const TileLane lane;
#pragma unroll
    for (int k = 0; k < kDepth; k += 8) {
      const float2 low = a.two(lane.group, k + lane.pair), high = a.two(lane.group + 8, k + lane.pair);
      const float from[4] = {low.x, high.x, low.y, high.y};
#pragma unroll
      for (int j = 0; j < kTiles; ++j) {
        const float2 by = b.two(j * 8 + lane.group, k + lane.pair);
        multiply_add(c[j], from, by.x, by.y);
      }
    }
  }
  /// += a b: a [16, kDepth], b [kDepth, 8 kTiles].
  template <int kDepth>
  __device__ void add_by_columns(Tiled a, Tiled b) {
    const TileLane lane;
#pragma unroll
    for (int k = 0; k < kDepth; k += 8) {
      const float2 low = a.two(lane.group, k + lane.pair), high = a.two(lane.group + 8, k + lane.pair);
      const float from[4] = {low.x, high.x, low.y, high.y};
#pragma unroll
      for (int j = 0; j < kTiles; ++j)
        multiply_add(c[j], from, b.one(k + lane.pair, j * 8 + lane.group),
                     b.one(k + lane.pair + 1, j * 8 + lane.group));
    }
  }
  /// += a^T b: a [kDepth, 16], b [kDepth, 8 kTiles].
  template <int kDepth>
  __device__ void add_over_rows(Tiled a, Tiled b) {
    const TileLane lane;
    const int t = lane.pair / 2;
#pragma unroll 4
    for (int k = 0; k < kDepth; k += 8) {
      const float from[4] = {a.one(k + t, lane.group), a.one(k + t, lane.group + 8), a.one(k + t + 4, lane.group),
                             a.one(k + t + 4, lane.group + 8)};
#pragma unroll
      for (int j = 0; j < kTiles; ++j)
        multiply_add(c[j], from, b.one(k + t, j * 8 + lane.group), b.one(k + t + 4, j * 8 + lane.group));
    }
  }

  /// f(number, row, column) of every number, in the lane's tile.
  template <class F>
  __device__ void each(F&& f) {
    const TileLane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int k = 0; k < 4; ++k) f(c[j][k], lane.group + k / 2 * 8, j * 8 + lane.pair + k % 2);
  }
  /// Rounded for the next product.
  __device__ void store_rounded(float* to, int stride) const {
    const TileLane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int half = 0; half < 2; ++half)
        *reinterpret_cast<float2*>(to + (lane.group + half * 8) * stride + j * 8 + lane.pair) = {
            to_tf32(c[j][half * 2]), to_tf32(c[j][half * 2 + 1])};
  }
  __device__ void store(float* to, int stride) const {
    const TileLane lane;
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int half = 0; half < 2; ++half)
        *reinterpret_cast<float2*>(to + (lane.group + half * 8) * stride + j * 8 + lane.pair) = {c[j][half * 2],
                                                                                                 c[j][half * 2 + 1]};
  }
};

}  // namespace giga
