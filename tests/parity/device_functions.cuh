// The bodies that device_functions.cu and device_functions.cpp share.
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "parity/device_functions.hpp"
#include "sim/draws.hpp"

namespace giga::test {

GIGA_HD void evaluate_functions(float angle, float* out) {
  const SinCos direction = sin_cos(angle);
  out[0] = direction.sin;
  out[1] = direction.cos;
  out[2] = wrap_original(angle);
  out[3] = wrap_angle(angle);
  out[4] = fmod_two_pi(angle);
  out[5] = std::sqrt(angle < 0 ? -angle : angle);
  out[6] = 1.0f / angle;
}

GIGA_HD void evaluate_draws(uint64_t seed, uint32_t world, uint32_t step, float* out) {
  DrawKey key(seed, world, step);
  for (uint32_t k = 0; k < 25; ++k) out[k] = key.uniform(Draw::detect, k / 5, k % 5);
  PhiloxDraws draws(seed, world, step);
  out[25] = static_cast<float>(draws.map(7));
}

}  // namespace giga::test
