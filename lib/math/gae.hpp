// Generalised advantage estimation (Schulman et al. 2016, equations 11 to 16), one agent's column at a time.
#pragma once

#include "core/host_device.hpp"
#include "sim/world.hpp"

namespace giga {

/// Advantages and returns of a rollout; column = world * n + slot. What comes after an agent's death or a decided game
/// is worth zero; a game cut off by the time limit is worth the value of its final observation; nothing crosses a
/// reset.
struct Gae {
  int horizon;       // T
  int64_t n_worlds;  // W
  int n;
  float gamma, lambda;
  const float* reward;         // [T, W, n]
  const uint8_t* done;         // [T, W] Done
  const uint8_t* alive;        // [T + 1, W, n] at the observation of step t
  const float* value;          // [T + 1, W, n] in units of `value_scale`
  const float* final_value;    // [W, n] of the observation before a reset, likewise
  const uint8_t* final_alive;  // [W, n]
  const float* value_mean;     // scalar: value = mean + std * (what the network says); null = 0
  const float* value_std;      // scalar; null = 1
  float* advantage;            // [T, W, n]; 0 for the dead
  float* returns;              // [T, W, n] advantage + value, in reward units; 0 for the dead

  GIGA_HD float denormalised(float v) const {
    return (value_mean ? *value_mean : 0.0f) + (value_std ? *value_std : 1.0f) * v;
  }

  GIGA_HD void operator()(int64_t column) const {
    const int64_t stride = n_worlds * n, world = column / n;
    float carried = 0;
    for (int t = horizon - 1; t >= 0; --t) {
      const int64_t at = t * stride + column;
      if (!alive[at]) {
        advantage[at] = returns[at] = carried = 0;
        continue;
      }
      const Done end = static_cast<Done>(done[t * n_worlds + world]);
      float next = 0;
      if (end == Done::running && alive[at + stride]) {
        next = denormalised(value[at + stride]);
      } else {
        carried = 0;
        if (end == Done::truncated && final_alive[column]) next = denormalised(final_value[column]);
      }
      const float v = denormalised(value[at]);
      carried = reward[at] + gamma * next - v + gamma * lambda * carried;
      advantage[at] = carried;
      returns[at] = carried + v;
    }
  }
};

}  // namespace giga
