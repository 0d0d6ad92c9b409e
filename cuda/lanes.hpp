// Lanes of the GPU: how the agents of a world are spread over threads (see sim/lanes.hpp). Sync keeps the threads in
// step: wait() returns when all have called it, any(flag) likewise with whether any flag was set. On the GPU these are
// its barriers (simulator.cu); where there is none, tests run the threads one after the other (tests/parity).
//
// Sync also copies numbers from shared memory on its own while the threads go on: each thread that has
// written some calls before_sending, then all wait(), then one calls send(to, from, count); it may only write to `from`
// again after its wait_sent, and read `to` after its wait_delivered. Both addresses are multiples of 16 bytes, count
// of 4.
#pragma once

#include "core/host_device.hpp"

#if defined(__CUDA_ARCH__)
#define GIGA_UNROLL_TWICE _Pragma("unroll 2")
#else
#define GIGA_UNROLL_TWICE
#endif

namespace giga {

/// Several worlds per group of threads, one thread per agent: 3 worlds of 10 agents use 30 of the 32 threads of a warp,
/// 4 worlds of 40 all of a block of 5 warps. Threads beyond the last whole world, or beyond the last world, have `first`
/// past every loop and only keep in step. Sync: of the group.
template <class Sync>
struct TileLanes {
  static constexpr bool kSerial = false;
  int first, stride;
  Sync sync;
  template <class F>
  GIGA_HD void each(int n, F&& f) const {
    for (int i = first; i < n; i += stride) f(i);
    sync.wait();
  }
  template <class F>
  GIGA_HD void each_agent(int n, F&& f) const {
    if (first < n) f(first);
    sync.wait();
  }
  template <class OfRow, class F>
  GIGA_HD void each_cell(int rows, int columns, OfRow&& of_row, F&& f) const {
    for (int row = 0; row < rows && first < columns; ++row) {
      const auto common = of_row(row);
      if (!common) continue;
      GIGA_UNROLL_TWICE
      for (int column = first; column < columns; column += stride) f(common, column);
    }
    sync.wait();
  }
  GIGA_HD void before_sending() const { sync.before_sending(); }
  GIGA_HD void send(float* to, const float* from, int count) const { sync.send(to, from, count); }
  GIGA_HD void wait_sent() const { sync.wait_sent(); }
  GIGA_HD void wait_delivered() const { sync.wait_delivered(); }
  GIGA_HD bool any(bool flag) const { return sync.any(flag); }
};

/// One world per thread block of whole warps. Sync: of the block.
template <class Sync>
struct BlockLanes {
  static constexpr bool kSerial = false;
  int first, stride;
  Sync sync;
  template <class F>
  GIGA_HD void each(int n, F&& f) const {
    for (int i = first; i < n; i += stride) f(i);
    sync.wait();
  }
  template <class F>
  GIGA_HD void each_agent(int n, F&& f) const {
    each(n, f);
  }
  /// A warp per row.
  template <class OfRow, class F>
  GIGA_HD void each_cell(int rows, int columns, OfRow&& of_row, F&& f) const {
    for (int row = first / 32; row < rows; row += stride / 32) {
      const auto common = of_row(row);
      if (!common) continue;
      GIGA_UNROLL_TWICE
      for (int column = first % 32; column < columns; column += 32) f(common, column);
    }
    sync.wait();
  }
  GIGA_HD void wait_sent() const {}
  GIGA_HD void wait_delivered() const {}
  GIGA_HD bool any(bool flag) const { return sync.any(flag); }
};

}  // namespace giga
