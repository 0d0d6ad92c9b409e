// The value's loss: what it takes of a row besides the network's output, and of the whole minibatch; and the sums of a
// block.
#pragma once

#include "cuda/ppo_tiles.cuh"

namespace giga {

constexpr int kValueStride = 8;  // two gradients by the value of a row, in front of zeros

/// What the loss takes of a row besides the network's output, on its way from global memory.
struct FetchedLossRow {
  float old_value = 0, returns = 0;
  bool alive = false;

  __device__ void fetch(const FusedCritic& k, int64_t source) {
    const bool some = source >= 0, loss = some && !k.values;
    alive = some && k.rows.alive[source];
    old_value = loss ? __ldg(k.loss.old_value + source) : 0.0f;
    returns = loss ? __ldg(k.loss.returns + source) : 0.0f;
  }
};

/// The scale of gradients into shared memory: advantages are the errors of the values before the update, and gradients
/// by values are these times value_coef. One thread calls it.
template <class Memory>
__device__ __forceinline__ void take_scale(const FusedCritic& k, const BatchMoments& moments, Memory& m) {
  const float error = sqrtf(moments.variance + moments.mean * moments.mean) / *k.loss.value_std;
  m.scale = gradient_scale(error * k.loss.value_coef);
  m.unscale = moments.inv_count / m.scale;
}

/// The sums of all lanes become those of the block: in `out`, the block's row of k.partial, of losses behind the
/// gradient, and of the gradient by the value's bias in it. All threads call it; the lane's sums become the warp's.
template <class S, class Memory>
__device__ __forceinline__ void write_value_sums(const FusedMlp& net, Memory& m, float& d_bias3, float& loss,
                                                 float unscale, float* out) {
  const int thread = static_cast<int>(threadIdx.x), warp = thread / 32;
#pragma unroll
  for (int apart = 1; apart < 32; apart *= 2) {
    d_bias3 += __shfl_xor_sync(0xFFFFFFFFu, d_bias3, apart);
    loss += __shfl_xor_sync(0xFFFFFFFFu, loss, apart);
  }
  if (thread % 32 == 0) {
    m.sums[0][warp] = loss;
    m.sums[1][warp] = d_bias3;
  }
  __syncthreads();
  if (thread < kFusedSums) {
    float all = 0;
    if (thread < 2)
      for (int w = 0; w < S::kWarps; ++w) all += m.sums[thread][w];
    if (thread == 1) out[net.bias[2]] = all * unscale;
    out[net.size + thread] = thread == 0 ? all : 0.0f;
  }
}

}  // namespace giga
