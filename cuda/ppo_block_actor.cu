// The gradient of the policy's loss for hidden layers of up to 128 (ppo_gradients.hpp, ppo_block_tiles.cuh).
#include "cuda/check.cuh"
#include "cuda/ppo_block.hpp"
#include "cuda/ppo_block_heads.cuh"
#include "cuda/ppo_block_tiles.cuh"

namespace giga {
namespace {

using Narrow = BlockShape<64, true, 0>;
using Medium = BlockShape<128, true, 0>;
using Wide = BlockShape<FusedMlp::kMaxInput, true, 2>;

/// Shared memory of a block.
template <class S>
struct Memory {
  BlockKeptSlopes<S, (S::kKeptSlopes > 0)> slopes1;
  BlockKeptSlopes<S, (S::kKeptSlopes > 1)> slopes2;
  alignas(16) __half x[S::kRows * S::kInStride];
  struct Layers {
    alignas(16) __half hidden1[S::kLayerHalves];  // features
    alignas(16) __half hidden2[S::kLayerHalves];
    alignas(16) __half gradient2[S::kLayerHalves];  // by the sums of the second layer
  };
  union {
    Layers of;
    StagedInputs<S> next;  // while the last product of a tile runs, which reads none of these layers
  };
  alignas(16) __half gradient1[S::kLayerHalves];    // by the sums of the first
  alignas(16) __half head[S::kRows * kHeadStride];  // the gradient by the logits or means
  alignas(16) __half weight1[S::kHidden * S::kInStride];
  alignas(16) __half weight2[S::kHidden * S::kStride];
  alignas(16) __half weight3[kHead * S::kStride];
  alignas(16) float bias1[S::kHidden], bias2[S::kHidden], bias3[kHead];
  float log_std[4];
  float sums[S::kWarps][4 * kLaneSums];
  float advantage_mean, advantage_inv_std, clip_coef, entropy_coef;
  float scale, unscale;         // gradients are `scale` times too large
  int64_t source[2][S::kRows];  // of this tile and the next
  LossRow row[S::kRows];
};

template <class S>
__device__ void load_network(const FusedActor& k, Memory<S>& m) {
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
  load_matrix<S::kHidden, S::kInStride, S::kThreads>(k.parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<S::kHidden, S::kStride, S::kThreads>(k.parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_matrix<kHead, S::kStride, S::kThreads>(k.parameters + net.weight[2], output, hidden2, m.weight3);
  load_vector(k.parameters + net.bias[0], hidden1, m.bias1, S::kHidden);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, S::kHidden);
  load_vector(k.parameters + net.bias[2], output, m.bias3, kHead);
  load_vector(k.loss.action ? nullptr : k.parameters + net.log_std, kActionSize, m.log_std, 4);
  if (threadIdx.x < 32) take_moments(k, m);
}

template <class S>
__global__ void __launch_bounds__(S::kThreads, 1) block_actor_kernel(const __grid_constant__ FusedActor k) {
  extern __shared__ __align__(16) char shared[];
  Memory<S>& m = *reinterpret_cast<Memory<S>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileRows tiles(k.rows, S::kRows);
  const FusedMlp& net = k.net;
  const int input = net.width[0];
  const BlockPart<S> part;
  const HeadPart head;
  load_network(k, m);

  BlockWeightGradient<S::kInTiles> d_weight1(4);
  BlockWeightGradient<S::kWeightTiles> d_weight2(4);
  BlockWeightGradient<2> d_weight3(1);
  BlockBiasGradients d_bias;
  float sums[kLaneSums] = {};

  int64_t tile = blockIdx.x;
  if (thread < S::kRows) m.source[0][thread] = tiles.source(k.rows, tile, thread);
  __syncthreads();
  LossRow next_row;
  const auto fetch = [&](int turn) {
    m.next.fetch(k.rows, input, [&](int i) { return m.source[turn][warp * S::kWarpRows + i]; });
    if (thread < S::kRows) next_row = LossRow(k, m.source[turn][thread]);
  };
  fetch(0);

  for (int turn = 0; tile < tiles.n_tiles; tile += gridDim.x, turn ^= 1) {
    m.next.wait();
    m.next.store(k.rows, input, m.x);
    if (thread < S::kRows) {
      m.row[thread] = next_row;
      m.source[turn ^ 1][thread] = tiles.source(k.rows, tile + gridDim.x, thread);
    }
    __syncthreads();

    // Forward.
    BlockSlopes<S> slope1, slope2;
    LayerSums<S> y;
    first_layer(m, part, net.activation, y, slope1);
    __syncthreads();
    y.start(m.bias2 + part.column);
    y.template add_by_rows<S::kDepth>(part.rows(m.of.hidden1), Halves<S::kStride>(m.weight2, part.column, 0));
    slope2.activate(net.activation, y, part.at(m.of.hidden2));
    m.slopes2.keep(slope2);
    __syncthreads();

    head_gradient<S>(k, m, head, m.of.hidden2, sums);
    __syncthreads();

    // Backward.
    Factor<S::kTiles / 2> gradient[S::kRowTiles];
    d_weight3.template add<S::kRowDepth, kHeadStride, S::kStride>(m.head, m.of.hidden2,
                                                                  [&](int i, const uint32_t(&t)[4]) {
                                                                    if (i == warp) d_bias.add(2, t);
                                                                  });
    y.clear();
    y.template add_by_columns<kHead / 16>(Halves<kHeadStride>(m.head, part.row, 0),
                                          Halves<S::kStride>(m.weight3, 0, part.column));
    m.slopes2.take(slope2);
    slope2.scale(y, gradient);
    slope2.store_all(gradient, part.at(m.of.gradient2));
    __syncthreads();
    d_weight2.template add<S::kRowDepth, S::kStride, S::kStride>(m.of.gradient2, m.of.hidden1,
                                                                 [&](int i, const uint32_t(&t)[4]) {
                                                                   if (i == warp / 4) d_bias.add(1, t);
                                                                 });
    y.clear();
    y.template add_by_columns<S::kDepth>(part.rows(m.of.gradient2), Halves<S::kStride>(m.weight2, 0, part.column));
    m.slopes1.take(slope1);
    slope1.scale(y, gradient);
    slope1.store_all(gradient, part.at(m.gradient1));
    __syncthreads();
    fetch(turn ^ 1);
    d_weight1.template add<S::kRowDepth, S::kStride, S::kInStride>(m.gradient1, m.x, [&](int i, const uint32_t(&t)[4]) {
      if (i == warp / 4) d_bias.add(0, t);
    });
    __syncthreads();
  }

  // The block's sums.
  const float unscale = m.unscale;
  const int hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
  float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
  d_weight1.write(unscale, hidden1, input, out + net.weight[0]);
  d_weight2.write(unscale, hidden2, hidden1, out + net.weight[1]);
  d_weight3.write(unscale, output, hidden2, out + net.weight[2]);
  d_bias.write(0, unscale, part.bias, hidden1, out + net.bias[0]);
  d_bias.write(1, unscale, part.bias, hidden2, out + net.bias[1]);
  if (warp < kHead / 16) d_bias.write(2, unscale, warp * 16, output, out + net.bias[2]);
  write_policy_sums<S>(k, m, sums, unscale, out);
}

template <class S>
void launch(const FusedActor& actor, void* stream) {
  static_assert(sizeof(Memory<S>) <= kMostSharedAlone);
  const auto kernel = block_actor_kernel<S>;
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(Memory<S>)));
  kernel<<<actor.n_partial, S::kThreads, sizeof(Memory<S>), static_cast<cudaStream_t>(stream)>>>(actor);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace

void launch_block_actor_gradient(const FusedActor& actor, void* stream) {
  const int input = actor.net.width[0];
  if (input <= Narrow::kIn) return launch<Narrow>(actor, stream);
  if (input <= Medium::kIn) return launch<Medium>(actor, stream);
  GIGA_CHECK(input <= Wide::kIn, "inputs of ", input, " numbers");
  launch<Wide>(actor, stream);
}

}  // namespace giga
