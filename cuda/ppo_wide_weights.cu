// Wide networks (ppo_wide.hpp): the gradients of their large weights, as products over all rows, and the sums over
// blocks.
#include "cuda/ppo_wide_tiles.cuh"

namespace giga {
namespace {

/// A block computes kOut rows and kIn columns of a gradient, of which a warp has 32 rows.
template <int kOut_, int kIn_>
struct WeightShape {
  static constexpr int kOut = kOut_, kIn = kIn_, kOutStride = kOut + 8, kInStride = kIn + 8;
  static constexpr int kRows = 128, kThreads = LayerTile::kThreads;
  static constexpr int kRowParts = kOut / 32, kTiles = kIn / (LayerTile::kWarps / kRowParts) / 8;
  static constexpr bool kHalved = kOut < WideLayers::kWidth, kInputs = kIn < WideLayers::kWidth;
};

template <class S>
struct WeightMemory {
  alignas(16) __half outer[2][S::kRows * S::kOutStride];  // of this tile and the next
  alignas(16) __half inner[2][S::kRows * S::kInStride];
};

template <class S>
__global__ void __launch_bounds__(S::kThreads, 1) wide_weight_kernel(const __grid_constant__ WideWeight k) {
  extern __shared__ __align__(16) char shared[];
  WeightMemory<S>& m = *reinterpret_cast<WeightMemory<S>*>(shared);
  const int warp = static_cast<int>(threadIdx.x) / 32;
  const TileLane lane;
  // Two blocks that lie side by side have the same rows, and each its half of the weight.
  const int half = S::kHalved ? static_cast<int>(blockIdx.x) % 2 : 0;
  const int64_t block = S::kHalved ? blockIdx.x / 2 : blockIdx.x, blocks = S::kHalved ? gridDim.x / 2 : gridDim.x;
  const auto outer = reinterpret_cast<const __half*>(k.outer) + half * S::kOut;
  const auto inner = reinterpret_cast<const __half*>(k.inner);
  const int64_t tiles = (k.rows + S::kRows - 1) / S::kRows;
  const auto begin = [&](int64_t tile, int turn) {
    if (tile >= tiles) return;
    const int64_t first = tile * S::kRows;
    begin_rows<S::kRows, S::kOut, S::kOutStride, S::kThreads>(outer + first * WideLayers::kWidth, WideLayers::kWidth,
                                                              k.rows - first, m.outer[turn]);
    begin_rows<S::kRows, S::kIn, S::kInStride, S::kThreads>(inner + first * S::kIn, S::kIn, k.rows - first,
                                                            m.inner[turn]);
  };
  BlockWeightGradient<S::kTiles> gradient(S::kRowParts);
  BlockBiasGradients bias;  // those of the first columns have it
  const bool has_bias = k.bias >= 0 && warp < S::kRowParts;
  int64_t tile = block;
  begin(tile, 0);
  for (int turn = 0; tile < tiles; tile += blocks, turn ^= 1) {
    wait_for_copies();
    __syncthreads();
    begin(tile + blocks, turn ^ 1);
    gradient.template add<S::kRows / 16, S::kOutStride, S::kInStride>(m.outer[turn], m.inner[turn],
                                                                      [&](int i, const uint32_t(&t)[4]) {
                                                                        if (has_bias) bias.add(i, t);
                                                                      });
  }

  const float unscale = *k.unscale;
  float* out = k.parts + block * k.stride;
  gradient.each([&](float value, int r, int c) {
    r = wide_place(half * S::kOut + gradient.row + r);
    c = S::kInputs ? gradient.column + c : wide_place(gradient.column + c);
    if (r < k.out && c < k.in) out[k.weight + r * k.in + c] = value * unscale;
  });
  if (!has_bias) return;
    // The first lane of each four has columns 0 and 1: the sums for i = 0 and 1.
#pragma unroll
  for (int i = 0; i < 2; ++i)
#pragma unroll
    for (int of_group = 0; of_group < 2; ++of_group) {
      const int r = wide_place(half * S::kOut + gradient.row + i * 16 + of_group * 8 + lane.group);
      if (lane.pair == 0 && r < k.out) out[k.bias + r] = bias.c[of_group * 2 + i] * unscale;
    }
}

template <class S>
void start(const WideWeight& weight, int blocks, void* stream) {
  static_assert(S::kHalved == (S::kIn > WideWeight::kMostWhole));
  start_wide<WeightMemory<S>>(wide_weight_kernel<S>, weight, weight.blocks(blocks), stream);
}

constexpr int kSumColumns = WideSums::kColumns, kSumRows = LayerTile::kThreads / kSumColumns;

/// Shared memory: [kSumRows][kSumColumns].
__global__ void __launch_bounds__(LayerTile::kThreads) wide_sums_kernel(const __grid_constant__ WideSums k) {
  extern __shared__ __align__(16) char shared[];
  float* const work = reinterpret_cast<float*>(shared);
  const int thread = static_cast<int>(threadIdx.x);
  const int64_t column = static_cast<int64_t>(blockIdx.x) * kSumColumns + thread % kSumColumns;
  const bool some = column < k.stride;
  float sum = 0;
  if (some)
    for (int part = thread / kSumColumns, end = k.parts_of(column); part < end; part += kSumRows)
      sum += k.parts[part * k.stride + column];
  work[thread] = sum;
  __syncthreads();
  if (thread >= kSumColumns || !some) return;
  for (int row = 1; row < kSumRows; ++row) sum += work[row * kSumColumns + thread];
  k.to[column] = sum;
}

}  // namespace

void launch_wide(const WideWeight& weight, int blocks, void* stream) {
  switch (weight.inner_width) {
    case 128:
      return start<WeightShape<256, 128>>(weight, blocks, stream);
    case FusedMlp::kMaxInput:
      return start<WeightShape<128, FusedMlp::kMaxInput>>(weight, blocks, stream);
    case WideLayers::kWidth:
      return start<WeightShape<128, WideLayers::kWidth>>(weight, blocks, stream);
    default:
      throw Error(cat("rows of ", weight.inner_width, " numbers"));
  }
}

void launch_wide(const WideSums& sums, int, void* stream) {
  struct Memory {
    float work[kSumRows][kSumColumns];
  };
  start_wide<Memory>(wide_sums_kernel, sums, sums.blocks(), stream);
}

}  // namespace giga
