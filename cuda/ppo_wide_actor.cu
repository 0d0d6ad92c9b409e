// Wide actors (ppo_wide.hpp): the second layer, the policy's loss, and the gradient of the last layer.
#include "cuda/ppo_block_heads.cuh"
#include "cuda/ppo_wide_tiles.cuh"

namespace giga {
namespace {

using S = LayerTile;

struct Memory {
  // Features of the first layer of this tile, whose place those of the second take; and of the next.
  alignas(16) __half layer[2][S::kLayerHalves];
  alignas(16) __half head[S::kRows * kHeadStride];  // the gradient by the logits or means
  alignas(16) __half weight2[S::kHidden * S::kStride];
  alignas(16) __half weight3[kHead * S::kStride];
  alignas(16) float bias2[S::kHidden], bias3[kHead];
  float log_std[4];
  float sums[S::kWarps][4 * kLaneSums];
  float advantage_mean, advantage_inv_std, clip_coef, entropy_coef;
  float scale, unscale;  // gradients are `scale` times too large
  LossRow row[S::kRows];
};

__device__ void load_network(const FusedActor& k, Memory& m) {
  const FusedMlp& net = k.net;
  const int hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
  load_ordered<S::kHidden, S::kStride, Order::columns, Order::places, S::kThreads>(k.parameters + net.weight[1],
                                                                                   hidden2, hidden1, m.weight2);
  load_matrix<kHead, S::kStride, S::kThreads>(k.parameters + net.weight[2], output, hidden2, m.weight3);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, S::kHidden);
  load_vector(k.parameters + net.bias[2], output, m.bias3, kHead);
  load_vector(k.loss.action ? nullptr : k.parameters + net.log_std, kActionSize, m.log_std, 4);
  if (threadIdx.x < 32) take_moments(k, m);
}

__global__ void __launch_bounds__(S::kThreads, 1) wide_actor_kernel(const __grid_constant__ WideActor second) {
  extern __shared__ __align__(16) char shared[];
  Memory& m = *reinterpret_cast<Memory*>(shared);
  const FusedActor& k = second.of;
  const WidePiece& piece = second.piece;
  const WideLayers& l = piece.layers;
  const FusedMlp& net = k.net;
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileRows tiles(k.rows, S::kRows);
  const BlockPart<S> part;
  const HeadPart head;
  load_network(k, m);

  BlockWeightGradient<2> d_weight3(1);
  BlockBiasGradients d_bias;
  float sums[kLaneSums] = {};

  int64_t tile = blockIdx.x;
  LossRow next_row;
  const auto begin = [&](int64_t of, int turn) {
    if (of >= piece.count) return;
    begin_tile(l.hidden1, of, m.layer[turn]);
    if (thread < S::kRows) next_row = LossRow(k, tiles.source(k.rows, piece.first + of, thread));
  };
  begin(tile, 0);
  __syncthreads();  // a block without a tile reads m.unscale, too
  for (int turn = 0; tile < piece.count; tile += gridDim.x, turn ^= 1) {
    wait_for_copies();
    if (thread < S::kRows) m.row[thread] = next_row;
    __syncthreads();
    begin(tile + gridDim.x, turn ^ 1);
    __half* const layer = m.layer[turn];

    LayerSums<S> y;
    y.start(m.bias2 + part.column);
    y.template add_by_rows<S::kDepth>(part.rows(layer), Halves<S::kStride>(m.weight2, part.column, 0));
    __syncthreads();
    BlockSlopes<S> slopes;
#pragma unroll
    for (int t = 0; t < S::kRowTiles; ++t) {
      activate_wide(net.activation, y.part[t], slopes.part[t]);
      store(y.part[t].factor(), part.at(layer) + t * 16 * S::kStride, S::kStride);
    }
    __syncthreads();

    if (warp < 8) head_gradient<S>(k, m, head, layer, sums);
    __syncthreads();

    d_weight3.template add<S::kRowDepth, kHeadStride, S::kStride>(m.head, layer, [&](int i, const uint32_t(&t)[4]) {
      if (i == warp) d_bias.add(2, t);
    });
    y.clear();
    y.template add_by_columns<kHead / 16>(Halves<kHeadStride>(m.head, part.row, 0),
                                          Halves<S::kStride>(m.weight3, 0, part.column));
    WideFactors d2;
    slopes.scale(y, d2);
    write_tile(d2, part, tile, l.d2);
  }

  const float unscale = m.unscale;
  float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
  d_weight3.write(unscale, net.width[3], net.width[2], out + net.weight[2]);
  if (warp < kHead / 16) d_bias.write(2, unscale, warp * 16, net.width[3], out + net.bias[2]);
  write_policy_sums<S>(k, m, sums, unscale, out);
  if (blockIdx.x == 0 && thread == 0) *l.unscale = unscale;
}

}  // namespace

void launch_wide(const WideActor& second, int blocks, void* stream) {
  start_wide<Memory>(wide_actor_kernel, second, blocks, stream);
}

void launch_wide_actor_gradient(const FusedActor& actor, void* stream) {
  GIGA_CHECK(actor.wide, "work memory");
  queue_wide_actor(actor, [&](const auto& step) { launch_wide(step, actor.n_partial, stream); });
}

}  // namespace giga
