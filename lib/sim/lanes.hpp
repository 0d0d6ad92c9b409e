// Lanes: how the agents of one world are spread over workers. A stage is lanes.each(n, f): f(0) ... f(n - 1) in any
// order, all finished and visible to every worker when it returns. lanes.each_cell(rows, columns, of_row, f) does the
// same with f(of_row(row), column) over a matrix, neighboring lanes at neighboring columns: each worker calls of_row
// once for a row, for what its cells have in common; where that converts to false the row is left out. each_agent is
// each for the agents of the world: where there is a worker for each of them, the compiler learns that f runs once.
// kSerial: one worker does it all, in order. wait_delivered: from the next stage on, rows that were written can be
// read.
//   SerialLanes  one worker (CPU; worlds run in parallel over threads)
//   TileLanes    part of a warp, several worlds a warp (small teams); cuda/lanes.hpp
//   BlockLanes   one thread block (dozens to hundreds of agents); cuda/lanes.hpp
//   GridLanes    several thread blocks, up to the whole GPU (a grid of many agents); cuda/grid_lanes.hpp. WideLanes:
//                they can also gather(n, start, f, merge): each worker calls f(sum, i) for its part of 0 ... n - 1 with
//                a sum of its own that begins as `start`, then merge(sum) once; gather_by_block puts the sums of a
//                block together first. They write rows by write_pieces, add up in order by each_sum, go through items
//                warp by warp or block by block (each_warp, each_block), whose lanes add up in order by sum_rows, sort
//                by those of a block or of all blocks (sorters), and look for others by crews (with_crews): several
//                lanes for an agent where there are enough, else single ones, some of each warp where there are many
//                (spread_over).
// without_barrier(lanes): for a stage whose results no worker but the one that made them needs before the next barrier.
// each_agent and gather of the same lanes and the same n give an item to the same worker every time. So does each, but
// a single item (n = 1) may go to another worker than theirs.
#pragma once

#include "core/host_device.hpp"

namespace giga {

template <class Lanes>
concept WideLanes = requires {
  requires Lanes::kWide;
};

/// Lanes for which a barrier is dear leave it out; for all others it is part of how they are written.
template <class Lanes>
GIGA_HD decltype(auto) without_barrier(const Lanes& lanes) {
  if constexpr (WideLanes<Lanes>)
    return lanes.without_barrier();
  else
    return (lanes);
}

struct SerialLanes {
  static constexpr bool kSerial = true;
  template <class F>
  GIGA_HD void each(int n, F&& f) const {
    for (int i = 0; i < n; ++i) f(i);
  }
  template <class F>
  GIGA_HD void each_agent(int n, F&& f) const {
    each(n, f);
  }
  template <class OfRow, class F>
  GIGA_HD void each_cell(int rows, int columns, OfRow&& of_row, F&& f) const {
    for (int row = 0; row < rows; ++row) {
      const auto common = of_row(row);
      for (int column = 0; common && column < columns; ++column) f(common, column);
    }
  }
  GIGA_HD void wait_delivered() const {}
  /// Whether `flag` holds in any world that shares this one's workers: stages guarded by it stay in lockstep.
  GIGA_HD bool any(bool flag) const { return flag; }
};

}  // namespace giga
