// What the fused kernels of networks with up to 128 numbers in a hidden layer have in common. A warp's registers would
// not hold 16 rows of such a layer beside its part of the gradients, so here the warps of a block divide each product:
// a warp computes 32 rows x 32 columns of a layer, reads features of all columns from shared memory, and leaves its
// own there. Gradients of weights stay in registers across tiles, as they do in the kernels of 64 (ppo_tiles.cuh).
#pragma once

#include "cuda/async_copy.cuh"
#include "cuda/ppo_tiles.cuh"

namespace giga {

constexpr size_t kMostSharedAlone = 227 * 1024;  // bytes, of the only block on a multiprocessor of capability 9.0

/// The shape of a block's tiles: inputs padded to so many; whether gradients have shared memory of their own, or take
/// the place of the features once these are used, which costs a barrier each; how many layers' slopes are kept in
/// shared memory and not in registers.
template <int kIn_, bool kOwnGradients_, int kKeptSlopes_>
struct BlockShape {
  static constexpr int kIn = kIn_, kInStride = kIn + 8, kInDepth = kIn / 16;
  static constexpr bool kOwnGradients = kOwnGradients_;
  static constexpr int kKeptSlopes = kKeptSlopes_;
  static constexpr int kWarps = 8, kThreads = kWarps * 32;
  static constexpr int kRows = 64, kRowDepth = kRows / 16, kWarpRows = kRows / kWarps;
  static constexpr int kHidden = FusedMlp::kBlockHidden, kDepth = kHidden / 16, kStride = kHidden + 8;
  static constexpr int kLayerHalves = kRows * kStride;  // of the features of a layer
  // Of a layer a warp has so many tiles of 16 rows and of 8 columns.
  static constexpr int kRowTiles = 2, kTiles = 4, kColumnWarps = kHidden / 32;
  // Of the gradient of a weight [128, ..] a warp has 32 rows, and half of the columns.
  static constexpr int kInTiles = kIn / 16, kWeightTiles = kHidden / 16;
  static_assert(kRows == 32 * kRowTiles && kHidden == 4 * 8 * kTiles && kWarps == 2 * kColumnWarps);
  static_assert(kStride % 64 == 8 && kInStride % 64 == 8 && kStride * 2 % 16 == 0 && kInStride * 2 % 16 == 0,
                "rows of matrices begin where ldmatrix may read, and on different banks");
};

/// A warp's 16 kM rows x 8 kN columns of a result.
template <int kM, int kN>
struct BlockSums {
  static constexpr int kRows = 16 * kM, kColumns = 8 * kN;
  TileSums<kN> part[kM];

  __device__ void clear() {
#pragma unroll
    for (int m = 0; m < kM; ++m) part[m].clear();
  }
  /// Every row starts as these numbers, one for each column.
  __device__ void start(const float* columns) {
#pragma unroll
    for (int m = 0; m < kM; ++m) part[m].start(columns);
  }

  /// += a b^T: a [16 kM, 16 kDepth], b [8 kN, 16 kDepth], both in shared memory.
  template <int kDepth, int kStrideA, int kStride>
  __device__ void add_by_rows(Halves<kStrideA> a, Halves<kStride> b) {
    const uint32_t from = b.beside(), left = a.below();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) {
      uint32_t tile[kM][4];
#pragma unroll
      for (int m = 0; m < kM; ++m) load(tile[m], left + apart<kStrideA>(m * 16, k * 16));
#pragma unroll
      for (int j = 0; j < kN; j += 2) {
        uint32_t by[4];
        load(by, from + apart<kStride>(j * 8, k * 16));
        multiply(tile, j, by);
      }
    }
  }
  /// += a b: b [16 kDepth, 8 kN].
  template <int kDepth, int kStrideA, int kStride>
  __device__ void add_by_columns(Halves<kStrideA> a, Halves<kStride> b) {
    const uint32_t from = b.below(), left = a.below();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) {
      uint32_t tile[kM][4];
#pragma unroll
      for (int m = 0; m < kM; ++m) load(tile[m], left + apart<kStrideA>(m * 16, k * 16));
      add_columns<kStride>(tile, from + apart<kStride>(k * 16, 0));
    }
  }
  /// += a^T b: a [16 kDepth, 16 kM], b [16 kDepth, 8 kN]. f(m, tile): is shown each tile of a^T.
  template <int kDepth, int kStrideA, int kStride, class F>
  __device__ void add_over_rows(Halves<kStrideA> a, Halves<kStride> b, F&& f) {
    const uint32_t from = b.below(), left = a.beside();
#pragma unroll
    for (int k = 0; k < kDepth; ++k) {
      uint32_t tile[kM][4];
#pragma unroll
      for (int m = 0; m < kM; ++m) load_transposed(tile[m], left + apart<kStrideA>(k * 16, m * 16));
      add_columns<kStride>(tile, from + apart<kStride>(k * 16, 0));
#pragma unroll
      for (int m = 0; m < kM; ++m) f(m, tile[m]);
    }
  }

  /// f(number, row, column) of every number, in the warp's part.
  template <class F>
  __device__ void each(F&& f) {
#pragma unroll
    for (int m = 0; m < kM; ++m) part[m].each([&](float& value, int r, int c) { f(value, r + m * 16, c); });
  }

 private:
  __device__ void multiply(const uint32_t (&tile)[kM][4], int j, const uint32_t (&by)[4]) {
#pragma unroll
    for (int m = 0; m < kM; ++m) {
      multiply_add(part[m].c[j], tile[m], by[0], by[1]);
      multiply_add(part[m].c[j + 1], tile[m], by[2], by[3]);
    }
  }
  template <int kStride>
  __device__ void add_columns(const uint32_t (&tile)[kM][4], uint32_t b) {
#pragma unroll
    for (int j = 0; j < kN; j += 2) {
      uint32_t by[4];
      load_transposed(by, b + apart<kStride>(0, j * 8));
      multiply(tile, j, by);
    }
  }
};

/// The rows and columns of a layer that a warp computes.
template <class S>
struct BlockPart {
  int row, column;  // the first
  int bias;         // the first of the 16 numbers of a bias whose gradient it computes: of its part of the weight
  __device__ BlockPart() {
    const int warp = static_cast<int>(threadIdx.x) / 32;
    row = warp / S::kColumnWarps * 32;
    column = warp % S::kColumnWarps * 32;
    bias = column + row / 2;
  }
  /// Of no bias.
  __device__ BlockPart(int row_, int column_) : row(row_), column(column_), bias(-1) {}
  /// Their place in features, or in what is laid out like them.
  __device__ __half* at(__half* layer) const { return layer + row * S::kStride + column; }
  __device__ Halves<S::kStride> rows(const __half* layer) const { return {layer, row, 0}; }
};
template <class S>
using LayerSums = BlockSums<S::kRowTiles, S::kTiles>;

/// What a warp's numbers of a layer become, and their derivatives.
template <class S>
struct BlockSlopes {
  SlopesOf<S::kTiles> part[S::kRowTiles];

  /// Features in the place of sums: to shared memory, and in `sums`.
  __device__ void activate(Activation activation, LayerSums<S>& sums, __half* to) {
#pragma unroll
    for (int m = 0; m < S::kRowTiles; ++m) {
      giga::activate(activation, sums.part[m], part[m]);
      store(sums.part[m].factor(), to + m * 16 * S::kStride, S::kStride);
    }
  }
  /// The gradient by a layer's sums, from that by its features.
  __device__ void scale(const LayerSums<S>& gradient, Factor<S::kTiles / 2> (&out)[S::kRowTiles]) const {
#pragma unroll
    for (int m = 0; m < S::kRowTiles; ++m) out[m] = part[m].scaled(gradient.part[m]);
  }
  static __device__ void store_all(const Factor<S::kTiles / 2> (&gradient)[S::kRowTiles], __half* to) {
#pragma unroll
    for (int m = 0; m < S::kRowTiles; ++m) store(gradient[m], to + m * 16 * S::kStride, S::kStride);
  }
};

/// The slopes of a layer while they are in shared memory, if they are.
template <class S, bool kKept>
struct BlockKeptSlopes {
  static constexpr int kWords = S::kRowTiles * S::kTiles / 2;
  uint4 words[kKept ? kWords : 1][kKept ? S::kThreads : 1];

  __device__ void keep(const BlockSlopes<S>& slopes) {
    if constexpr (kKept)
#pragma unroll
      for (int i = 0; i < kWords; ++i) {
        const uint32_t(&k)[4] = slopes.part[i / (S::kTiles / 2)].by.k[i % (S::kTiles / 2)];
        words[i][threadIdx.x] = {k[0], k[1], k[2], k[3]};
      }
  }
  __device__ void take(BlockSlopes<S>& slopes) const {
    if constexpr (kKept)
#pragma unroll
      for (int i = 0; i < kWords; ++i) {
        const uint4 w = words[i][threadIdx.x];
        uint32_t(&k)[4] = slopes.part[i / (S::kTiles / 2)].by.k[i % (S::kTiles / 2)];
        k[0] = w.x;
        k[1] = w.y;
        k[2] = w.z;
        k[3] = w.w;
      }
  }
};

/// The first layer of a tile: its features to m.of.hidden1 and in `y`, its slopes in `slope` and where m keeps them.
template <class S, class Memory>
__device__ __forceinline__ void first_layer(Memory& m, const BlockPart<S>& part, Activation activation, LayerSums<S>& y,
                                            BlockSlopes<S>& slope) {
  y.start(m.bias1 + part.column);
  y.template add_by_rows<S::kInDepth>(Halves<S::kInStride>(m.x, part.row, 0),
                                      Halves<S::kInStride>(m.weight1, part.column, 0));
  slope.activate(activation, y, part.at(m.of.hidden1));
  m.slopes1.keep(slope);
}

/// Brings the inputs of the next tile into the second cache, where no registers are free to hold them: source(i) as
/// for FetchedInputs.
template <class S, class Source>
__device__ void begin_fetch(const FusedRows& rows, int input, Source&& source) {
  constexpr int kLine = 32;  // numbers of 128 bytes
  const int lane = static_cast<int>(threadIdx.x) % 32, lines = (input + kLine - 1) / kLine + 1;
  for (int i = lane; i < S::kWarpRows * lines; i += 32) {
    const int64_t from = source(i / lines);
    const int column = min(i % lines * kLine, input - 1);
    if (from >= 0) prefetch(rows.obs + from * rows.obs_stride + column);
  }
}

/// The inputs of a warp's rows on their way through shared memory, which takes no registers while they come.
template <class S>
struct StagedInputs {
  float x[S::kRows * S::kIn];

  /// source(i) as for FetchedInputs.
  template <class Source>
  __device__ void fetch(const FusedRows& rows, int input, Source&& source) {
    const bool aligned = (reinterpret_cast<uintptr_t>(rows.obs) % 8 | static_cast<uintptr_t>(rows.obs_stride % 2)) == 0;
    const uint32_t to = static_cast<uint32_t>(__cvta_generic_to_shared(own()));
#pragma unroll 2
    for (int i = 0; i < S::kWarpRows; ++i) {
      const int64_t from = source(i);
      const float* at = rows.obs + (from >= 0 ? from : 0) * rows.obs_stride;
#pragma unroll
      for (int j = 0; j < S::kIn / 64; ++j) {
        const int c = FetchedInputs<S::kIn>::column(j), count = from >= 0 ? max(0, min(input - c, 2)) : 0;
        const uint32_t there = to + static_cast<uint32_t>((i * S::kIn + c) * 4);
        const float* here = count > 0 ? at + c : rows.obs;
        if (aligned) {
          copy<8>(there, here, count * 4);
        } else {
          copy<4>(there, here, count > 0 ? 4 : 0);
          copy<4>(there + 4, count > 1 ? here + 1 : here, count > 1 ? 4 : 0);
        }
      }
    }
  }
  /// Those of the warp's rows that this lane has fetched are there.
  __device__ static void wait() { wait_for_copies(); }
  /// To the warp's rows of `to`. Each lane takes what it has fetched.
  __device__ void store(const FusedRows& rows, int input, __half* to) const {
    constexpr int kAtOnce = 2;
    const float* from = x + static_cast<int>(threadIdx.x) / 32 * S::kWarpRows * S::kIn;
    to += static_cast<int>(threadIdx.x) / 32 * S::kWarpRows * S::kInStride;
#pragma unroll 1
    for (int first = 0; first < S::kWarpRows; first += kAtOnce) {
      FetchedInputs<S::kIn, kAtOnce> some;
#pragma unroll
      for (int i = 0; i < kAtOnce; ++i)
#pragma unroll
        for (int j = 0; j < S::kIn / 64; ++j)
          some.x[i][j] = *reinterpret_cast<const float2*>(from + (first + i) * S::kIn + some.column(j));
      some.template store<S::kInStride>(rows, input, to + first * S::kInStride);
    }
  }

 private:
  __device__ float* own() { return x + static_cast<int>(threadIdx.x) / 32 * S::kWarpRows * S::kIn; }
  /// Begins a copy of kBytes, of which all but the first `count` are zeros.
  template <int kBytes>
  __device__ static void copy(uint32_t to, const float* from, int count) {
    asm volatile("cp.async.ca.shared.global [%0], [%1], %2, %3;" ::"r"(to), "l"(from), "n"(kBytes), "r"(count)
                 : "memory");
  }
};

/// A warp's part of the gradient of a weight [128, ..]: 32 rows, of so many tiles of columns; or of one [32, ..].
template <int kN>
using BlockWeightGradient = WeightGradientOf<BlockSums<2, kN>>;

/// A warp's part of the gradients of up to 8 biases, 16 numbers of each: sums of rows by tensor cores, as the columns
/// of one product.
struct BlockBiasGradients {
  float c[4] = {0, 0, 0, 0};

  /// Of bias number `bias`.
  __device__ void add(int bias, const uint32_t (&tile)[4]) {
    const uint32_t ones = static_cast<int>(threadIdx.x) % 32 / 4 == bias ? BiasGradient::kOnes : 0u;
    multiply_add(c, tile, ones, ones);
  }
  /// The numbers from `first` on, to out [count].
  __device__ void write(int bias, float factor, int first, int count, float* out) const {
    const TileLane lane;
    if (lane.pair != bias / 2 * 2) return;
    for (int k = 0; k < 2; ++k)
      if (const int at = first + lane.group + k * 8; at < count) out[at] = c[2 * k + bias % 2] * factor;
  }
};

}  // namespace giga
