// Angles and small float helpers, bit-identical on CPU and GPU: only +, -, *, comparisons and correctly rounded sqrt
// and division, compiled without contraction into fused multiply-adds.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "core/host_device.hpp"

namespace giga {

constexpr float kPi = 3.14159265358979323846f;
constexpr float kTwoPi = 6.28318530717958647692f;

GIGA_HD float clamp(float v, float lo, float hi) { return v < lo ? lo : (v > hi ? hi : v); }
GIGA_HD float min_of(float a, float b) { return b < a ? b : a; }
GIGA_HD float max_of(float a, float b) { return b > a ? b : a; }

/// C's fmod(a, 2 pi), exact for |a| < 6 pi: a subtraction is exact where the result is not larger than what is taken
/// away (Sterbenz). Headings and their differences stay below 5 pi. Much cheaper on the GPU than fmod.
GIGA_HD float fmod_two_pi(float a) {
  float size = a < 0 ? -a : a;
  if (!(size < 1e4f)) return 0;
  while (size >= 2 * kTwoPi) size -= 2 * kTwoPi;
  if (size >= kTwoPi) size -= kTwoPi;
  return a < 0 ? -size : size;
}

/// The original's wrap: fmod(q + pi, 2 pi) - pi, which leaves values below -pi as low as -3 pi.
GIGA_HD float wrap_original(float q) { return fmod_two_pi(q + kPi) - kPi; }

/// Wraps an angle to [-pi, pi).
GIGA_HD float wrap_angle(float q) {
  float r = fmod_two_pi(q + kPi);
  if (r < 0) r += kTwoPi;
  if (r >= kTwoPi) r = 0;  // a tiny negative r rounds up to the whole turn
  return r - kPi;
}

#if defined(__CUDA_ARCH__)
/// The number, or 1 instead of 0; the compiler does not know that it is.
__device__ inline float or_one(float a) {
  float other = a == 0 ? 1.0f : a;
  asm("" : "+f"(other));
  return other;
}
#endif

/// a / b for a finite a and a normal b above 0; the same as the operator. The GPU takes ten times as long over a
/// dividend of 0, and its whole warp with it, so it is given another one then.
GIGA_HD float divide(float a, float b) {
#if defined(__CUDA_ARCH__)
  const float quotient = or_one(a) / b;
  return a == 0 ? a : quotient;
#else
  return a / b;
#endif
}
/// The square root of a number that is not negative; likewise.
GIGA_HD float square_root(float a) {
#if defined(__CUDA_ARCH__)
  const float root = std::sqrt(or_one(a));
  return a == 0 ? a : root;
#else
  return std::sqrt(a);
#endif
}

/// The bits of a number, as an integer.
GIGA_HD uint32_t float_bits(float value) {
#if defined(__CUDA_ARCH__)
  return __float_as_uint(value);
#else
  return std::bit_cast<uint32_t>(value);
#endif
}

struct SinCos {
  float sin, cos;
};

/// Sine and cosine for |angle| < 100 to about 1e-7: reduction by pi/2 in three parts (Cody and Waite) and the minimax
/// polynomials of the Cephes library (Moshier). Ours instead of the C library's, because that differs between CPU and
/// GPU in the last bit, and a trajectory would drift apart.
GIGA_HD SinCos sin_cos(float angle) {
  const float scaled = angle * 0.63661977236758134308f;  // 2 / pi
  const int quadrant = static_cast<int>(scaled + (scaled < 0 ? -0.5f : 0.5f));
  const float k = static_cast<float>(quadrant);
  const float r = ((angle - k * 1.5703125f) - k * 4.837512969970703125e-4f) - k * 7.54978995489188216e-8f;
  const float r2 = r * r;
  const float s = ((-1.9515295891e-4f * r2 + 8.3321608736e-3f) * r2 - 1.6666654611e-1f) * r2 * r + r;
  const float c =
      ((2.443315711809948e-5f * r2 - 1.388731625493765e-3f) * r2 + 4.166664568298827e-2f) * r2 * r2 - 0.5f * r2 + 1.0f;
  const int turn = quadrant & 3;
  const float sine = (turn & 1) ? c : s, cosine = (turn & 1) ? s : c;
  return {(turn & 2) ? -sine : sine, (turn == 1 || turn == 2) ? -cosine : cosine};
}

}  // namespace giga
