// The end of a dense layer in bfloat16, and its gradient, as elementwise operations: what is added to the sums, the
// activation, and the mean over a team, in one pass over memory each way.
#pragma once

#include <cstdint>
#include <cstring>

#include "math/activation.hpp"
#include "math/bfloat16.hpp"
#include "math/rows.hpp"

namespace giga {

/// Eight neighbouring columns of a row, which a thread reads and writes at once.
struct alignas(16) EightColumns {
  static constexpr int kSize = 8;
  uint32_t pairs[kSize / 2];

  GIGA_HD static EightColumns of(const float (&x)[kSize]) {
    EightColumns rounded;
    GIGA_UNROLL for (int k = 0; k < kSize / 2; ++k) rounded.pairs[k] = bfloat16_pair(x[2 * k], x[2 * k + 1]);
    return rounded;
  }
  GIGA_HD float operator[](int k) const {
    const uint32_t bits = k % 2 ? pairs[k / 2] & 0xFFFF0000u : pairs[k / 2] << 16;
    float value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }
};
static_assert(sizeof(EightColumns) == EightColumns::kSize * sizeof(BFloat16));

/// The rows of a layer, `n` of them a state; without anything that a team shares, any number of neighbours.
struct LayerRows {
  static constexpr int kAtOnce = 2;  // rows on their way
  int64_t rows;
  int columns, n;  // columns: a multiple of 8

  GIGA_HD int across() const { return columns / EightColumns::kSize; }
  GIGA_HD int64_t states() const { return quotient(rows + n - 1, n); }
  /// f(first row, rows) for the rows of a state, so many at once.
  template <class F>
  GIGA_HD void each(int64_t state, F&& f) const {
    const int64_t first = state * n, end = first + n < rows ? first + n : rows;
    for (int64_t row = first; row < end; row += kAtOnce)
      f(row, static_cast<int>(end - row < kAtOnce ? end - row : kAtOnce));
  }
  GIGA_HD EightColumns read(const BFloat16* from, int64_t row, int column) const {
    return *reinterpret_cast<const EightColumns*>(from + row * columns + column);
  }
  GIGA_HD void write(const float (&x)[EightColumns::kSize], BFloat16* to, int64_t row, int column) const {
    *reinterpret_cast<EightColumns*>(to + row * columns + column) = EightColumns::of(x);
  }
};

/// Whether the slope follows from the output. Of other activations it is kept for the way back.
GIGA_HD bool output_tells_slope(Activation activation) {
  return activation == Activation::tanh || activation == Activation::relu;
}
/// activate_with_slope for numbers that are rounded to bfloat16: on a GPU tanh within 2^-11.
GIGA_HD Activated activate_roughly(Activation activation, float x) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 750
  if (activation == Activation::tanh) {
    float y;
    asm("tanh.approx.f32 %0, %1;" : "=f"(y) : "f"(x));
    return {y, 1.0f - y * y};
  }
#endif
  return activate_with_slope(activation, x);
}

/// output = activation(sums + bias + of_team[state]), mean = the mean of the state's living rows (0 where none lives).
/// Row s * columns / 8 + k: eight columns of the rows of state s.
struct DenseEpilogue {
  LayerRows layer;
  Activation activation;
  const BFloat16* sums;     // [rows, columns]
  const BFloat16* bias;     // [columns]
  const BFloat16* of_team;  // [states, columns]; null = none
  const float* alive;       // [rows] 0 or 1; null = no mean is wanted
  BFloat16* output;         // [rows, columns]
  BFloat16* slopes;         // [rows, columns] of the activation; null = not wanted
  BFloat16* mean;           // [states, columns]

  GIGA_HD void operator()(int64_t row) const {
    constexpr int kSize = EightColumns::kSize;
    const int64_t state = quotient(row, layer.across());
    const int column = static_cast<int>(row - state * layer.across()) * kSize;
    float added[kSize], sum[kSize] = {}, living = 0;
    const EightColumns of_bias = layer.read(bias, 0, column);
    GIGA_UNROLL for (int k = 0; k < kSize; ++k) added[k] = of_bias[k];
    if (of_team) {
      const EightColumns more = layer.read(of_team, state, column);
      GIGA_UNROLL for (int k = 0; k < kSize; ++k) added[k] += more[k];
    }
    layer.each(state, [&](int64_t first, int count) {
      EightColumns x[LayerRows::kAtOnce];
      GIGA_UNROLL for (int i = 0; i < LayerRows::kAtOnce; ++i) if (i < count) x[i] =
          layer.read(sums, first + i, column);
      GIGA_UNROLL for (int i = 0; i < LayerRows::kAtOnce; ++i) {
        if (i >= count) break;
        const float weight = alive ? alive[first + i] : 0.0f;
        living += weight;
        float y[kSize], slope[kSize];
        GIGA_UNROLL for (int k = 0; k < kSize; ++k) {
          const Activated a = activate_roughly(activation, x[i][k] + added[k]);
          y[k] = a.value;
          slope[k] = a.slope;
          sum[k] += weight * a.value;
        }
        layer.write(y, output, first + i, column);
        if (slopes) layer.write(slope, slopes, first + i, column);
      }
    });
    if (!alive) return;
    const float share = living > 0 ? 1.0f / living : 0.0f;
    GIGA_UNROLL for (int k = 0; k < kSize; ++k) sum[k] *= share;
    layer.write(sum, mean, state, column);
  }
};

/// Its gradient. Row p * columns / 8 + k: eight columns of the states p, p + parts, ...
struct DenseEpilogueGradient {
  LayerRows layer;
  Activation activation;
  int parts;
  const BFloat16* kept;      // [rows, columns]: the output where it tells the slope, else the slopes
  const BFloat16* d_output;  // [rows, columns]; null = 0
  const BFloat16* d_mean;    // [states, columns]; null = 0
  const float* alive;        // [rows]; read with d_mean alone
  BFloat16* d_sums;          // [rows, columns]
  BFloat16* d_of_team;       // [states, columns] d_sums added up over the state; null = not wanted
  float* d_bias;             // [parts, columns] of d_sums added up over all rows

  GIGA_HD float slope(float x) const {
    return activation == Activation::tanh ? 1.0f - x * x : activation == Activation::relu ? (x > 0 ? 1.0f : 0.0f) : x;
  }
  GIGA_HD void operator()(int64_t row) const {
    constexpr int kSize = EightColumns::kSize;
    const int64_t part = quotient(row, layer.across()), states = layer.states();
    const int column = static_cast<int>(row - part * layer.across()) * kSize;
    float of_part[kSize] = {};
    for (int64_t state = part; state < states; state += parts) {
      float of_mean[kSize] = {}, of_state[kSize] = {};
      if (d_mean) {
        float living = 0;
        for (int i = 0; i < layer.n; ++i) living += alive[state * layer.n + i];
        const EightColumns d = layer.read(d_mean, state, column);
        const float share = living > 0 ? 1.0f / living : 0.0f;
        GIGA_UNROLL for (int k = 0; k < kSize; ++k) of_mean[k] = share * d[k];
      }
      layer.each(state, [&](int64_t first, int count) {
        EightColumns x[LayerRows::kAtOnce], d[LayerRows::kAtOnce] = {};
        GIGA_UNROLL for (int i = 0; i < LayerRows::kAtOnce; ++i) {
          if (i >= count) break;
          x[i] = layer.read(kept, first + i, column);
          if (d_output) d[i] = layer.read(d_output, first + i, column);
        }
        GIGA_UNROLL for (int i = 0; i < LayerRows::kAtOnce; ++i) {
          if (i >= count) break;
          const float weight = d_mean ? alive[first + i] : 0.0f;
          float d_sum[kSize];
          GIGA_UNROLL for (int k = 0; k < kSize; ++k) {
            d_sum[k] = (d[i][k] + weight * of_mean[k]) * slope(x[i][k]);
            of_state[k] += d_sum[k];
          }
          layer.write(d_sum, d_sums, first + i, column);
        }
      });
      if (d_of_team) layer.write(of_state, d_of_team, state, column);
      GIGA_UNROLL for (int k = 0; k < kSize; ++k) of_part[k] += of_state[k];
    }
    GIGA_UNROLL for (int k = 0; k < kSize; ++k) d_bias[part * layer.columns + column + k] = of_part[k];
  }
};

}  // namespace giga
