// How the GPU back end spreads worlds over blocks and threads: the shape of its launches, and the simulator that
// launches. Plain C++: simulator.cu calls it, and tests/parity from an emulation that needs no GPU.
#pragma once

#include <algorithm>

#include "cuda/scratch.hpp"
#include "cuda/world_threads.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// That of tiles, for a kernel that knows `known` agents (block_is_group); not `tiles` where a block cannot have any.
inline LaunchShape tile_shape(int n_agents, int known, size_t world_bytes, int n_worlds, size_t limit = kSharedLimit) {
  const int threads = tile_threads(known), group = group_threads(known);
  const int worlds = threads / group * (group / n_agents);  // of a block
  const size_t bytes = world_bytes * static_cast<size_t>(worlds);
  if (worlds == 0 || bytes > limit) return {};
  return {true, true, (n_worlds + worlds - 1) / worlds, threads, group, world_bytes, bytes};
}

/// That of a step, or of another job, for which the parameters may be of another type.
template <bool kStep>
LaunchShape launch_shape(const SimParams& p, int n_worlds) {
  const int n = p.n_agents;
  const size_t per_world = shared_bytes<kStep>(p);
  LaunchShape tiles{};
  with_usual_params<kStep>(p, [&]<class P>(const P&) {
    tiles = tile_shape(n, P::kAgents, per_world, n_worlds, kStep ? kStepSharedLimit : kSharedLimit);
  });
  if (tiles.tiles) return tiles;
  const bool in_shared = global_scratch_bytes(p, n_worlds) == 0;
  const int threads = std::min((n + kWarp - 1) / kWarp * kWarp, kMaxBlockThreads);
  return {false, in_shared, n_worlds, threads, threads, per_world, in_shared ? per_world : 0};
}

/// That of a step whose parameters are all constants that FixedParams has.
inline LaunchShape fixed_shape(const SimParams& p, int n_worlds) {
  const auto staged = static_cast<size_t>(stage_rows(p.n_agents) * stage_row(p.n_neighbors, p.waypoints));
  return tile_shape(p.n_agents, p.n_agents, shared_bytes(p.n_agents, ScratchLayout(p, staged)), n_worlds,
                    kStepSharedLimit);
}

/// A simulator that runs its jobs by launches. Its back end launches, and lists the worlds that play.
class LaunchingSimulator : public Simulator {
 protected:
  LaunchingSimulator(SimSpec spec, const SimOptions& options, Memory& memory)
      : Simulator(std::move(spec), with_pairs(options, Pairs::tables), memory),
        step_shape_(launch_shape<true>(params(), n_worlds())),
        shape_(launch_shape<false>(params(), n_worlds())),
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
            .world_bytes = 0,
            .scratch = scratch_.data(),
            .seed = options_.seed,
            .first_world = options_.first_world,
            .draw_period = options_.draw_period,
            .n_worlds = n_worlds(),
            .ending = ending(),
            .playing = listed ? playing_.data() : nullptr,
            .n_playing = listed ? n_playing() : nullptr};
  }
  const LaunchShape& shape(bool step) const { return step ? step_shape_ : shape_; }
  int32_t* playing() { return playing_.data(); }
  int32_t* n_playing() { return playing_.data() + n_worlds(); }

 private:
  LaunchShape step_shape_, shape_;  // of Job::step, and of the others
  ScratchLayout layout_;
  Buffer<char> scratch_;     // [W, layout_.size], where shared memory does not hold it
  Buffer<int32_t> playing_;  // [W + 1] OnDone::freeze: worlds that play, in any order, then their number
};

}  // namespace giga
