// Lanes of the GPU: how the agents of a world are spread over threads (see sim/lanes.hpp).
#pragma once

namespace giga {

/// Several worlds per warp, one thread per agent: 3 worlds of 10 agents use 30 of 32 threads. Threads beyond the last
/// whole world, or beyond the last world, have `first` past every loop and only keep in step.
struct TileLanes {
  int first, stride;
  template <class F>
  __device__ void each(int n, F&& f) const {
    for (int i = first; i < n; i += stride) f(i);
    __syncwarp();
  }
  __device__ bool any(bool flag) const { return __any_sync(0xFFFFFFFFu, flag); }
};

/// One world per thread block.
struct BlockLanes {
  int first, stride;
  template <class F>
  __device__ void each(int n, F&& f) const {
    for (int i = first; i < n; i += stride) f(i);
    __syncthreads();
  }
  __device__ bool any(bool flag) const { return __syncthreads_or(flag); }
};

}  // namespace giga
