// Generalised advantage estimation (Schulman et al. 2016, equations 11 to 16), one agent's column at a time.
#pragma once

#include "core/host_device.hpp"
#include "sim/world.hpp"

namespace giga {

/// Advantages and returns of a rollout; column = world * n + slot. The future of an agent is worth 0 after its death
/// and after a decided game; if the time limit cuts a game off, it is worth the value of the final observation. Nothing
/// crosses a reset.
struct Gae {
  int horizon;       // T
  int64_t n_worlds;  // W
  int n;
  float gamma, lambda;
  const float* reward;         // [T, W, n]
  const uint8_t* done;         // [T, W] Done
  const uint8_t* alive;        // [T + 1, W, n] at the observation of step t
  const float* value;          // [T + 1, W, n] the critic's output
  const float* final_value;    // [W, n] likewise, of the observation before a reset
  const uint8_t* final_alive;  // [W, n]
  const float* value_mean;     // scalar: value in reward units = mean + std * output; null = 0
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
      // delta_t = r_t + gamma V(s_(t + 1)) - V(s_t) (10);  A_t = delta_t + gamma lambda A_(t + 1) (16)
      carried = reward[at] + gamma * next - v + gamma * lambda * carried;
      advantage[at] = carried;
      returns[at] = carried + v;
    }
  }
};

}  // namespace giga
