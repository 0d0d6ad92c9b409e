// The gradient of the policy's loss in one kernel (ppo_gradients.hpp).
#include "cuda/check.cuh"
#include "cuda/ppo_tiles.cuh"

namespace giga {
namespace {

/// What the loss takes of the rows of a tile besides the network's output.
template <int kRows>
struct LossRows {
  float old_log_prob[kRows], advantage[kRows], u[kRows][kActionSize];
  int action[kRows];
  bool alive[kRows];
};

/// Shared memory of a block.
template <class S>
struct ActorMemory {
  float x[S::kRows * S::kInStride];
  float hidden1[S::kRows * kHiddenStride];  // features; then the gradient by their sums
  float hidden2[S::kRows * kHiddenStride];
  float head[S::kRows * kLogitStride + kHead - kLogitStride];  // logits or means; then the gradient by them
  float weight1[kHidden * S::kInStride];
  float weight2[kHidden * kHiddenStride];
  float weight3[kHead * kHiddenStride];
  float bias1[kHidden], bias2[kHidden], bias3[kHead];
  float log_std[4];
  LossRows<S::kRows> rows;
  float sums[S::kRows][kNPolicyDiagnostics + kActionSize];  // diagnostics and gradient by log_std, added up
  BatchMoments moments;
  int64_t source[2][S::kRows];  // of this tile and the next
};

/// A row of logits, spread over four lanes that lie side by side: each has every fourth number.
struct SpreadLogits {
  static constexpr int kNumbers = kLogitStride / 4;
  float x[kNumbers];
  int lane;

  __device__ SpreadLogits(const float* row, int lane_) : lane(lane_) {
#pragma unroll
    for (int k = 0; k < kNumbers; ++k) x[k] = row[column(k)];
  }
  __device__ int column(int k) const { return 4 * k + lane; }
  __device__ bool is_action(int k) const { return column(k) < kNDiscreteActions; }
  __device__ float total(float sum) const {
    sum += __shfl_xor_sync(0xFFFFFFFFu, sum, 1);
    return sum + __shfl_xor_sync(0xFFFFFFFFu, sum, 2);
  }
  __device__ float greatest(float top) const {
    top = fmaxf(top, __shfl_xor_sync(0xFFFFFFFFu, top, 1));
    return fmaxf(top, __shfl_xor_sync(0xFFFFFFFFu, top, 2));
  }
};

/// LossRows of one row, on its way from global memory.
struct FetchedLossRow {
  float old_log_prob = 0, advantage = 0, u[kActionSize] = {};
  int action = 0;
  bool alive = false;

  __device__ void fetch(const FusedActor& k, int64_t source) {
    const bool some = source >= 0;
    alive = some && k.rows.alive[source];
    old_log_prob = some ? k.loss.old_log_prob[source] : 0.0f;
    advantage = some ? k.loss.advantage[source] : 0.0f;
    action = some && k.loss.action ? k.loss.action[source] : 0;
    if (!k.loss.action)
      for (int i = 0; i < kActionSize; ++i) u[i] = some ? k.loss.pre_tanh_action[source * kActionSize + i] : 0.0f;
  }
  template <int kRows>
  __device__ void store(LossRows<kRows>& to, int row) const {
    to.old_log_prob[row] = old_log_prob;
    to.advantage[row] = advantage;
    for (int i = 0; i < kActionSize; ++i) to.u[row][i] = u[i];
    to.action[row] = action;
    to.alive[row] = alive;
  }
};

template <class S>
__global__ void __launch_bounds__(kFusedThreads, 1) actor_kernel(const __grid_constant__ FusedActor k) {
  extern __shared__ __align__(16) char shared[];
  ActorMemory<S>& m = *reinterpret_cast<ActorMemory<S>*>(shared);
  const int thread = static_cast<int>(threadIdx.x);
  const WarpPlace<S> place;
  const TileRows tiles(k.rows, S::kRows);
  const FusedMlp& net = k.net;
  const bool continuous = k.loss.action == nullptr;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2], output = net.width[3];

  load_matrix(k.parameters + net.weight[0], hidden1, input, m.weight1, kHidden, S::kInStride);
  load_matrix(k.parameters + net.weight[1], hidden2, hidden1, m.weight2, kHidden, kHiddenStride);
  load_matrix(k.parameters + net.weight[2], output, hidden2, m.weight3, kHead, kHiddenStride);
  load_vector(k.parameters + net.bias[0], hidden1, m.bias1, kHidden);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, kHidden);
  load_vector(k.parameters + net.bias[2], output, m.bias3, kHead);
  for (int i = thread; i < S::kRows * kLogitStride + kHead - kLogitStride; i += kFusedThreads) m.head[i] = 0;
  if (thread < S::kRows)
    for (float& sum : m.sums[thread]) sum = 0;
  if (thread < kActionSize) m.log_std[thread] = continuous ? k.parameters[net.log_std + thread] : 0.0f;
  if (thread == 0) {
    m.moments = batch_moments(k.moments);
    if (k.loss.advantage_mean) {
      m.moments.mean = *k.loss.advantage_mean;
      m.moments.inv_std = *k.loss.advantage_inv_std;
    }
  }
  int64_t tile = blockIdx.x;
  if (thread < S::kRows) m.source[0][thread] = tiles.source(k.rows, tile, thread);
  __syncthreads();
  FetchedInputs<S> next;
  FetchedLossRow next_row;
  next.fetch(k.rows, input, m.source[0]);
  if (thread < S::kRows) next_row.fetch(k, m.source[0][thread]);

  TileSums<S::kInTiles> d_weight1;
  TileSums<2> d_weight2;
  TileSums<1> d_weight3;
  d_weight1.clear();
  d_weight2.clear();
  d_weight3.clear();
  ColumnSums<kHidden> d_bias1, d_bias2;
  ColumnSums<kHead> d_bias3;  // columns from kLogitStride on mean nothing

  const int rows_at = place.first_row * kHiddenStride, columns = place.column_warp * S::kTiles * 8;
  const int head_columns = place.column_warp * S::kHeadTiles * 8;
  const int warp = thread / 32, head_rows = warp % 2 * 16, head_part = warp / 2 * 8;
  for (int turn = 0; tile < tiles.n_tiles; tile += gridDim.x, turn ^= 1) {
    next.store(k.rows, input, m.x);
    if (thread < S::kRows) next_row.store(m.rows, thread);
    __syncthreads();

    // Forward.
    TileSums<S::kTiles> y;
    Slopes<S::kTiles> slope1, slope2;
    y.start(m.bias1 + columns);
    y.template add_by_rows<S::kIn>({m.x + place.first_row * S::kInStride, S::kInStride},
                                   {m.weight1 + columns * S::kInStride, S::kInStride});
    activate(net.activation, y, slope1);
    y.store_rounded(m.hidden1 + rows_at + columns, kHiddenStride);
    __syncthreads();
    y.start(m.bias2 + columns);
    y.template add_by_rows<kHidden>({m.hidden1 + rows_at, kHiddenStride},
                                    {m.weight2 + columns * kHiddenStride, kHiddenStride});
    activate(net.activation, y, slope2);
    y.store_rounded(m.hidden2 + rows_at + columns, kHiddenStride);
    __syncthreads();
    TileSums<S::kHeadTiles> head;
    head.start(m.bias3 + head_columns);
    head.template add_by_rows<kHidden>({m.hidden2 + rows_at, kHiddenStride},
                                       {m.weight3 + head_columns * kHiddenStride, kHiddenStride});
    head.each([&](float value, int r, int c) {
      if (head_columns + c < kLogitStride) m.head[(place.first_row + r) * kLogitStride + head_columns + c] = value;
    });
    __syncthreads();

    // The loss: four lanes a row.
    for (int r = thread / 4; r < S::kRows; r += kFusedThreads / 4) {
      float* at = m.head + r * kLogitStride;
      SpreadLogits l(at, thread % 4);
      const bool alive = m.rows.alive[r], first = l.lane == 0;
      const PolicySample of{m.rows.old_log_prob[r], (m.rows.advantage[r] - m.moments.mean) * m.moments.inv_std,
                            m.moments.inv_count, k.loss.clip_coef, k.loss.entropy_coef};
      float diagnostic[kNPolicyDiagnostics];
      if (continuous) {
        float d_mean[kActionSize], d_std[kActionSize];
        gaussian_gradient(at, m.log_std, m.rows.u[r], of, d_mean, d_std, diagnostic);
        __syncwarp();  // all lanes have read the means
        for (int i = 0; i < SpreadLogits::kNumbers; ++i) l.x[i] = 0;
        if (l.lane < kActionSize) l.x[0] = l.lane == 0 ? d_mean[0] : l.lane == 1 ? d_mean[1] : d_mean[2];
        if (first && alive)
          for (int i = 0; i < kActionSize; ++i) m.sums[r][kNPolicyDiagnostics + i] += d_std[i];
      } else {
        categorical_gradient(l, m.rows.action[r], of, diagnostic);
      }
      for (int i = 0; i < SpreadLogits::kNumbers; ++i) at[l.column(i)] = alive ? to_tf32(l.x[i]) : 0.0f;
      if (first && alive)
        for (int i = 0; i < kNPolicyDiagnostics; ++i) m.sums[r][i] += diagnostic[i];
    }
    if (thread < S::kRows) m.source[turn ^ 1][thread] = tiles.source(k.rows, tile + gridDim.x, thread);
    __syncthreads();
    // Backward: the gradient by a layer's sums takes the place of its features once these are used.
    y.clear();
    y.template add_by_columns<kHead>({m.head + place.first_row * kLogitStride, kLogitStride},
                                     {m.weight3 + columns, kHiddenStride});
    d_weight3.template add_over_rows<S::kRows>({m.head + head_rows, kLogitStride},
                                               {m.hidden2 + head_part, kHiddenStride});
    d_bias3.add(m.head, S::kRows, kLogitStride);
    slope2.scale(y);
    __syncthreads();
    y.store_rounded(m.hidden2 + rows_at + columns, kHiddenStride);
    __syncthreads();
    y.clear();
    y.template add_by_columns<kHidden>({m.hidden2 + rows_at, kHiddenStride}, {m.weight2 + columns, kHiddenStride});
    d_weight2.template add_over_rows<S::kRows>({m.hidden2 + place.weight_row, kHiddenStride},
                                               {m.hidden1 + place.weight_part * 16, kHiddenStride});
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

  // The block's sums.
  float* out = k.partial + blockIdx.x * (net.size + kFusedSums);
  write_gradient(d_weight1, place.weight_row, place.weight_part * S::kInTiles * 8, hidden1, input, out + net.weight[0]);
  write_gradient(d_weight2, place.weight_row, place.weight_part * 16, hidden2, hidden1, out + net.weight[1]);
  write_gradient(d_weight3, head_rows, head_part, output, hidden2, out + net.weight[2]);
  d_bias1.write(m.hidden1, out + net.bias[0], hidden1);
  d_bias2.write(m.hidden1, out + net.bias[1], hidden2);
  d_bias3.write(m.hidden1, out + net.bias[2], output);
  if (thread < kNPolicyDiagnostics + kActionSize) {
    float all = 0;
    for (int r = 0; r < S::kRows; ++r) all += m.sums[r][thread];
    if (thread < kNPolicyDiagnostics)
      out[net.size + thread] = all;
    else if (continuous)
      out[net.log_std + thread - kNPolicyDiagnostics] = all;
  }
  if (thread >= kNPolicyDiagnostics && thread < kFusedSums) out[net.size + thread] = 0;
}

template <class S>
void launch(const FusedActor& actor, int index, void* stream) {
  GIGA_CUDA(cudaFuncSetAttribute(actor_kernel<S>, cudaFuncAttributeMaxDynamicSharedMemorySize, sizeof(ActorMemory<S>)));
  actor_kernel<S>
      <<<fused_blocks(index), kFusedThreads, sizeof(ActorMemory<S>), static_cast<cudaStream_t>(stream)>>>(actor);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace

void launch_actor_gradient(const FusedActor& actor, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const int input = actor.net.width[0];
  if (input <= 64) return launch<TileShape<64, 128>>(actor, index, stream);
  if (input <= 128) return launch<TileShape<128, 128>>(actor, index, stream);
  GIGA_CHECK(input <= FusedMlp::kMaxInput, "inputs of ", input, " numbers");
  launch<TileShape<192, 64>>(actor, index, stream);
}

}  // namespace giga
