// The gradient of the value's loss, or the values, for critics on local observations with hidden layers of up to 128
// (ppo_gradients.hpp, ppo_block_tiles.cuh, ppo_block_team.cuh).
#include "cuda/check.cuh"
#include "cuda/ppo_block.hpp"
#include "cuda/ppo_block_critic_memory.cuh"
#include "cuda/ppo_block_heads.cuh"
#include "cuda/ppo_block_team.cuh"
#include "cuda/ppo_block_tiles.cuh"

namespace giga {
namespace {

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

template <class S, bool kTeam, bool kGradient>
__global__ void __launch_bounds__(S::kThreads, 1) block_critic_kernel(const __grid_constant__ FusedCritic k) {
  static_assert(S::kOwnGradients || kTeam, "else two barriers are missing");
  static_assert(S::kRows == KeptStates::kTileRows, "what is kept has room for the states of each tile");
  extern __shared__ __align__(16) char shared[];
  BlockCriticMemory<S, kTeam>& m = *reinterpret_cast<BlockCriticMemory<S, kTeam>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const TileRows tiles(k.rows, min(S::kRows, kMostStates * k.rows.n));
  const FusedMlp& net = k.net;
  const int input = net.width[0];
  const BlockPart<S> part;
  ValueWeights<kTeam> value_weights{m.weight3, nullptr};
  if constexpr (kTeam) value_weights.team = m.team.weight3;
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

    keep_dots(y, part, lane, value_weights, m);
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
      feature_gradient(y, part, lane, value_weights,
                       [&](int t, int i) { return m.by_value[part.row + t * 16 + lane.group + i * 8]; });
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
  using Shared = BlockCriticMemory<S, kTeam>;
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
