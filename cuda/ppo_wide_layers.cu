// Wide networks (ppo_wide.hpp): the first layer, the products with a team weight, and the way back through the second
// weight.
#include "cuda/ppo_wide_tiles.cuh"

namespace giga {
namespace {

/// A warp has 32 columns of all rows: first of one half of the rows, then of the other. So two blocks share a
/// multiprocessor where inputs are few: one computes while the other waits for memory or at a barrier.
template <int kIn_>
struct FirstShape : WideShape<kIn_> {
  static constexpr int kWarps = 8, kThreads = kWarps * 32, kWarpRows = FirstShape::kRows / kWarps;
  static constexpr int kBlocks = kIn_ <= 64 ? 2 : 1;  // on a multiprocessor
  static constexpr int kHalfRows = FirstShape::kRows / 2;
};

template <class S>
struct FirstMemory {
  StagedInputs<S> next;  // inputs of the next tile, on their way
  alignas(16) __half x[S::kRows * S::kInStride];
  alignas(16) __half hidden1[S::kLayerHalves];  // for means over states
  alignas(16) __half weight1[S::kHidden * S::kInStride];
  alignas(16) float bias1[S::kHidden];
  float share[S::kRows];
  int64_t source[2][S::kRows];  // of this tile and the next
  uint8_t alive[S::kRows];
};

template <class S>
__global__ void __launch_bounds__(S::kThreads, S::kBlocks) wide_first_kernel(const __grid_constant__ WideFirst k) {
  extern __shared__ __align__(16) char shared[];
  FirstMemory<S>& m = *reinterpret_cast<FirstMemory<S>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileRows tiles(k.rows, S::kRows);
  const WideLayers& l = k.piece.layers;
  const int input = k.net.width[0];
  load_matrix<S::kHidden, S::kInStride, S::kThreads>(k.parameters + k.net.weight[0], k.net.width[1], input, m.weight1);
  load_vector(k.parameters + k.net.bias[0], k.net.width[1], m.bias1, S::kHidden);

  int64_t tile = blockIdx.x;
  bool next_alive = false;
  const auto choose = [&](int turn, int64_t of) {
    if (thread >= S::kRows) return;
    const int64_t source = of < k.piece.count ? tiles.source(k.rows, k.piece.first + of, thread) : -1;
    m.source[turn][thread] = source;
    next_alive = source >= 0 && k.rows.alive[source];
  };
  const auto fetch = [&](int turn) {
    m.next.fetch(k.rows, input, [&](int i) { return m.source[turn][warp * S::kWarpRows + i]; });
  };
  choose(0, tile);
  __syncthreads();
  fetch(0);
  for (int turn = 0; tile < k.piece.count; tile += gridDim.x, turn ^= 1) {
    m.next.wait();
    m.next.store(k.rows, input, m.x);
    if (thread < S::kRows) m.alive[thread] = next_alive;
    choose(turn ^ 1, tile + gridDim.x);
    __syncthreads();
    fetch(turn ^ 1);
    if (l.inputs) {
      constexpr int kChunks = S::kIn / 8;  // of 16 bytes
      uint4* to = reinterpret_cast<uint4*>(l.inputs) + tile * S::kRows * kChunks;
      for (int i = thread; i < S::kRows * kChunks; i += S::kThreads)
        to[i] = *reinterpret_cast<const uint4*>(m.x + i / kChunks * S::kInStride + i % kChunks * 8);
    }
    if (thread < S::kRows) {
      const int state = thread / tiles.n;
      int living = 0;
      if (state < tiles.states)
        for (int r = state * tiles.n; r < (state + 1) * tiles.n; ++r) living += m.alive[r];
      const float share = state < tiles.states && m.alive[thread] ? 1.0f / static_cast<float>(living) : 0.0f;
      m.share[thread] = share;
      l.share[tile * S::kRows + thread] = share;
    }

#pragma unroll 1
    for (int row = 0; row < S::kRows; row += S::kHalfRows) {
      const BlockPart<LayerTile> part(row, warp * 32);
      LayerSums<LayerTile> y;
      y.start(m.bias1 + part.column);
      y.template add_by_rows<S::kInDepth>(Halves<S::kInStride>(m.x, part.row, 0),
                                          Halves<S::kInStride>(m.weight1, part.column, 0));
      BlockSlopes<LayerTile> slopes;
      WideFactors features;
#pragma unroll
      for (int t = 0; t < S::kRowTiles; ++t) {
        activate_wide(k.net.activation, y.part[t], slopes.part[t]);
        features[t] = y.part[t].factor();
      }
      write_tile(features, part, tile, l.hidden1);
      if (l.means) store_tile(features, part, m.hidden1);
      if (!l.slopes1) continue;
#pragma unroll
      for (int t = 0; t < S::kRowTiles; ++t) features[t] = slopes.part[t].by;
      write_tile(features, part, tile, l.slopes1);
    }
    if (l.means) {
      __syncthreads();
      sum_wide_states<S::kThreads>(m.hidden1, tiles.n, tiles.states, l.means + tile * tiles.states * kWidePairs,
                                   [&m](int r) { return m.share[r]; });
    }
    __syncthreads();  // the next inputs take the place of these
  }
}

struct ProductMemory {
  alignas(16) __half rows[2][LayerTile::kLayerHalves];  // of this tile and the next
  alignas(16) __half weight[LayerTile::kHidden * LayerTile::kStride];
};

template <bool kForward>
__global__ void __launch_bounds__(LayerTile::kThreads, 1)
    wide_team_product_kernel(const __grid_constant__ WideTeamProduct k) {
  using S = LayerTile;
  extern __shared__ __align__(16) char shared[];
  ProductMemory& m = *reinterpret_cast<ProductMemory*>(shared);
  const BlockPart<S> part;
  const auto from = reinterpret_cast<const __half*>(k.from);
  load_ordered<S::kHidden, S::kStride, kForward ? Order::columns : Order::places,
               kForward ? Order::places : Order::columns, S::kThreads>(k.parameters + k.net.team_weight[1],
                                                                       k.net.width[2], k.net.width[1], m.weight);
  const int64_t tiles = (k.rows + S::kRows - 1) / S::kRows;
  const auto begin = [&](int64_t tile, int turn) {
    if (tile < tiles)
      begin_rows<S::kRows, S::kHidden, S::kStride, S::kThreads>(from + tile * S::kRows * S::kHidden, S::kHidden,
                                                                k.rows - tile * S::kRows, m.rows[turn]);
  };
  int64_t tile = blockIdx.x;
  begin(tile, 0);
  for (int turn = 0; tile < tiles; tile += gridDim.x, turn ^= 1) {
    wait_for_copies();
    __syncthreads();
    begin(tile + gridDim.x, turn ^ 1);
    LayerSums<S> y;
    y.clear();
    if constexpr (kForward)
      y.template add_by_rows<S::kDepth>(part.rows(m.rows[turn]), Halves<S::kStride>(m.weight, part.column, 0));
    else
      y.template add_by_columns<S::kDepth>(part.rows(m.rows[turn]), Halves<S::kStride>(m.weight, 0, part.column));
    WideFactors sums;
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t) sums[t] = y.part[t].factor();
    each_lane_row(part, tile, [&](int t, int i, int64_t at) {
      if (at < k.rows * kWidePairs)
        *reinterpret_cast<uint4*>(k.to + at) = {sums[t].k[0][i], sums[t].k[0][i + 2], sums[t].k[1][i],
                                                sums[t].k[1][i + 2]};
    });
  }
}

/// The derivatives of tanh or relu, from the features.
__device__ __forceinline__ uint32_t slopes_of(Activation activation, uint32_t features) {
  const float2 y = __half22float2(reinterpret_cast<const __half2&>(features));
  if (activation == Activation::tanh) return half_pair(1.0f - y.x * y.x, 1.0f - y.y * y.y);
  return half_pair(y.x > 0 ? 1.0f : 0.0f, y.y > 0 ? 1.0f : 0.0f);
}

/// The gradient of the first weight, where few inputs leave it room in the registers.
template <bool kHere>
struct FirstWeightGradient {
  static constexpr int kStride = WideBack::kFewInputs + 8, kHalves = LayerTile::kRows * kStride;

  __device__ void add(const __half*, const __half*) {}
  __device__ void write(const WideBack&) const {}
};
template <>
struct FirstWeightGradient<true> : FirstWeightGradient<false> {
  static constexpr int kRowParts = LayerTile::kHidden / 32;
  BlockWeightGradient<WideBack::kFewInputs / 16> weight{kRowParts};
  BlockBiasGradients bias;

  /// Of a tile: d1 [64, 256], x [64, 64].
  __device__ void add(const __half* d1, const __half* x) {
    weight.template add<LayerTile::kRowDepth, LayerTile::kStride, kStride>(d1, x, [&](int i, const uint32_t(&t)[4]) {
      if (weight.column == 0) bias.add(i, t);
    });
  }
  __device__ void write(const WideBack& k) {
    const float unscale = *k.piece.layers.unscale;
    const int out = k.net.width[1], in = k.net.width[0];
    float* part = k.piece.layers.parts + blockIdx.x * (k.net.size + kFusedSums);
    weight.write(unscale, out, in, part + k.net.weight[0]);
    if (weight.column > 0) return;
    for (int i = 0; i < 2; ++i) bias.write(i, unscale, weight.row + i * 16, out, part + k.net.bias[0]);
  }
};

template <bool kWeight>
struct BackMemory : ProductMemory {
  alignas(16) __half x[2][kWeight ? FirstWeightGradient<true>::kHalves : 8];  // of this tile and the next
};

template <bool kTeam, bool kWeight>
__global__ void __launch_bounds__(LayerTile::kThreads, 1) wide_back_kernel(const __grid_constant__ WideBack k) {
  using S = LayerTile;
  constexpr int kInputs = WideBack::kFewInputs;
  extern __shared__ __align__(16) char shared[];
  BackMemory<kWeight>& m = *reinterpret_cast<BackMemory<kWeight>*>(shared);
  const BlockPart<S> part;
  const WideLayers& l = k.piece.layers;
  load_ordered<S::kHidden, S::kStride, Order::places, Order::columns, S::kThreads>(
      k.parameters + k.net.weight[1], k.net.width[2], k.net.width[1], m.weight);
  FirstWeightGradient<kWeight> gradient;
  const auto begin = [&](int64_t tile, int turn) {
    if (tile >= k.piece.count) return;
    begin_tile(l.d2, tile, m.rows[turn]);
    if constexpr (kWeight)
      begin_rows<S::kRows, kInputs, FirstWeightGradient<true>::kStride, S::kThreads>(
          reinterpret_cast<const __half*>(l.inputs) + tile * S::kRows * kInputs, kInputs, S::kRows, m.x[turn]);
  };
  int64_t tile = blockIdx.x;
  begin(tile, 0);
  for (int turn = 0; tile < k.piece.count; tile += gridDim.x, turn ^= 1) {
    wait_for_copies();
    __syncthreads();
    begin(tile + gridDim.x, turn ^ 1);
    WideFactors slopes;
    read_tile(l.slopes1 ? l.slopes1 : l.hidden1, part, tile, slopes);
    TeamTerms of_team;
    if constexpr (kTeam) of_team.fetch(l.of_team, k.n, l.states, part, tile);
    LayerSums<S> y;
    y.clear();
    y.template add_by_columns<S::kDepth>(part.rows(m.rows[turn]), Halves<S::kStride>(m.weight, 0, part.column));
    if constexpr (kTeam) of_team.add(y, part, [&](int row) { return __ldg(l.share + tile * S::kRows + row); });
    WideFactors d1;
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t) {
      d1[t] = y.part[t].factor();
#pragma unroll
      for (int j = 0; j < S::kTiles / 2; ++j)
#pragma unroll
        for (int i = 0; i < 4; ++i) {
          const uint32_t kept = slopes[t].k[j][i];
          d1[t].k[j][i] = multiply_pairs(d1[t].k[j][i], l.slopes1 ? kept : slopes_of(k.net.activation, kept));
        }
    }
    if constexpr (kWeight) {
      __syncthreads();
      store_tile(d1, part, m.rows[turn]);
      __syncthreads();
      gradient.add(m.rows[turn], m.x[turn]);
    } else {
      write_tile(d1, part, tile, l.hidden1);
    }
  }
  gradient.write(k);
}

template <int kIn>
void start_first(const WideFirst& first, int blocks, void* stream) {
  using S = FirstShape<kIn>;
  static_assert(S::kBlocks * sizeof(FirstMemory<S>) <= kMostShared || S::kBlocks == 1);
  start_wide<FirstMemory<S>, S::kThreads>(wide_first_kernel<S>, first, S::kBlocks * blocks, stream);
}

template <bool kTeam, bool kWeight>
void start_back(const WideBack& back, int blocks, void* stream) {
  start_wide<BackMemory<kWeight>>(wide_back_kernel<kTeam, kWeight>, back, blocks, stream);
}

}  // namespace

void launch_wide(const WideFirst& first, int blocks, void* stream) {
  switch (WideLayers::padded_input(first.net)) {
    case 64:
      return start_first<64>(first, blocks, stream);
    case 128:
      return start_first<128>(first, blocks, stream);
    case FusedMlp::kMaxInput:
      return start_first<FusedMlp::kMaxInput>(first, blocks, stream);
    default:
      throw Error(cat("inputs of ", first.net.width[0], " numbers"));
  }
}
void launch_wide(const WideTeamProduct& product, int blocks, void* stream) {
  product.forward ? start_wide<ProductMemory>(wide_team_product_kernel<true>, product, blocks, stream)
                  : start_wide<ProductMemory>(wide_team_product_kernel<false>, product, blocks, stream);
}
void launch_wide(const WideBack& back, int blocks, void* stream) {
  const bool team = back.piece.layers.means;
  if (back.few_inputs())
    team ? start_back<true, true>(back, blocks, stream) : start_back<false, true>(back, blocks, stream);
  else
    team ? start_back<true, false>(back, blocks, stream) : start_back<false, false>(back, blocks, stream);
}

}  // namespace giga
