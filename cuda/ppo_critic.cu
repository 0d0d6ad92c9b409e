// The gradient of the value's loss in one kernel, for critics on local observations whose layers exchange the mean
// features of the living (composed) or do not (independent); or the values alone (ppo_gradients.hpp).
#include "cuda/check.cuh"
#include "cuda/ppo_tiles.cuh"

namespace giga {
namespace {

/// Shared memory of a block.
template <class S>
struct CriticMemory {
  float x[S::kRows * S::kInStride];
  float hidden1[S::kRows * kHiddenStride];  // features; then the gradient by their sums
  float hidden2[S::kRows * kHiddenStride];  // the gradient by the second layer's sums
  float weight1[kHidden * S::kInStride];
  float weight2[kHidden * kHiddenStride], team_weight2[kHidden * kHiddenStride];
  float mean1[kMostStates * kHiddenStride];      // features of the first layer, over the living
  float d_sums2[kMostStates * kHiddenStride];    // the gradient by the second layer's sums, over the team
  float exchanged[kMostStates * kHiddenStride];  // what the team adds to the sums; then the gradient by mean1
  float bias1[kHidden], bias2[kHidden], weight3[kHidden], team_weight3[kHidden];
  float dots[2][S::kColumnWarps][S::kRows];  // a row's features times weight3, times team_weight3; parts of columns
  float d_value[S::kRows];
  float living[S::kRows];  // 1 / living agents of the state, 0 for the dead
  bool alive[S::kRows];
  float old_value[S::kRows], returns[S::kRows];
  int64_t source[2][S::kRows];  // of this tile and the next
};

/// What the loss of a row takes besides the network's output, on its way from global memory.
struct FetchedLossRow {
  float old_value = 0, returns = 0;
  bool alive = false;

  __device__ void fetch(const FusedCritic& k, int64_t source) {
    const bool some = source >= 0, loss = some && !k.values;
    alive = some && k.rows.alive[source];
    old_value = loss ? k.loss.old_value[source] : 0.0f;
    returns = loss ? k.loss.returns[source] : 0.0f;
  }
};

/// Sums over the agents of each state: out[state, column] = the sum of weight[row] x[row, column]; no weights: of all.
__device__ void sum_states(const TileRows& tiles, const float* x, const float* weight, float* out) {
  const int column = static_cast<int>(threadIdx.x) % kHidden;
  for (int state = static_cast<int>(threadIdx.x) / kHidden; state < tiles.states; state += kFusedThreads / kHidden) {
    const float* at = x + state * tiles.n * kHiddenStride + column;
    float sum = 0;
    for (int i = 0; i < tiles.n; ++i, at += kHiddenStride) sum += weight ? weight[state * tiles.n + i] * *at : *at;
    out[state * kHiddenStride + column] = to_tf32(sum);
  }
}

template <class S, bool kGradient>
__global__ void __launch_bounds__(kFusedThreads, 1) critic_kernel(const __grid_constant__ FusedCritic k) {
  extern __shared__ __align__(16) char shared[];
  CriticMemory<S>& m = *reinterpret_cast<CriticMemory<S>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const WarpPlace<S> place;
  const TileRows tiles(k.rows, S::kRows);
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2];
  const bool team = net.team_weight[1] >= 0;
  const auto team_weight = [&](int layer) {
    return net.team_weight[layer] >= 0 ? k.parameters + net.team_weight[layer] : nullptr;
  };

  load_matrix(k.parameters + net.weight[0], hidden1, input, m.weight1, kHidden, S::kInStride);
  load_matrix(k.parameters + net.weight[1], hidden2, hidden1, m.weight2, kHidden, kHiddenStride);
  load_matrix(team_weight(1), hidden2, hidden1, m.team_weight2, kHidden, kHiddenStride);
  load_vector(k.parameters + net.bias[0], hidden1, m.bias1, kHidden);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, kHidden);
  load_vector(k.parameters + net.weight[2], hidden2, m.weight3, kHidden);
  load_vector(team_weight(2), hidden2, m.team_weight3, kHidden);
  for (int i = thread; i < kMostStates * kHiddenStride; i += kFusedThreads)
    m.mean1[i] = m.d_sums2[i] = m.exchanged[i] = 0;
  const float bias3 = k.parameters[net.bias[2]];
  const float inv_count = kGradient ? batch_moments(k.moments).inv_count : 0.0f;
  const float value_mean = kGradient ? *k.loss.value_mean : 0.0f, value_std = kGradient ? *k.loss.value_std : 1.0f;

  int64_t tile = blockIdx.x;
  if (thread < S::kRows) m.source[0][thread] = tiles.source(k.rows, tile, thread);
  __syncthreads();
  FetchedInputs<S> next;
  FetchedLossRow next_row;
  next.fetch(k.rows, input, m.source[0]);
  if (thread < S::kRows) next_row.fetch(k, m.source[0][thread]);

  TileSums<S::kInTiles> d_weight1;
  TileSums<2> d_weight2, d_team_weight2;
  d_weight1.clear();
  d_weight2.clear();
  d_team_weight2.clear();
  ColumnSums<kHidden> d_bias1, d_bias2;
  WeightedColumnSums<S::kTiles> d_weight3, d_team_weight3;
  float d_bias3 = 0, loss = 0;

  const int rows_at = place.first_row * kHiddenStride, columns = place.column_warp * S::kTiles * 8;
  const int state_rows = warp % 2 * 16, state_columns = warp / 2 * 8;  // a warp's tile of [kMostStates, kHidden]
  const int row_of[2] = {place.first_row + lane.group, place.first_row + lane.group + 8};
  int state_of[2];  // rows beyond the last state are dead
  for (int i = 0; i < 2; ++i) state_of[i] = min(row_of[i] / tiles.n, kMostStates - 1);

  for (int turn = 0; tile < tiles.n_tiles; tile += gridDim.x, turn ^= 1) {
    next.store(k.rows, input, m.x);
    if (thread < S::kRows) {
      m.alive[thread] = next_row.alive;
      m.old_value[thread] = next_row.old_value;
      m.returns[thread] = next_row.returns;
    }
    __syncthreads();

    // Forward.
    TileSums<S::kTiles> y;
    Slopes<S::kTiles> slope1, slope2;
    y.start(m.bias1 + columns);
    y.template add_by_rows<S::kIn>({m.x + place.first_row * S::kInStride, S::kInStride},
                                   {m.weight1 + columns * S::kInStride, S::kInStride});
    activate(net.activation, y, slope1);
    y.store_rounded(m.hidden1 + rows_at + columns, kHiddenStride);
    if (thread < S::kRows) {
      const int first = thread / tiles.n * tiles.n;
      int count = 0;
      if (m.alive[thread])
        for (int r = first; r < first + tiles.n; ++r) count += m.alive[r];
      m.living[thread] = count > 0 ? 1.0f / static_cast<float>(count) : 0.0f;
      m.source[turn ^ 1][thread] = tiles.source(k.rows, tile + gridDim.x, thread);
    }
    __syncthreads();
    if constexpr (!kGradient) next.fetch(k.rows, input, m.source[turn ^ 1]);
    if (team) {
      sum_states(tiles, m.hidden1, m.living, m.mean1);
      __syncthreads();
      TileSums<1> exchanged;
      exchanged.clear();
      exchanged.template add_by_rows<kHidden>({m.mean1 + state_rows * kHiddenStride, kHiddenStride},
                                              {m.team_weight2 + state_columns * kHiddenStride, kHiddenStride});
      exchanged.store(m.exchanged + state_rows * kHiddenStride + state_columns, kHiddenStride);
      __syncthreads();
    }
    y.start(m.bias2 + columns);
    y.template add_by_rows<kHidden>({m.hidden1 + rows_at, kHiddenStride},
                                    {m.weight2 + columns * kHiddenStride, kHiddenStride});
    if (team)
#pragma unroll
      for (int j = 0; j < S::kTiles; ++j)
#pragma unroll
        for (int i = 0; i < 4; ++i)
          y.c[j][i] += m.exchanged[state_of[i / 2] * kHiddenStride + columns + j * 8 + lane.pair + i % 2];
    activate(net.activation, y, slope2);

    // The values: products with one column.
    float dots[2][2] = {};
#pragma unroll
    for (int j = 0; j < S::kTiles; ++j)
#pragma unroll
      for (int i = 0; i < 4; ++i) {
        const int column = columns + j * 8 + lane.pair + i % 2;
        dots[0][i / 2] += y.c[j][i] * m.weight3[column];
        dots[1][i / 2] += y.c[j][i] * m.team_weight3[column];
      }
#pragma unroll
    for (int d = 0; d < 2; ++d)
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        dots[d][i] += __shfl_xor_sync(0xFFFFFFFFu, dots[d][i], 1);
        dots[d][i] += __shfl_xor_sync(0xFFFFFFFFu, dots[d][i], 2);
        if (lane.pair == 0) m.dots[d][place.column_warp][row_of[i]] = dots[d][i];
      }
    __syncthreads();
    const auto dot = [&](int d, int r) {
      float all = 0;
      for (int w = 0; w < S::kColumnWarps; ++w) all += m.dots[d][w][r];
      return all;
    };
    if (thread < S::kRows) {
      const int first = thread / tiles.n * tiles.n;
      float value = bias3 + dot(0, thread);
      if (team && first + tiles.n <= S::kRows)
        for (int r = first; r < first + tiles.n; ++r) value += m.living[r] * dot(1, r);
      if constexpr (kGradient) {
        float slope = 0;
        if (m.alive[thread]) {
          const ValueError::Error e =
              k.loss.error.of(value, m.old_value[thread], (m.returns[thread] - value_mean) / value_std);
          slope = k.loss.value_coef * e.slope * inv_count;
          loss += e.loss;
        }
        m.d_value[thread] = slope;
        d_bias3 += slope;
      } else {
        const int64_t source = m.source[turn][thread];
        if (source >= 0) k.values[source] = value;
      }
      if constexpr (!kGradient) next_row.fetch(k, m.source[turn ^ 1][thread]);
    }
    __syncthreads();
    if constexpr (kGradient) {
      // Backward: the gradient by a layer's sums takes the place of its features once these are used.
      float by_own[2], by_team[2] = {0, 0};
#pragma unroll
      for (int i = 0; i < 2; ++i) {
        by_own[i] = m.d_value[row_of[i]];
        const int first = row_of[i] / tiles.n * tiles.n;
        if (team && first + tiles.n <= S::kRows)
          for (int r = first; r < first + tiles.n; ++r) by_team[i] += m.d_value[r];
        by_team[i] *= m.living[row_of[i]];
      }
      d_weight3.add(y, by_own[0], by_own[1]);
      d_team_weight3.add(y, by_team[0], by_team[1]);
#pragma unroll
      for (int j = 0; j < S::kTiles; ++j)
#pragma unroll
        for (int i = 0; i < 4; ++i) {
          const int column = columns + j * 8 + lane.pair + i % 2;
          y.c[j][i] = by_own[i / 2] * m.weight3[column] + by_team[i / 2] * m.team_weight3[column];
        }
      slope2.scale(y);
      y.store_rounded(m.hidden2 + rows_at + columns, kHiddenStride);
      __syncthreads();
      if (team) {
        sum_states(tiles, m.hidden2, nullptr, m.d_sums2);
        __syncthreads();
        TileSums<1> by_mean;
        by_mean.clear();
        by_mean.template add_by_columns<kHidden>({m.d_sums2 + state_rows * kHiddenStride, kHiddenStride},
                                                 {m.team_weight2 + state_columns, kHiddenStride});
        by_mean.store(m.exchanged + state_rows * kHiddenStride + state_columns, kHiddenStride);
        d_team_weight2.template add_over_rows<kMostStates>({m.d_sums2 + place.weight_row, kHiddenStride},
                                                           {m.mean1 + place.weight_part * 16, kHiddenStride});
        __syncthreads();
      }
      y.clear();
      y.template add_by_columns<kHidden>({m.hidden2 + rows_at, kHiddenStride}, {m.weight2 + columns, kHiddenStride});
      d_weight2.template add_over_rows<S::kRows>({m.hidden2 + place.weight_row, kHiddenStride},
                                                 {m.hidden1 + place.weight_part * 16, kHiddenStride});
      if (team)
#pragma unroll
        for (int j = 0; j < S::kTiles; ++j)
#pragma unroll
          for (int i = 0; i < 4; ++i)
            y.c[j][i] += m.living[row_of[i / 2]] *
                         m.exchanged[state_of[i / 2] * kHiddenStride + columns + j * 8 + lane.pair + i % 2];
      d_bias2.add(m.hidden2, S::kRows, kHiddenStride);
      slope1.scale(y);
      __syncthreads();
      y.store_rounded(m.hidden1 + rows_at + columns, kHiddenStride);
      __syncthreads();
      next.fetch(k.rows, input, m.source[turn ^ 1]);
      if (thread < S::kRows) next_row.fetch(k, m.source[turn ^ 1][thread]);
      d_bias1.add(m.hidden1, S::kRows, kHiddenStride);
      d_weight1.template add_over_rows<S::kRows>({m.hidden1 + place.weight_row, kHiddenStride},
                                                 {m.x + place.weight_part * S::kInTiles * 8, S::kInStride});
      __syncthreads();
    }
  }

  if constexpr (kGradient) {  // the block's sums
    float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
    write_gradient(d_weight1, place.weight_row, place.weight_part * S::kInTiles * 8, hidden1, input,
                   out + net.weight[0]);
    write_gradient(d_weight2, place.weight_row, place.weight_part * 16, hidden2, hidden1, out + net.weight[1]);
    d_bias1.write(m.hidden1, out + net.bias[0], hidden1);
    d_bias2.write(m.hidden1, out + net.bias[1], hidden2);
    d_weight3.template write<S>(place, m.hidden1, out + net.weight[2], hidden2);
    if (team) {
      write_gradient(d_team_weight2, place.weight_row, place.weight_part * 16, hidden2, hidden1,
                     out + net.team_weight[1]);
      d_team_weight3.template write<S>(place, m.hidden1, out + net.team_weight[2], hidden2);
    }
    __syncthreads();
    if (thread < S::kRows) {
      m.dots[0][0][thread] = d_bias3;
      m.d_value[thread] = loss;
    }
    __syncthreads();
    if (thread < kFusedSums) {
      float all = 0;
      if (thread < 2)
        for (int r = 0; r < S::kRows; ++r) all += thread == 0 ? m.d_value[r] : m.dots[0][0][r];
      if (thread == 1) out[net.bias[2]] = all;
      out[net.size + thread] = thread == 0 ? all : 0.0f;
    }
  }
}

template <class S, bool kGradient>
void launch(const FusedCritic& critic, int index, void* stream) {
  const auto kernel = critic_kernel<S, kGradient>;
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(CriticMemory<S>)));
  kernel<<<fused_blocks(index), kFusedThreads, sizeof(CriticMemory<S>), static_cast<cudaStream_t>(stream)>>>(critic);
  GIGA_CUDA(cudaGetLastError());
}
template <bool kGradient>
void launch(const FusedCritic& critic, int index, void* stream) {
  const int input = critic.net.width[0];
  if (input <= 64) return launch<TileShape<64, 128>, kGradient>(critic, index, stream);
  if (input <= 128) return launch<TileShape<128, 64>, kGradient>(critic, index, stream);
  GIGA_CHECK(input <= FusedMlp::kMaxInput, "inputs of ", input, " numbers");
  launch<TileShape<192, 64>, kGradient>(critic, index, stream);
}

}  // namespace

void launch_critic_gradient(const FusedCritic& critic, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  critic.values ? launch<false>(critic, index, stream) : launch<true>(critic, index, stream);
}

}  // namespace giga
