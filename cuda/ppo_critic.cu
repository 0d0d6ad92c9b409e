// The gradient of the value's loss in one kernel, for critics on local observations whose layers exchange the mean
// features of the living (composed) or do not (independent); or the values alone (ppo_gradients.hpp).
//
// A state may lie in the rows of two warps or more, so means over a team are products too: with a matrix that has a 1
// where two rows are of the same state. What a team weight T gets of the rows h of a layer is mean(h) T^T; the way back
// takes sums over the team first: G = sum(d), whence d_h = G T / living and d_T = G^T h / living.
#include "cuda/check.cuh"
#include "cuda/ppo_block.hpp"
#include "cuda/ppo_tiles.cuh"
#include "cuda/ppo_value_loss.cuh"
#include "cuda/ppo_wide.hpp"

namespace giga {
namespace {

/// Shared memory of a block.
template <class S>
struct CriticMemory {
  KeptSlopes<S> slopes1;
  alignas(16) __half x[S::kRows * S::kInStride];
  __half hidden1[S::kRows * kHiddenStride];   // features of the first layer
  __half hidden2[S::kRows * kHiddenStride];   // of the second; then G
  __half gradient[S::kRows * kHiddenStride];  // by the sums of the second layer; then of the first
  __half value[S::kRows * kValueStride];      // the gradient by the own part of the value, and by the team's
  __half weight1[kHidden * S::kInStride];
  __half weight2[kHidden * kHiddenStride], team_weight2[kHidden * kHiddenStride];
  float bias1[kHidden], bias2[kHidden], weight3[kHidden], team_weight3[kHidden];
  float dots[2][S::kRows];  // a row's features times weight3, times team_weight3
  float d_value[S::kRows];
  float inv_living[S::kRows];  // 1 / living agents of the row's state; 0: nobody lives
  uint16_t alive[S::kRows];    // a mask of half-precision numbers: all bits or none
  float unscale;               // gradients are 1 / (unscale living rows) times too large
  float scale, sums[2][S::kWarps];
  int64_t source[2][S::kRows];  // of this tile and the next
};

/// Two lanes' rows of a tile and the rows of their states: from `begin` to `end`.
struct StateRows {
  int row[2], begin[2], end[2];
  int first_tile, last_tile;  // tiles of 16 rows that have rows of the warp's states

  __device__ StateRows(int n, int rows) {
    const TileLane lane;
    const int first = static_cast<int>(threadIdx.x) / 32 * 16;
#pragma unroll
    for (int i = 0; i < 2; ++i) {
      row[i] = first + lane.group + 8 * i;
      begin[i] = row[i] / n * n;
      end[i] = min(begin[i] + n, rows);
    }
    first_tile = first / n * n / 16;
    last_tile = (min((first + 15) / n * n + n, rows) - 1) / 16;
  }

  /// x [16 rows of the warp, ..] = sums of the rows of the same state, of matrix [rows, ..]; of the living rows only if
  /// there is a mask.
  template <int kTiles>
  __device__ void sum(const __half* matrix, const uint16_t* mask, TileSums<kTiles>& x) const {
    const TileLane lane;
    x.clear();
    for (int t = first_tile; t <= last_tile; ++t) {
      uint32_t same[4];
#pragma unroll
      for (int k = 0; k < 4; ++k) {
        const int column = t * 16 + lane.pair + k / 2 * 8, i = k % 2;
        same[k] = (column >= begin[i] && column < end[i] ? 0x3C00u : 0u) |
                  (column + 1 >= begin[i] && column + 1 < end[i] ? 0x3C000000u : 0u);
        if (mask) same[k] &= *reinterpret_cast<const uint32_t*>(mask + column);
      }
      x.template add_by_columns<kHiddenStride>(same, Halves<kHiddenStride>(matrix, t * 16, 0).below());
    }
  }
};

/// += value^T features of the second layer: 16 rows, of which two are not zero. The other half of a tile is nothing.
template <class S>
__device__ void add_by_value(const CriticMemory<S>& m, WeightGradient<2>& gradient) {
  const int lane = static_cast<int>(threadIdx.x) % 32;
  const uint32_t from = Halves<kHiddenStride>(m.hidden2, 0, gradient.column).below();
  const uint32_t values = static_cast<uint32_t>(__cvta_generic_to_shared(m.value + lane % 16 * kValueStride));
#pragma unroll 4
  for (int t = 0; t < S::kRowDepth; ++t) {
    uint32_t by[4] = {0, 0, 0, 0};
    asm volatile("ldmatrix.sync.aligned.m8n8.x2.trans.shared.b16 {%0, %1}, [%2];"
                 : "=r"(by[0]), "=r"(by[2])
                 : "r"(values + apart<kValueStride>(t * 16, 0)));
    gradient.template add_by_columns<kHiddenStride>(by, from + apart<kHiddenStride>(t * 16, 0));
  }
}

template <class S>
__device__ void load_network(const FusedCritic& k, CriticMemory<S>& m) {
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2];
  const auto team_weight = [&](int layer) {
    return net.team_weight[layer] >= 0 ? k.parameters + net.team_weight[layer] : nullptr;
  };
  load_matrix<kHidden, S::kInStride, S::kThreads>(k.parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<kHidden, kHiddenStride, S::kThreads>(k.parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_matrix<kHidden, kHiddenStride, S::kThreads>(team_weight(1), hidden2, hidden1, m.team_weight2);
  load_vector(k.parameters + net.bias[0], hidden1, m.bias1, kHidden);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, kHidden);
  load_vector(k.parameters + net.weight[2], hidden2, m.weight3, kHidden);
  load_vector(team_weight(2), hidden2, m.team_weight3, kHidden);
  for (int i = static_cast<int>(threadIdx.x); i < S::kRows * kValueStride; i += S::kThreads) m.value[i] = __half(0);
  if (threadIdx.x >= 32 || k.values) return;
  const BatchMoments moments(k.moments);
  if (threadIdx.x > 0) return;
  take_scale(k, moments, m);
}

template <class S, bool kGradient>
__global__ void __launch_bounds__(S::kThreads, 1) critic_kernel(const __grid_constant__ FusedCritic k) {
  extern __shared__ __align__(16) char shared[];
  CriticMemory<S>& m = *reinterpret_cast<CriticMemory<S>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const TileRows tiles(k.rows, S::kRows);
  const StateRows of_state(tiles.n, S::kRows);
  const FusedMlp& net = k.net;
  const int input = net.width[0];
  const bool team = net.team_weight[1] >= 0;
  load_network(k, m);
  const float bias3 = k.parameters[net.bias[2]];
  const float value_mean = kGradient ? *k.loss.value_mean : 0.0f, value_std = kGradient ? *k.loss.value_std : 1.0f;

  // A warp's rows in shared memory. What is done once for a row is done by half of the lanes.
  const bool has_row = thread % 32 < 16;
  const int own_row = warp * 16 + thread % 16;
  __half* const x = m.x + warp * 16 * S::kInStride;
  const int rows_at = warp * 16 * kHiddenStride;

  WeightGradient<S::kInTiles> d_weight1(4);
  WeightGradient<S::kWeightTiles> d_weight2(4), d_team_weight2(4);
  WeightGradient<2> d_weight3(1);  // two rows of it
  BiasGradient d_bias;
  const bool has_bias1 = warp < 4, has_bias2 = warp >= 4 && warp < 8;
  float d_bias3 = 0, loss = 0;

  int64_t tile = blockIdx.x;
  if (has_row) m.source[0][own_row] = tiles.source(k.rows, tile, own_row);
  __syncthreads();
  FetchedInputs<S::kIn> next;
  FetchedLossRow next_row;
  next.fetch(k.rows, input, [&](int i) { return m.source[0][warp * 16 + i]; });
  if (has_row) next_row.fetch(k, m.source[0][own_row]);

  for (int turn = 0; tile < tiles.n_tiles; tile += gridDim.x, turn ^= 1) {
    const FetchedLossRow row = next_row;
    next.template store<S::kInStride>(k.rows, input, x);
    if (has_row) m.alive[own_row] = row.alive ? 0xFFFF : 0;
    __syncwarp();

    // Forward.
    TileSums<kHiddenTiles> y;
    Slopes slope1, slope2;
    y.start(m.bias1);
    y.template add_by_rows<S::kInDepth>(Halves<S::kInStride>(x, 0, 0), Halves<S::kInStride>(m.weight1, 0, 0));
    activate(net.activation, y, slope1);
    m.slopes1.keep(slope1);
    store(y.factor(), m.hidden1 + rows_at, kHiddenStride);
    if (has_row) m.source[turn ^ 1][own_row] = tiles.source(k.rows, tile + gridDim.x, own_row);
    __syncthreads();
    if (has_row) {
      const int begin = own_row / tiles.n * tiles.n, end = min(begin + tiles.n, S::kRows);
      int count = 0;
      for (int r = begin; r < end; ++r) count += m.alive[r] ? 1 : 0;
      m.inv_living[own_row] = count > 0 ? 1.0f / static_cast<float>(count) : 0.0f;
    }
    if constexpr (!kGradient) next.fetch(k.rows, input, [&](int i) { return m.source[turn ^ 1][warp * 16 + i]; });
    if (team) {
      __syncwarp();  // a warp reads the numbers of its own rows
      of_state.sum(m.hidden1, m.alive, y);
      const float share[2] = {m.inv_living[of_state.row[0]], m.inv_living[of_state.row[1]]};
#pragma unroll
      for (int j = 0; j < kHiddenTiles; ++j)
#pragma unroll
        for (int i = 0; i < 4; ++i) y.c[j][i] *= share[i / 2];
      const Factor<kHiddenDepth> mean = y.factor();
      y.start(m.bias2);
      y.add_by_rows(mean, Halves<kHiddenStride>(m.team_weight2, 0, 0));
    } else {
      y.start(m.bias2);
    }
    y.template add_by_rows<kHiddenDepth>(Halves<kHiddenStride>(m.hidden1 + rows_at, 0, 0),
                                         Halves<kHiddenStride>(m.weight2, 0, 0));
    activate(net.activation, y, slope2);
    if constexpr (kGradient) store(y.factor(), m.hidden2 + rows_at, kHiddenStride);

    // The values: products with one column.
    float dots[2][2] = {};
#pragma unroll
    for (int j = 0; j < kHiddenTiles; ++j) {
      const float2 own = *reinterpret_cast<const float2*>(m.weight3 + j * 8 + lane.pair);
      const float2 shared_by_team = *reinterpret_cast<const float2*>(m.team_weight3 + j * 8 + lane.pair);
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        dots[0][i] += y.c[j][2 * i] * own.x + y.c[j][2 * i + 1] * own.y;
        dots[1][i] += y.c[j][2 * i] * shared_by_team.x + y.c[j][2 * i + 1] * shared_by_team.y;
      }
    }
#pragma unroll
    for (int d = 0; d < 2; ++d)
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        dots[d][i] += __shfl_xor_sync(0xFFFFFFFFu, dots[d][i], 1);
        dots[d][i] += __shfl_xor_sync(0xFFFFFFFFu, dots[d][i], 2);
        if (lane.pair == 0) m.dots[d][of_state.row[i]] = dots[d][i];
      }
    __syncthreads();
    if (has_row) {
      const int begin = own_row / tiles.n * tiles.n, end = min(begin + tiles.n, S::kRows);
      float value = bias3 + m.dots[0][own_row];
      if (team) {
        float sum = 0;
        for (int r = begin; r < end; ++r) sum += m.alive[r] ? m.dots[1][r] : 0.0f;
        value += sum * m.inv_living[own_row];
      }
      if constexpr (kGradient) {
        float slope = 0;
        if (row.alive) {
          const ValueError::Error e = k.loss.error.of(value, row.old_value, (row.returns - value_mean) / value_std);
          slope = k.loss.value_coef * e.slope * m.scale;
          loss += e.loss;
        }
        m.d_value[own_row] = slope;
        d_bias3 += slope;
      } else {
        const int64_t source = m.source[turn][own_row];
        if (source >= 0) k.values[source] = value;
      }
      next_row.fetch(k, m.source[turn ^ 1][own_row]);
    }
    __syncthreads();
    if constexpr (kGradient) {
      // Backward. The gradient by the own part of the value, and by the team's, which all of its agents share.
      float by_own[2], by_team[2] = {0, 0};
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        const int r = of_state.row[i];
        by_own[i] = m.d_value[r];
        if (team) {
          for (int mate = of_state.begin[i]; mate < of_state.end[i]; ++mate) by_team[i] += m.d_value[mate];
          by_team[i] *= m.alive[r] ? m.inv_living[r] : 0.0f;
        }
        if (lane.pair == 0) *reinterpret_cast<uint32_t*>(m.value + r * kValueStride) = half_pair(by_own[i], by_team[i]);
      }
#pragma unroll
      for (int j = 0; j < kHiddenTiles; ++j) {
        const float2 own = *reinterpret_cast<const float2*>(m.weight3 + j * 8 + lane.pair);
        const float2 shared_by_team = *reinterpret_cast<const float2*>(m.team_weight3 + j * 8 + lane.pair);
#pragma unroll
        for (int i = 0; i < 2; ++i) {
          y.c[j][2 * i] = by_own[i] * own.x + by_team[i] * shared_by_team.x;
          y.c[j][2 * i + 1] = by_own[i] * own.y + by_team[i] * shared_by_team.y;
        }
      }
      store(slope2.scaled(y), m.gradient + rows_at, kHiddenStride);
      __syncthreads();
      if (d_weight3.column < kHidden) add_by_value(m, d_weight3);
      d_weight2.template add<S::kRowDepth, kHiddenStride, kHiddenStride>(m.gradient, m.hidden1,
                                                                         [&](const uint32_t(&t)[4]) {
                                                                           if (has_bias2) d_bias.add(t);
                                                                         });
      Factor<kHiddenDepth> team_gradient;
      if (team) {
        of_state.sum(m.gradient, nullptr, y);
        const int* r = of_state.row;
        const float share[2] = {m.alive[r[0]] ? m.inv_living[r[0]] : 0.0f, m.alive[r[1]] ? m.inv_living[r[1]] : 0.0f};
#pragma unroll
        for (int j = 0; j < kHiddenTiles; ++j)
#pragma unroll
          for (int i = 0; i < 4; ++i) y.c[j][i] *= share[i / 2];
        team_gradient = y.factor();
        y.clear();
        y.add_by_columns(team_gradient, Halves<kHiddenStride>(m.team_weight2, 0, 0));
      } else {
        y.clear();
      }
      y.template add_by_columns<kHiddenDepth>(Halves<kHiddenStride>(m.gradient + rows_at, 0, 0),
                                              Halves<kHiddenStride>(m.weight2, 0, 0));
      m.slopes1.take(slope1);
      const Factor<kHiddenDepth> gradient1 = slope1.scaled(y);
      __syncthreads();
      if (team) store(team_gradient, m.hidden2 + rows_at, kHiddenStride);
      store(gradient1, m.gradient + rows_at, kHiddenStride);
      next.fetch(k.rows, input, [&](int i) { return m.source[turn ^ 1][warp * 16 + i]; });
      __syncthreads();
      const auto nothing = [](const uint32_t(&)[4]) {};
      if (team) d_team_weight2.template add<S::kRowDepth, kHiddenStride, kHiddenStride>(m.hidden2, m.hidden1, nothing);
      d_weight1.template add<S::kRowDepth, kHiddenStride, S::kInStride>(m.gradient, m.x, [&](const uint32_t(&t)[4]) {
        if (has_bias1) d_bias.add(t);
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
    if (team) d_team_weight2.write(unscale, hidden2, hidden1, out + net.team_weight[1]);
    if (d_weight3.column < kHidden)
      d_weight3.each([&](float value, int r, int c) {
        c += d_weight3.column;
        if (r < 2 && c < hidden2 && (r == 0 || team))
          out[(r == 0 ? net.weight[2] : net.team_weight[2]) + c] = value * unscale;
      });
    if (has_bias1) d_bias.write(unscale, d_weight1.row, hidden1, out + net.bias[0]);
    if (has_bias2) d_bias.write(unscale, d_weight2.row, hidden2, out + net.bias[1]);
    write_value_sums<S>(net, m, d_bias3, loss, unscale, out);
  }
}

template <class S, bool kGradient>
void launch(const FusedCritic& critic, void* stream) {
  static_assert(sizeof(CriticMemory<S>) <= kMostShared);
  const auto kernel = critic_kernel<S, kGradient>;
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(CriticMemory<S>)));
  kernel<<<critic.n_partial, S::kThreads, sizeof(CriticMemory<S>), static_cast<cudaStream_t>(stream)>>>(critic);
  GIGA_CUDA(cudaGetLastError());
}
template <bool kGradient>
void launch(const FusedCritic& critic, void* stream) {
  const int input = critic.net.width[0];
  if (input <= NarrowTiles::kIn) return launch<NarrowTiles, kGradient>(critic, stream);
  if (input <= MixedTiles::kIn) return launch<MixedTiles, kGradient>(critic, stream);
  if (input <= MediumTiles::kIn) return launch<MediumTiles, kGradient>(critic, stream);
  GIGA_CHECK(input <= WideTiles::kIn, "inputs of ", input, " numbers");
  launch<WideTiles, kGradient>(critic, stream);
}

}  // namespace

void launch_critic_gradient(const FusedCritic& critic, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  if (critic.net.reads_state()) return launch_state_critic_gradient(critic, stream);
  if (critic.net.is_wide()) return launch_wide_critic_gradient(critic, stream);
  if (!critic.net.is_narrow()) return launch_block_critic_gradient(critic, stream);
  critic.values ? launch<false>(critic, stream) : launch<true>(critic, stream);
}

}  // namespace giga
