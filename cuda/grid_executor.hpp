// How the GPU back end spreads worlds of many agents (rules 17) over blocks and threads: several blocks work on a world
// together, up to the whole GPU, and go from world to world. Plain host-device code, as executor.hpp.
#pragma once

#include <algorithm>
#include <cstdint>

#include "cuda/executor.hpp"
#include "sim/grid_memory.hpp"
#include "sim/grid_sort.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"

namespace giga {

constexpr int kGridThreads = 512;   // threads of a block
constexpr int kThreadsOfAgent = 2;  // of a world, where there is room: most stages look at pairs or write rows
constexpr int kNumbersAtOnce = 5;   // of a row, that a thread works out before it writes any

/// The threads of the blocks that share a world. Sync: of all of them. A stage of nothing needs no barrier: that it is
/// one is the same for all of them, and the stage before has ended with its own.
template <class Sync>
struct GridLanes {
  static constexpr bool kSerial = false, kWide = true;
  int first, stride;
  Sync sync;
  template <class F>
  GIGA_HD void each(int n, F&& f) const {
    if (n <= 0) return;
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
    if (rows <= 0 || columns <= 0) return;
    for (int row = first / kWarp; row < rows; row += stride / kWarp) {
      const auto common = of_row(row);
      if (!common) continue;
      for (int column = first % kWarp; column < columns; column += kWarp) f(common, column);
    }
    sync.wait();
  }
  /// A warp per row: row_of(row)[column] = tell(ask(row, column), row, column), or nothing where that row is null. A
  /// thread asks for several numbers before it tells any: the compiler would not, because a write might change what is
  /// read behind it.
  template <class Rows, class Ask, class Tell>
  GIGA_HD void write_rows(int rows, int columns, Rows&& row_of, Ask&& ask, Tell&& tell) const {
    if (rows <= 0 || columns <= 0) return;
    for (int row = first / kWarp; row < rows; row += stride / kWarp) {
      float* to = row_of(row);
      if (!to) continue;
      for (int begin = first % kWarp; begin < columns; begin += kNumbersAtOnce * kWarp) {
        decltype(ask(0, 0)) asked[kNumbersAtOnce];
        GIGA_UNROLL
        for (int k = 0; k < kNumbersAtOnce; ++k) {
          const int column = begin + k * kWarp;
          asked[k] = ask(row, column < columns ? column : columns - 1);
        }
        GIGA_UNROLL
        for (int k = 0; k < kNumbersAtOnce; ++k) {
          const int column = begin + k * kWarp;
          if (column < columns) to[column] = tell(asked[k], row, column);
        }
      }
    }
    sync.wait();
  }
  template <class Sum, class F, class Merge>
  GIGA_HD void gather(int n, Sum sum, F&& f, Merge&& merge) const {
    if (n <= 0) return;
    for (int i = first; i < n; i += stride) f(sum, i);
    merge(sum);
    sync.wait();
  }
  GIGA_HD void wait_sent() const {}
  GIGA_HD void wait_delivered() const {}
  /// They share one world, so all hand in the same; nobody goes on to change it before all have read it.
  GIGA_HD bool any(bool flag) const {
    sync.wait();
    return flag;
  }
};

/// How blocks are put together. Groups go from world to world; all blocks of a launch that is not clustered run at the
/// same time, because they wait for each other.
struct GridLaunchShape {
  int groups;      ///< worlds at a time
  int blocks;      ///< of a group
  bool clustered;  ///< a group is a cluster of the hardware, whose barrier is ten times as fast as one in memory
};

/// What there is to spread them over.
struct GridDevice {
  int threads;         ///< of a block
  int resident;        ///< blocks that run at the same time
  int most_clustered;  ///< blocks of a cluster, a power of two; 1 = there are no clusters
};

/// As many blocks for a world as have work, and for as many worlds as there is room for.
inline GridLaunchShape grid_launch_shape(int n_agents, int n_worlds, const GridDevice& device) {
  const int useful = (kThreadsOfAgent * n_agents + device.threads - 1) / device.threads;
  int blocks = std::max(1, std::min(useful, device.resident / std::min(n_worlds, device.resident)));
  const bool clustered = blocks > 1 && blocks <= device.most_clustered;
  while (clustered && (blocks & (blocks - 1)) != 0) --blocks;  // to a power of two
  return {std::min(n_worlds, device.resident / blocks), blocks, clustered};
}

/// What a group keeps from launch to launch, in lines of memory of its own. Zero before the first.
struct alignas(64) GroupWords {
  uint32_t arrivals;  ///< of blocks at barriers (simulator of the GPU)
  SharedWork::Bounds bounds;
};

/// Arguments of a kernel, by value.
struct GridLaunch {
  GridParams params;
  StateView state;
  PairLists lists;
  StepIo io;
  char* scratch;  // [groups, scratch_bytes]
  size_t scratch_bytes;
  GroupWords* words;    // [groups]
  int32_t* full_lists;  // [1]
  uint64_t seed;
  int64_t first_world, draw_period;
  int n_worlds;
  Ending ending;
  const int32_t* playing;    // [n_playing] the worlds to work on; null = all
  const int32_t* n_playing;  // [1]
  int groups, blocks;

  GIGA_HD int count() const { return playing ? *n_playing : n_worlds; }
  GIGA_HD int world(int k) const { return playing ? playing[k] : k; }
};

/// What a thread does. `sync`: of its group.
template <Job job, class Sync>
GIGA_HD void run_grid_thread(const GridLaunch& k, const ThreadIndex& at, Sync sync) {
  const int group = at.block / k.blocks;
  // Warps take turns among the blocks, so that all have work where there are fewer agents than threads.
  const int warp = at.thread / kWarp * k.blocks + at.block % k.blocks;
  const GridLanes<Sync> lanes{warp * kWarp + at.thread % kWarp, k.blocks * at.n_threads, sync};
  GridWorld scratch{};
  attach_scratch(k.params, scratch, k.scratch + static_cast<size_t>(group) * k.scratch_bytes, true);
  scratch.work.bounds = &k.words[group].bounds;
  scratch.full_lists = k.full_lists;
  const int count = k.count();
  GIGA_ROLLED
  for (int index = group; index < count; index += k.groups) {
    const int world = k.world(index);
    GridWorld w = scratch;
    attach_state(k.params, w, k.state, k.lists, world);
    if (!has_work<job>(lanes, w)) continue;
    const uint32_t number = draw_world(k.first_world, k.draw_period, world);
    const auto draws_at = [&](uint32_t step) { return GridDraws(k.seed, number, step); };
    run_job<job>(lanes, k.params, w, draws_at, k.io, k.ending, world);
  }
}

/// A simulator of worlds of many agents that runs its jobs by launches. Its back end launches, and lists the worlds
/// that play.
class GridLaunchingSimulator : public Simulator {
 public:
  void redraw(const Redraw&) override { throw Error("there are no images"); }

 protected:
  GridLaunchingSimulator(SimSpec spec, const SimOptions& options, Memory& memory, const GridDevice& device)
      : Simulator(std::move(spec), options, memory),
        params_(grid_params(spec_, tables_, options_.most_shooters)),
        shape_(grid_launch_shape(params_.n_agents, n_worlds(), device)),
        scratch_bytes_(group_bytes()),
        scratch_(memory, scratch_bytes_ * static_cast<size_t>(shape_.groups)),
        words_(memory, static_cast<size_t>(shape_.groups)),
        full_lists_(memory, 1) {
    check_grid(params_, state_.shape(), options_);
    if (options.on_done == OnDone::freeze) playing_ = Buffer<int32_t>(memory, static_cast<size_t>(n_worlds()) + 1);
  }

  GridLaunch launch_of(const StepIo& io, Worlds worlds) {
    const bool listed = worlds == Worlds::listed;
    return {.params = params_,
            .state = state_.view(),
            .lists = state_.lists(),
            .io = io,
            .scratch = scratch_.data(),
            .scratch_bytes = scratch_bytes_,
            .words = words_.data(),
            .full_lists = full_lists_.data(),
            .seed = options_.seed,
            .first_world = options_.first_world,
            .draw_period = options_.draw_period,
            .n_worlds = n_worlds(),
            .ending = ending(),
            .playing = listed ? playing_.data() : nullptr,
            .n_playing = listed ? n_playing() : nullptr,
            .groups = shape_.groups,
            .blocks = shape_.blocks};
  }
  /// Throws if a list of fire was too short since this was last asked; waits for what was queued before.
  void check_full_lists() {
    const int full = full_lists_.to_host()[0];
    if (full == 0) return;
    full_lists_.clear();
    throw full_lists_error(full, params_, spec_.name);
  }
  const GridLaunchShape& shape() const { return shape_; }
  const Buffer<char>& scratch() const { return scratch_; }
  int32_t* playing() { return playing_.data(); }
  int32_t* n_playing() { return playing_.data() + n_worlds(); }

 private:
  size_t group_bytes() const {
    GridWorld w{};
    return (attach_scratch(params_, w, nullptr, true) + 127) & ~size_t{127};
  }

  GridParams params_;
  GridLaunchShape shape_;
  size_t scratch_bytes_;
  Buffer<char> scratch_;
  Buffer<GroupWords> words_;
  Buffer<int32_t> full_lists_;
  Buffer<int32_t> playing_;  // [W + 1] OnDone::freeze: worlds that play, in any order, then their number
};

}  // namespace giga
