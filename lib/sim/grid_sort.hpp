// Stages of a world of many agents for many workers at once (WideLanes): sorting the agents into the grid, going
// through them by place, who hits whom and who lives then, adding up returns. What comes out does not depend on who is
// faster, and is what one worker makes (grid_stages.hpp), but for the order within a cell, on which nothing else
// depends.
#pragma once

#include <bit>
#include <type_traits>

#include "sim/grid_stages.hpp"
#include "sim/lanes.hpp"

namespace giga {

/// A key that orders like the number it is made of; above 0 for every number.
GIGA_HD uint32_t ordered_key(float number) {
  const uint32_t bits = std::bit_cast<uint32_t>(number);
  return bits >> 31 ? ~bits : bits | 0x80000000u;
}
GIGA_HD float from_ordered_key(uint32_t key) { return std::bit_cast<float>(key >> 31 ? key & 0x7FFFFFFFu : ~key); }

/// Adds to a number, or takes the larger one, together with other workers: those of a warp as one.
GIGA_HD void add_from_all(int32_t* sum, int32_t value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
  const unsigned here = __activemask();
  const int32_t total = __reduce_add_sync(here, value);
  if (static_cast<int>(threadIdx.x % 32) == __ffs(static_cast<int>(here)) - 1 && total != 0) atomicAdd(sum, total);
#else
  add_together(sum, value);
#endif
}
GIGA_HD void largest_from_all(uint32_t* largest, uint32_t value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
  const unsigned here = __activemask();
  const uint32_t most = __reduce_max_sync(here, value);
  if (static_cast<int>(threadIdx.x % 32) == __ffs(static_cast<int>(here)) - 1 && most != 0) atomicMax(largest, most);
#elif defined(__CUDA_ARCH__)
  atomicMax(largest, value);
#else
  uint32_t before = __atomic_load_n(largest, __ATOMIC_RELAXED);
  while (before < value &&
         !__atomic_compare_exchange_n(largest, &before, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
  }
#endif
}
/// The number before one is added to it.
GIGA_HD int32_t take_number(int32_t* next) {
#if defined(__CUDA_ARCH__)
  return atomicAdd(next, 1);
#else
  return __atomic_fetch_add(next, 1, __ATOMIC_RELAXED);
#endif
}

/// Called by one thread of each of `most` blocks (on the CPU by each worker), behind a barrier of its block. True for
/// the last, which then sees what all of them wrote; the count begins anew.
GIGA_HD bool comes_last(int32_t* count, int most) {
#if defined(__CUDA_ARCH__)
  const bool last = __nv_atomic_fetch_add(count, 1, __NV_ATOMIC_ACQ_REL, __NV_THREAD_SCOPE_DEVICE) == most - 1;
#else
  const bool last = __atomic_fetch_add(count, 1, __ATOMIC_ACQ_REL) == most - 1;
#endif
  if (last) *count = 0;
  return last;
}

/// The cells that the living need, from their bounds.
GIGA_HD GridShape bounded_shape(const SharedWork::Bounds& bounds) {
  if (bounds.count == 0) return grid_shape(0, 0, 0, 0, 0);
  const auto edge = [&](int k) { return from_ordered_key(bounds.edge[k]); };
  return grid_shape(bounds.count, -edge(0), -edge(1), edge(2), edge(3));
}

/// One of two shapes, number by number: as a choice between objects it would put both into memory.
GIGA_HD GridShape either_shape(bool first, const GridShape& a, const GridShape& b) {
  GridShape g;
  g.columns = first ? a.columns : b.columns;
  g.rows = first ? a.rows : b.rows;
  g.x0 = first ? a.x0 : b.x0;
  g.y0 = first ? a.y0 : b.y0;
  g.inverse_size_x = first ? a.inverse_size_x : b.inverse_size_x;
  g.inverse_size_y = first ? a.inverse_size_y : b.inverse_size_y;
  return g;
}

/// Turns numbers of agents in `cells` cells, each one cell further than it belongs (cell_begin), into where cells
/// begin. Each worker adds up its share of the cells; then come the sums of the workers, the warps and the blocks
/// before it.
template <WideLanes Lanes>
GIGA_HD void sum_cells(const Lanes& sorters, const GridWorld& w, int cells) {
  const Lanes block = sorters.of_block();
  const int share = (cells + sorters.stride - 1) / sorters.stride;
  const int first = (sorters.block * block.stride + block.first) * share;
  const int end = first + share < cells ? first + share : cells;
  int32_t own = 0;
  for (int cell = first; cell < end; ++cell) own += w.cell_begin[cell + 1];
  const auto sum = block.sum_before(own);
  int32_t before = sum.before;
  if (sorters.n_blocks > 1) {
    int32_t* const of_blocks = block.words();
    if (block.first == 0) w.work.block_sums[sorters.block] = sum.all;
    sorters.wait();
    if (block.first == 0) *of_blocks = 0;
    block.wait();
    block.gather(
        sorters.n_blocks, int32_t{0},
        [&](int32_t& all, int other) { all += other < sorters.block ? w.work.block_sums[other] : 0; },
        [&](int32_t all) { add_from_all(of_blocks, all); });
    before += *of_blocks;
  }
  for (int cell = first; cell < end; ++cell) w.cell_begin[cell + 1] = before += w.cell_begin[cell + 1];
  sorters.wait();
}

/// The hook of step.hpp: every worker keeps the shape of the grid, in its own GridWorld. Small worlds are sorted by
/// each of their blocks for itself, which crosses no barrier of all blocks but one. Behind the living come the dead, by
/// cells of their own: nobody looks for them, but they look for others, and soon are most of a crowd (86 % of
/// swarm_million after 50 steps).
template <WideLanes Lanes>
GIGA_HD void sort_agents(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  if (n == 0) return;  // for all workers: they share the world
  const SharedWork work = w.work;
  const Lanes sorters = lanes.sorters();
  without_barrier(lanes).each_agent(n, [&](int i) {
    w.detects[i] = 0;
    w.dealt[i] = 0;
    if (i > 0) return;
    for (int k = kAlive0; k <= kWasAlive1; ++k) w.counts[k] = 0;  // for `fight`
  });
  without_barrier(sorters).each_agent(n, [&](int i) {
    w.cell_begin[i + 1] = 0;
    if (i == 0) w.cell_begin[0] = 0;
    if (i % kDeadOfCell == 0) w.cell_begin[n + 1 + i / kDeadOfCell] = 0;
  });
  if (lanes.sorts_by_block) lanes.wait();  // all agents have moved
  const auto add_bounds = [](const SharedWork::Bounds& bounds, SharedWork::Bounds& all) {
    for (int k = 0; k < 4; ++k) largest_from_all(all.edge + k, bounds.edge[k]);
    add_from_all(&all.count, bounds.count);
  };
  sorters.template gather_by_block<4>(
      n, SharedWork::Bounds{},
      [&](SharedWork::Bounds& bounds, int i) {
        const float x = w.x[i], y = w.y[i];
        const bool lives = w.alive[i] != 0;
        const uint32_t edge[4] = {ordered_key(-x), ordered_key(-y), ordered_key(x), ordered_key(y)};
        for (int k = 0; k < 4; ++k) bounds.edge[k] = lives && edge[k] > bounds.edge[k] ? edge[k] : bounds.edge[k];
        bounds.count += lives ? 1 : 0;
      },
      add_bounds, [&](const SharedWork::Bounds& bounds) { add_bounds(bounds, *work.bounds); });
  const bool some_dead = work.bounds->count < n;
  w.grid = bounded_shape(*work.bounds);
  const int cells = w.grid.cells();
  // Until it has its place, an agent keeps there how late it came into its cell: that depends on who was faster.
  sorters.each_agent(n, [&](int i) {
    const bool lives = w.alive[i] != 0;
    // One way for both, because lanes that take different ones wait for each other.
    const int cell = either_shape(lives, w.grid, p.of_dead).cell_of(w.x[i], w.y[i]) + (lives ? 0 : cells);
    work.cell[i] = cell;
    w.place[i] = take_number(w.cell_begin + cell + 1);
  });
  sum_cells(sorters, w, some_dead ? cells + p.of_dead.cells() : cells);
  const bool by_block = lanes.sorts_by_block;
  sorters.each_agent(n, [&](int i) {
    const int cell = work.cell[i];
    const int32_t place = w.cell_begin[cell] + w.place[i];
    if (i == 0) *work.bounds = {};  // all have read it
    if (by_block) {
      work.order[place] = i;
    } else {
      w.placed[place] = {w.x[i], w.y[i], i, 0};
      w.place[i] = cell < cells ? place : kNotPlaced;
    }
  });
  if (!by_block) return;
  // Blocks that sort for themselves must come to the same: those of a cell by number, whoever came first.
  sorters.each_agent(n, [&](int i) {
    const int cell = work.cell[i];
    const float x = w.x[i], y = w.y[i];
    const int32_t begin = w.cell_begin[cell], end = w.cell_begin[cell + 1];
    int32_t place = begin;
    for (int32_t k = begin; k < end; ++k) place += work.order[k] < i ? 1 : 0;
    w.placed[place] = {x, y, i, 0};
    w.place[i] = cell < cells ? place : kNotPlaced;
  });
}

/// The hook of step.hpp.
template <WideLanes Lanes>
GIGA_HD void mark_agents(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  lanes.sorters().each_agent(n > 0 ? w.cell_begin[w.grid.cells()] : 0,
                             [&](int k) { w.placed[k].marks = marks_of_agent(p, w, w.placed[k].agent); });
}

/// Leaves to launches that follow the shape of the grid, or word that there is nothing for them to do. No barrier.
template <WideLanes Lanes>
GIGA_HD void leave_grid(const Lanes& lanes, GridWorld& w, bool some) {
  lanes.without_barrier().each(1, [&](int) { *w.work.shape = some ? w.grid : GridShape{.columns = 0}; });
}

/// Where launches follow that observe the world, leaves to them what they need: whether it did. `n`: 0 = the world
/// waits; `ended`: it does not, because this step goes on. Where each block has sorted for itself, all have sorted
/// alike, and each leaves a part. Crews write rows as soon as they know who is in them: then all agents are prepared
/// here.
template <WideLanes Lanes>
GIGA_HD bool hand_on(const Lanes& all, const GridParameters auto& p, GridWorld& w, const StepIo& io, int64_t world,
                     int n, bool ended) {
  const SharedWork& work = w.work;
  if (!work.shape) return false;
  const Lanes lanes = all.without_barrier();
  const bool some = n > 0 && !ended;
  leave_grid(lanes, w, some);
  if (!some) return !ended;
  const bool wanted = wants_rows(io), crews = work.crews_follow;
  if (!work.placed_for_all) {
    lanes.each_agent(n, [&](int i) {
      const int32_t place = w.place[i];
      if (place != kNotPlaced) w.placed[place].marks = marks_of_agent(p, w, i);
      if (crews) prepare_rows(p, w, io, world, wanted, i);
    });
    return true;
  }
  if (crews) lanes.each_agent(n, [&](int i) { prepare_rows(p, w, io, world, wanted, i); });
  const int cells = w.grid.cells();
  lanes.each_agent(cells + 1, [&](int k) { work.cell_begin_for_all[k] = w.cell_begin[k]; });
  const int32_t living = w.cell_begin[cells];
  lanes.each_agent(n, [&](int k) {
    PlacedAgent a = w.placed[k];
    if (k < living) a.marks = marks_of_agent(p, w, a.agent);
    work.placed_for_all[k] = a;
  });
  return true;
}

/// Whether hand_on leaves rewards too.
GIGA_HD bool hands_on_rewards(const GridWorld& w) { return w.work.crews_follow; }

/// The hook of step.hpp: neighboring workers see to agents that are near each other, and so look at the same others.
template <WideLanes Lanes, class F>
GIGA_HD void each_by_place(const Lanes& lanes, const GridParameters auto&, const GridWorld& w, int n, F&& f) {
  lanes.spread_over(n).each_agent(n, [&](int k) { f(w.placed[k].agent); });
}

/// The hook of step.hpp.
template <WideLanes Lanes, class F>
GIGA_HD void each_crew_by_place(const Lanes& lanes, const GridParameters auto&, const GridWorld& w, int n, F&& f) {
  lanes.with_crews(n, [&](const auto& crews) {
    crews.each_agent(n, [&](const auto& crew, int k, bool some) { f(crew, w.placed[k].agent, some); });
    lanes.wait();
  });
}

/// What becomes of the agents in the fight, in one go: it depends on nothing that this writes of another. Into counters
/// that sort_agents has set to zero. Calls after(agent, whether it lived, whether it lives) for each. No barrier.
template <WideLanes Lanes, class Draws, class After>
GIGA_HD void fight_by_place(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, Draws& draws, int n,
                            After&& after) {
  lanes.with_crews(n, [&](const auto& crews) {
    crews.each_agent(n, [&](const auto& crew, int k, bool some) {
      const int i = w.placed[k].agent;
      const Vitals vitals = vitals_of(p, w, i);
      const int taken = find_fire(crew, p, w, draws, i, some);
      if (!some || !crew.leads()) return;
      const bool lives = take_damage(p, w, vitals, taken, i);
      after(i, vitals.lived != 0, lives);
    });
  });
}

/// Agents of both teams that live, and that lived before the step, for w.counts.
struct LivingCounts {
  int32_t living[kNCounts] = {};

  GIGA_HD void add(int team, bool lived, bool lives) {
    for (int t = 0; t < kNTeams; ++t) {
      living[kAlive0 + t] += team == t && lives ? 1 : 0;
      living[kWasAlive0 + t] += team == t && lived ? 1 : 0;
    }
  }
  GIGA_HD void add_to(int32_t* counts) const {
    for (int k = kAlive0; k <= kWasAlive1; ++k) add_from_all(counts + k, living[k]);
  }
};

/// The hook of step.hpp.
template <WideLanes Lanes, class Draws>
GIGA_HD void fight(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, Draws& draws, int n, int) {
  LivingCounts counts;
  fight_by_place(lanes, p, w, draws, n, [&](int i, bool lived, bool lives) { counts.add(p.team_of(i), lived, lives); });
  if (n == 0) return;
  lanes.wait_for_warp();  // those that come late add theirs with the others, and not one by one
  counts.add_to(w.counts);
  lanes.wait();
}

/// What `fight` counts, where the fight is a launch of its own: its many warps would queue at the four counters.
template <WideLanes Lanes>
GIGA_HD void count_living(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  lanes.template gather_by_block<4>(
      n, LivingCounts{},
      [&](LivingCounts& counts, int i) { counts.add(p.team_of(i), w.was_alive[i] != 0, w.alive[i] != 0); },
      [](const LivingCounts& counts, LivingCounts& all) { counts.add_to(all.living); },
      [&](const LivingCounts& counts) { counts.add_to(w.counts); });
}

/// What a block of agents gets for the step, and sums of it (rules 17.5). `group`: the lanes of a warp or a block of
/// threads. `k`: number of the block, those of the teams in turn; `some`: whether there is one. Teams lie one behind
/// the other. Returns the team. Ends with a barrier of the group: what it wrote, any of its threads may announce.
template <WideLanes Group>
GIGA_HD int reward_block(const Group& group, const GridParameters auto& p, GridWorld& w, const StepIo& io,
                         int64_t world, int k, bool some) {
  const SumLayout of(p);
  const int team = k % kNTeams, block = k / kNTeams, first = p.first_of(team) + block * kSumBlock;
  const int agents = some ? SumLayout::left(p.n_team[team], block) : 0;
  group.without_barrier().each_agent(agents, [&](int at) { reward_agent(p, w, io, world, first + at); });
  group.template sum_rows<kSumBlock>(
      of.rows(), agents,
      [&](int row, int at) {
        const StepSum number = StepItem(p, of.item_of_row(team, row)).of(p, w, first + at);
        return row == kMaskedRow ? number.masked : number.sum;
      },
      [&](int row, float sum) {
        if (!some) return;
        StepSum& to = w.work.sums[of.item_of_row(team, row) * of.pitch + block];
        (row == kMaskedRow ? to.masked : to.sum) = sum;
      });
  return team;
}

/// What all agents get for the step, and sums of it over blocks of them; those of a team, of at most kMostBlocksAtOnce
/// blocks, are added to its episode. The block of threads that comes last does that, so that no block waits for others.
/// By blocks and not by warps, because the launch is as long as this takes: 50.7 M instead of 49.3 M agent-steps/s
/// (2,000 crowded agents with policies, one H200).
template <WideLanes Lanes>
GIGA_HD void reward_and_add_up(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, const StepIo& io,
                               int64_t world, int n) {
  const SumLayout of(p);
  lanes.each_block(n > 0 ? kNTeams * of.blocks : 0, [&](const auto& group, int k, bool some) {
    const int team = reward_block(group, p, w, io, world, k, some);
    const bool last = some && group.first == 0 && comes_last(w.work.summed + team, of.blocks);
    if (!group.any_of_warp(last)) return;
    group.wait_for_warp();  // what the lane that came last sees, all of its warp see
    if (group.first >= of.items / kNTeams) return;
    const int item = of.item(team, group.first);
    const StepSum* sums = w.work.sums + item * of.pitch;
    StepItem(p, item).add_to_episode(p, w, add_up(of.blocks, [&](int at) { return sums[at]; }));
  });
}

/// Adds up the blocks, all of them in the first sums after a barrier, and adds the sums to those of the episode. Of few
/// blocks their sums are added up on the way (each_sum); of more, one barrier for each level of sums, but for the last
/// two, which nothing else of the step asks for.
template <WideLanes Lanes>
GIGA_HD void add_up_blocks(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  if (n == 0) return;
  const SumLayout of(p);
  int count = of.blocks;
  StepSum* sums = w.work.sums;
  GIGA_ROLLED
  while (count > kMostBlocksAtOnce) {
    const int blocks = sum_blocks(count);
    lanes.template each_sum<kSumBlock>(
        of.items * blocks, [&](int k) { return SumLayout::left(count, k % blocks); },
        [&](int k, int at) { return sums[k / blocks * of.pitch + k % blocks * kSumBlock + at]; },
        [&](int k, const StepSum& sum) { sums[k / blocks * of.pitch + count + k % blocks] = sum; });
    sums += count;
    count = blocks;
  }
  without_barrier(lanes).template each_sum<kSumBlock>(
      of.items, [&](int) { return count; }, [&](int item, int at) { return sums[item * of.pitch + at]; },
      [&](int item, const StepSum& sum) { StepItem(p, item).add_to_episode(p, w, sum); });
}

/// The hook of step.hpp.
template <WideLanes Lanes>
GIGA_HD void reward_and_accumulate(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, const StepIo& io,
                                   int64_t world, int n) {
  if (n == 0) return;
  if (!p.team_after_team) {
    lanes.each_agent(n, [&](int i) { reward_agent(p, w, io, world, i); });
    return lanes.each(n_step_items(p), [&](int item) { accumulate_episode(p, w, item); });
  }
  // By warps: a block has 512 threads here, eight for each agent of a block.
  lanes.each_warp(kNTeams * SumLayout(p).blocks,
                  [&](const auto& warp, int k, bool some) { reward_block(warp, p, w, io, world, k, some); });
  lanes.wait();
  add_up_blocks(lanes, p, w, n);
}

}  // namespace giga
