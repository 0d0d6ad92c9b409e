// How the GPU back end spreads worlds over blocks and threads: index arithmetic, the working copy of a world, and what
// one thread does. Plain host-device code: simulator.cu calls it from kernels, and tests/parity from an emulation that
// needs no GPU.
#pragma once

#include <algorithm>
#include <climits>

#include "cuda/lanes.hpp"
#include "cuda/scratch.hpp"
#include "sim/draws.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"

namespace giga {

constexpr int kWarp = 32;
constexpr int kTileWarps = 4;          // warps of a block of TileLanes
constexpr int kMaxBlockThreads = 512;  // threads of a block of BlockLanes
constexpr int kWorldsAlone = 1024;     // playing worlds up to which each has a warp for itself

/// Blocks and threads of a launch over all worlds.
struct LaunchShape {
  bool tiles;      ///< TileLanes, else BlockLanes
  bool in_shared;  ///< scratch and working copy in shared memory, else the scratch alone in global memory
  int blocks, threads;
  size_t shared_bytes;  ///< of a block
};

inline LaunchShape launch_shape(const SimParams& p, int n_worlds) {
  const int n = p.n_agents;
  const size_t per_world = shared_bytes(p);
  const int tiled = n <= kWarp ? kTileWarps * (kWarp / n) : 0;  // worlds of a block
  if (tiled > 0 && per_world * static_cast<size_t>(tiled) <= kSharedLimit)
    return {true, true, (n_worlds + tiled - 1) / tiled, kTileWarps * kWarp, per_world * static_cast<size_t>(tiled)};
  const bool in_shared = global_scratch_bytes(p, n_worlds) == 0;
  const int threads = std::min((n + kWarp - 1) / kWarp * kWarp, kMaxBlockThreads);
  return {false, in_shared, n_worlds, threads, in_shared ? per_world : 0};
}

/// Arguments of a kernel, by value. P: SimParams, or some of them as constants of the compiler.
template <class P>
struct LaunchOf {
  P params;
  StateView state;
  StepIo io;
  ScratchLayout layout;
  size_t copy_bytes;  // working copy of the agents' state, in front of a world's scratch in shared memory
  char* scratch;      // [W, layout.size]; null = shared memory, with the working copy
  uint64_t seed;
  int64_t first_world, draw_period;
  int n_worlds;
  Ending ending;
  const int32_t* playing;    // [n_playing] the worlds to work on; null = all
  const int32_t* n_playing;  // [1]

  GIGA_HD int count() const { return playing ? *n_playing : n_worlds; }
  GIGA_HD int world(int k) const { return playing ? playing[k] : k; }

  /// The same with other parameters of the same values.
  template <class Q>
  LaunchOf<Q> with(const Q& q) const {
    return {q,           state,       io,       layout, copy_bytes, scratch,  seed,
            first_world, draw_period, n_worlds, ending, playing,    n_playing};
  }
};
using Launch = LaunchOf<SimParams>;

/// Which thread of a launch this is.
struct ThreadIndex {
  int block, n_blocks;
  int thread, n_threads;  // of the block
};

/// Points the working fields of the state to shared memory; copy_agents moves them there or back. Words come first, so
/// that each array is aligned.
GIGA_HD WorldView working_copy(const WorldView& home, char* block, int n) {
  WorldView w = home;
  size_t at = 0;
  const auto take = [&](auto field, auto member) {
    auto*& array = w.*member;
    array = reinterpret_cast<std::remove_reference_t<decltype(array)>>(block + at);
    at += sizeof(*array) * static_cast<size_t>(field.count(n));
  };
  for_each_field([&](auto field, auto member) {
    constexpr size_t kSize = sizeof(*(w.*member));
    static_assert(!field.working || (field.columns == 1 && ((field.per == Per::agent && (kSize == 4 || kSize == 1)) ||
                                                            (field.per == Per::pair && kSize == 1))),
                  "a working field has a word or a byte for each agent, or a byte for each pair: working_copy and "
                  "copy_agents know no others");
    if constexpr (field.working && kSize == sizeof(uint32_t)) take(field, member);
  });
  for_each_field([&](auto field, auto member) {
    if constexpr (field.working && field.per == Per::pair) take(field, member);
  });
  for_each_field([&](auto field, auto member) {
    if constexpr (field.working && field.per != Per::pair && sizeof(*(w.*member)) == 1) take(field, member);
  });
  return w;
}
template <class Lanes>
GIGA_HD void copy_agents(const Lanes& lanes, const WorldView& from, const WorldView& to, int n) {
  lanes.each(n, [&](int i) {
    for_each_field([&](auto field, auto member) {
      if constexpr (field.working && field.per == Per::agent) (to.*member)[i] = (from.*member)[i];
    });
  });
  for_each_field([&](auto field, auto member) {
    if constexpr (field.working && field.per == Per::pair) {
      if (n % 2 == 0)  // whole words
        lanes.each(n * n / 4, [&](int k) {
          reinterpret_cast<uint32_t*>(to.*member)[k] = reinterpret_cast<const uint32_t*>(from.*member)[k];
        });
      else
        lanes.each(n * n, [&](int k) { (to.*member)[k] = (from.*member)[k]; });
    }
  });
}

/// Runs the job for one world. `shared` = this world's block of shared memory; a template parameter says whether it is
/// used, so that the compiler knows which memory its pointers mean.
template <Job job, bool in_shared, class Lanes, class P>
GIGA_HD void run_world(const Lanes& lanes, const LaunchOf<P>& k, int world, char* shared) {
  const WorldView home = world_view(k.state, k.params.n_agents, world);
  if (!has_work<job>(lanes, home)) return;
  WorldView w = home;
  if constexpr (in_shared) {
    w = working_copy(home, shared, k.params.n_agents);
    attach_scratch(w, k.layout, shared + k.copy_bytes);
    copy_agents(lanes, home, w, k.params.n_agents);
  } else {
    attach_scratch(w, k.layout, k.scratch + static_cast<size_t>(world) * k.layout.size);
  }
  const auto draws_at = [&](uint32_t step) {
    return PhiloxDraws(k.seed, draw_world(k.first_world, k.draw_period, world), step);
  };
  run_job<job>(lanes, k.params, w, draws_at, k.io, k.ending, world);
  if constexpr (in_shared) copy_agents(lanes, w, home, k.params.n_agents);
}

/// What a thread does in a launch of TileLanes.
template <Job job, class Sync, class P>
GIGA_HD void run_tile_thread(const LaunchOf<P>& k, const ThreadIndex& at, char* shared, Sync sync) {
  const int n = k.params.n_agents, count = k.count();
  // Few worlds take as long as one does: a warp for each is faster then.
  const bool alone = k.playing && count <= kWorldsAlone && count <= at.n_blocks * kTileWarps;
  const int width = alone ? kWarp : n, per_warp = kWarp / width;
  const int lane = at.thread % kWarp, warp = at.thread / kWarp;
  const int tile = lane / width;
  const int slot = warp * per_warp + (tile < per_warp ? tile : 0);
  const int index = at.block * (kTileWarps * per_warp) + slot;
  if (at.block * (kTileWarps * per_warp) >= count) return;
  const bool idle = tile >= per_warp || index >= count;
  const TileLanes<Sync> lanes{idle ? INT_MAX : lane % width, width, sync};
  // An idle thread looks at some world of the launch, so that it can keep in step.
  run_world<job, true>(lanes, k, k.world(index < count ? index : count - 1),
                       shared + slot * (k.copy_bytes + k.layout.size));
}

/// What a thread does in a launch of BlockLanes.
template <Job job, bool in_shared, class Sync, class P>
GIGA_HD void run_block_thread(const LaunchOf<P>& k, const ThreadIndex& at, char* shared, Sync sync) {
  if (at.block >= k.count()) return;
  const BlockLanes<Sync> lanes{at.thread, at.n_threads, sync};
  run_world<job, in_shared>(lanes, k, k.world(at.block), shared);
}

/// A simulator that runs its jobs by launches. Its back end launches, and lists the worlds that play.
class LaunchingSimulator : public Simulator {
 protected:
  LaunchingSimulator(SimSpec spec, const SimOptions& options, Memory& memory)
      : Simulator(std::move(spec), options, memory),
        shape_(launch_shape(params(), n_worlds())),
        layout_(params()),
        scratch_(memory, global_scratch_bytes(params(), n_worlds())) {
    if (options.on_done == OnDone::freeze) playing_ = Buffer<int32_t>(memory, static_cast<size_t>(n_worlds()) + 1);
  }

  Launch launch_of(const StepIo& io, Worlds worlds) {
    const bool listed = worlds == Worlds::listed;
    return {.params = params(),
            .state = state_.view(),
            .io = io,
            .layout = layout_,
            .copy_bytes = working_copy_bytes(params().n_agents),
            .scratch = scratch_.data(),
            .seed = options_.seed,
            .first_world = options_.first_world,
            .draw_period = options_.draw_period,
            .n_worlds = n_worlds(),
            .ending = ending(),
            .playing = listed ? playing_.data() : nullptr,
            .n_playing = listed ? n_playing() : nullptr};
  }
  const LaunchShape& shape() const { return shape_; }
  int32_t* playing() { return playing_.data(); }
  int32_t* n_playing() { return playing_.data() + n_worlds(); }

 private:
  LaunchShape shape_;
  ScratchLayout layout_;
  Buffer<char> scratch_;     // [W, layout_.size], where shared memory does not hold it
  Buffer<int32_t> playing_;  // [W + 1] OnDone::freeze: worlds that play, in any order, then their number
};

}  // namespace giga
