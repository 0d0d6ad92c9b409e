// ForgetEpisodes: what agents remember is zero where an episode begins.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"

namespace giga {

/// Row = one number of the memory [W, per_world].
struct ForgetEpisodes {
  const int32_t* episode_length;  // [W] steps since the reset
  float* memory;
  int64_t per_world;

  GIGA_HD void operator()(int64_t row) const {
    if (episode_length[row / per_world] == 0) memory[row] = 0;
  }
};

}  // namespace giga
