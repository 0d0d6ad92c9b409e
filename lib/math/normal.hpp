// Normal numbers from uniform ones.
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "core/host_device.hpp"

namespace giga {

struct NormalPair {
  float first, second;
};

/// Two independent standard normal numbers from two uniform on [0, 1) (Box and Muller 1958).
GIGA_HD NormalPair normal_pair(float u, float v) {
  const float radius = std::sqrt(-2.0f * std::log(1.0f - u));  // 1 - u is in (0, 1]
  const float angle = 2 * kPi * v;
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

}  // namespace giga
