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
  template <class OfRow, class F>
  __device__ void each_cell(int rows, int columns, OfRow&& of_row, F&& f) const {
    for (int row = 0; row < rows && first < columns; ++row) {
      const auto common = of_row(row);
      if (!common) continue;
#pragma unroll 2
      for (int column = first; column < columns; column += stride) f(common, column);
    }
    __syncwarp();
  }
  __device__ bool any(bool flag) const { return __any_sync(0xFFFFFFFFu, flag); }
};

/// One world per thread block of whole warps.
struct BlockLanes {
  int first, stride;
  template <class F>
  __device__ void each(int n, F&& f) const {
    for (int i = first; i < n; i += stride) f(i);
    __syncthreads();
  }
  /// A warp per row.
  template <class OfRow, class F>
  __device__ void each_cell(int rows, int columns, OfRow&& of_row, F&& f) const {
    for (int row = first / 32; row < rows; row += stride / 32) {
      const auto common = of_row(row);
      if (!common) continue;
#pragma unroll 2
      for (int column = first % 32; column < columns; column += 32) f(common, column);
    }
    __syncthreads();
  }
  __device__ bool any(bool flag) const { return __syncthreads_or(flag); }
};

}  // namespace giga
