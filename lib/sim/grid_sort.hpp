// Stages of a world of many agents for many workers at once (WideLanes): sorting the agents into the grid, going
// through them by place, who hits whom and who lives then, adding up returns. What comes out does not depend on who is
// faster, and is what one worker makes (grid_stages.hpp).
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
  sorters.each_read(
      n, [&](int i) { return take_number(w.cell_begin + cell_of(i) + 1); },
      [&](int i, int32_t number) { w.place[i] = number; });
  sum_cells(sorters, w, some_dead ? cells + of_dead.cells() : cells);
  sorters.each_read(
      n, [&](int i) { return w.cell_begin[cell_of(i)] + w.place[i]; },
      [&](int i, int32_t place) {
        if (i == 0) *work.bounds = {};  // all have read it
        if (i == 0 && work.shape) *work.shape = w.grid;
        work.order[place] = i;
      });
  // Those of a cell by number, whoever came first.
  struct ToPlace {
    float x, y;
    bool lives;
    CellRange cell;
  };
  sorters.each_read(
      n,
      [&](int i) {
        const int cell = cell_of(i);
        return ToPlace{w.x[i], w.y[i], w.alive[i] != 0, {w.cell_begin[cell], w.cell_begin[cell + 1]}};
      },
      [&](int i, const ToPlace& a) {
        int32_t place = a.cell.begin;
        for (int32_t k = a.cell.begin; k < a.cell.end; ++k) place += work.order[k] < i ? 1 : 0;
        w.placed[place] = {a.x, a.y, i, 0};
        w.place[i] = a.lives ? place : kNotPlaced;
      });
}

/// The hook of step.hpp.
template <WideLanes Lanes>
GIGA_HD void mark_agents(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  lanes.sorters().each_read(
      n > 0 ? w.cell_begin[w.grid.cells()] : 0, [&](int k) { return ToMark(p, w, w.placed[k].agent); },
      [&](int k, const ToMark& what) { w.placed[k].marks = what.marks(); });
}

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

/// The hook of step.hpp, in one go: what becomes of an agent depends on nothing that this writes of another. Into
/// counters that sort_agents has set to zero.
template <WideLanes Lanes, class Draws>
GIGA_HD void fight(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, Draws& draws, int n, int) {
  lanes.with_crews(n, [&](const auto& crews) {
    int32_t living[kNCounts] = {};
    crews.each_agent(n, [&](const auto& crew, int k, bool some) {
      const int i = w.placed[k].agent;
      detect_and_track(crew, p, w, draws, i, some);
      if (!some || !crew.leads()) return;
      update_health(p, w, i);
      note_death(w, i);
      const int team = p.team_of(i);
      for (int t = 0; t < kNTeams; ++t) {
        living[kAlive0 + t] += team == t && w.alive[i] ? 1 : 0;
        living[kWasAlive0 + t] += team == t && w.was_alive[i] ? 1 : 0;
      }
    });
    lanes.wait_for_warp();  // those that come late add theirs with the others, and not one by one
    for (int k = kAlive0; k <= kWasAlive1; ++k) add_from_all(w.counts + k, living[k]);
    lanes.wait();
  });
}

/// The hook of step.hpp (rules 17.5): each block of workers sees to some blocks of agents and adds up what these get,
/// then all add up blocks of such sums.
template <WideLanes Lanes>
GIGA_HD void reward_and_accumulate(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, const StepIo& io,
                                   int64_t world, int n) {
  if (n == 0) return;
  const int items = n_step_items(p);
  if (!p.team_after_team) {
    lanes.each_agent(n, [&](int i) { reward_agent(p, w, io, world, i); });
    return lanes.each(items, [&](int item) { accumulate_episode(p, w, item); });
  }
  const int most = p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1], pitch = sums_of_team(most);
  // How many of n are in a block.
  const auto left = [](int n_all, int block) {
    const int more = n_all - block * kSumBlock;
    return more < 0 ? 0 : more < kSumBlock ? more : kSumBlock;
  };
  int count = sum_blocks(most);
  StepSum* sums = w.work.sums;
  // Blocks of agents of both teams in turn; as many for each block of workers, so that all come to its barriers.
  struct OfTeam {
    int team, block;
  };
  const auto block_of = [&](int k) {
    const int at = k * lanes.n_blocks + lanes.block;
    return OfTeam{at % kNTeams, at / kNTeams};
  };
  const int own = (kNTeams * count + lanes.n_blocks - 1) / lanes.n_blocks, of_team = items / kNTeams;
  const Lanes block = lanes.of_block();
  block.each_agent(own * kSumBlock, [&](int k) {
    const OfTeam some = block_of(k / kSumBlock);
    const int at = k % kSumBlock;
    if (at < left(p.n_team[some.team], some.block))
      reward_agent(p, w, io, world, p.first_of(some.team) + some.block * kSumBlock + at);
  });
  const auto item_of = [&](int team, int k) { return k == 0 ? team : kNTeams + team * p.n_active_terms + k - 1; };
  block.without_barrier().template each_sum<kSumBlock>(
      own * of_team,
      [&](int k) {
        const OfTeam some = block_of(k / of_team);
        return left(p.n_team[some.team], some.block);
      },
      [&](int k, int at) {
        const OfTeam some = block_of(k / of_team);
        const int i = p.first_of(some.team) + some.block * kSumBlock + at;
        return StepItem(p, item_of(some.team, k % of_team)).of(p, w, i);
      },
      [&](int k, const StepSum& sum) {
        const OfTeam some = block_of(k / of_team);
        if (some.block < count) sums[item_of(some.team, k % of_team) * pitch + some.block] = sum;
      });
  lanes.wait();
  GIGA_ROLLED
  while (count > kSumBlock) {
    const int blocks = sum_blocks(count);
    lanes.template each_sum<kSumBlock>(
        items * blocks, [&](int k) { return left(count, k % blocks); },
        [&](int k, int at) { return sums[k / blocks * pitch + k % blocks * kSumBlock + at]; },
        [&](int k, const StepSum& sum) { sums[k / blocks * pitch + count + k % blocks] = sum; });
    sums += count;
    count = blocks;
  }
  without_barrier(lanes).template each_sum<kSumBlock>(  // nothing else of the step asks for them
      items, [&](int) { return count; }, [&](int item, int at) { return sums[item * pitch + at]; },
      [&](int item, const StepSum& sum) { StepItem(p, item).add_to_episode(p, w, sum); });
}

}  // namespace giga
