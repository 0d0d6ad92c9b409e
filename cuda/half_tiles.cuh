// Products of matrices by tensor cores: factors in half precision, sums in fp32 (PTX, mma.m16n8k16 and ldmatrix). A
// warp holds 16 rows of a factor or a result. What it computes it can multiply on without leaving the registers.
#pragma once

#include <cuda_fp16.h>

#include <cstdint>

namespace giga {

/// Which numbers of 16 rows x 8 columns a lane holds: rows `group` and group + 8, columns `pair` and pair + 1.
struct TileLane {
  int group, pair;
  __device__ TileLane() : group(static_cast<int>(threadIdx.x) % 32 / 4), pair(static_cast<int>(threadIdx.x) % 4 * 2) {}
};

/// Two numbers rounded to half precision, the first in the low half; what is too large becomes the largest.
__device__ __forceinline__ uint32_t half_pair(float low, float high) {
  uint32_t pair;
  asm("cvt.rn.satfinite.f16x2.f32 %0, %1, %2;" : "=r"(pair) : "f"(high), "f"(low));
  return pair;
}
__device__ __forceinline__ __half as_half(float x) {
  const uint32_t pair = half_pair(x, 0);
  return reinterpret_cast<const __half*>(&pair)[0];
}
__device__ __forceinline__ uint32_t multiply_pairs(uint32_t a, uint32_t b) {
  const __half2 product = __hmul2(reinterpret_cast<const __half2&>(a), reinterpret_cast<const __half2&>(b));
  return reinterpret_cast<const uint32_t&>(product);
}

/// 16 rows x 16 kDepth columns of a left factor.
template <int kDepth>
struct Factor {
  uint32_t k[kDepth][4];
};

__device__ __forceinline__ void multiply_add(float (&c)[4], const uint32_t (&a)[4], uint32_t b0, uint32_t b1) {
  asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, "
      "%3};"
      : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
      : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}

__device__ __forceinline__ uint32_t shared_address(const void* at) {
  return static_cast<uint32_t>(__cvta_generic_to_shared(at));
}

/// A matrix in shared memory, row by row. A stride that is 8 more than a multiple of 64 keeps the rows that are read
/// together on different banks (40 does too).
template <int kStride_>
struct Halves {
  static constexpr int kStride = kStride_;
  const __half* at;
  __device__ Halves(const __half* matrix, int row, int column) : at(matrix + row * kStride + column) {}

  /// The address of the row that this lane names for a load of 16 x 16 numbers as four matrices of 8 x 8: the second
  /// lies below the first, or beside it.
  __device__ uint32_t below() const {
    const int lane = static_cast<int>(threadIdx.x) % 32;
    return address(lane % 16, lane / 16 * 8);
  }
  __device__ uint32_t beside() const {
    const int lane = static_cast<int>(threadIdx.x) % 32;
    return address(lane % 8 + lane / 16 * 8, lane / 8 % 2 * 8);
  }

 private:
  __device__ uint32_t address(int row, int column) const { return shared_address(at + row * kStride + column); }
};
/// Bytes from one number to that so many rows and columns further.
template <int kStride>
__device__ constexpr uint32_t apart(int rows, int columns) {
  return static_cast<uint32_t>((rows * kStride + columns) * 2);
}

__device__ __forceinline__ void load(uint32_t (&to)[4], uint32_t address) {
  asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0, %1, %2, %3}, [%4];"
               : "=r"(to[0]), "=r"(to[1]), "=r"(to[2]), "=r"(to[3])
               : "r"(address));
}
__device__ __forceinline__ void load_transposed(uint32_t (&to)[4], uint32_t address) {
  asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0, %1, %2, %3}, [%4];"
               : "=r"(to[0]), "=r"(to[1]), "=r"(to[2]), "=r"(to[3])
               : "r"(address));
}
/// Two matrices, one below the other: of the addresses of the first 16 lanes.
__device__ __forceinline__ void load_transposed(uint32_t (&to)[2], uint32_t address) {
  asm volatile("ldmatrix.sync.aligned.m8n8.x2.trans.shared.b16 {%0, %1}, [%2];"
               : "=r"(to[0]), "=r"(to[1])
               : "r"(address));
}

/// A warp's 16 rows x 8 kTiles columns of a result. An odd number of tiles may add by columns only.
template <int kTiles>
struct TileSums {
  static constexpr int kRows = 16, kColumns = 8 * kTiles;
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

  /// += a b^T, one tile of the depth: a [16, 16]; b [8 kTiles, 16] in shared memory.
  template <int kStride>
  __device__ void add_by_rows(const uint32_t (&a)[4], uint32_t b) {
    static_assert(kTiles % 2 == 0);
#pragma unroll
    for (int j = 0; j < kTiles; j += 2) {
      uint32_t by[4];
      load(by, b + apart<kStride>(j * 8, 0));
      multiply_add(c[j], a, by[0], by[1]);
      multiply_add(c[j + 1], a, by[2], by[3]);
    }
  }
  /// += a b, one tile of the depth: b [16, 8 kTiles].
  template <int kStride>
  __device__ void add_by_columns(const uint32_t (&a)[4], uint32_t b) {
#pragma unroll
    for (int j = 0; j + 1 < kTiles; j += 2) {
      uint32_t by[4];
      load_transposed(by, b + apart<kStride>(0, j * 8));
      multiply_add(c[j], a, by[0], by[1]);
      multiply_add(c[j + 1], a, by[2], by[3]);
    }
    if constexpr (kTiles % 2 == 1) {
      uint32_t by[2];
      load_transposed(by, b + apart<kStride>(0, (kTiles - 1) * 8));
      multiply_add(c[kTiles - 1], a, by[0], by[1]);
    }
  }
  /// += a b^T: b [8 kTiles, 16 kDepth].
  template <int kDepth, int kStride>
  __device__ void add_by_rows(const Factor<kDepth>& a, Halves<kStride> b) {
    const uint32_t from = b.beside();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) add_by_rows<kStride>(a.k[k], from + apart<kStride>(0, k * 16));
  }
  /// The same with a [16, 16 kDepth] in shared memory.
  template <int kDepth, int kStrideA, int kStride>
  __device__ void add_by_rows(Halves<kStrideA> a, Halves<kStride> b) {
    const uint32_t from = b.beside(), left = a.below();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) {
      uint32_t tile[4];
      load(tile, left + apart<kStrideA>(0, k * 16));
      add_by_rows<kStride>(tile, from + apart<kStride>(0, k * 16));
    }
  }
  /// += a b: b [16 kDepth, 8 kTiles].
  template <int kDepth, int kStride>
  __device__ void add_by_columns(const Factor<kDepth>& a, Halves<kStride> b) {
    const uint32_t from = b.below();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) add_by_columns<kStride>(a.k[k], from + apart<kStride>(k * 16, 0));
  }
  /// The same with a in shared memory.
  template <int kDepth, int kStrideA, int kStride>
  __device__ void add_by_columns(Halves<kStrideA> a, Halves<kStride> b) {
    const uint32_t from = b.below(), left = a.below();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) {
      uint32_t tile[4];
      load(tile, left + apart<kStrideA>(0, k * 16));
      add_by_columns<kStride>(tile, from + apart<kStride>(k * 16, 0));
    }
  }
  /// += a^T b: a [16 kDepth, 16], b [16 kDepth, 8 kTiles], both in shared memory. f(tile): is shown each tile of a^T.
  template <int kDepth, int kStrideA, int kStride, class F>
  __device__ void add_over_rows(Halves<kStrideA> a, Halves<kStride> b, F&& f) {
    const uint32_t from = b.below(), left = a.beside();
#pragma unroll 4
    for (int k = 0; k < kDepth; ++k) {
      uint32_t tile[4];
      load_transposed(tile, left + apart<kStrideA>(k * 16, 0));
      add_by_columns<kStride>(tile, from + apart<kStride>(k * 16, 0));
      f(tile);
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
  /// As a left factor: two tiles of 8 columns lie in a lane as one tile of 16 does there.
  __device__ Factor<kTiles / 2> factor() const {
    Factor<kTiles / 2> a;
#pragma unroll
    for (int t = 0; t < kTiles / 2; ++t)
#pragma unroll
      for (int k = 0; k < 4; ++k) a.k[t][k] = half_pair(c[2 * t + k / 2][k % 2 * 2], c[2 * t + k / 2][k % 2 * 2 + 1]);
    return a;
  }
};

/// Writes a factor's 16 rows to shared memory.
template <int kDepth>
__device__ void store(const Factor<kDepth>& a, __half* to, int stride) {
  const TileLane lane;
  uint32_t* at = reinterpret_cast<uint32_t*>(to + lane.group * stride + lane.pair);
#pragma unroll
  for (int t = 0; t < kDepth; ++t)
#pragma unroll
    for (int k = 0; k < 4; ++k) at[(k % 2 * 8 * stride + t * 16 + k / 2 * 8) / 2] = a.k[t][k];
}

}  // namespace giga
