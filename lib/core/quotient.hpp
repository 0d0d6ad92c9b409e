// quotient: the division of whole numbers that address rows.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"

namespace giga {

/// a / b, of numbers that are not negative. A GPU has no division of 64 bits: where 32 suffice it takes a quarter of
/// the time.
GIGA_HD int64_t quotient(int64_t a, int64_t b) {
#if defined(__CUDA_ARCH__)
  if ((a | b) >> 32 == 0) return static_cast<uint32_t>(a) / static_cast<uint32_t>(b);
#endif
  return a / b;
}
/// What that division leaves over.
GIGA_HD int64_t left_over(int64_t a, int64_t b) { return a - quotient(a, b) * b; }

}  // namespace giga
