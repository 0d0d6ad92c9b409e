// The gradient of the policy's loss in one kernel (ppo_gradients.hpp).
#include "cuda/check.cuh"
#include "cuda/ppo_block.hpp"
#include "cuda/ppo_policy_loss.cuh"
#include "cuda/ppo_tiles.cuh"
#include "cuda/ppo_wide.hpp"

namespace giga {
namespace {

/// Shared memory of a block.
template <class S>
struct ActorMemory {
  KeptSlopes<S> slopes1;
  alignas(16) __half x[S::kRows * S::kInStride];
  __half hidden1[S::kRows * kHiddenStride];  // features; then the gradient by their sums
  __half hidden2[S::kRows * kHiddenStride];
  __half head[S::kRows * kHeadStride];  // the gradient by the logits or means
  __half weight1[kHidden * S::kInStride];
  __half weight2[kHidden * kHiddenStride];
  __half weight3[kHead * kHiddenStride];
  float bias1[kHidden], bias2[kHidden], bias3[kHead];
  float log_std[4];
  float sums[S::kWarps][4 * kLaneSums];
  float advantage_mean, advantage_inv_std, clip_coef, entropy_coef;
  float scale, unscale;         // gradients are `scale` times too large
  int64_t source[2][S::kRows];  // of this tile and the next
};

template <class S>
__device__ void load_network(const FusedActor& k, ActorMemory<S>& m) {
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];
  load_matrix<kHidden, S::kInStride, S::kThreads>(k.parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<kHidden, kHiddenStride, S::kThreads>(k.parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_matrix<kHead, kHiddenStride, S::kThreads>(k.parameters + net.weight[2], output, hidden2, m.weight3);
  load_vector(k.parameters + net.bias[0], hidden1, m.bias1, kHidden);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, kHidden);
  load_vector(k.parameters + net.bias[2], output, m.bias3, kHead);
  load_vector(k.loss.action ? nullptr : k.parameters + net.log_std, kActionSize, m.log_std, 4);
  if (threadIdx.x < 32) take_moments(k, m);
}

template <class S>
__global__ void __launch_bounds__(S::kThreads, 1) actor_kernel(const __grid_constant__ FusedActor k) {
  extern __shared__ __align__(16) char shared[];
  ActorMemory<S>& m = *reinterpret_cast<ActorMemory<S>*>(shared);
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const TileRows tiles(k.rows, S::kRows);
  const FusedMlp& net = k.net;
  const int input = net.width[0];
  load_network(k, m);

  // A warp's rows in shared memory.
  __half* const x = m.x + warp * 16 * S::kInStride;
  __half* const hidden1 = m.hidden1 + warp * 16 * kHiddenStride;
  __half* const hidden2 = m.hidden2 + warp * 16 * kHiddenStride;
  __half* const head = m.head + warp * 16 * kHeadStride;

  WeightGradient<S::kInTiles> d_weight1(4);
  WeightGradient<S::kWeightTiles> d_weight2(4);
  WeightGradient<2> d_weight3(2);
  BiasGradient d_bias, d_bias3;  // of the first layer or of the second; of the head
  const bool has_bias1 = warp < 4, has_bias2 = warp >= 4 && warp < 8, has_bias3 = warp < 2;
  float sums[kLaneSums] = {};

  int64_t tile = blockIdx.x;
  if (thread < S::kRows) m.source[0][thread] = tiles.source(k.rows, tile, thread);
  __syncthreads();
  FetchedInputs<S::kIn> next;
  next.fetch(k.rows, input, [&](int i) { return m.source[0][warp * 16 + i]; });

  for (int turn = 0; tile < tiles.n_tiles; tile += gridDim.x, turn ^= 1) {
    next.template store<S::kInStride>(k.rows, input, x);
    const int64_t* source = m.source[turn] + warp * 16;
    const LossRow row[2] = {LossRow(k, source[lane.group]), LossRow(k, source[lane.group + 8])};
    __syncwarp();

    // Forward.
    Slopes slope1, slope2;
    TileSums<kHead / 8> logits;
    {
      TileSums<kHiddenTiles> y;
      y.start(m.bias1);
      y.template add_by_rows<S::kInDepth>(Halves<S::kInStride>(x, 0, 0), Halves<S::kInStride>(m.weight1, 0, 0));
      activate(net.activation, y, slope1);
      m.slopes1.keep(slope1);
      Factor<kHiddenDepth> features = y.factor();
      store(features, hidden1, kHiddenStride);
      y.start(m.bias2);
      y.add_by_rows(features, Halves<kHiddenStride>(m.weight2, 0, 0));
      activate(net.activation, y, slope2);
      features = y.factor();
      store(features, hidden2, kHiddenStride);
      logits.start(m.bias3);
      logits.add_by_rows(features, Halves<kHiddenStride>(m.weight3, 0, 0));
    }

    // The loss of two rows for each lane.
#pragma unroll
    for (int half = 0; half < 2; ++half) {
      QuadLogits l;
      l.pair = lane.pair;
#pragma unroll
      for (int i = 0; i < QuadLogits::kNumbers; ++i) l.x[i] = logits.c[i / 2][2 * half + i % 2];
      policy_gradient(k, m, row[half], l, sums);
#pragma unroll
      for (int i = 0; i < QuadLogits::kNumbers; ++i) logits.c[i / 2][2 * half + i % 2] = l.x[i];
    }

    // Backward: the gradient by a layer's sums takes the place of its features once these are used.
    Factor<kHiddenDepth> gradient;
    {
      const Factor<kHead / 16> by_head = logits.factor();
      store(by_head, head, kHeadStride);
      TileSums<kHiddenTiles> y;
      y.clear();
      y.add_by_columns(by_head, Halves<kHiddenStride>(m.weight3, 0, 0));
      gradient = slope2.scaled(y);
    }
    if (thread < S::kRows) m.source[turn ^ 1][thread] = tiles.source(k.rows, tile + gridDim.x, thread);
    __syncthreads();
    if (d_weight3.column < kHidden)
      d_weight3.template add<S::kRowDepth, kHeadStride, kHiddenStride>(m.head, m.hidden2, [&](const uint32_t(&t)[4]) {
        if (has_bias3) d_bias3.add(t);
      });
    __syncthreads();
    store(gradient, hidden2, kHiddenStride);
    {
      TileSums<kHiddenTiles> y;
      y.clear();
      y.add_by_columns(gradient, Halves<kHiddenStride>(m.weight2, 0, 0));
      m.slopes1.take(slope1);
      gradient = slope1.scaled(y);
    }
    __syncthreads();
    d_weight2.template add<S::kRowDepth, kHiddenStride, kHiddenStride>(m.hidden2, m.hidden1,
                                                                       [&](const uint32_t(&t)[4]) {
                                                                         if (has_bias2) d_bias.add(t);
                                                                       });
    __syncthreads();
    store(gradient, hidden1, kHiddenStride);
    next.fetch(k.rows, input, [&](int i) { return m.source[turn ^ 1][warp * 16 + i]; });
    __syncthreads();
    d_weight1.template add<S::kRowDepth, kHiddenStride, S::kInStride>(m.hidden1, m.x, [&](const uint32_t(&t)[4]) {
      if (has_bias1) d_bias.add(t);
    });
    __syncthreads();
  }

  // The block's sums.
  const float unscale = m.unscale;
  const int hidden1_width = net.width[1], hidden2_width = net.width[2], output = net.width[3];
  float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
  d_weight1.write(unscale, hidden1_width, input, out + net.weight[0]);
  d_weight2.write(unscale, hidden2_width, hidden1_width, out + net.weight[1]);
  if (d_weight3.column < kHidden) d_weight3.write(unscale, output, hidden2_width, out + net.weight[2]);
  if (has_bias1) d_bias.write(unscale, d_weight1.row, hidden1_width, out + net.bias[0]);
  if (has_bias2) d_bias.write(unscale, d_weight2.row, hidden2_width, out + net.bias[1]);
  if (has_bias3) d_bias3.write(unscale, d_weight3.row, output, out + net.bias[2]);
  write_policy_sums<S>(k, m, sums, unscale, out);
}

template <class S>
void launch(const FusedActor& actor, void* stream) {
  static_assert(sizeof(ActorMemory<S>) <= kMostShared);
  GIGA_CUDA(cudaFuncSetAttribute(actor_kernel<S>, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(ActorMemory<S>)));
  actor_kernel<S><<<actor.n_partial, S::kThreads, sizeof(ActorMemory<S>), static_cast<cudaStream_t>(stream)>>>(actor);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace

void launch_actor_gradient(const FusedActor& actor, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  if (actor.net.is_wide()) return launch_wide_actor_gradient(actor, stream);
  if (!actor.net.is_narrow()) return launch_block_actor_gradient(actor, stream);
  const int input = actor.net.width[0];
  if (input <= NarrowTiles::kIn) return launch<NarrowTiles>(actor, stream);
  if (input <= MixedTiles::kIn) return launch<MixedTiles>(actor, stream);
  if (input <= MediumTiles::kIn) return launch<MediumTiles>(actor, stream);
  GIGA_CHECK(input <= WideTiles::kIn, "inputs of ", input, " numbers");
  launch<WideTiles>(actor, stream);
}

}  // namespace giga
