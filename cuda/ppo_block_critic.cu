// The gradient of the value's loss, or the values, for critics on local observations with hidden layers of up to 128
// (ppo_gradients.hpp, ppo_block_tiles.cuh).
//
// What a team weight T gets of the rows h of a layer is mean(h) T^T, once for each state; the way back takes sums over
// the team first: G = sum(d), whence d_h = G T / living and d_T = G^T mean(h). The registers do not hold d_T beside the
// other gradients, so means and G of all states of a block are kept, and make d_T after the last tile (KeptStates).
#include "cuda/check.cuh"
#include "cuda/ppo_block.hpp"
#include "cuda/ppo_block_tiles.cuh"
#include "cuda/ppo_value_loss.cuh"

namespace giga {
namespace {

constexpr int kTeamStride = FusedMlp::kHidden + 4;  // floats: states that are read together lie on different banks
constexpr int kColumnParts = 4;                     // of a layer: warps that have the same rows
constexpr int kMostStates = KeptStates::kMost, kPairs = KeptStates::kWords;

/// Shared memory of a block that only critics with team weights have.
template <class S, bool kTeam>
struct TeamMemory {};
template <class S>
struct TeamMemory<S, true> {
  alignas(16) __half states[kMostStates * S::kStride];    // mean features of the first layer; then G
  alignas(16) float products[kMostStates * kTeamStride];  // with the team weight
};
template <class S, bool kTeam>
struct TeamWeight {};
template <class S>
struct TeamWeight<S, true> {
  alignas(16) __half weight2[S::kHidden * S::kStride];
  alignas(16) float weight3[S::kHidden];
  float inv_living[kMostStates];  // 1 / living agents of a state; 0: nobody lives
};
template <class S, bool kOwn>
struct LayerMemory {  // gradients by the sums of a layer take the place of features
  alignas(16) __half hidden1[S::kLayerHalves];
  alignas(16) __half hidden2[S::kLayerHalves];
  __device__ __half* gradient2() { return hidden2; }
};
template <class S>
struct LayerMemory<S, true> {
  alignas(16) __half hidden1[S::kLayerHalves];
  alignas(16) __half hidden2[S::kLayerHalves];
  alignas(16) __half second[S::kLayerHalves];
  __device__ __half* gradient2() { return second; }
};

/// Shared memory of a block.
template <class S, bool kTeam>
struct Memory {
  BlockKeptSlopes<S, (S::kKeptSlopes > 0)> slopes1;
  BlockKeptSlopes<S, (S::kKeptSlopes > 1)> slopes2;
  alignas(16) __half x[S::kRows * S::kInStride];
  // The inputs of the next tile come while nothing of this is read: with gradients of their own while the last product
  // of a tile runs, else between two tiles.
  struct Features : LayerMemory<S, S::kOwnGradients>, TeamMemory<S, kTeam> {};
  union {
    Features of;
    StagedInputs<S> next;
  };
  alignas(16) __half first[S::kOwnGradients ? S::kLayerHalves : 8];
  alignas(16) __half value[S::kRows * kValueStride];  // the gradient by the own part of the value, and by the team's
  alignas(16) __half weight1[S::kHidden * S::kInStride];
  alignas(16) __half weight2[S::kHidden * S::kStride];
  alignas(16) float bias1[S::kHidden], bias2[S::kHidden], weight3[S::kHidden];
  TeamWeight<S, kTeam> team;
  alignas(16) float dots[2][S::kRows][kColumnParts];  // a row's features times weight3, times the team's
  float2 by_value[S::kRows];                          // the gradients by the parts of the value, in fp32
  float d_value[S::kRows];
  int state[S::kRows];  // of each row, in the tile; -1: none
  uint8_t alive[S::kRows];
  float unscale;  // gradients are 1 / (unscale living rows) times too large
  float scale, sums[2][S::kWarps];
  int64_t source[2][S::kRows];  // of this tile and the next

  __device__ __half* gradient1() { return S::kOwnGradients ? first : of.hidden1; }
};

template <class S, bool kTeam>
__device__ void load_network(const FusedCritic& k, Memory<S, kTeam>& m, int n, int states) {
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2];
  load_matrix<S::kHidden, S::kInStride, S::kThreads>(k.parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<S::kHidden, S::kStride, S::kThreads>(k.parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_vector(k.parameters + net.bias[0], hidden1, m.bias1, S::kHidden);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, S::kHidden);
  load_vector(k.parameters + net.weight[2], hidden2, m.weight3, S::kHidden);
  if constexpr (kTeam) {
    load_matrix<S::kHidden, S::kStride, S::kThreads>(k.parameters + net.team_weight[1], hidden2, hidden1,
                                                     m.team.weight2);
    load_vector(k.parameters + net.team_weight[2], hidden2, m.team.weight3, S::kHidden);
  }
  const int thread = static_cast<int>(threadIdx.x);
  if (thread < S::kRows) m.state[thread] = thread < states * n ? thread / n : -1;
  for (int i = thread; i < S::kRows * kValueStride; i += S::kThreads) m.value[i] = __half(0);
  if (thread >= 32 || k.values) return;
  const BatchMoments moments(k.moments);
  if (thread > 0) return;
  take_scale(k, moments, m);
}

/// Sums over the agents of each state of matrix [rows, 128] become rows of m.of.states: of all agents; or of the living
/// ones, divided by their number. They are also written to `kept`, if any: [states, 64 pairs].
template <bool kMean, class S>
__device__ void sum_states(Memory<S, true>& m, const __half* matrix, int n, int states, uint32_t* kept) {
  const int pair = static_cast<int>(threadIdx.x) % kPairs;
  for (int s = static_cast<int>(threadIdx.x) / kPairs; s < states; s += S::kThreads / kPairs) {
    float2 sum{0, 0};
    int living = 0;
    for (int r = s * n; r < s * n + n; ++r) {
      if (kMean && !m.alive[r]) continue;
      const float2 x = __half22float2(*reinterpret_cast<const __half2*>(matrix + r * S::kStride + 2 * pair));
      sum.x += x.x;
      sum.y += x.y;
      ++living;
    }
    if constexpr (kMean) {
      const float share = living > 0 ? 1.0f / static_cast<float>(living) : 0.0f;
      sum.x *= share;
      sum.y *= share;
      if (pair == 0) m.team.inv_living[s] = share;
    }
    const uint32_t both = half_pair(sum.x, sum.y);
    *reinterpret_cast<uint32_t*>(m.of.states + s * S::kStride + 2 * pair) = both;
    if (kept) kept[s * kPairs + pair] = both;
  }
}

/// A warp's 16 columns of the products of all states with the team weight, to shared memory.
template <class S>
__device__ void keep_products(Memory<S, true>& m, BlockSums<2, 2>& product) {
  const TileLane lane;
  float* to = m.of.products + lane.group * kTeamStride + static_cast<int>(threadIdx.x) / 32 * 16 + lane.pair;
#pragma unroll
  for (int t = 0; t < 2; ++t)
#pragma unroll
    for (int j = 0; j < 2; ++j)
#pragma unroll
      for (int i = 0; i < 2; ++i)
        *reinterpret_cast<float2*>(to + (t * 16 + i * 8) * kTeamStride + j * 8) = {product.part[t].c[j][2 * i],
                                                                                   product.part[t].c[j][2 * i + 1]};
}
/// Adds to each row the products of its state; of the gradient each living agent has its share.
template <bool kShare, class S>
__device__ void add_products(Memory<S, true>& m, const BlockPart<S>& part, LayerSums<S>& y) {
  const TileLane lane;
#pragma unroll
  for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
    for (int i = 0; i < 2; ++i) {
      const int row = part.row + t * 16 + lane.group + i * 8, state = m.state[row];
      if (state < 0) continue;
      const float share = !kShare ? 1.0f : m.alive[row] ? m.team.inv_living[state] : 0.0f;
      const float* from = m.of.products + state * kTeamStride + part.column + lane.pair;
#pragma unroll
      for (int j = 0; j < S::kTiles; ++j) {
        const float2 x = *reinterpret_cast<const float2*>(from + j * 8);
        y.part[t].c[j][2 * i] += share * x.x;
        y.part[t].c[j][2 * i + 1] += share * x.y;
      }
    }
}

/// A warp's part of the gradient of the two weights of the value: 16 columns of features, times the gradients by the
/// value.
struct ValueWeightGradient {
  float c[4] = {0, 0, 0, 0};

  template <class S>
  __device__ void add(const __half* features, const __half* value) {
    const int lane = static_cast<int>(threadIdx.x) % 32, column = static_cast<int>(threadIdx.x) / 32 * 16;
    const uint32_t left = Halves<S::kStride>(features, 0, column).beside();
    const uint32_t from = static_cast<uint32_t>(__cvta_generic_to_shared(value + lane % 16 * kValueStride));
#pragma unroll
    for (int t = 0; t < S::kRowDepth; ++t) {
      uint32_t tile[4], by[2];
      load_transposed(tile, left + apart<S::kStride>(t * 16, 0));
      load_transposed(by, from + apart<kValueStride>(t * 16, 0));
      multiply_add(c, tile, by[0], by[1]);
    }
  }
  /// The first (0) or the second of the weights.
  __device__ void write(int which, float factor, int count, float* out) const {
    const TileLane lane;
    if (lane.pair != 0) return;
    const int first = static_cast<int>(threadIdx.x) / 32 * 16 + lane.group;
    for (int k = 0; k < 2; ++k)
      if (first + k * 8 < count) out[first + k * 8] = c[2 * k + which] * factor;
  }
};

/// The gradient of the second layer's team weight, from what was kept of `count` states.
template <class S>
__device__ void write_team_gradient(Memory<S, true>& m, const uint32_t* means, const uint32_t* sums, int64_t count,
                                    float factor, int out, int in, float* to) {
  constexpr int kWords = 4, kChunks = kPairs / kWords;  // 16 bytes at a time
  BlockWeightGradient<S::kWeightTiles> gradient(4);
  for (int64_t first = 0; first < count; first += S::kRows) {
#pragma unroll
    for (int i = static_cast<int>(threadIdx.x); i < S::kRows * kChunks; i += S::kThreads) {
      const int row = i / kChunks, chunk = i % kChunks;
      uint4 mean{0, 0, 0, 0}, sum{0, 0, 0, 0};
      if (first + row < count) {
        const int64_t at = (first + row) * kPairs + chunk * kWords;
        mean = *reinterpret_cast<const uint4*>(means + at);
        sum = *reinterpret_cast<const uint4*>(sums + at);
      }
      *reinterpret_cast<uint4*>(m.of.hidden1 + row * S::kStride + chunk * kWords * 2) = mean;
      *reinterpret_cast<uint4*>(m.of.hidden2 + row * S::kStride + chunk * kWords * 2) = sum;
    }
    __syncthreads();
    gradient.template add<S::kRowDepth, S::kStride, S::kStride>(m.of.hidden2, m.of.hidden1,
                                                                [](int, const uint32_t(&)[4]) {});
    __syncthreads();
  }
  gradient.write(factor, out, in, to);
}

template <class S, bool kTeam, bool kGradient>
__global__ void __launch_bounds__(S::kThreads, 1) block_critic_kernel(const __grid_constant__ FusedCritic k) {
  static_assert(S::kOwnGradients || kTeam, "else two barriers are missing");
  static_assert(S::kRows == KeptStates::kTileRows, "what is kept has room for the states of each tile");
  extern __shared__ __align__(16) char shared[];
  Memory<S, kTeam>& m = *reinterpret_cast<Memory<S, kTeam>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const TileRows tiles(k.rows, min(S::kRows, kMostStates * k.rows.n));
  const FusedMlp& net = k.net;
  const int input = net.width[0];
  const BlockPart<S> part;
  load_network(k, m, tiles.n, tiles.states);
  const float bias3 = k.parameters[net.bias[2]];
  const float value_mean = kGradient ? *k.loss.value_mean : 0.0f, value_std = kGradient ? *k.loss.value_std : 1.0f;
  // What is done once for a row is done by the first threads.
  const bool has_row = thread < S::kRows;
  uint32_t *kept_means = nullptr, *kept_sums = nullptr;
  int64_t n_kept = 0;
  if constexpr (kTeam && kGradient) {
    const int64_t words = KeptStates(tiles.n, k.rows.n_states, static_cast<int>(gridDim.x)).per_block * kPairs;
    kept_means = k.kept + blockIdx.x * 2 * words;
    kept_sums = kept_means + words;
  }

  BlockWeightGradient<S::kInTiles> d_weight1(4);
  BlockWeightGradient<S::kWeightTiles> d_weight2(4);
  ValueWeightGradient d_weight3;
  BlockBiasGradients d_bias;
  float d_bias3 = 0, loss = 0;

  int64_t tile = blockIdx.x;
  if (has_row) m.source[0][thread] = tiles.source(k.rows, tile, thread);
  __syncthreads();
  FetchedLossRow next_row;
  const auto source_of = [&](int turn) {
    return [&m, turn, warp](int i) { return m.source[turn][warp * S::kWarpRows + i]; };
  };
  const auto fetch = [&](int turn) {
    m.next.fetch(k.rows, input, source_of(turn));
    if (has_row) next_row.fetch(k, m.source[turn][thread]);
  };
  if constexpr (S::kOwnGradients) fetch(0);

  for (int turn = 0; tile < tiles.n_tiles; tile += gridDim.x, turn ^= 1) {
    if constexpr (!S::kOwnGradients) fetch(turn);
    m.next.wait();
    m.next.store(k.rows, input, m.x);
    const FetchedLossRow row = next_row;
    if (has_row) {
      m.alive[thread] = row.alive ? 1 : 0;
      m.source[turn ^ 1][thread] = tiles.source(k.rows, tile + gridDim.x, thread);
    }
    __syncthreads();

    // Forward.
    BlockSlopes<S> slope1, slope2;
    LayerSums<S> y;
    first_layer(m, part, net.activation, y, slope1);
    if constexpr (!S::kOwnGradients) begin_fetch<S>(k.rows, input, source_of(turn ^ 1));
    __syncthreads();
    if constexpr (kTeam) {
      sum_states<true>(m, m.of.hidden1, tiles.n, tiles.states, kGradient ? kept_means + n_kept * kPairs : nullptr);
      __syncthreads();
      BlockSums<2, 2> product;
      product.clear();
      product.template add_by_rows<S::kDepth>(Halves<S::kStride>(m.of.states, 0, 0),
                                              Halves<S::kStride>(m.team.weight2, warp * 16, 0));
      keep_products(m, product);
    }
    y.start(m.bias2 + part.column);
    y.template add_by_rows<S::kDepth>(part.rows(m.of.hidden1), Halves<S::kStride>(m.weight2, part.column, 0));
    if constexpr (kTeam) {
      __syncthreads();
      add_products<false>(m, part, y);
    }
    slope2.activate(net.activation, y, part.at(m.of.hidden2));
    m.slopes2.keep(slope2);

    // The values: products with one column.
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
      for (int d = 0; d < (kTeam ? 2 : 1); ++d) {
        float dots[2] = {};
        const float* weight = m.weight3;
        if constexpr (kTeam) weight = d == 0 ? m.weight3 : m.team.weight3;
#pragma unroll
        for (int j = 0; j < S::kTiles; ++j) {
          const float2 w = *reinterpret_cast<const float2*>(weight + part.column + j * 8 + lane.pair);
#pragma unroll
          for (int i = 0; i < 2; ++i) dots[i] += y.part[t].c[j][2 * i] * w.x + y.part[t].c[j][2 * i + 1] * w.y;
        }
#pragma unroll
        for (int i = 0; i < 2; ++i) {
          dots[i] += __shfl_xor_sync(0xFFFFFFFFu, dots[i], 1);
          dots[i] += __shfl_xor_sync(0xFFFFFFFFu, dots[i], 2);
          if (lane.pair == 0) m.dots[d][part.row + t * 16 + lane.group + i * 8][part.column / 32] = dots[i];
        }
      }
    __syncthreads();
    float2 by{0, 0};  // the gradients by the own part of the row's value, and by the team's
    if (has_row) {
      const auto dot = [&m](int d, int r) {
        const float4 x = *reinterpret_cast<const float4*>(m.dots[d][r]);
        return (x.x + x.y) + (x.z + x.w);
      };
      const int state = m.state[thread], begin = state * tiles.n, end = begin + tiles.n;
      float value = bias3 + dot(0, thread);
      if constexpr (kTeam) {
        if (state >= 0) {
          float sum = 0;
          for (int r = begin; r < end; ++r) sum += m.alive[r] ? dot(1, r) : 0.0f;
          value += sum * m.team.inv_living[state];
        }
      }
      if constexpr (kGradient) {
        if (row.alive) {
          const ValueError::Error e = k.loss.error.of(value, row.old_value, (row.returns - value_mean) / value_std);
          by.x = k.loss.value_coef * e.slope * m.scale;
          loss += e.loss;
        }
        d_bias3 += by.x;
        if constexpr (kTeam) m.d_value[thread] = by.x;
      } else {
        const int64_t source = m.source[turn][thread];
        if (source >= 0) k.values[source] = value;
      }
    }
    if constexpr (kTeam && kGradient) {  // the team's part of the value, which all of its agents share
      __syncthreads();
      if (has_row && row.alive) {
        const int state = m.state[thread], begin = state * tiles.n;
        for (int r = begin; r < begin + tiles.n; ++r) by.y += m.d_value[r];
        by.y *= m.team.inv_living[state];
      }
    }
    if (kGradient && has_row) {
      m.by_value[thread] = by;
      *reinterpret_cast<uint32_t*>(m.value + thread * kValueStride) = half_pair(by.x, by.y);
    }
    if constexpr (!kGradient && S::kOwnGradients) fetch(turn ^ 1);
    __syncthreads();
    if constexpr (kGradient) {
      // Backward. The gradient by the own part of the value, and by the team's.
      Factor<S::kTiles / 2> gradient[S::kRowTiles];
      d_weight3.template add<S>(m.of.hidden2, m.value);
#pragma unroll
      for (int j = 0; j < S::kTiles; ++j) {
        const int column = part.column + j * 8 + lane.pair;
        const float2 own = *reinterpret_cast<const float2*>(m.weight3 + column);
        float2 team{0, 0};
        if constexpr (kTeam) team = *reinterpret_cast<const float2*>(m.team.weight3 + column);
#pragma unroll
        for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
          for (int i = 0; i < 2; ++i) {
            const float2 by = m.by_value[part.row + t * 16 + lane.group + i * 8];
            y.part[t].c[j][2 * i] = by.x * own.x + by.y * team.x;
            y.part[t].c[j][2 * i + 1] = by.x * own.y + by.y * team.y;
          }
      }
      m.slopes2.take(slope2);
      slope2.scale(y, gradient);
      if constexpr (!S::kOwnGradients) __syncthreads();
      slope2.store_all(gradient, part.at(m.of.gradient2()));
      __syncthreads();
      d_weight2.template add<S::kRowDepth, S::kStride, S::kStride>(m.of.gradient2(), m.of.hidden1,
                                                                   [&](int i, const uint32_t(&t)[4]) {
                                                                     if (i == warp / 4) d_bias.add(1, t);
                                                                   });
      if constexpr (kTeam) {
        sum_states<false>(m, m.of.gradient2(), tiles.n, tiles.states, kept_sums + n_kept * kPairs);
        n_kept += tiles.states;
        __syncthreads();
        BlockSums<2, 2> product;
        product.clear();
        product.template add_by_columns<S::kDepth>(Halves<S::kStride>(m.of.states, 0, 0),
                                                   Halves<S::kStride>(m.team.weight2, 0, warp * 16));
        keep_products(m, product);
      }
      y.clear();
      y.template add_by_columns<S::kDepth>(part.rows(m.of.gradient2()), Halves<S::kStride>(m.weight2, 0, part.column));
      if constexpr (kTeam) {
        __syncthreads();
        add_products<true>(m, part, y);
      }
      m.slopes1.take(slope1);
      slope1.scale(y, gradient);
      slope1.store_all(gradient, part.at(m.gradient1()));
      __syncthreads();
      if constexpr (S::kOwnGradients) fetch(turn ^ 1);
      d_weight1.template add<S::kRowDepth, S::kStride, S::kInStride>(m.gradient1(), m.x,
                                                                     [&](int i, const uint32_t(&t)[4]) {
                                                                       if (i == warp / 4) d_bias.add(0, t);
                                                                     });
      __syncthreads();
    }
  }

  if constexpr (kGradient) {  // the block's sums
    const float unscale = m.unscale;
    const int hidden1 = net.width[1], hidden2 = net.width[2];
    float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
    d_weight1.write(unscale, hidden1, input, out + net.weight[0]);
    d_weight2.write(unscale, hidden2, hidden1, out + net.weight[1]);
    d_weight3.write(0, unscale, hidden2, out + net.weight[2]);
    d_bias.write(0, unscale, part.bias, hidden1, out + net.bias[0]);
    d_bias.write(1, unscale, part.bias, hidden2, out + net.bias[1]);
    if constexpr (kTeam) {
      d_weight3.write(1, unscale, hidden2, out + net.team_weight[2]);
      m.next.wait();  // before the same memory serves for what was kept
      __syncthreads();
      write_team_gradient(m, kept_means, kept_sums, n_kept, unscale, hidden2, hidden1, out + net.team_weight[1]);
    }
    write_value_sums<S>(net, m, d_bias3, loss, unscale, out);
  }
}

template <class S, bool kTeam, bool kGradient>
void launch(const FusedCritic& critic, void* stream) {
  using Shared = Memory<S, kTeam>;
  static_assert(sizeof(Shared) <= kMostSharedAlone);
  const auto kernel = block_critic_kernel<S, kTeam, kGradient>;
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(Shared)));
  kernel<<<critic.n_partial, S::kThreads, sizeof(Shared), static_cast<cudaStream_t>(stream)>>>(critic);
  GIGA_CUDA(cudaGetLastError());
}
template <bool kTeam, bool kGradient>
void launch(const FusedCritic& critic, void* stream) {
  constexpr int kMaxInput = FusedMlp::kMaxInput;
  const int input = critic.net.width[0];
  if (input <= 64) return launch<BlockShape<64, true, 0>, kTeam, kGradient>(critic, stream);
  if (input <= 128) return launch<BlockShape<128, true, 0>, kTeam, kGradient>(critic, stream);
  GIGA_CHECK(input <= kMaxInput, "inputs of ", input, " numbers");
  launch<BlockShape<kMaxInput, !kTeam, kTeam ? 1 : 2>, kTeam, kGradient>(critic, stream);
}

}  // namespace

void launch_block_critic_gradient(const FusedCritic& critic, void* stream) {
  const bool team = critic.net.team_weight[1] >= 0;
  if (critic.values) return team ? launch<true, false>(critic, stream) : launch<false, false>(critic, stream);
  GIGA_CHECK(!team || critic.kept, "work memory");
  team ? launch<true, true>(critic, stream) : launch<false, true>(critic, stream);
}

}  // namespace giga
