// What one thread of a launch does: the working copy of a world, and the jobs of run_job on it. Plain host-device code
// without the standard library's containers: kernels call it, those of the build and one that is compiled at run time
// (step_compiler.hpp), and an emulation that needs no GPU (tests/parity).
#pragma once

#include <climits>
#include <cstddef>
#include <cstdint>

#include "cuda/lanes.hpp"
#include "sim/draws.hpp"
#include "sim/step.hpp"

namespace giga {

constexpr int kWarp = 32;
constexpr int kTileWarps = 4;          // warps of a block of TileLanes, where each is a group
constexpr int kGroupWarps = 5;         // or where they are a group together: 4 worlds of 40 agents, 8 of 20
constexpr int kMaxBlockThreads = 512;  // threads of a block of BlockLanes
constexpr int kWorldsAlone = 1024;     // playing worlds up to which each has a group for itself

#if !defined(__CUDA_ARCH__)
/// What lanes of a warp tell each other where there are no shuffles: f(what is known so far, what a member says, its
/// number) for members 0 .. members - 1, who are the lanes from `first` on. `said`: [kWarp]
template <class Sync, class F>
uint32_t hear_members(const Sync& sync, uint32_t* said, int lane, int first, int members, uint32_t value, F&& f) {
  said[lane] = value;
  sync.wait_for_warp();
  uint32_t known = 0;
  for (int k = 0; k < members; ++k) known = f(known, said[first + k], k);
  sync.wait_for_warp();
  return known;
}
#endif

/// Numbers of a warp in shared memory, in worlds of many agents: where its lanes note whom they found, and put together
/// what they write.
constexpr int kStageNumbers = kNeighborFeatures * kWarp;
/// The part of a crew of so many lanes, in which each has as many as there are about an agent.
template <int kLanes>
GIGA_HD float* crew_stage(void* stage, int lane) {
  return static_cast<float*>(stage) + lane / kLanes * kLanes * kNeighborFeatures;
}

/// Threads of a block of TileLanes, and of a group of them that share their barriers: a warp or, for teams that fill
/// a warp badly, the block. `agents`: of a world, where a kernel knows them as a constant, else 0.
constexpr bool block_is_group(int agents) { return agents > kWarp / 2; }
constexpr int tile_threads(int agents) { return (block_is_group(agents) ? kGroupWarps : kTileWarps) * kWarp; }
constexpr int group_threads(int agents) { return block_is_group(agents) ? tile_threads(agents) : kWarp; }
template <class P>
constexpr bool kBlockIsGroup = block_is_group(P::kAgents);
template <class P>
constexpr int kTileThreads = tile_threads(P::kAgents);
template <class P>
constexpr int kGroupThreads = group_threads(P::kAgents);

/// Blocks and threads of a launch over all worlds.
struct LaunchShape {
  bool tiles;      ///< TileLanes, else BlockLanes
  bool in_shared;  ///< scratch and working copy in shared memory, else the scratch alone in global memory
  int blocks, threads;
  int group;            ///< threads that share their barriers
  size_t world_bytes;   ///< of shared memory: the working copy of a world's state, then its scratch
  size_t shared_bytes;  ///< of a block
};

/// Bytes of the working copy of the agents' state and the world's, in front of a world's scratch in shared memory.
GIGA_HD size_t working_copy_bytes(int n_agents) {
  size_t bytes = 0;
  for_each_field([&](auto field, auto member) {
    const StateView fields{};
    if constexpr (field.working) bytes += sizeof(*(fields.*member)) * static_cast<size_t>(field.count(n_agents));
  });
  return (bytes + 3 + 15) & ~size_t{15};  // 3: the world's words begin at a whole one behind the agents' bytes
}

/// Arguments of a kernel, by value. P: SimParams, or some of them as constants of the compiler.
template <class P>
struct LaunchOf {
  P params;
  StateView state;
  StepIo io;
  ScratchLayout layout;
  size_t world_bytes;  // of the shape, where it has tiles
  char* scratch;       // [W, layout.size]; null = shared memory, with the working copy
  uint64_t seed;
  int64_t first_world, draw_period;
  int n_worlds;
  Ending ending;
  const int32_t* playing;    // [n_playing] the worlds to work on; null = all
  const int32_t* n_playing;  // [1]

  /// That of the launch; worked out anew where that costs the compiler and not the GPU.
  GIGA_HD ScratchLayout scratch_layout() const {
    if constexpr (P::kTeam > 0)
      return ScratchLayout(params);
    else
      return layout;
  }
  GIGA_HD int count() const { return playing ? *n_playing : n_worlds; }
  GIGA_HD int world(int k) const { return playing ? playing[k] : k; }

  /// The same with other parameters of the same values, for tiles of that shape.
  template <class Q>
  LaunchOf<Q> with(const Q& q, const LaunchShape& shape) const {
    return {q,           state,       io,       layout, shape.world_bytes, scratch,  seed,
            first_world, draw_period, n_worlds, ending, playing,           n_playing};
  }
};
using Launch = LaunchOf<SimParams>;

/// Which thread of a launch this is.
struct ThreadIndex {
  int block, n_blocks;
  int thread, n_threads;  // of the block
};

/// Points the working fields of the state to shared memory; copy_world moves them there or back. The agents' words come
/// first and their bytes at a whole word, so that several of an array are read at once.
GIGA_HD WorldView working_copy(const WorldView& home, char* block, int n) {
  WorldView w = home;
  size_t at = 0;
  const auto take = [&](auto field, auto member) {
    auto*& array = w.*member;
    at = (at + sizeof(*array) - 1) / sizeof(*array) * sizeof(*array);
    array = reinterpret_cast<std::remove_reference_t<decltype(array)>>(block + at);
    at += sizeof(*array) * static_cast<size_t>(field.count(n));
  };
  const auto take_all = [&](auto&& wanted) {
    for_each_field([&](auto field, auto member) {
      constexpr size_t kSize = sizeof(*(w.*member));
      static_assert(!field.working || (field.columns == 1 && ((field.per == Per::agent && (kSize == 4 || kSize == 1)) ||
                                                              (field.per == Per::agent_words && kSize == 4) ||
                                                              (field.per == Per::world && (kSize == 4 || kSize == 1)) ||
                                                              (field.per == Per::pair && kSize == 1))),
                    "a working field has a word or a byte for the world, a word, words of bits or a byte for each "
                    "agent, or a byte for each pair: working_copy and copy_world know no others");
      if constexpr (field.working)
        if (wanted(field.per, kSize)) take(field, member);
    });
  };
  take_all([](Per per, size_t size) { return per != Per::world && size == 4; });
  take_all([](Per per, size_t) { return per == Per::pair; });
  take_all([](Per per, size_t size) { return per == Per::agent && size == 1; });
  take_all([](Per per, size_t size) { return per == Per::world && size == 4; });
  take_all([](Per per, size_t size) { return per == Per::world && size == 1; });
  return w;
}

/// Word k of the world's working fields.
template <class T>
GIGA_HD uint32_t* world_word(const T& w, int k) {
  uint32_t* word = nullptr;
  int count = 0;
  for_each_field([&](auto field, auto member) {
    if constexpr (field.working && field.per == Per::world && sizeof(*(w.*member)) == 4)
      if (count++ == k) word = reinterpret_cast<uint32_t*>(w.*member);
  });
  return word;
}
constexpr int count_world_words() {
  int count = 0;
  for_each_field([&](auto field, auto member) {
    constexpr size_t kSize = sizeof(*(std::declval<StateView>().*member));
    count += field.working && field.per == Per::world && kSize == 4 ? 1 : 0;
  });
  return count;
}

/// Copies the working fields. Where the number of agents is a constant, all in one go, so that all that has to be read
/// is asked for before the first of it is waited for.
template <class Lanes>
GIGA_HD void copy_world(const Lanes& lanes, const Parameters auto& p, const WorldView& from, const WorldView& to) {
  constexpr int kAgents = std::remove_cvref_t<decltype(p)>::kAgents, kWorldWords = count_world_words();
  const int n = p.n_agents, one_word = words_for(n) == 1;
  const auto agent_word = [&](int k) {
    for_each_field([&](auto field, auto member) {
      if constexpr (field.working && field.per == Per::agent_words) (to.*member)[k] = (from.*member)[k];
    });
  };
  const auto agent = [&](int i) {
    for_each_field([&](auto field, auto member) {
      if constexpr (field.working && field.per == Per::agent) (to.*member)[i] = (from.*member)[i];
      if constexpr (field.working && field.per == Per::world && sizeof(*(to.*member)) == 1)
        if (i == n - 1) *(to.*member) = *(from.*member);
    });
    agent_word(i);
  };
  const auto pair_word = [&](int k) {
    for_each_field([&](auto field, auto member) {
      if constexpr (field.working && field.per == Per::pair)
        reinterpret_cast<uint32_t*>(to.*member)[k] = reinterpret_cast<const uint32_t*>(from.*member)[k];
    });
  };
  const auto pair = [&](int k) {
    for_each_field([&](auto field, auto member) {
      if constexpr (field.working && field.per == Per::pair) (to.*member)[k] = (from.*member)[k];
    });
  };
  const auto of_world = [&](int k) { *world_word(to, k) = *world_word(from, k); };
  if constexpr (kAgents > 0) {
    // Of an odd number of agents the pairs are no whole words.
    constexpr bool kWholeWords = kAgents % 2 == 0;
    constexpr int kPairs = kAgents * kAgents / (kWholeWords ? 4 : 1), kWords = words_for(kAgents);
    lanes.each_agent(n, [&](int i) {
      GIGA_UNROLL
      for (int k = 0; k < kWorldWords; k += kAgents)
        if (k + i < kWorldWords) of_world(k + i);
      agent(i);
      GIGA_UNROLL
      for (int k = 0; k < kPairs; k += kAgents)
        if (k + i < kPairs) kWholeWords ? pair_word(k + i) : pair(k + i);
      GIGA_UNROLL
      for (int k = kAgents; k < kAgents * kWords; k += kAgents) agent_word(k + i);
    });
  } else {
    lanes.each(kWorldWords, of_world);
    lanes.each_agent(n, agent);
    if (!one_word) lanes.each(n * words_for(n) - n, [&](int k) { agent_word(n + k); });
    if (n % 2 == 0)
      lanes.each(n * n / 4, pair_word);
    else
      lanes.each(n * n, pair);
  }
}

/// Asks for what a step reads of memory besides the working copy, long before it is needed: the actions, and the sums
/// of the episode. Measured on an H200: 2 vs 2 9 to 12 % faster, 10 vs 10 2 %, 5 vs 5 as before; 20 vs 20, which does
/// without, 1 % slower.
template <class Lanes>
GIGA_HD void ask_ahead(const Lanes& lanes, const Parameters auto& p, const WorldView& home, const StepIo& io,
                       int world) {
  lanes.each_agent(p.n_agents, [&](int i) {
    prefetch(static_cast<const int32_t*>(io.of(p.team_of(i)).action) + team_row(p, world, i));
    const float* sums = i == 0   ? home.returns
                        : i == 1 ? home.returns_masked
                        : i == 2 ? home.term_returns
                                 : home.term_returns + kNTeams * kNRewardTerms - 1;
    if (i < 4) prefetch(sums);
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
    attach_scratch(w, k.scratch_layout(), shared + working_copy_bytes(k.params.n_agents));
    if constexpr (job == Job::step && P::kTeam > 0 && P::kAgents <= kWarp)
      ask_ahead(lanes, k.params, home, k.io, world);
    copy_world(lanes, k.params, home, w);
  } else {
    attach_scratch(w, k.layout, k.scratch + static_cast<size_t>(world) * k.layout.size);
  }
  const auto draws_at = [&](uint32_t step) {
    return PhiloxDraws(k.seed, draw_world(k.first_world, k.draw_period, world), step);
  };
  run_job<job>(lanes, k.params, w, draws_at, k.io, k.ending, world);
  if constexpr (in_shared) copy_world(lanes, k.params, w, home);
  lanes.wait_sent();  // before the shared memory goes
}

/// What a thread does in a launch of TileLanes.
template <Job job, class Sync, class P>
GIGA_HD void run_tile_thread(const LaunchOf<P>& k, const ThreadIndex& at, char* shared, Sync sync) {
  constexpr int kGroup = kGroupThreads<P>, kGroups = kTileThreads<P> / kGroup;
  const int n = k.params.n_agents, count = k.count();
  // Few worlds take as long as one does: a group for each is faster then.
  const bool alone = k.playing && count <= kWorldsAlone && count <= at.n_blocks * kGroups;
  const int lane = at.thread % kGroup, group = at.thread / kGroup;
  // Divided by n, which may be a constant, rather than by the width.
  const int width = alone ? kGroup : n, per_group = alone ? 1 : kGroup / n;
  const int tile = alone ? 0 : lane / n, first = alone ? lane : lane % n;
  const int slot = group * per_group + (tile < per_group ? tile : 0);
  const int index = at.block * (kGroups * per_group) + slot;
  if (at.block * (kGroups * per_group) >= count) return;
  const bool idle = tile >= per_group || index >= count;
  const TileLanes<Sync> lanes{idle ? INT_MAX : first, width, sync};
  // An idle thread looks at some world of the launch, so that it can keep in step.
  run_world<job, true>(lanes, k, k.world(index < count ? index : count - 1),
                       shared + static_cast<size_t>(slot) * (k.world_bytes / 16 * 16));  // as the compiler learns so
}

/// What a thread does in a launch of BlockLanes.
template <Job job, bool in_shared, class Sync, class P>
GIGA_HD void run_block_thread(const LaunchOf<P>& k, const ThreadIndex& at, char* shared, Sync sync) {
  if (at.block >= k.count()) return;
  const BlockLanes<Sync> lanes{at.thread, at.n_threads, sync};
  run_world<job, in_shared>(lanes, k, k.world(at.block), shared);
}

}  // namespace giga
