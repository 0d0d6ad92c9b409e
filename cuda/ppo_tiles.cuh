// What the fused kernels of actor and critic have in common: a block takes tiles of rows, one after the other, through
// three layers. All 16 warps share each product: a warp has 16 rows and a part of the columns.
#pragma once

#include <cuda_fp16.h>

#include "cuda/ppo_gradients.hpp"
#include "cuda/tf32_tiles.cuh"

namespace giga {

constexpr int kFusedWarps = 16, kFusedThreads = kFusedWarps * 32;
constexpr int kHidden = FusedMlp::kHidden;
constexpr int kHiddenStride = kHidden + 8;
constexpr int kMostStates = 32;  // of a tile
constexpr int kHead = 32;        // outputs of the actor, in whole tiles

/// The shape of a tile: so many rows, and inputs padded to so many.
template <int kIn_, int kRows_>
struct TileShape {
  static constexpr int kIn = kIn_, kRows = kRows_, kInStride = kIn + 8;
  static constexpr int kRowWarps = kRows / 16, kColumnWarps = kFusedWarps / kRowWarps;
  static constexpr int kTiles = kHidden / 8 / kColumnWarps;  // of 8 columns, that a warp has of a hidden layer
  static constexpr int kHeadTiles = kHead / 8 / kColumnWarps;
  static constexpr int kInTiles = kIn / 8 / (kFusedWarps / 4);  // that a warp has of the first weight's gradient
  // A thread fetches so many numbers of so many rows of the next tile: a warp has a row.
  static constexpr int kFetchedRows = kRows / kFusedWarps, kFetchedColumns = kIn / 32;
};

/// tanh within 2^-21: 1 - 2 / (1 + exp(2 x)). std::tanh would take as long as a product.
__device__ __forceinline__ float fast_tanh(float x) {
  constexpr float kTwoLog2E = 2.88539008177792681472f;
  float power, inverse;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(power) : "f"(x * kTwoLog2E));
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(power + 1.0f));
  return __fmaf_rn(-2.0f, inverse, 1.0f);
}

/// Derivatives of features, in half precision: products round them as much.
template <int kTiles>
struct Slopes {
  __half2 pair[kTiles][2];
  __device__ void scale(TileSums<kTiles>& x) const {
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int k = 0; k < 2; ++k) {
        const float2 by = __half22float2(pair[j][k]);
        x.c[j][2 * k] *= by.x;
        x.c[j][2 * k + 1] *= by.y;
      }
  }
};

/// The numbers become features, and `slopes` their derivatives: f(number).
template <int kTiles, class F>
__device__ __forceinline__ void activate_by(TileSums<kTiles>& sums, Slopes<kTiles>& slopes, F&& f) {
#pragma unroll
  for (int j = 0; j < kTiles; ++j)
#pragma unroll
    for (int k = 0; k < 2; ++k) {
      const Activated a = f(sums.c[j][2 * k]), b = f(sums.c[j][2 * k + 1]);
      sums.c[j][2 * k] = a.value;
      sums.c[j][2 * k + 1] = b.value;
      slopes.pair[j][k] = __floats2half2_rn(a.slope, b.slope);
    }
}
template <int kTiles>
__device__ void activate(Activation activation, TileSums<kTiles>& sums, Slopes<kTiles>& slopes) {
  switch (activation) {
    case Activation::tanh:
      return activate_by(sums, slopes, [](float x) {
        const float y = fast_tanh(x);
        return Activated{y, 1.0f - y * y};
      });
    case Activation::relu:
      return activate_by(sums, slopes, [](float x) { return activate_with_slope(Activation::relu, x); });
    case Activation::silu:
      return activate_by(sums, slopes, [](float x) { return activate_with_slope(Activation::silu, x); });
    case Activation::gelu:
      return activate_by(sums, slopes, [](float x) { return activate_with_slope(Activation::gelu, x); });
  }
}

/// Loads a matrix [out, in] into [rows, stride], rounded, padded with zeros.
__device__ inline void load_matrix(const float* from, int out, int in, float* to, int rows, int stride) {
  for (int k = static_cast<int>(threadIdx.x); k < rows * stride; k += kFusedThreads) {
    const int o = k / stride, i = k - o * stride;
    to[k] = from && o < out && i < in ? to_tf32(from[o * in + i]) : 0.0f;
  }
}
__device__ inline void load_vector(const float* from, int n, float* to, int padded) {
  for (int k = static_cast<int>(threadIdx.x); k < padded; k += kFusedThreads) to[k] = from && k < n ? from[k] : 0.0f;
}

/// The moments of a minibatch, from their parts.
struct BatchMoments {
  float inv_count, mean, inv_std;
};
__device__ inline BatchMoments batch_moments(const double* parts) {
  double sum[kMoments] = {0, 0, 0};
  for (int part = 0; part < kMomentParts; ++part)
    for (int k = 0; k < kMoments; ++k) sum[k] += parts[part * kMoments + k];
  const double count = sum[0] > 1 ? sum[0] : 1, mean = sum[1] / count, variance = sum[2] / count - mean * mean;
  return {static_cast<float>(1 / count), static_cast<float>(mean),
          static_cast<float>(1 / (sqrt(variance > 0 ? variance : 0) + 1e-8))};
}

/// Rows of a tile: whole states, at most kMostStates.
struct TileRows {
  int n, states;  // agents of a state, states of a tile
  int64_t n_tiles;
  __device__ TileRows(const FusedRows& rows, int most) : n(rows.n) {
    states = most / n < kMostStates ? most / n : kMostStates;
    n_tiles = (rows.n_states + states - 1) / states;
  }
  /// The row of the rollout; -1 beyond the last.
  __device__ int64_t source(const FusedRows& rows, int64_t tile, int row) const {
    const int local = row / n;
    const int64_t state = tile * states + local;
    if (local >= states || tile >= n_tiles || state >= rows.n_states) return -1;
    return (rows.states ? rows.states[state] : state) * n + (row - local * n);
  }
};

/// The inputs of the next tile, on their way from global memory while a tile is at work.
template <class S>
struct FetchedInputs {
  float x[S::kFetchedRows][S::kFetchedColumns];

  __device__ static int row(int i) { return i * kFusedWarps + static_cast<int>(threadIdx.x) / 32; }
  __device__ static int column(int j) { return j * 32 + static_cast<int>(threadIdx.x) % 32; }

  __device__ void fetch(const FusedRows& rows, int input, const int64_t* source) {
#pragma unroll
    for (int i = 0; i < S::kFetchedRows; ++i) {
      const int64_t from = source[row(i)];
      const float* at = rows.obs + (from >= 0 ? from : 0) * rows.obs_stride;
#pragma unroll
      for (int j = 0; j < S::kFetchedColumns; ++j)
        x[i][j] = from >= 0 && column(j) < input ? __ldg(at + column(j)) : 0.0f;
    }
  }
  __device__ void store(const FusedRows& rows, int input, float* to) {
    if (rows.obs_mean) normalize(rows, input);
#pragma unroll
    for (int i = 0; i < S::kFetchedRows; ++i)
#pragma unroll
      for (int j = 0; j < S::kFetchedColumns; ++j) to[row(i) * S::kInStride + column(j)] = to_tf32(x[i][j]);
  }

 private:
  __device__ void normalize(const FusedRows& rows, int input) {
#pragma unroll
    for (int j = 0; j < S::kFetchedColumns; ++j) {
      if (column(j) >= input) continue;
      const float mean = __ldg(rows.obs_mean + column(j)), std = __ldg(rows.obs_std + column(j));
#pragma unroll
      for (int i = 0; i < S::kFetchedRows; ++i) {
        const float value = (x[i][j] - mean) / std;
        // A NaN stays one.
        x[i][j] = value > rows.obs_limit ? rows.obs_limit : value < -rows.obs_limit ? -rows.obs_limit : value;
      }
    }
  }
};

/// A warp's place in products of a tile's rows, and in the gradients of weights.
template <class S>
struct WarpPlace {
  int first_row, column_warp;   // of the warp's rows; which part of the columns it has
  int weight_row, weight_part;  // of a hidden layer's gradient [64, ..]: its 16 rows, and which quarter of the columns
  __device__ WarpPlace() {
    const int warp = static_cast<int>(threadIdx.x) / 32;
    first_row = warp % S::kRowWarps * 16;
    column_warp = warp / S::kRowWarps;
    weight_row = warp % 4 * 16;
    weight_part = warp / 4;
  }
};

/// Sums of the columns of a tile [rows, kColumns], added up over tiles: a thread has some rows of a column.
template <int kColumns>
struct ColumnSums {
  float sum = 0;

  __device__ void add(const float* tile, int rows, int stride) {
    const int column = static_cast<int>(threadIdx.x) % kColumns;
    for (int row = static_cast<int>(threadIdx.x) / kColumns; row < rows; row += kFusedThreads / kColumns)
      sum += tile[row * stride + column];
  }
  /// Of all threads, to out [count]. `work` [threads]. All threads call it.
  __device__ void write(float* work, float* out, int count) const {
    __syncthreads();
    work[threadIdx.x] = sum;
    __syncthreads();
    if (const int column = static_cast<int>(threadIdx.x); column < count) {
      float all = 0;
      for (int part = 0; part < kFusedThreads / kColumns; ++part) all += work[part * kColumns + column];
      out[column] = all;
    }
  }
};

/// Sums of the columns of a warp's part of a tile, each row with a weight, added up over tiles.
template <int kTiles>
struct WeightedColumnSums {
  float sum[kTiles][2] = {};

  /// `low`, `high`: the weights of rows `group` and group + 8.
  __device__ void add(const TileSums<kTiles>& x, float low, float high) {
#pragma unroll
    for (int j = 0; j < kTiles; ++j) {
      sum[j][0] += x.c[j][0] * low + x.c[j][2] * high;
      sum[j][1] += x.c[j][1] * low + x.c[j][3] * high;
    }
  }
  /// Of all warps, to out [count]. `work` [row warps, kHidden]. All threads call it.
  template <class S>
  __device__ void write(const WarpPlace<S>& place, float* work, float* out, int count) const {
    const TileLane lane;
    __syncthreads();
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int k = 0; k < 2; ++k) {
        float all = sum[j][k];
        for (int apart = 4; apart < 32; apart *= 2) all += __shfl_xor_sync(0xFFFFFFFFu, all, apart);
        if (lane.group == 0)
          work[place.first_row / 16 * kHidden + (place.column_warp * kTiles + j) * 8 + lane.pair + k] = all;
      }
    __syncthreads();
    if (const int column = static_cast<int>(threadIdx.x); column < count) {
      float all = 0;
      for (int w = 0; w < S::kRowWarps; ++w) all += work[w * kHidden + column];
      out[column] = all;
    }
  }
};

/// A warp's part of a weight's gradient -> the matrix [out, in].
template <int kTiles>
__device__ void write_gradient(TileSums<kTiles>& sums, int first_row, int first_column, int out, int in, float* to) {
  sums.each([&](float value, int row, int column) {
    row += first_row;
    column += first_column;
    if (row < out && column < in) to[row * in + column] = value;
  });
}

}  // namespace giga
