// The fused policy of some ten thousand rows, which find warps for all of them at nearly the same time: a warp takes 16
// rows through the network and waits for nobody. Each instruction runs a few times only, and the first time it has to
// be fetched, so the code is short: loops stay loops, and the layers are one. The weights of a block lie in shared
// memory before the rows are written, if the kernel is launched early.
#pragma once

#include "cuda/async_copy.cuh"
#include "cuda/early_launch.cuh"
#include "cuda/fused_policy.hpp"
#include "cuda/lane_logits.cuh"
#include "cuda/ppo_tiles.cuh"

namespace giga {

/// Shared memory of a block, for inputs padded to so many. Narrow networks.
template <int kIn>
struct WarpRowsBlock {
  static constexpr int kWarps = 10, kThreads = kWarps * 32;
  // On a multiprocessor, of registers: half of them are left to the launch before, behind which it begins early.
  static constexpr int kBlocks = 2;
  // Of a warp, one after the other: as fast as kernels of other shapes at up to three (60,000 rows), not measured
  // beyond.
  static constexpr int kMostTiles = 6;
  static constexpr int kPitch = kIn + 4;           // of a row, in fp32
  static constexpr int kInputStride = 2 * kPitch;  // of the same row in half precision, which takes its place
  static constexpr int kWeightStride = kIn + 8;
  static constexpr int kLayers = 3;
  alignas(16) float rows[kWarps][16 * kPitch];  // inputs, then features, then logits
  alignas(16) __half first[kHidden * kWeightStride];
  __half second[kHidden * kHiddenStride];
  __half third[kHead * kHiddenStride];
  alignas(16) float bias[kLayers][kHidden];

  __device__ __half* weights(int layer) { return layer == 0 ? first : layer == 1 ? second : third; }
};

/// Four rows of a warp in its registers, two columns of each 64 a lane.
template <int kIn>
struct FourRows {
  static constexpr int kRows = 4, kPairs = (kIn + 63) / 64;
  float2 x[kRows][kPairs];

  __device__ static int column(int j) { return j * 64 + static_cast<int>(threadIdx.x) % 32 * 2; }

  /// read(row, column, two): reads two numbers.
  template <class Read>
  __device__ explicit FourRows(Read&& read) {
#pragma unroll
    for (int i = 0; i < kRows; ++i)
#pragma unroll
      for (int j = 0; j < kPairs; ++j) read(i, column(j), x[i][j]);
  }
  /// Writes so many columns in half precision, row i to row_of(i).
  template <class RowOf>
  __device__ void put(int columns, RowOf&& row_of) const {
#pragma unroll
    for (int i = 0; i < kRows; ++i)
#pragma unroll
      for (int j = 0; j < kPairs; ++j)
        if (const int c = column(j); c < columns)
          *reinterpret_cast<uint32_t*>(row_of(i) + c) = half_pair(x[i][j].x, x[i][j].y);
  }
};

/// A matrix [out, in] as halves, padded with zeros.
template <int kIn, int kWarps>
__device__ void load_weights(const float* from, int out, int in, __half* to, int padded_out, int padded_in) {
  constexpr int kRows = FourRows<kIn>::kRows;
#pragma unroll 1
  for (int row = static_cast<int>(threadIdx.x) / 32 * kRows; row < padded_out; row += kWarps * kRows) {
    const FourRows<kIn> rows([&](int i, int c, float2& two) {
      const int left = row + i < out ? in - c : 0;
      const float* at = from + (row + i) * in + c;
      two = {left > 0 ? __ldg(at) : 0.0f, left > 1 ? __ldg(at + 1) : 0.0f};
    });
    rows.put(padded_in, [&](int i) { return to + (row + i) * (padded_in + 8); });
  }
}

/// The rows of a warp, in shared memory.
template <int kIn>
struct WarpRows {
  static constexpr int kPitch = WarpRowsBlock<kIn>::kPitch;
  float* at;
  int lane = static_cast<int>(threadIdx.x) % 32;

  /// Copies so many rows, at most 16.
  __device__ void copy(const float* from, int64_t stride, int input, int rows) const {
    if ((reinterpret_cast<uintptr_t>(from) % 16 | static_cast<uintptr_t>(stride % 4)) == 0) {
      // Whole pieces of four numbers: rows are made of such.
      const int pieces = (input + 3) / 4;
#pragma unroll 1
      for (int row = 0; row < rows; ++row)
        for (int piece = lane; piece < pieces; piece += 32)
          copy_16_bytes(at + row * kPitch + piece * 4, from + row * stride + piece * 4);
      wait_for_copies();
    } else {
#pragma unroll 1
      for (int row = 0; row < rows; ++row)
#pragma unroll 1
        for (int c = lane; c < input; c += 32) at[row * kPitch + c] = read_behind(from + row * stride + c);
    }
    __syncwarp();
  }
  /// Puts them in half precision, normalised, where they are: each row at its own place, padded with zeros, and rows of
  /// zeros where there are no more.
  __device__ void halve(const FusedRows& rows, int input, int n_rows) const {
    if (rows.obs_mean) normalise(rows, input, n_rows);
#pragma unroll 1
    for (int first = 0; first < 16; first += FourRows<kIn>::kRows) {
      const FourRows<kIn> some([&](int i, int c, float2& two) {
        const int left = first + i < n_rows ? input - c : 0;
        two = {0, 0};
        if (left > 0) two = *reinterpret_cast<const float2*>(at + (first + i) * kPitch + c);
        if (left == 1) two.y = 0;  // what a row of pieces has behind its numbers
      });
      __syncwarp();  // halves lie where numbers of the same row did
      some.put(kIn, [&](int i) { return reinterpret_cast<__half*>(at + (first + i) * kPitch); });
    }
    __syncwarp();
  }

 private:
  __device__ void normalise(const FusedRows& rows, int input, int n_rows) const {
#pragma unroll 1
    for (int c = lane; c < input; c += 32) {
      const float mean = __ldg(rows.obs_mean + c), std = __ldg(rows.obs_std + c);
#pragma unroll 1
      for (int row = 0; row < n_rows; ++row) {
        float& x = at[row * kPitch + c];
        x = held((x - mean) / std, rows.obs_limit);
      }
    }
    __syncwarp();
  }
};

/// Several policies in one launch. Blocks [.., most groups of a policy, policies].
template <int kIn>
__global__ void __launch_bounds__(WarpRowsBlock<kIn>::kThreads, WarpRowsBlock<kIn>::kBlocks)
    warp_rows_kernel(const __grid_constant__ FusedPolicies policies) {
  using Block = WarpRowsBlock<kIn>;
  extern __shared__ __align__(16) char shared[];
  Block& m = *reinterpret_cast<Block*>(shared);
  const FusedPolicy& k = policies.policy[blockIdx.z];
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  // A kernel that is launched early behind this one relies on what this one waits for, with nothing to do too.
  if (static_cast<int>(blockIdx.y) >= k.groups || !k.group_plays(blockIdx.y)) return wait_for_last();
  const int64_t step = static_cast<int64_t>(gridDim.x) * Block::kWarps * 16;
  int64_t at = (static_cast<int64_t>(blockIdx.x) * Block::kWarps + warp) * 16;
  const int64_t offset = blockIdx.y * k.group_stride, first_row = blockIdx.y * k.rows_per_group;
  const FusedMlp& net = k.net;
#pragma unroll 1
  for (int layer = 0; layer < Block::kLayers; ++layer) {
    const float* parameters = k.parameters + offset;
    const int out = net.width[layer + 1];
    load_weights<kIn, Block::kWarps>(parameters + net.weight[layer], out, net.width[layer], m.weights(layer),
                                     layer == 2 ? kHead : kHidden, layer == 0 ? kIn : kHidden);
    if (const int c = static_cast<int>(threadIdx.x); c < kHidden)
      m.bias[layer][c] = c < out ? __ldg(parameters + net.bias[layer] + c) : 0.0f;
  }
  const FusedRows rows = k.rows(offset);
  const bool discrete = k.actions == ActionKind::discrete;
  const WarpRows<kIn> own{m.rows[warp]};
  __half* const features = reinterpret_cast<__half*>(own.at);
  __syncthreads();
  wait_for_last();
#pragma unroll 1
  for (; at < k.rows_per_group; at += step) {
    const int64_t left = k.rows_per_group - at;
    const int n_rows = left < 16 ? static_cast<int>(left) : 16;
    own.copy(rows.obs + (first_row + at) * rows.obs_stride, rows.obs_stride, net.width[0], n_rows);
    own.halve(rows, net.width[0], n_rows);
#pragma unroll 1
    for (int layer = 0; layer < Block::kLayers; ++layer) {
      // A tile of the depth at a time, as TileSums::add_by_rows does.
      const bool first = layer == 0, last = layer == Block::kLayers - 1;
      const int depth = (first ? kIn : kHidden) / 16, by_stride = first ? Block::kWeightStride : kHiddenStride;
      const int stride = first ? Block::kInputStride : kHiddenStride;
      uint32_t a = shared_address(features + lane % 16 * stride + lane / 16 * 8);
      uint32_t b = shared_address(m.weights(layer) + (lane % 8 + lane / 16 * 8) * by_stride + lane / 8 % 2 * 8);
      TileSums<kHidden / 8> y;
      y.start(m.bias[layer]);
#pragma unroll 2
      for (int tile = 0; tile < depth; ++tile) {
        uint32_t left_tile[4];
        load(left_tile, a + tile * 32);
#pragma unroll
        for (int j = 0; j < kHidden / 8; j += 2)
          if (!last || j < kHead / 8) {
            uint32_t by[4];
            load(by, b + tile * 32 + j * 16 * by_stride);
            multiply_add(y.c[j], left_tile, by[0], by[1]);
            multiply_add(y.c[j + 1], left_tile, by[2], by[3]);
          }
      }
      __syncwarp();  // what follows takes the place of what has been read
      if (!last) {
        SlopesOf<kHidden / 8> slopes;
        activate(net.activation, y, slopes);
        store(y.factor(), features, kHiddenStride);
      } else {
        y.each([&](float value, int r, int c) {
          if (c < kLogitStride) own.at[r * kLogitStride + c] = value;
        });
      }
      __syncwarp();
    }
    if (discrete) {
      constexpr int kLanes = 4, kRows = 32 / kLanes;
#pragma unroll 1
      for (int begin = 0; begin < 16; begin += kRows) {
        const int row = begin + lane / kLanes;
        const auto choice = k.discrete.choose(LaneLogits<kLanes>(own.at + row * kLogitStride), [&] {
          return row < n_rows ? k.discrete.uniform(first_row + at + row) : 0.0f;
        });
        if (row < n_rows && lane % kLanes == 0) k.discrete.keep(first_row + at + row, choice);
      }
    } else if (lane < n_rows) {
      k.gaussian(offset).sample(first_row + at + lane, own.at + lane * kLogitStride);
    }
    __syncwarp();  // the next rows take the same memory
  }
}

}  // namespace giga
