// What the fused kernels of actor and critic have in common: a block takes tiles of rows, one after the other, through
// three layers. A warp takes 16 rows through all layers and back in its registers; the gradients of weights need the
// features of all rows, so these pass through shared memory, and each warp has a part of each gradient.
#pragma once

#include "cuda/early_launch.cuh"
#include "cuda/half_tiles.cuh"
#include "cuda/ppo_gradients.hpp"

namespace giga {

constexpr int kHidden = FusedMlp::kNarrowHidden, kHiddenTiles = kHidden / 8, kHiddenDepth = kHidden / 16;
constexpr int kHiddenStride = kHidden + 8;
constexpr size_t kMostShared = 226 * 1024;          // bytes, of all blocks on a multiprocessor of capability 9.0
constexpr int kHead = 32, kHeadStride = kHead + 8;  // outputs of the actor, in whole tiles

/// The shape of a block's tiles: inputs padded to so many, so many warps with 16 rows each; whether shared memory has
/// room for the first layer's slopes, which would else be spilled to local memory.
template <int kIn_, int kWarps_, bool kRoomForSlopes_>
struct TileShape {
  static constexpr int kIn = kIn_, kInStride = kIn + 8, kInDepth = kIn / 16;
  static constexpr int kWarps = kWarps_, kThreads = kWarps * 32;
  static constexpr int kRows = kWarps * 16, kRowDepth = kRows / 16;
  static constexpr bool kRoomForSlopes = kRoomForSlopes_;
  // Of the gradient of a weight [64, ..] a warp has 16 rows, and one of so many parts of the columns.
  static constexpr int kParts = kWarps / 4;
  static constexpr int kInTiles = kIn / 8 / kParts, kWeightTiles = kHiddenTiles / kParts;
};
using NarrowTiles = TileShape<64, 16, true>;
/// Of egocentric views in mixed teams, 77 and 80 numbers. The actor would have room for its slopes, and spill more
/// then.
using MixedTiles = TileShape<96, 16, false>;
using MediumTiles = TileShape<128, 16, false>;
using WideTiles = TileShape<FusedMlp::kMaxInput, 8, false>;

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
struct SlopesOf {
  Factor<kTiles / 2> by;
  /// The gradient by what the features were made of.
  __device__ Factor<kTiles / 2> scaled(const TileSums<kTiles>& gradient) const {
    Factor<kTiles / 2> out = gradient.factor();
#pragma unroll
    for (int t = 0; t < kTiles / 2; ++t)
#pragma unroll
      for (int k = 0; k < 4; ++k) out.k[t][k] = multiply_pairs(out.k[t][k], by.k[t][k]);
    return out;
  }
};
using Slopes = SlopesOf<kHiddenTiles>;

/// The slopes of a lane, kept in shared memory if there is room.
template <class S>
struct KeptSlopes {
  uint4 words[S::kRoomForSlopes ? kHiddenDepth : 1][S::kRoomForSlopes ? S::kThreads : 1];

  __device__ void keep(const Slopes& slopes) {
    if constexpr (S::kRoomForSlopes)
#pragma unroll
      for (int t = 0; t < kHiddenDepth; ++t)
        words[t][threadIdx.x] = {slopes.by.k[t][0], slopes.by.k[t][1], slopes.by.k[t][2], slopes.by.k[t][3]};
  }
  __device__ void take(Slopes& slopes) const {
    if constexpr (S::kRoomForSlopes)
#pragma unroll
      for (int t = 0; t < kHiddenDepth; ++t) {
        const uint4 w = words[t][threadIdx.x];
        slopes.by.k[t][0] = w.x;
        slopes.by.k[t][1] = w.y;
        slopes.by.k[t][2] = w.z;
        slopes.by.k[t][3] = w.w;
      }
  }
};

/// The numbers become features, and `slopes` their derivatives: f(number).
template <int kTiles, class F>
__device__ __forceinline__ void activate_by(TileSums<kTiles>& sums, SlopesOf<kTiles>& slopes, F&& f) {
#pragma unroll
  for (int j = 0; j < kTiles; ++j)
#pragma unroll
    for (int k = 0; k < 2; ++k) {
      const Activated a = f(sums.c[j][2 * k]), b = f(sums.c[j][2 * k + 1]);
      sums.c[j][2 * k] = a.value;
      sums.c[j][2 * k + 1] = b.value;
      slopes.by.k[j / 2][j % 2 * 2 + k] = half_pair(a.slope, b.slope);
    }
}
template <int kTiles>
__device__ __forceinline__ void activate(Activation activation, TileSums<kTiles>& sums, SlopesOf<kTiles>& slopes) {
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

/// Loads `in` columns of a matrix [out, width] into [kRows, kStride], padded with zeros, with so many reads of a thread
/// on their way. No matrix: zeros.
template <int kRows, int kStride, int kThreads, int kAtOnce = 8>
__device__ void load_columns(const float* from, int out, int in, int width, __half* to) {
  for (int first = static_cast<int>(threadIdx.x); first < kRows * kStride; first += kAtOnce * kThreads) {
    float x[kAtOnce];
#pragma unroll
    for (int j = 0; j < kAtOnce; ++j) {
      const int k = first + j * kThreads, o = k / kStride, i = k - o * kStride;
      x[j] = from && o < out && i < in ? __ldg(from + o * width + i) : 0.0f;
    }
#pragma unroll
    for (int j = 0; j < kAtOnce; ++j)
      if (const int k = first + j * kThreads; k < kRows * kStride) to[k] = as_half(x[j]);
  }
}
/// All columns.
template <int kRows, int kStride, int kThreads, int kAtOnce = 8>
__device__ void load_matrix(const float* from, int out, int in, __half* to) {
  load_columns<kRows, kStride, kThreads, kAtOnce>(from, out, in, in, to);
}
__device__ inline void load_vector(const float* from, int n, float* to, int padded) {
  for (int k = static_cast<int>(threadIdx.x); k < padded; k += static_cast<int>(blockDim.x))
    to[k] = from && k < n ? from[k] : 0.0f;
}

/// The moments of a minibatch, from their parts.
struct BatchMoments {
  float inv_count, mean, variance;
  /// All lanes of a warp call it.
  __device__ explicit BatchMoments(const double* parts) {
    static_assert(kMomentParts == 64);
    const int lane = static_cast<int>(threadIdx.x) % 32;
    double sum[kMoments];
    for (int k = 0; k < kMoments; ++k) {
      sum[k] = parts[lane * kMoments + k] + parts[(lane + 32) * kMoments + k];
      for (int apart = 1; apart < 32; apart *= 2) sum[k] += __shfl_xor_sync(0xFFFFFFFFu, sum[k], apart);
    }
    const double count = sum[0] > 1 ? sum[0] : 1, m = sum[1] / count, v = sum[2] / count - m * m;
    inv_count = static_cast<float>(1 / count);
    mean = static_cast<float>(m);
    variance = static_cast<float>(v > 0 ? v : 0);
  }
};
/// Gradients are computed this many times larger, so that numbers of the size of `typical` become 1: half precision
/// has few numbers below 2^-14. A power of two, which rounds nothing.
__device__ inline float gradient_scale(float typical) {
  if (!(typical > 1e-9f && typical < 1e9f)) return 1.0f;
  return exp2f(-rintf(log2f(typical)));
}

/// Rows of a tile: whole states.
struct TileRows {
  int n, states;  // agents of a state, states of a tile
  int64_t n_tiles;
  __device__ TileRows(const FusedRows& rows, int most)
      : n(rows.n), states(most / n), n_tiles((rows.n_states + states - 1) / states) {}
  /// The row of the rollout; -1 beyond the last.
  __device__ int64_t source(const FusedRows& rows, int64_t tile, int row) const {
    const int local = row / n;
    const int64_t state = tile * states + local;
    if (local >= states || tile >= n_tiles || state >= rows.n_states) return -1;
    return (rows.states ? rows.states[state] : state) * n + (row - local * n);
  }
};

/// A NaN stays one.
__device__ inline float held(float x, float limit) { return x > limit ? limit : x < -limit ? -limit : x; }

/// The inputs of a warp's rows, on their way from global memory: two columns for each lane, and those 64 further.
template <int kIn, int kRows = 16>
struct FetchedInputs {
  static constexpr int kPairs = (kIn + 63) / 64;
  float2 x[kRows][kPairs];

  __device__ static int column(int j) { return j * 64 + static_cast<int>(threadIdx.x) % 32 * 2; }

  /// source(i): the row of the rollout, or below 0, of the warp's row i. kBehind: they are written while the kernel
  /// runs.
  template <bool kBehind = false, class Source>
  __device__ void fetch(const FusedRows& rows, int input, Source&& source) {
    // Pairs of columns are read together where they are aligned.
    const bool aligned = (reinterpret_cast<uintptr_t>(rows.obs) % 8 | static_cast<uintptr_t>(rows.obs_stride % 2)) == 0;
#pragma unroll
    for (int i = 0; i < kRows; ++i) {
      const int64_t from = source(i);
      const float* at = rows.obs + (from >= 0 ? from : 0) * rows.obs_stride;
#pragma unroll
      for (int j = 0; j < kPairs; ++j) {
        const int c = column(j);
        float2 two{0, 0};
        if (from >= 0 && c < input) {
          if (aligned)
            two = read<kBehind>(reinterpret_cast<const float2*>(at + c));
          else
            two = {read<kBehind>(at + c), c + 1 < input ? read<kBehind>(at + c + 1) : 0.0f};
        }
        x[i][j] = two;
      }
    }
  }
  /// To shared memory, where the warp's rows begin.
  template <int kStride>
  __device__ void store(const FusedRows& rows, int input, __half* to) {
#pragma unroll
    for (int j = 0; j < kPairs; ++j) {
      const int c = column(j);
      if (kIn % 64 != 0 && c >= kIn) continue;
      const bool first = c < input, second = c + 1 < input;
      float2 mean{0, 0}, std{1, 1};
      if (rows.obs_mean) {
        mean = {first ? __ldg(rows.obs_mean + c) : 0.0f, second ? __ldg(rows.obs_mean + c + 1) : 0.0f};
        std = {first ? __ldg(rows.obs_std + c) : 1.0f, second ? __ldg(rows.obs_std + c + 1) : 1.0f};
      }
#pragma unroll
      for (int i = 0; i < kRows; ++i) {
        float2 two = x[i][j];
        if (rows.obs_mean) {
          two.x = held((two.x - mean.x) / std.x, rows.obs_limit);
          two.y = held((two.y - mean.y) / std.y, rows.obs_limit);
        }
        *reinterpret_cast<uint32_t*>(to + i * kStride + c) = half_pair(first ? two.x : 0.0f, second ? two.y : 0.0f);
      }
    }
  }

 private:
  template <bool kBehind, class T>
  __device__ static T read(const T* at) {
    if constexpr (kBehind)
      return read_behind(at);
    else
      return __ldg(at);
  }
};

/// A warp's part of the gradient of a weight, as sums of so many rows and columns.
template <class Sums>
struct WeightGradientOf : Sums {
  int row, column;  // its first

  /// Of a gradient with so many parts one below the other.
  __device__ explicit WeightGradientOf(int row_parts) {
    const int warp = static_cast<int>(threadIdx.x) / 32;
    row = warp % row_parts * Sums::kRows;
    column = warp / row_parts * Sums::kColumns;
    this->clear();
  }
  /// += outer^T features, over the rows of a tile. f as for add_over_rows.
  template <int kDepth, int kStrideA, int kStride, class F>
  __device__ void add(const __half* outer, const __half* features, F&& f) {
    this->template add_over_rows<kDepth>(Halves<kStrideA>(outer, 0, row), Halves<kStride>(features, 0, column), f);
  }
  /// To the matrix [out, in].
  __device__ void write(float factor, int out, int in, float* to) {
    this->each([&](float value, int r, int c) {
      r += row;
      c += column;
      if (r < out && c < in) to[r * in + c] = value * factor;
    });
  }
};
/// Of a weight [64, ..] or [32, ..].
template <int kTiles>
using WeightGradient = WeightGradientOf<TileSums<kTiles>>;

/// The gradient of a bias: sums of rows, by tensor cores too. A warp has 16 numbers of one layer's.
struct BiasGradient {
  static constexpr uint32_t kOnes = 0x3C003C00;
  float c[4] = {0, 0, 0, 0};

  __device__ void add(const uint32_t (&tile)[4]) { multiply_add(c, tile, kOnes, kOnes); }
  /// The numbers from `first` on, to out [count].
  __device__ void write(float factor, int first, int count, float* out) const {
    const TileLane lane;
    if (lane.pair != 0) return;
    for (int k = 0; k < 2; ++k)
      if (const int at = first + lane.group + k * 8; at < count) out[at] = c[2 * k] * factor;
  }
};

/// Adds up numbers of all lanes with the same place in their group of four, in the same order each time.
__device__ __forceinline__ float sum_of_groups(float x) {
#pragma unroll
  for (int apart = 4; apart < 32; apart *= 2) x += __shfl_xor_sync(0xFFFFFFFFu, x, apart);
  return x;
}

}  // namespace giga
