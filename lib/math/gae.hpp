// Generalised advantage estimation (Schulman et al. 2016, equations 11 to 16), one agent's column at a time.
#pragma once

#include "core/host_device.hpp"
#include "sim/world.hpp"

namespace giga {

/// Advantages and returns of a rollout; column = world * n + slot. The future of an agent is worth 0 after its death
/// and after a decided game; if the time limit cuts a game off, it is worth the value of the final observation. Nothing
/// crosses a reset.
///
/// With `team_share` s an agent's reward is (1 - s) of its own and s of its team's mean, the dead counted with what
/// they get. Then an agent that has died still has a future: s times the sum of the team's mean rewards m to come. A
/// living mate expects (1 - s) r + s m, and where k of n live, the mean of r over them is m n / k; so what it leaves
/// behind is its mates' mean value times s / ((1 - s) n / k + s), exactly so while k stays as it is, or at s = 1.
struct Gae {
  int horizon;       // T
  int64_t n_worlds;  // W
  int n;
  float gamma, lambda;
  float team_share = 0;        // s
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

  /// `row`: of the first agent of the column's world.
  GIGA_HD float shared_reward(int64_t at, int64_t row) const {
    if (team_share == 0) return reward[at];
    float sum = 0;
    for (int k = 0; k < n; ++k) sum += reward[row + k];
    return (1 - team_share) * reward[at] + team_share * sum / static_cast<float>(n);
  }
  /// What an agent that has just died leaves behind, from the values of its team at `row`.
  GIGA_HD float left_behind(const float* values, const uint8_t* living, int64_t row) const {
    if (team_share == 0) return 0;  // first: of a crowd all would ask all
    float sum = 0;
    int count = 0;
    for (int k = 0; k < n; ++k) {
      if (!living[row + k]) continue;
      sum += denormalised(values[row + k]);
      ++count;
    }
    if (count == 0) return 0;
    const float mates = static_cast<float>(count);
    return sum / mates * team_share / ((1 - team_share) * static_cast<float>(n) / mates + team_share);
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
      const int64_t first = world * n, row = t * stride + first;  // of the world's agents
      float next = 0;
      if (end == Done::running && alive[at + stride]) {
        next = denormalised(value[at + stride]);
      } else {
        carried = 0;
        if (end == Done::running)
          next = left_behind(value, alive, row + stride);
        else if (end == Done::truncated)
          next = final_alive[column] ? denormalised(final_value[column]) : left_behind(final_value, final_alive, first);
      }
      const float v = denormalised(value[at]);
      // delta_t = r_t + gamma V(s_(t + 1)) - V(s_t) (10);  A_t = delta_t + gamma lambda A_(t + 1) (16)
      carried = shared_reward(at, row) + gamma * next - v + gamma * lambda * carried;
      advantage[at] = carried;
      returns[at] = carried + v;
    }
  }
};

}  // namespace giga
