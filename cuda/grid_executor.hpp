// How the GPU back end spreads worlds of many agents (rules 17) over blocks and threads: several blocks work on a world
// together, up to the whole GPU, and go from world to world. Plain host-device code, as executor.hpp.
#pragma once

#include <cstdint>
#include <string>
#include <type_traits>

#include "cuda/executor.hpp"
#include "cuda/grid_launch_shape.hpp"
#include "sim/grid_sort.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"
#include "sim/step_parts.hpp"

namespace giga {

/// What a group keeps from launch to launch, in lines of memory of its own. Zero before the first.
struct alignas(64) GroupWords {
  uint32_t arrivals;          ///< of blocks at barriers (simulator of the GPU)
  SharedWork::Bounds bounds;  ///< where all blocks sort together
  GridShape shape;            ///< of their grid, where a step is several launches
  int32_t summed[kNTeams];    ///< see SharedWork
};

/// Arguments of a kernel, by value.
template <GridParameters P>
struct GridLaunchOf {
  P params;
  StateView state;
  PairLists lists;
  StepIo io;
  char* scratch;  // [groups, scratch_bytes]
  size_t scratch_bytes;
  GroupWords* words;    // [groups]
  int32_t* full_lists;  // [1]
  PhiloxKeys keys;
  int64_t first_world, draw_period;
  int n_worlds;
  Ending ending;
  const int32_t* playing;    // [n_playing] the worlds to work on; null = all
  const int32_t* n_playing;  // [1]
  int groups, blocks;
  bool sorts_by_block;
  bool crews_follow;      ///< see SharedWork
  bool by_block = false;  ///< neighboring warps are of a block

  GIGA_HD int count() const { return playing ? *n_playing : n_worlds; }
  GIGA_HD int world(int k) const { return playing ? playing[k] : k; }

  /// The same with other parameters of the same values.
  template <class Q>
  GridLaunchOf<Q> with(const Q& q) const {
    return {q,      state,          lists,        io,       scratch, scratch_bytes, words,     full_lists,
            keys,   first_world,    draw_period,  n_worlds, ending,  playing,       n_playing, groups,
            blocks, sorts_by_block, crews_follow, by_block};
  }
};
using GridLaunch = GridLaunchOf<GridParams>;

/// Calls f with the launch, and the lanes of a crew as a constant: of constants, and with crews, if the scenario is a
/// plain crowd.
template <class F>
void with_plain_crowd(const GridLaunch& k, int lanes_of_agent, F&& f) {
  if (!PlainCrowd::fits(k.params)) return f(k, std::integral_constant<int, 1>{});
  const GridLaunchOf<PlainCrowd> plain = k.with(PlainCrowd(k.params));
  if (lanes_of_agent == kLanesOfAgent) return f(plain, std::integral_constant<int, kLanesOfAgent>{});
  f(plain, std::integral_constant<int, 1>{});
}

/// Whether a step is one launch or several, whose sorted agents outlive each of them; and who sorts then.
enum class Launched {
  alone,
  by_block,  ///< one of several; each block sorts for itself
  together   ///< one of several; if it sorts, all do together, in global memory
};
constexpr Launched launched_as(StepPart part, int crew) {
  return part == StepPart::play && crew > 1 ? Launched::by_block : Launched::together;
}

/// Whether those that look alone have their lists in shared memory: where a launch does nothing else.
constexpr bool has_room_to_look(StepPart part, int crew) { return part == StepPart::look && crew == 1; }

/// Bytes of shared memory that a block has in a part in which no block waits for another.
constexpr size_t free_part_bytes(StepPart part, int crew, int threads) {
  const bool room_to_look = has_room_to_look(part, crew);
  const bool stages = crew > 1 || room_to_look || part == StepPart::write;
  return stages ? grid_stage_bytes(threads, room_to_look) : 0;
}

/// Calls run(lanes, view of a world, draws_at, its number) for the worlds of a thread. `sync`: of its group; `shared`:
/// memory of its block. Always inlined: as a function of its own it reached the kernel's parameters through a pointer,
/// with 5 kB of spills (ptxas).
template <Launched kLaunched, int kCrew, bool kRoomToLook = false, class P, class Sync, class Run>
[[gnu::always_inline]] GIGA_HD void run_grid_worlds(const GridLaunchOf<P>& k, const ThreadIndex& at, Sync sync,
                                                    char* shared, Run&& run) {
  const int group = at.block / k.blocks, block = at.block % k.blocks, n_warps = at.n_threads / kWarp;
  // Warps take turns among the blocks, so that all have work where there are fewer agents than threads. Where there is
  // a thread for each, those of a block look at the same others.
  const int warp = k.by_block ? block * n_warps + at.thread / kWarp : at.thread / kWarp * k.blocks + block;
  float* const stage = reinterpret_cast<float*>(shared);
  constexpr bool kSeveral = kLaunched != Launched::alone;
  const bool sorts_by_block = kSeveral ? kLaunched == Launched::by_block : k.sorts_by_block;
  const GridLanes<Sync, kCrew, kRoomToLook> lanes{warp * kWarp + at.thread % kWarp,
                                                  k.blocks * at.n_threads,
                                                  block,
                                                  k.blocks,
                                                  at.thread,
                                                  at.n_threads,
                                                  sync,
                                                  stage + at.thread / kWarp * stage_numbers(kRoomToLook),
                                                  sorts_by_block};
  GridWorld scratch{};
  attach_scratch(k.params, scratch, k.scratch + static_cast<size_t>(group) * k.scratch_bytes, true,
                 kSeveral || !sorts_by_block);
  if (sorts_by_block) {
    if (kSeveral) {
      scratch.work.placed_for_all = scratch.placed;
      scratch.work.cell_begin_for_all = scratch.cell_begin;
    }
    attach_sorted(k.params.n_agents, scratch, shared + grid_stage_bytes(at.n_threads));
    if (at.thread == 0) *scratch.work.bounds = {};  // a barrier follows before anybody sorts
  } else {
    scratch.work.bounds = &k.words[group].bounds;
  }
  if (kSeveral) {
    scratch.work.shape = &k.words[group].shape;
    scratch.work.summed = k.words[group].summed;
    scratch.work.crews_follow = k.crews_follow;
  }
  scratch.full_lists = k.full_lists;
  const int count = k.count();
  GIGA_ROLLED
  for (int index = group; index < count; index += k.groups) {
    const int world = k.world(index);
    GridWorld w = scratch;
    attach_state(k.params, w, k.state, k.lists, world);
    const uint32_t number = draw_world(k.first_world, k.draw_period, world);
    run(
        lanes, w, [&](uint32_t step) { return GridDraws(k.keys, number, step); }, world);
  }
}

/// What a thread does of a job that is one launch.
template <Job job, int kCrew, class P, class Sync>
[[gnu::always_inline]] GIGA_HD void run_grid_thread(const GridLaunchOf<P>& k, const ThreadIndex& at, Sync sync,
                                                    char* shared) {
  const auto run = [&](const auto& lanes, GridWorld& w, auto&& draws_at, int world) __attribute__((always_inline)) {
    if (has_work<job>(lanes, w)) run_job<job>(lanes, k.params, w, draws_at, k.io, k.ending, world);
  };
  run_grid_worlds<Launched::alone, kCrew>(k, at, sync, shared, run);
}

/// The same of a part of a step. All groups have a world at most, so that scratch and shape stay as the launch before
/// has left them.
template <StepPart part, int kCrew, class P, class Sync>
[[gnu::always_inline]] GIGA_HD void run_grid_part(const GridLaunchOf<P>& k, const ThreadIndex& at, Sync sync,
                                                  char* shared) {
  const auto run = [&](const auto& lanes, GridWorld& w, auto&& draws_at, int world) __attribute__((always_inline)) {
    constexpr bool kBegins = part == StepPart::play || part == StepPart::move;
    if (!kBegins) w.grid = *w.work.shape;
    const int left = kBegins || w.grid.columns == 0 ? 0 : k.params.n_agents;
    run_part<part>(lanes, k.params, w, draws_at, k.io, k.ending, world, left);
  };
  run_grid_worlds<launched_as(part, kCrew), kCrew, has_room_to_look(part, kCrew)>(k, at, sync, shared, run);
}

/// A simulator of worlds of many agents that runs its jobs by launches. Its back end launches, and lists the worlds
/// that play.
class GridLaunchingSimulator : public Simulator {
 public:
  void redraw(const Redraw&) override { throw Error("there are no images"); }
  std::string step_way() const override { return kByPlaceWay; }

 protected:
  GridLaunchingSimulator(SimSpec spec, const SimOptions& options, Memory& memory, const GridDevice& device)
      : Simulator(std::move(spec), with_pairs(options, Pairs::by_place), memory),
        params_(grid_params(spec_, tables_, options_.most_shooters)),
        shape_(grid_launch_shape(params_.n_agents, n_worlds(), device)),
        lanes_of_agent_(many(device) ? 1 : shape_.lanes_of_agent(params_.n_agents, device.threads)),
        sorted_bytes_(grid_sorted_bytes(params_.n_agents, device)),
        shared_bytes_(grid_stage_bytes(device.threads) + sorted_bytes_),
        launches_(launches_of_step(device)),
        crowded_(is_crowded(params_)),
        turns_(int64_t{params_.n_agents} * n_worlds() >= int64_t{kTurnsFrom} * device.resident),
        scratch_bytes_(group_bytes()),
        scratch_(memory, scratch_bytes_ * static_cast<size_t>(shape_.groups)),
        words_(memory, static_cast<size_t>(shape_.groups)),
        full_lists_(memory, 1) {
    if (launches_ == StepLaunches::of_more) lanes_of_agent_ = 1;  // in launches with barriers
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
            .keys = PhiloxKeys(options_.seed),
            .first_world = options_.first_world,
            .draw_period = options_.draw_period,
            .n_worlds = n_worlds(),
            .ending = ending(),
            .playing = listed ? playing_.data() : nullptr,
            .n_playing = listed ? n_playing() : nullptr,
            .groups = shape_.groups,
            .blocks = shape_.blocks,
            .sorts_by_block = sorted_bytes_ > 0,
            .crews_follow = launches_ == StepLaunches::of_few || launches_ == StepLaunches::of_more};
  }
  /// The same for a free part, in which no block waits for another, in blocks of so many threads: so many for each
  /// agent, and some more.
  template <class P>
  static GridLaunchOf<P> free_part_launch(GridLaunchOf<P> k, int threads, int threads_of_agent = 1, int more = 0) {
    k.blocks = (k.params.n_agents * threads_of_agent + more + threads - 1) / threads;
    k.by_block = true;
    return k;
  }
  StepLaunches launches() const { return launches_; }
  /// The launches of a step that are several, one after the other: calls with_barriers.operator()<part>(), and
  /// free.operator()<part, lanes of a crew, whether there are more of these than run at a time>(k, threads of an agent,
  /// some more threads).
  template <int kCrew, class P, class WithBarriers, class Free>
  void for_launches(const GridLaunchOf<P>& k, WithBarriers&& with_barriers, Free&& free) const {
    using enum StepPart;
    const int more = kSumBlock * kNTeams * SumLayout(k.params).blocks;  // threads that see to rewards
    const auto write_other_rows = [&] {
      GridLaunchOf<P> others = k;
      for (TeamIo& team : others.io.team) team.obs[Observation::vector].rows = nullptr;
      if (wants_rows(others.io) || wants_rows(others.io, ObservationOf::world))
        free.template operator()<write, 1, true>(others, kLanesOfAgent, 0);
    };
    if constexpr (kCrew > 1) {
      with_barriers.template operator()<play>();
      free.template operator()<observe, kLanesToLook, false>(k, kLanesToLook, more);
      write_other_rows();
    } else {
      if constexpr (std::is_same_v<P, PlainCrowd>)
        if (launches_ == StepLaunches::of_more) {
          if (crowded_) {
            with_barriers.template operator()<move>();
            free.template operator()<fight, kLanesToFight, true>(k, kLanesToFight, 0);
            with_barriers.template operator()<settle>();
            const int turns = turns_ ? 2 : 1;
            free.template operator()<observe, kLanesOfCrowd, true>(k, kLanesOfCrowd / turns, more / turns);
          } else {
            with_barriers.template operator()<play>();
            free.template operator()<observe, kLanesOfAgent, true>(k, kLanesOfAgent, more);
          }
          return write_other_rows();
        }
      with_barriers.template operator()<move>();
      free.template operator()<fight, 1, true>(k, 1, 0);
      with_barriers.template operator()<settle>();
      free.template operator()<look, 1, true>(k, 1, 0);
      free.template operator()<write, 1, true>(k, 1, 0);
    }
  }
  /// Throws if a list of fire was too short since this was last asked; waits for what was queued before.
  void check_full_lists() {
    const int full = full_lists_.to_host()[0];
    if (full == 0) return;
    full_lists_.clear();
    throw full_lists_error(full, params_, spec_.name);
  }
  const GridLaunchShape& shape() const { return shape_; }
  int lanes_of_agent() const { return lanes_of_agent_; }
  size_t shared_bytes() const { return shared_bytes_; }  // of a block
  const Buffer<char>& scratch() const { return scratch_; }
  int32_t* playing() { return playing_.data(); }
  int32_t* n_playing() { return playing_.data() + n_worlds(); }

 private:
  size_t group_bytes() const {
    GridWorld w{};
    return (attach_scratch(params_, w, nullptr, true, launches_ != StepLaunches::one || sorted_bytes_ == 0) + 127) &
           ~size_t{127};
  }
  bool many(const GridDevice& device) const { return device.in_parts > 0 && params_.n_agents >= device.in_parts; }
  StepLaunches launches_of_step(const GridDevice& device) const {
    using enum StepLaunches;
    if (device.in_parts == 0 || shape_.groups < n_worlds()) return one;
    const bool plain = PlainCrowd::fits(params_), idle = 2 * shape_.groups * shape_.blocks <= device.resident;
    if (sorted_bytes_ > 0)
      return plain && idle && lanes_of_agent_ == kLanesOfAgent && SumLayout(params_).blocks <= kMostBlocksAtOnce
                 ? of_few
                 : one;
    if (many(device)) return of_many;
    return plain && SumLayout(params_).blocks <= kMostBlocksAtOnce ? of_more : one;
  }

  GridParams params_;
  GridLaunchShape shape_;
  int lanes_of_agent_;
  size_t sorted_bytes_, shared_bytes_;
  StepLaunches launches_;
  bool crowded_, turns_;
  size_t scratch_bytes_;
  Buffer<char> scratch_;
  Buffer<GroupWords> words_;
  Buffer<int32_t> full_lists_;
  Buffer<int32_t> playing_;  // [W + 1] OnDone::freeze: worlds that play, in any order, then their number
};

}  // namespace giga
