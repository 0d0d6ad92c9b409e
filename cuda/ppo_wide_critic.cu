// Wide critics on local observations (ppo_wide.hpp): the second layer, the value, its loss, and the gradient of the
// last layer.
#include "cuda/ppo_block_heads.cuh"
#include "cuda/ppo_wide_tiles.cuh"

namespace giga {
namespace {

using S = LayerTile;

struct Memory {
  // Features of the first layer of this tile, whose place the gradient by the sums of the second takes where it is
  // added up over states; and of the next.
  alignas(16) __half layer[2][S::kLayerHalves];
  alignas(16) __half weight2[S::kHidden * S::kStride];
  alignas(16) float bias2[S::kHidden];
  alignas(16) float weight3[2][S::kHidden];              // of the own features, of the team's mean
  alignas(16) float dots[2][S::kRows][S::kColumnWarps];  // a row's features times these
  alignas(16) float d_weight3[2][2][S::kHidden];         // of each half of the rows
  float2 by_value[S::kRows];                             // the gradients by the parts of the value
  float d_value[S::kRows];
  float share[2][S::kRows];  // of this tile and the next
  float unscale, scale, sums[2][S::kWarps];
};

template <bool kTeam>
__device__ void load_network(const FusedCritic& k, Memory& m) {
  const FusedMlp& net = k.net;
  const int hidden1 = net.width[1], hidden2 = net.width[2];
  load_ordered<S::kHidden, S::kStride, Order::columns, Order::places, S::kThreads>(k.parameters + net.weight[1],
                                                                                   hidden2, hidden1, m.weight2);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, S::kHidden);
  load_vector(k.parameters + net.weight[2], hidden2, m.weight3[0], S::kHidden);
  load_vector(kTeam ? k.parameters + net.team_weight[2] : nullptr, hidden2, m.weight3[1], S::kHidden);
  if (threadIdx.x >= 32 || k.values) return;
  const BatchMoments moments(k.moments);
  if (threadIdx.x == 0) take_scale(k, moments, m);
}

/// A warp's 32 columns of the gradient of the value's weights: sums over rows in the lanes, 8 columns each.
struct ValueWeightGradient {
  float own[S::kTiles][2] = {}, team[S::kTiles][2] = {};

  template <bool kTeam>
  __device__ void add(const LayerSums<S>& features, const float2 (&by)[S::kRowTiles][2]) {
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
      for (int i = 0; i < 2; ++i)
#pragma unroll
        for (int j = 0; j < S::kTiles; ++j)
#pragma unroll
          for (int b = 0; b < 2; ++b) {
            const float x = features.part[t].c[j][2 * i + b];
            own[j][b] += by[t][i].x * x;
            if constexpr (kTeam) team[j][b] += by[t][i].y * x;
          }
  }
  /// To shared memory [2][columns], of the warp's rows.
  __device__ void keep(float (&to)[2][S::kHidden], int column) const {
    const TileLane lane;
#pragma unroll
    for (int j = 0; j < S::kTiles; ++j)
#pragma unroll
      for (int b = 0; b < 2; ++b) {
        const float of_own = sum_of_groups(own[j][b]), of_team = sum_of_groups(team[j][b]);
        if (lane.group > 0) continue;
        to[0][column + j * 8 + lane.pair + b] = of_own;
        to[1][column + j * 8 + lane.pair + b] = of_team;
      }
  }
};

template <bool kTeam, bool kGradient>
__global__ void __launch_bounds__(S::kThreads, 1) wide_critic_kernel(const __grid_constant__ WideCritic second) {
  extern __shared__ __align__(16) char shared[];
  Memory& m = *reinterpret_cast<Memory*>(shared);
  const FusedCritic& k = second.of;
  const WidePiece& piece = second.piece;
  const WideLayers& l = piece.layers;
  const FusedMlp& net = k.net;
  const int thread = static_cast<int>(threadIdx.x);
  const TileLane lane;
  const TileRows tiles(k.rows, S::kRows);
  const BlockPart<S> part;
  const ValueWeights<kTeam> value_weights{m.weight3[0], m.weight3[1]};
  load_network<kTeam>(k, m);
  const float bias3 = k.parameters[net.bias[2]];
  const float value_mean = kGradient ? *k.loss.value_mean : 0.0f, value_std = kGradient ? *k.loss.value_std : 1.0f;
  const bool has_row = thread < S::kRows;  // what is done once for a row is done by the first threads
  const int state = thread / tiles.n, first_of_state = state * tiles.n;
  const bool has_state = has_row && state < tiles.states;

  ValueWeightGradient d_weight3;
  float d_bias3 = 0, loss = 0;

  int64_t tile = blockIdx.x, next_source = -1;
  FetchedLossRow next_row;
  float next_share = 0;
  const auto begin = [&](int64_t of, int turn) {
    if (of >= piece.count) return;
    begin_tile(l.hidden1, of, m.layer[turn]);
    if (!has_row) return;
    next_source = tiles.source(k.rows, piece.first + of, thread);
    next_row.fetch(k, next_source);
    if constexpr (kTeam) next_share = l.share[of * S::kRows + thread];
  };
  begin(tile, 0);
  __syncthreads();  // a block without a tile reads m.unscale, too
  for (int turn = 0; tile < piece.count; tile += gridDim.x, turn ^= 1) {
    wait_for_copies();
    const FetchedLossRow row = next_row;
    const int64_t source = next_source;
    if (has_row) m.share[turn][thread] = next_share;
    __syncthreads();
    begin(tile + gridDim.x, turn ^ 1);
    __half* const layer = m.layer[turn];

    TeamTerms of_team;
    if constexpr (kTeam) of_team.fetch(l.of_team, tiles.n, tiles.states, part, tile);
    LayerSums<S> y;
    y.start(m.bias2 + part.column);
    y.template add_by_rows<S::kDepth>(part.rows(layer), Halves<S::kStride>(m.weight2, part.column, 0));
    if constexpr (kTeam) of_team.add(y, part, [](int) { return 1.0f; });
    BlockSlopes<S> slopes;
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t) activate_wide(net.activation, y.part[t], slopes.part[t]);

    keep_dots(y, part, lane, value_weights, m);
    __syncthreads();
    float2 by{0, 0};  // the gradients by the own part of the row's value, and by the team's
    if (has_row) {
      const auto dot = [&m](int d, int r) {
        const float4 *x = reinterpret_cast<const float4*>(m.dots[d][r]), a = x[0], b = x[1];
        return ((a.x + a.y) + (a.z + a.w)) + ((b.x + b.y) + (b.z + b.w));
      };
      float value = bias3 + dot(0, thread);
      if constexpr (kTeam)
        if (has_state)
          for (int r = first_of_state; r < first_of_state + tiles.n; ++r) value += m.share[turn][r] * dot(1, r);
      if constexpr (kGradient) {
        if (row.alive) {
          const ValueError::Error e = k.loss.error.of(value, row.old_value, (row.returns - value_mean) / value_std);
          by.x = k.loss.value_coef * e.slope * m.scale;
          loss += e.loss;
        }
        d_bias3 += by.x;
        if constexpr (kTeam) m.d_value[thread] = by.x;
      } else {
        if (source >= 0) k.values[source] = value;
      }
    }
    if constexpr (kGradient) {
      if constexpr (kTeam) {  // the team's part of the value, which all of its agents share
        __syncthreads();
        if (has_state) {
          for (int r = first_of_state; r < first_of_state + tiles.n; ++r) by.y += m.d_value[r];
          by.y *= m.share[turn][thread];
        }
      }
      if (has_row) m.by_value[thread] = by;
      __syncthreads();

      float2 of_row[S::kRowTiles][2];
#pragma unroll
      for (int t = 0; t < S::kRowTiles; ++t)
#pragma unroll
        for (int i = 0; i < 2; ++i) of_row[t][i] = m.by_value[part.row + t * 16 + lane.group + i * 8];
      d_weight3.template add<kTeam>(y, of_row);
      feature_gradient(y, part, lane, value_weights, [&of_row](int t, int i) { return of_row[t][i]; });
      WideFactors d2;
      slopes.scale(y, d2);
      write_tile(d2, part, tile, l.d2);
      if constexpr (kTeam) {
        store_tile(d2, part, layer);
        __syncthreads();
        sum_wide_states<S::kThreads>(layer, tiles.n, tiles.states, l.d2_sums + tile * tiles.states * kWidePairs,
                                     [](int) { return 1.0f; });
      }
    }
  }

  if constexpr (kGradient) {  // the block's sums
    const float unscale = m.unscale;
    float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
    d_weight3.keep(m.d_weight3[part.row / 32], part.column);
    __syncthreads();
    for (int c = thread; c < net.width[2]; c += S::kThreads) {
      out[net.weight[2] + c] = (m.d_weight3[0][0][c] + m.d_weight3[1][0][c]) * unscale;
      if constexpr (kTeam) out[net.team_weight[2] + c] = (m.d_weight3[0][1][c] + m.d_weight3[1][1][c]) * unscale;
    }
    write_value_sums<S>(net, m, d_bias3, loss, unscale, out);
    if (blockIdx.x == 0 && thread == 0) *l.unscale = unscale;
  }
}

template <bool kTeam>
void start(const WideCritic& second, int blocks, void* stream) {
  second.of.values ? start_wide<Memory>(wide_critic_kernel<kTeam, false>, second, blocks, stream)
                   : start_wide<Memory>(wide_critic_kernel<kTeam, true>, second, blocks, stream);
}

}  // namespace

void launch_wide(const WideCritic& second, int blocks, void* stream) {
  second.of.net.team_weight[1] >= 0 ? start<true>(second, blocks, stream) : start<false>(second, blocks, stream);
}

void launch_wide_critic_gradient(const FusedCritic& critic, void* stream) {
  GIGA_CHECK(critic.wide && (!critic.values || critic.wide_tiles > 0), "work memory");
  queue_wide_critic(critic, [&](const auto& step) { launch_wide(step, critic.n_partial, stream); });
}

}  // namespace giga
