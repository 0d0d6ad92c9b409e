// What kernels of layers of images have in common: pairs of bfloat16 in a word, the first in the low half; products of
// them.
#pragma once

#include <cuda_bf16.h>

#include <cstdint>

namespace giga {

/// Word j of four.
__device__ __forceinline__ uint32_t word_of(const uint4& words, int j) {
  return j == 0 ? words.x : j == 1 ? words.y : j == 2 ? words.z : words.w;
}
/// The gradient through a ReLU: that of its output, 0 where the output is 0.
__device__ __forceinline__ uint32_t through_relu(uint32_t output, uint32_t d_output) {
  return d_output & __hneu2_mask(reinterpret_cast<const __nv_bfloat162&>(output), __nv_bfloat162());
}
/// max(x, 0) of two numbers, rounded; NaN stays NaN.
__device__ __forceinline__ uint32_t relu_pair(float low, float high) {
  uint32_t pair;
  asm("cvt.rn.relu.bf16x2.f32 %0, %1, %2;" : "=r"(pair) : "f"(high), "f"(low));
  return pair;
}
__device__ __forceinline__ float low(uint32_t pair) { return __uint_as_float(pair << 16); }
__device__ __forceinline__ float high(uint32_t pair) { return __uint_as_float(pair & 0xFFFF0000u); }

/// The channel that is column c of a tile of 8: so a lane holds eight neighbours of its four tiles.
__device__ constexpr int channel_of(int tile, int column) { return column / 2 * 8 + tile * 2 + column % 2; }

/// As multiply_add of half_tiles.cuh.
__device__ __forceinline__ void multiply_add_bfloat16(float (&c)[4], const uint32_t (&a)[4], uint32_t b0, uint32_t b1) {
  asm("mma.sync.aligned.m16n8k16.row.col.f32.bf16.bf16.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, "
      "%3};"
      : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
      : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}

}  // namespace giga
