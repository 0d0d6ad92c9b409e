// BFloat16: the upper half of a float, rounded to nearest even; the layout of LibTorch's and CUDA's own types.
#pragma once

#include <cstdint>
#include <cstring>

#include "core/host_device.hpp"

namespace giga {

struct BFloat16 {
  uint16_t bits;

  BFloat16() = default;
  GIGA_HD explicit BFloat16(float value) {
    uint32_t u;
    std::memcpy(&u, &value, sizeof u);
    // NaN stays NaN: rounding could carry its mantissa into infinity.
    bits = value != value ? 0x7FC0 : static_cast<uint16_t>((u + 0x7FFFu + ((u >> 16) & 1u)) >> 16);
  }
  GIGA_HD explicit operator float() const {
    const uint32_t u = static_cast<uint32_t>(bits) << 16;
    float value;
    std::memcpy(&value, &u, sizeof value);
    return value;
  }
};
static_assert(sizeof(BFloat16) == 2);

/// Two numbers rounded, in one word: the first in its low half.
GIGA_HD uint32_t bfloat16_pair(float first, float second) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
  uint32_t pair;
  asm("cvt.rn.bf16x2.f32 %0, %1, %2;" : "=r"(pair) : "f"(second), "f"(first));
  return pair;
#else
  return BFloat16(first).bits | static_cast<uint32_t>(BFloat16(second).bits) << 16;
#endif
}

}  // namespace giga
