// Stages of a world of many agents for many workers at once (WideLanes): sorting the agents into the grid, going
// through them by place, who hits whom and who lives then, adding up returns. What comes out does not depend on who is
// faster, and is what one worker makes (grid_stages.hpp).
#pragma once

#include <bit>

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
  if (static_cast<int>(threadIdx.x % 32) == __ffs(static_cast<int>(here)) - 1) atomicMax(largest, most);
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

/// The cells that the living need, from their bounds.
GIGA_HD GridShape bounded_shape(const SharedWork::Bounds& bounds) {
  if (bounds.count == 0) return grid_shape(0, 0, 0, 0, 0);
  const auto edge = [&](int k) { return from_ordered_key(bounds.edge[k]); };
  return grid_shape(bounds.count, -edge(0), -edge(1), edge(2), edge(3));
}

/// Turns numbers of agents in `cells` cells, each one cell further than it belongs (cell_begin), into where cells
/// begin. Each worker adds up its share of the cells; each block the sums of its workers, in shared memory; each block
/// those of the blocks before it.
template <WideLanes Lanes>
GIGA_HD void sum_cells(const Lanes& sorters, const GridWorld& w, int cells) {
  const Lanes block = sorters.of_block();
  const int share = (cells + sorters.stride - 1) / sorters.stride, n_threads = block.stride;
  const auto begin_of = [&](int thread) { return (sorters.block * n_threads + thread) * share; };
  const auto end_of = [&](int thread) { return begin_of(thread + 1) < cells ? begin_of(thread + 1) : cells; };
  int32_t *sums = block.words(), *more = sums + n_threads, *before = more + n_threads;
  block.each(n_threads, [&](int thread) {
    int32_t total = 0;
    for (int cell = begin_of(thread); cell < end_of(thread); ++cell) total += w.cell_begin[cell + 1];
    sums[thread] = total;
    if (thread == 0) *before = 0;
  });
  GIGA_ROLLED
  for (int apart = 1; apart < n_threads; apart *= 2) {  // Hillis and Steele 1986
    block.each(n_threads,
               [&](int thread) { more[thread] = sums[thread] + (thread >= apart ? sums[thread - apart] : 0); });
    int32_t* const other = sums;
    sums = more;
    more = other;
  }
  if (sorters.n_blocks > 1) {
    if (block.first == 0) w.work.block_sums[sorters.block] = sums[n_threads - 1];
    sorters.wait();
    block.gather(
        sorters.n_blocks, int32_t{0},
        [&](int32_t& sum, int other) { sum += other < sorters.block ? w.work.block_sums[other] : 0; },
        [&](int32_t sum) { add_from_all(before, sum); });
  }
  block.without_barrier().each(n_threads, [&](int thread) {
    int32_t total = *before + (thread > 0 ? sums[thread - 1] : 0);
    for (int cell = begin_of(thread); cell < end_of(thread); ++cell)
      w.cell_begin[cell + 1] = total += w.cell_begin[cell + 1];
  });
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
  sorters.template gather<4>(
      n, SharedWork::Bounds{},
      [&](SharedWork::Bounds& bounds, int i) {
        const float x = w.x[i], y = w.y[i];
        const bool lives = w.alive[i] != 0;
        const uint32_t edge[4] = {ordered_key(-x), ordered_key(-y), ordered_key(x), ordered_key(y)};
        for (int k = 0; k < 4; ++k) bounds.edge[k] = lives && edge[k] > bounds.edge[k] ? edge[k] : bounds.edge[k];
        bounds.count += lives ? 1 : 0;
      },
      [&](const SharedWork::Bounds& bounds) {
        for (int k = 0; k < 4; ++k) largest_from_all(work.bounds->edge + k, bounds.edge[k]);
        add_from_all(&work.bounds->count, bounds.count);
      });
  const bool some_dead = work.bounds->count < n;
  w.grid = bounded_shape(*work.bounds);
  const GridShape of_dead = grid_shape(cells_of_dead(n), 0, 0, p.limit_x, p.limit_y);
  const int cells = w.grid.cells();
  const auto cell_of = [&](int i) {
    const float x = w.x[i], y = w.y[i];
    return w.alive[i] ? w.grid.cell_of(x, y) : cells + of_dead.cell_of(x, y);
  };
  // Until it has its place, an agent keeps there how late it came into its cell: that depends on who was faster.
  sorters.each_agent(n, [&](int i) { w.place[i] = take_number(w.cell_begin + cell_of(i) + 1); });
  sum_cells(sorters, w, some_dead ? cells + of_dead.cells() : cells);
  sorters.each_agent(n, [&](int i) {
    if (i == 0) *work.bounds = {};  // all have read it
    if (i == 0 && work.shape) *work.shape = w.grid;
    work.order[w.cell_begin[cell_of(i)] + w.place[i]] = i;
  });
  // Those of a cell by number, whoever came first.
  sorters.each_agent(n, [&](int i) {
    const int cell = cell_of(i);
    const int32_t first = w.cell_begin[cell], end = w.cell_begin[cell + 1];
    int32_t place = first;
    for (int32_t k = first; k < end; ++k) place += work.order[k] < i ? 1 : 0;
    w.placed[place] = {w.x[i], w.y[i], i, 0};
    w.place[i] = w.alive[i] ? place : kNotPlaced;
  });
}

/// The hook of step.hpp.
template <WideLanes Lanes>
GIGA_HD void mark_agents(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  mark_placed(lanes.sorters(), p, w, n);
}

/// The hook of step.hpp: neighboring workers see to agents that are near each other, and so look at the same others.
template <WideLanes Lanes, class F>
GIGA_HD void each_by_place(const Lanes& lanes, const GridParameters auto&, const GridWorld& w, int n, F&& f) {
  lanes.spread_over(n).each_agent(n, [&](int k) { f(w.placed[k].agent); });
}

/// The hook of step.hpp, in one go: what becomes of an agent depends on nothing that this writes of another. Into
/// counters that sort_agents has set to zero.
template <WideLanes Lanes, class Draws>
GIGA_HD void fight(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, Draws& draws, int n, int) {
  struct Living {
    int32_t count[kNCounts];
  };
  lanes.spread_over(n).gather(
      n, Living{},
      [&](Living& living, int k) {
        const int i = w.placed[k].agent;
        detect_and_track(p, w, draws, i);
        update_health(p, w, i);
        note_death(w, i);
        const int team = p.team_of(i);
        for (int t = 0; t < kNTeams; ++t) {
          living.count[kAlive0 + t] += team == t && w.alive[i] ? 1 : 0;
          living.count[kWasAlive0 + t] += team == t && w.was_alive[i] ? 1 : 0;
        }
      },
      [&](const Living& living) {
        for (int k = kAlive0; k <= kWasAlive1; ++k) add_from_all(w.counts + k, living.count[k]);
      });
}

/// Rules 17.5: blocks side by side, then blocks of their sums.
template <WideLanes Lanes>
GIGA_HD void accumulate_step(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int items) {
  if (!p.team_after_team) return lanes.each(items, [&](int item) { accumulate_episode(p, w, item); });
  const int most = p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1], pitch = sums_of_team(most);
  const auto end_of = [](int block, int n) { return (block + 1) * kSumBlock < n ? (block + 1) * kSumBlock : n; };
  const auto block_of = [&](int block, int n, const StepSum* from) {
    const int end = end_of(block, n);
    StepSum sum;
    GIGA_UNROLL_BY(8)  // so that it does not wait for each number
    for (int k = block * kSumBlock; k < end; ++k) sum += from[k];
    return sum;
  };
  int count = sum_blocks(most);
  StepSum* sums = w.work.sums;
  lanes.each(items * count, [&](int k) {
    const int item = k / count, block = k - item * count;
    const StepItem what(p, item);
    const int first = p.first_of(what.team);
    sums[item * pitch + block] = what.sum(p, w, first + block * kSumBlock, first + end_of(block, p.n_team[what.team]));
  });
  GIGA_ROLLED
  while (count > kSumBlock) {
    const int blocks = sum_blocks(count);
    lanes.each(items * blocks, [&](int k) {
      const int item = k / blocks, block = k - item * blocks;
      sums[item * pitch + count + block] = block_of(block, count, sums + item * pitch);
    });
    sums += count;
    count = blocks;
  }
  without_barrier(lanes).each(items, [&](int item) {  // nothing else of the step asks for them
    StepItem(p, item).add_to_episode(p, w, block_of(0, count, sums + item * pitch));
  });
}

}  // namespace giga
