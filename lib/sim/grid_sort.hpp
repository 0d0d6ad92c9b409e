// Stages of a world of many agents for many workers at once (WideLanes): sorting the agents into the grid, going
// through them by place, counting the teams, adding up returns. What comes out does not depend on who is faster, and is
// what one worker makes (grid_stages.hpp).
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

/// Turns numbers of agents, each one cell further than it belongs (cell_begin), into where cells begin.
template <WideLanes Lanes>
GIGA_HD void sum_cells(const Lanes& lanes, const GridWorld& w) {
  const SharedWork& work = w.work;
  const int cells = w.grid.cells(), chunks = (cells + kCellChunk - 1) / kCellChunk;
  const int groups = (chunks + kCellChunk - 1) / kCellChunk;
  const auto sum = [](const int32_t* from, int first, int end) {
    int32_t total = 0;
    for (int k = first; k < end; ++k) total += from[k];
    return total;
  };
  const auto end_of = [](int chunk, int count) {
    return (chunk + 1) * kCellChunk < count ? (chunk + 1) * kCellChunk : count;
  };
  lanes.each(chunks, [&](int k) { work.cell_sums[k] = sum(w.cell_begin + 1, k * kCellChunk, end_of(k, cells)); });
  if (groups > 1)
    lanes.each(groups, [&](int k) { work.chunk_sums[k] = sum(work.cell_sums, k * kCellChunk, end_of(k, chunks)); });
  lanes.each(chunks, [&](int k) {
    const int group = k / kCellChunk;
    int32_t total = sum(work.chunk_sums, 0, group) + sum(work.cell_sums, group * kCellChunk, k);
    for (int cell = k * kCellChunk; cell < end_of(k, cells); ++cell)
      w.cell_begin[cell + 1] = total += w.cell_begin[cell + 1];
  });
}

/// The hook of step.hpp: every worker keeps the shape of the grid, in its own GridWorld.
template <WideLanes Lanes>
GIGA_HD void sort_agents(const Lanes& lanes, const GridParams&, GridWorld& w, int n) {
  if (n == 0) return;  // for all workers: they share the world
  const SharedWork work = w.work;
  lanes.gather(
      n, SharedWork::Bounds{},
      [&](SharedWork::Bounds& bounds, int i) {
        w.detects[i] = 0;
        w.dealt[i] = 0;
        w.cell_begin[i + 1] = 0;
        if (i == 0) {
          w.cell_begin[0] = 0;
          for (int k = kAlive0; k <= kWasAlive1; ++k) w.counts[k] = 0;  // for count_teams
        }
        if (!w.alive[i]) {
          work.arrival[i] = kNotPlaced;
          return;
        }
        ++bounds.count;
        const float x = w.x[i], y = w.y[i];
        const uint32_t edge[4] = {ordered_key(-x), ordered_key(-y), ordered_key(x), ordered_key(y)};
        for (int k = 0; k < 4; ++k) bounds.edge[k] = edge[k] > bounds.edge[k] ? edge[k] : bounds.edge[k];
      },
      [&](const SharedWork::Bounds& bounds) {
        for (int k = 0; k < 4; ++k) largest_from_all(work.bounds->edge + k, bounds.edge[k]);
        add_from_all(&work.bounds->count, bounds.count);
      });
  w.grid = bounded_shape(*work.bounds);
  const auto cell_of = [&](int i) { return w.grid.cell_of(w.x[i], w.y[i]); };
  lanes.each_agent(n, [&](int i) {
    if (w.alive[i]) work.arrival[i] = take_number(w.cell_begin + cell_of(i) + 1);
  });
  sum_cells(lanes, w);
  lanes.each_agent(n, [&](int i) {
    if (i == 0) *work.bounds = {};  // all have read it
    if (w.alive[i]) work.order[w.cell_begin[cell_of(i)] + work.arrival[i]] = i;
  });
  // Those of a cell by number, whoever came first.
  lanes.each_agent(n, [&](int i) {
    if (!w.alive[i]) return;
    const int cell = cell_of(i);
    const int32_t first = w.cell_begin[cell], end = w.cell_begin[cell + 1];
    int32_t place = first;
    for (int32_t k = first; k < end; ++k) place += work.order[k] < i ? 1 : 0;
    w.placed[place] = {w.x[i], w.y[i], i, 0};
  });
}

/// Counters that sort_agents has set to zero.
template <WideLanes Lanes>
GIGA_HD void count_teams(const Lanes& lanes, const GridParams& p, GridWorld& w, int teams) {
  struct Living {
    int32_t count[kNCounts];
  };
  lanes.gather(
      teams > 0 ? p.n_agents : 0, Living{},
      [&](Living& living, int i) {
        const int team = p.team_of(i);
        for (int k = 0; k < kNTeams; ++k) {
          living.count[kAlive0 + k] += team == k && w.alive[i] ? 1 : 0;
          living.count[kWasAlive0 + k] += team == k && w.was_alive[i] ? 1 : 0;
        }
      },
      [&](const Living& living) {
        for (int k = kAlive0; k <= kWasAlive1; ++k) add_from_all(w.counts + k, living.count[k]);
      });
}

/// Rules 17.5: blocks side by side, then blocks of their sums.
template <WideLanes Lanes>
GIGA_HD void accumulate_step(const Lanes& lanes, const GridParams& p, GridWorld& w, int items) {
  if (!p.team_after_team) return lanes.each(items, [&](int item) { accumulate_episode(p, w, item); });
  const int most = p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1], pitch = sums_of_team(most);
  const auto block_of = [](int block, int n, auto&& number) {
    const int end = (block + 1) * kSumBlock < n ? (block + 1) * kSumBlock : n;
    StepSum sum;
    for (int k = block * kSumBlock; k < end; ++k) sum += number(k);
    return sum;
  };
  int count = sum_blocks(most);
  StepSum* sums = w.work.sums;
  lanes.each(items * count, [&](int k) {
    const int item = k / count, block = k - item * count;
    const StepItem what(p, item);
    sums[item * pitch + block] =
        block_of(block, p.n_team[what.team], [&](int slot) { return what.of(p, w, p.first_of(what.team) + slot); });
  });
  GIGA_ROLLED
  while (count > kSumBlock) {
    const int blocks = sum_blocks(count);
    lanes.each(items * blocks, [&](int k) {
      const int item = k / blocks, block = k - item * blocks;
      const StepSum* from = sums + item * pitch;
      sums[item * pitch + count + block] = block_of(block, count, [&](int at) { return from[at]; });
    });
    sums += count;
    count = blocks;
  }
  lanes.each(items, [&](int item) {
    const StepSum* from = sums + item * pitch;
    StepItem(p, item).add_to_episode(p, w, block_of(0, count, [&](int at) { return from[at]; }));
  });
}

/// The hook of step.hpp: neighboring workers see to agents that are near each other, and so look at the same others.
template <WideLanes Lanes, class F>
GIGA_HD void each_by_place(const Lanes& lanes, const GridParams&, const GridWorld& w, int n, F&& f) {
  const int placed = n > 0 ? w.cell_begin[w.grid.cells()] : 0;
  lanes.each(placed + n, [&](int k) {
    const int i = k < placed ? w.placed[k].agent : k - placed;
    if (k < placed || w.work.arrival[i] == kNotPlaced) f(i);
  });
}

}  // namespace giga
