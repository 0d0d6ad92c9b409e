// The policy's loss of rows whose logits or means lie in the registers of a warp, as products leave them; and the sums
// of a block.
#pragma once

#include "cuda/ppo_tiles.cuh"

namespace giga {

constexpr int kSums = kNPolicyDiagnostics + kActionSize;  // diagnostics, and the gradient by log_std
constexpr int kLaneSums = (kSums + 3) / 4;                // of which each of four lanes adds up every fourth

/// A row of logits as a product leaves it: four lanes that lie side by side have two columns of each tile.
struct QuadLogits {
  static constexpr int kNumbers = kHead / 4;
  float x[kNumbers];
  int pair;

  __device__ int column(int k) const { return k / 2 * 8 + pair + k % 2; }
  __device__ bool is_action(int k) const { return column(k) < kNDiscreteActions; }
  __device__ float total(float sum) const {
    sum += __shfl_xor_sync(0xFFFFFFFFu, sum, 1);
    return sum + __shfl_xor_sync(0xFFFFFFFFu, sum, 2);
  }
  __device__ float total_of(const float (&)[kNumbers], float sum) const { return total(sum); }
  __device__ float greatest(float top) const {
    top = fmaxf(top, __shfl_xor_sync(0xFFFFFFFFu, top, 1));
    return fmaxf(top, __shfl_xor_sync(0xFFFFFFFFu, top, 2));
  }
};

/// What the loss takes of a row besides the network's output.
struct LossRow {
  int64_t source = -1;
  float old_log_prob = 0, advantage = 0;
  int action = 0;
  bool alive = false;

  LossRow() = default;
  __device__ LossRow(const FusedActor& k, int64_t source_) : source(source_) {
    if (source < 0) return;
    alive = k.rows.alive[source];
    old_log_prob = __ldg(k.loss.old_log_prob + source);
    advantage = __ldg(k.loss.advantage + source);
    if (k.loss.action) action = __ldg(k.loss.action + source);
  }
};

/// The loss of a row: its gradient takes the place of the logits or means, and its sums are added to those of the lane.
template <class Memory>
__device__ void policy_gradient(const FusedActor& k, const Memory& m, const LossRow& row, QuadLogits& l,
                                float (&sums)[kLaneSums]) {
  const PolicySample of{row.old_log_prob, (row.advantage - m.advantage_mean) * m.advantage_inv_std, m.scale,
                        m.clip_coef, m.entropy_coef};
  float all[4 * kLaneSums] = {};
  if (k.loss.action) {
    categorical_gradient(l, row.action, of, all);
  } else {
    // The means are with the first lane of the four and the one beside it.
    const int first = static_cast<int>(threadIdx.x) % 32 / 4 * 4;
    const float mean[kActionSize] = {__shfl_sync(0xFFFFFFFFu, l.x[0], first), __shfl_sync(0xFFFFFFFFu, l.x[1], first),
                                     __shfl_sync(0xFFFFFFFFu, l.x[0], first + 1)};
    float u[kActionSize] = {}, d_mean[kActionSize], *d_std = all + kNPolicyDiagnostics;
    if (row.source >= 0)
      for (int i = 0; i < kActionSize; ++i) u[i] = __ldg(k.loss.pre_tanh_action + row.source * kActionSize + i);
    gaussian_gradient(mean, m.log_std, u, of, d_mean, d_std, all);
#pragma unroll
    for (int i = 0; i < QuadLogits::kNumbers; ++i) l.x[i] = 0;
    if (l.pair == 0) {
      l.x[0] = d_mean[0];
      l.x[1] = d_mean[1];
    } else if (l.pair == 2) {
      l.x[0] = d_mean[2];
    }
  }
#pragma unroll
  for (int i = 0; i < QuadLogits::kNumbers; ++i) l.x[i] = row.alive ? l.x[i] : 0.0f;
#pragma unroll
  for (int i = 0; i < kLaneSums; ++i) {
    const float mine = l.pair == 0   ? all[4 * i]
                       : l.pair == 2 ? all[4 * i + 1]
                       : l.pair == 4 ? all[4 * i + 2]
                                     : all[4 * i + 3];
    sums[i] += row.alive ? mine : 0.0f;
  }
}

/// What the loss takes of the whole minibatch, into shared memory; gradients are `scale` times too large. All lanes of
/// a warp call it.
template <class Memory>
__device__ void take_moments(const FusedActor& k, Memory& m) {
  const BatchMoments moments(k.moments);
  if (threadIdx.x > 0) return;
  m.advantage_mean = k.loss.advantage_mean ? *k.loss.advantage_mean : moments.mean;
  m.advantage_inv_std = k.loss.advantage_inv_std ? *k.loss.advantage_inv_std : 1.0f / (sqrtf(moments.variance) + 1e-8f);
  const float off = moments.mean - m.advantage_mean;
  float slope = 1;  // of a gradient by the head's number: that by a mean is by 1 / deviation larger
  if (!k.loss.action)
    for (int d = 0; d < kActionSize; ++d) slope = fmaxf(slope, expf(-k.parameters[k.net.log_std + d]));
  m.scale = gradient_scale(sqrtf(moments.variance + off * off) * m.advantage_inv_std * slope);
  m.unscale = moments.inv_count / m.scale;
  m.clip_coef = *k.loss.clip_coef;
  m.entropy_coef = *k.loss.entropy_coef;
}

/// The sums of all lanes become those of the block: in `out`, the block's row of k.partial, of diagnostics behind the
/// gradient, and of the gradient by log_std in it. All threads call it.
template <class S, class Memory>
__device__ __forceinline__ void write_policy_sums(const FusedActor& k, Memory& m, const float (&sums)[kLaneSums],
                                                  float unscale, float* out) {
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
  const TileLane lane;
  const FusedMlp& net = k.net;
#pragma unroll
  for (int i = 0; i < kLaneSums; ++i) {
    const float all = sum_of_groups(sums[i]);
    if (lane.group == 0) m.sums[warp][4 * i + lane.pair / 2] = all;
  }
  __syncthreads();
  if (thread < kSums) {
    float all = 0;
    for (int w = 0; w < S::kWarps; ++w) all += m.sums[w][thread];
    if (thread < kNPolicyDiagnostics)
      out[net.size + thread] = all;
    else if (!k.loss.action)
      out[net.log_std + thread - kNPolicyDiagnostics] = all * unscale;
  } else if (thread - kSums < kFusedSums - kNPolicyDiagnostics) {
    out[net.size + kNPolicyDiagnostics + thread - kSums] = 0;
  }
}

}  // namespace giga
