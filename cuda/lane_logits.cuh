// A row of logits that several lanes of a warp have together, for kernels in which what counts is how long a row takes.
#pragma once

#include "math/distributions.hpp"

namespace giga {

/// A row of logits of which lanes that lie side by side have some each, in order. Sums are taken in the order of
/// Logits, so that both choose the same action. All lanes of the warp call it.
template <int kLanes_>
struct LaneLogits {
  static constexpr int kLanes = kLanes_, kNumbers = (kLogitStride + kLanes - 1) / kLanes;
  static_assert(kLogitStride % kNumbers == 0);
  static constexpr uint32_t kWarp = 0xFFFFFFFFu;
  float x[kNumbers] = {};
  int lane = static_cast<int>(threadIdx.x) % kLanes;

  __device__ explicit LaneLogits(const float* row) {
    if (lane * kNumbers >= kLogitStride) return;
#pragma unroll
    for (int k = 0; k < kNumbers; ++k) x[k] = row[lane * kNumbers + k];
  }
  __device__ int column(int k) const { return lane * kNumbers + k; }
  __device__ bool is_action(int k) const { return column(k) < kNDiscreteActions; }
  __device__ float greatest(float top) const {
#pragma unroll
    for (int apart = 1; apart < kLanes; apart *= 2) top = fmaxf(top, __shfl_xor_sync(kWarp, top, apart));
    return top;
  }
  /// The sum of the numbers of the lanes before this one.
  __device__ float before(const float (&p)[kNumbers]) const {
    float sum = 0;
#pragma unroll
    for (int turn = 1; turn < kLanes; ++turn) {
      sum = of_lane(lane - 1, through(sum, p));
      if (lane == 0) sum = 0;
    }
    return sum;
  }
  __device__ float total_of(const float (&p)[kNumbers], float) const {
    return of_lane(kLanes - 1, through(before(p), p));
  }
  /// NaNs are never the largest, unless the first number is one, as in Logits.
  __device__ int largest() const {
    float top = lane == 0 ? x[0] : -INFINITY;
    int chosen = 0;
#pragma unroll
    for (int k = 0; k < kNumbers; ++k)
      if (is_action(k) && x[k] > top) {
        top = x[k];
        chosen = column(k);
      }
#pragma unroll
    for (int apart = 1; apart < kLanes; apart *= 2) {
      const float other = __shfl_xor_sync(kWarp, top, apart);
      const int others = __shfl_xor_sync(kWarp, chosen, apart);
      if (other > top || (other == top && others < chosen)) {
        top = other;
        chosen = others;
      }
    }
    return of_lane(0, chosen);
  }
  __device__ int draw(const float (&p)[kNumbers], float u) const {
    float below = before(p);
    int chosen = 0;
#pragma unroll
    for (int k = 0; k < kNumbers; ++k) {
      below += p[k];
      chosen += column(k) < kNDiscreteActions - 1 && u >= below ? 1 : 0;
    }
#pragma unroll
    for (int apart = 1; apart < kLanes; apart *= 2) chosen += __shfl_xor_sync(kWarp, chosen, apart);
    return chosen;
  }
  __device__ float at(int index) const {
    const int k = index % kNumbers;
    float mine = x[0];
#pragma unroll
    for (int j = 1; j < kNumbers; ++j) mine = j == k ? x[j] : mine;
    return of_lane(index / kNumbers, mine);
  }

 private:
  template <class T>
  __device__ T of_lane(int number, T x) const {
    return __shfl_sync(kWarp, x, (static_cast<int>(threadIdx.x) - lane + number) & 31);
  }
  __device__ static float through(float sum, const float (&p)[kNumbers]) {
#pragma unroll
    for (int k = 0; k < kNumbers; ++k) sum += p[k];
    return sum;
  }
};

}  // namespace giga
