// The gradient of the value's loss, or the values, for critics of the true state with hidden layers of up to 128
// (FusedState in ppo_gradients.hpp, ppo_state_critic_memory.cuh).
//
// A tile has whole states, with up to 64 agents of the own team and as many of the other. What a value reads besides
// the agent's own code is alike for the rows of a state, so a state takes it through the second layer once
// (ppo_state_critic_shared.cuh).
#include "cuda/check.cuh"
#include "cuda/ppo_block.hpp"
#include "cuda/ppo_state_critic_memory.cuh"
#include "cuda/ppo_state_critic_shared.cuh"

namespace giga {
namespace {

/// The rows and columns of a layer that a warp computes.
template <class S>
struct StatePart {
  int row, column;  // the first
  __device__ StatePart() {
    const int warp = static_cast<int>(threadIdx.x) / 32;
    row = warp / S::kColumnParts * 16 * S::kRowTiles;
    column = warp % S::kColumnParts * 32;
  }
  __device__ __half* at(__half* layer) const { return layer + row * S::kStride + column; }
  __device__ Halves<S::kStride> rows(const __half* layer) const { return {layer, row, 0}; }
  /// f(a, b, row, tile, column) of every two numbers side by side that are the lane's: their row, the tile of columns
  /// among the warp's, and the column of the first.
  template <class F>
  __device__ void each_pair(LayerSums<S>& y, F&& f) const {
    const TileLane lane;
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
      for (int i = 0; i < 2; ++i)
#pragma unroll
        for (int j = 0; j < S::kTiles; ++j)
          f(y.part[t].c[j][2 * i], y.part[t].c[j][2 * i + 1], row + t * 16 + lane.group + i * 8, j,
            column + j * 8 + lane.pair);
  }
};

/// The codes of one team's agents to m.codes, their slopes in `slope`.
template <class S>
__device__ __forceinline__ void encode(StateMemory<S>& m, const StatePart<S>& part, Activation activation, int team,
                                       BlockSlopes<S>& slope) {
  LayerSums<S> y;
  y.start(m.bias1 + part.column);
  y.template add_by_rows<S::kIn / 16>(Halves<S::kInStride>(m.agents[team], part.row, 0),
                                      Halves<S::kInStride>(m.encoder, part.column, 0));
  slope.activate(activation, y, part.at(m.codes[team]));
}

/// What the block's warps have found of the encoder, of the second layer's weight on an agent's own code and of the
/// value's weight, to `out`. m.products is free.
template <class S>
__device__ void write_own_gradients(const FusedMlp& net, StateMemory<S>& m, const StatePart<S>& part,
                                    StateWeightGradient<S, S::kHidden / 2>& d_own,
                                    StateWeightGradient<S, S::kIn>& d_encoder, const float2 (&d_weight3)[S::kTiles],
                                    float* out) {
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const float unscale = m.unscale;
  const int input = net.width[0], codes = net.width[1], hidden = net.width[2], reads = net.state.inputs(codes);
  float *const by_others = m.products[0], *const by_rows = m.products[1];  // [kHidden, kIn], [row parts, kHidden]
  d_own.each([&](float value, int r, int c) {
    r += d_own.row;
    c += d_own.column;
    if (r < hidden && c < codes) out[net.weight[1] + r * reads + c] = value * unscale;
  });
  if (warp >= 4)
    d_encoder.each([&](float value, int r, int c) { by_others[(r + d_encoder.row) * S::kIn + c] = value; });
#pragma unroll
  for (int j = 0; j < S::kTiles; ++j) {
    const float a = sum_of_groups(d_weight3[j].x), b = sum_of_groups(d_weight3[j].y);
    if (lane.group == 0)
      *reinterpret_cast<float2*>(by_rows + warp / S::kColumnParts * S::kHidden + part.column + j * 8 + lane.pair) = {a,
                                                                                                                     b};
  }
  __syncthreads();
  if (warp < 4)
    d_encoder.each([&](float value, int r, int c) {
      r += d_encoder.row;
      value = (value + by_others[r * S::kIn + c]) * unscale;
      if (r >= codes) return;
      if (c < input) out[net.weight[0] + r * input + c] = value;
      if (c == input) out[net.bias[0] + r] = value;  // of the 1 behind the agent's numbers
    });
  if (thread < hidden) {
    float sum = 0;
    for (int p = 0; p < S::kWarps / S::kColumnParts; ++p) sum += by_rows[p * S::kHidden + thread];
    out[net.weight[2] + thread] = sum * unscale;
  }
}

template <class S, bool kGradient>
__global__ void __launch_bounds__(S::kThreads, 1) state_critic_kernel(const __grid_constant__ FusedCritic k) {
  extern __shared__ __align__(16) char shared[];
  StateMemory<S>& m = *reinterpret_cast<StateMemory<S>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const StateTiles tiles(k);
  const FusedMlp& net = k.net;
  const StatePart<S> part;
  load_network(k, tiles, m);
  const float bias3 = k.parameters[net.bias[2]];
  const float value_mean = kGradient ? *k.loss.value_mean : 0.0f, value_std = kGradient ? *k.loss.value_std : 1.0f;
  // What is done once for a row is done by the first threads.
  const bool has_row = thread < S::kRows;
  uint32_t* kept = nullptr;
  int64_t n_kept = 0, stride = 0;
  if constexpr (kGradient) {
    const KeptTrueStates keeping(net, tiles.n[0], k.rows.n_states, static_cast<int>(gridDim.x));
    kept = k.kept + blockIdx.x * keeping.words_per_block();
    stride = keeping.per_block * S::kPairs;
  }

  const auto nothing = [](int, const uint32_t(&)[4]) {};
  StateWeightGradient<S, S::kHidden / 2> d_own(4);
  StateWeightGradient<S, S::kIn> d_encoder(4);  // of the own team's agents, and of the others': four warps each
  d_encoder.column = 0;
  float2 d_weight3[S::kTiles] = {};
  float d_bias3 = 0, loss = 0;

  int64_t tile = blockIdx.x;
  if (thread < S::kStates) m.source[0][thread] = tiles.source(k.rows, tile, thread);
  __syncthreads();
  FetchedLossRow next_row;
  const auto row_source = [&](int turn) -> int64_t {
    const int state = m.state[kOwnTeam][thread];
    const int64_t source = state >= 0 ? m.source[turn][state] : -1;
    return source >= 0 ? source * tiles.n[0] + (thread - state * tiles.n[0]) : -1;
  };
  const auto fetch = [&](int turn) {
    fetch_numbers(k.rows, tiles, m, turn);
    if (has_row) next_row.fetch(k, row_source(turn));
  };
  fetch(0);

  for (int turn = 0; tile < tiles.n_tiles; tile += gridDim.x, turn ^= 1) {
    wait_for_copies();
    __syncthreads();
    uint32_t* const kept_here = kGradient ? kept + n_kept * S::kPairs : nullptr;
    take_numbers(tiles, m, kGradient ? kept_here + KeptTrueStates::kWorld * stride : nullptr);
    const FetchedLossRow row = next_row;
    if (thread < S::kStates) m.source[turn ^ 1][thread] = tiles.source(k.rows, tile + gridDim.x, thread);
    __syncthreads();
    fetch(turn ^ 1);

    // Forward.
    BlockSlopes<S> slope1, slope2;
    encode(m, part, net.activation, kOtherTeam, slope2);
    encode(m, part, net.activation, kOwnTeam, slope1);
    __syncthreads();
    take_means(tiles, m, kept_here, stride);
    __syncthreads();
    if constexpr (kGradient)
#pragma unroll
      for (int t = 0; t < S::kRowTiles; ++t)
        store(slope2.part[t].by, part.at(m.codes[kOtherTeam]) + t * 16 * S::kStride, S::kStride);
    multiply_states(m);
    LayerSums<S> y;
    y.start(m.bias2 + part.column);
    y.template add_by_rows<S::kDepth>(part.rows(m.codes[kOwnTeam]), Halves<S::kStride>(m.of_own, part.column, 0));
    __syncthreads();
    const auto product = [&](int r, int column) {
      const int state = m.state[kOwnTeam][r];
      return state < 0 ? float2{0, 0}
                       : *reinterpret_cast<const float2*>(m.products[0] + state * S::kProductStride + column);
    };
    part.each_pair(y, [&](float& a, float& b, int r, int, int column) {
      const float2 x = product(r, column);
      a += x.x;
      b += x.y;
    });
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t) activate(net.activation, y.part[t], slope2.part[t]);

      // The values: products with one column.
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        float dot = 0;
#pragma unroll
        for (int j = 0; j < S::kTiles; ++j) {
          const float2 w = *reinterpret_cast<const float2*>(m.weight3 + part.column + j * 8 + lane.pair);
          dot += y.part[t].c[j][2 * i] * w.x + y.part[t].c[j][2 * i + 1] * w.y;
        }
        dot += __shfl_xor_sync(0xFFFFFFFFu, dot, 1);
        dot += __shfl_xor_sync(0xFFFFFFFFu, dot, 2);
        if (lane.pair == 0) m.dots[part.row + t * 16 + lane.group + i * 8][part.column / 32] = dot;
      }
    __syncthreads();
    if (has_row) {
      const float4 dots = *reinterpret_cast<const float4*>(m.dots[thread]);
      const float value = bias3 + ((dots.x + dots.y) + (dots.z + dots.w));
      if constexpr (kGradient) {
        float by = 0;
        if (row.alive) {
          const ValueError::Error e = k.loss.error.of(value, row.old_value, (row.returns - value_mean) / value_std);
          by = k.loss.value_coef * e.slope * m.scale;
          loss += e.loss;
        }
        d_bias3 += by;
        m.by_value[thread] = by;
      } else {
        const int64_t source = row_source(turn);
        if (source >= 0) k.values[source] = value;
      }
    }
    if constexpr (kGradient) {
      __syncthreads();
      // Backward.
      Factor<S::kTiles / 2> gradient[S::kRowTiles];
      part.each_pair(y, [&](float& a, float& b, int r, int j, int column) {
        const float by = m.by_value[r];
        const float2 w = *reinterpret_cast<const float2*>(m.weight3 + column);
        d_weight3[j].x += by * a;
        d_weight3[j].y += by * b;
        a = by * w.x;
        b = by * w.y;
      });
      slope2.scale(y, gradient);
      slope2.store_all(gradient, part.at(m.gradient));
      __syncthreads();
      d_own.template add<S::kRowDepth, S::kStride, S::kStride>(m.gradient, m.codes[kOwnTeam], nothing);
      take_totals(tiles, m, kept_here + KeptTrueStates::kTotal * stride);
      n_kept += tiles.states;
      __syncthreads();
      multiply_totals(m);
      y.clear();
      y.template add_by_columns<S::kDepth>(part.rows(m.gradient), Halves<S::kStride>(m.of_own, 0, part.column));
      __syncthreads();
      part.each_pair(y, [&](float& a, float& b, int r, int, int column) {
        const float2 x = product(r, column);
        const float share = m.share[kOwnTeam][r];
        a += share * x.x;
        b += share * x.y;
      });
      slope1.scale(y, gradient);
      slope1.store_all(gradient, part.at(m.codes[kOwnTeam]));
      take_others_gradient(m);
      __syncthreads();
      d_encoder.template add<S::kRowDepth, S::kStride, S::kInStride>(m.codes[warp / 4], m.agents[warp / 4], nothing);
    }
  }
  wait_for_copies();

  if constexpr (kGradient) {  // the block's sums
    float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
    write_own_gradients(net, m, part, d_own, d_encoder, d_weight3, out);
    write_kept_gradients(net, m, kept, stride, n_kept, out);
    write_value_sums<S>(net, m, d_bias3, loss, m.unscale, out);
  }
}

template <class S, bool kGradient>
void launch(const FusedCritic& critic, void* stream) {
  static_assert(sizeof(StateMemory<S>) <= kMostSharedAlone);
  const auto kernel = state_critic_kernel<S, kGradient>;
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(StateMemory<S>)));
  kernel<<<critic.n_partial, S::kThreads, sizeof(StateMemory<S>), static_cast<cudaStream_t>(stream)>>>(critic);
  GIGA_CUDA(cudaGetLastError());
}
template <class S>
void launch(const FusedCritic& critic, void* stream) {
  GIGA_CHECK(critic.net.width[0] < S::kIn && critic.net.state.fits(), "a state of this size");
  if (critic.values) return launch<S, false>(critic, stream);
  GIGA_CHECK(critic.kept, "work memory");
  launch<S, true>(critic, stream);
}

}  // namespace

void launch_state_critic_gradient(const FusedCritic& critic, void* stream) {
  critic.net.is_narrow() ? launch<StateShape<64>>(critic, stream) : launch<StateShape<128>>(critic, stream);
}

}  // namespace giga
