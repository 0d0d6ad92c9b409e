// Mean of features over the living agents of a team, and its gradient, as elementwise operations.
#pragma once

#include "math/bfloat16.hpp"
#include "math/rows.hpp"

namespace giga {

/// Row s * width + k: mean of feature k over the living agents of state s; 0 where none lives. `T` = float or
/// BFloat16.
template <class T>
struct LivingMean {
  const T* x;          // [S, n, width]
  const float* alive;  // [S, n] 0 or 1
  int n, width;
  T* mean;  // [S, width]

  GIGA_HD void operator()(int64_t row) const {
    const int64_t state = row / width;
    const int k = static_cast<int>(row - state * width);
    float sum = 0, count = 0;
    for (int i = 0; i < n; ++i) {
      const float a = alive[state * n + i];
      sum += a * static_cast<float>(x[(state * n + i) * width + k]);
      count += a;
    }
    mean[row] = static_cast<T>(count > 0 ? sum / count : 0.0f);
  }
};

/// Its gradient: every living agent's feature counts 1 / living.
template <class T>
struct LivingMeanGradient {
  const T* d_mean;     // [S, width]
  const float* alive;  // [S, n]
  int n, width;
  T* d_x;  // [S, n, width]

  GIGA_HD void operator()(int64_t row) const {
    const int64_t state = row / width;
    const int k = static_cast<int>(row - state * width);
    float count = 0;
    for (int i = 0; i < n; ++i) count += alive[state * n + i];
    const float share = static_cast<float>(d_mean[row]) / (count > 0 ? count : 1.0f);
    for (int i = 0; i < n; ++i) d_x[(state * n + i) * width + k] = static_cast<T>(alive[state * n + i] * share);
  }
};

}  // namespace giga
