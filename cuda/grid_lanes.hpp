// GridLanes: the threads of the blocks that share a world of many agents (sim/lanes.hpp), and what they do together.
// Plain host-device code, as executor.hpp.
#pragma once

#include <cstdint>
#include <type_traits>

#include "cuda/search_crew.hpp"
#include "cuda/single_lane.hpp"
#include "cuda/subwarp.hpp"
#include "cuda/world_threads.hpp"
#include "sim/grid.hpp"
#include "sim/vector_observation.hpp"

namespace giga {

constexpr int stage_numbers(bool room_to_look) {
  return room_to_look && kRoomyLaneWords > kStageNumbers ? kRoomyLaneWords : kStageNumbers;
}
constexpr int kPiecesAtOnce = 2;  // of rows, that a thread works out before it writes any

/// The crew of so many lanes that look for an agent together.
template <int kLanes, class Sync>
struct CrewOf {
  using Type = Subwarp<kLanes, Sync>;
};
template <int kLanes, class Sync>
requires(kLanes >= kWarp / 2) struct CrewOf<kLanes, Sync> {
  using Type = SearchCrew<kLanes, Sync>;
};

/// Makes the barrier of a warp that of its lanes.
template <class Sync>
struct WarpSync {
  Sync sync;
  GIGA_HD void wait() const { sync.wait_for_warp(); }
};

/// The threads of the blocks that share a world. Sync: of all of them. A stage of nothing needs no barrier: that it is
/// one is the same for all of them, and the stage before has ended with its own.
/// kCrew: lanes that look for an agent together. kRoomToLook: whether one that looks alone has its lists in the stage.
template <class Sync, int kCrew, bool kRoomToLook = false>
struct GridLanes {
  static constexpr bool kSerial = false, kWide = true;
  static constexpr int kStage = stage_numbers(kRoomToLook);
  int first, stride;
  int block, n_blocks, thread, n_threads;  // n_threads: of a block
  Sync sync;
  float* stage;         // [kStage] of the warp, in shared memory
  bool sorts_by_block;  // the sorted agents are in shared memory, once for each block
  bool waits = true;

  GIGA_HD void wait() const {
    if (waits) sync.wait();
  }
  GIGA_HD GridLanes without_barrier() const {
    GridLanes lanes = *this;
    lanes.waits = false;
    return lanes;
  }
  /// Those of this block alone, at barriers of their own.
  GIGA_HD GridLanes of_block() const {
    return {thread, n_threads, 0, 1, thread, n_threads, sync.of_block(), stage, sorts_by_block, true};
  }
  /// Those of this warp alone, likewise.
  GIGA_HD GridLanes<WarpSync<Sync>, kCrew, kRoomToLook> of_warp() const {
    const int lane = first % kWarp;
    return {lane, kWarp, 0, 1, lane, kWarp, {sync}, stage, sorts_by_block, true};
  }
  /// 8 or 16 lanes of each warp, where there are so many that n items would leave warps idle: those of a warp that look
  /// for others wait for the one that has most to do, and for each branch that another takes. One world of 2,000
  /// agents, H100, before there were crews: 34.3 M agent-steps/s instead of 31.6 M, crowded 20.3 M instead of 18.6 M.
  GIGA_HD GridLanes spread_over(int n) const {
    const int used = stride >= 4 * n ? kWarp / 4 : stride >= 2 * n ? kWarp / 2 : kWarp;
    GridLanes lanes = *this;
    lanes.stride = stride / kWarp * used;
    lanes.first = first % kWarp < used ? first / kWarp * used + first % kWarp : n;  // n: has none
    return lanes;
  }
  GIGA_HD void wait_for_warp() const { sync.wait_for_warp(); }
  GIGA_HD bool any_of_warp(bool flag) const { return sync.any_of_warp(flag); }
  /// Calls f(crews): crews.each_agent(n, f) calls f(crew, item, whether the crew has one), without a barrier
  /// and as often for each lane of a warp.
  template <class F>
  GIGA_HD void with_crews(int n, F&& f) const {
    if (n <= 0) return;
    if constexpr (kCrew > 1)
      f(GridCrews<kCrew>{*this});
    else
      f(SingleLanes{spread_over(n)});
  }
  using Lane = std::conditional_t<kRoomToLook, RoomyLane<Sync>, SingleLane<Sync>>;
  GIGA_HD Lane single_lane() const {
    if constexpr (kRoomToLook)
      return Lane(sync, first % kWarp, reinterpret_cast<int32_t*>(stage));
    else
      return Lane(sync);
  }
  struct SingleLanes {
    GridLanes lanes;
    template <class F>
    GIGA_HD void each_agent(int n, F&& f) const {
      const Lane lane = lanes.single_lane();
      GIGA_ROLLED
      for (int begin = 0; begin < n; begin += lanes.stride) {  // as often for each lane
        const int item = begin + lanes.first;
        f(lane, item < n ? item : 0, item < n);
      }
    }
  };
  template <int kLanes>
  struct GridCrews {
    GridLanes lanes;
    template <class F>
    GIGA_HD void each_agent(int n, F&& f) const {
      using Crew = typename CrewOf<kLanes, Sync>::Type;
      static_assert(Crew::kWords <= kStageNumbers);
      const Crew crew(lanes.sync, lanes.first % kWarp, lanes.stage);
      const int crews = lanes.stride / kLanes;
      GIGA_ROLLED
      for (int begin = 0; begin < n; begin += crews) {  // as often for each warp
        const int item = begin + lanes.first / kLanes;
        f(crew, item < n ? item : 0, item < n);
      }
    }
  };
  /// Calls f(the lanes of this warp, item, whether there is one), as often for each warp. The last warps begin: they
  /// have the least to do otherwise.
  template <class F>
  GIGA_HD void each_warp(int n, F&& f) const {
    each_of_groups(n, of_warp(), first / kWarp, stride / kWarp, f);
  }
  /// The same by blocks.
  template <class F>
  GIGA_HD void each_block(int n, F&& f) const {
    each_of_groups(n, of_block(), block, n_blocks, f);
  }
  template <class Group, class F>
  GIGA_HD static void each_of_groups(int n, const Group& lanes, int group, int groups, F&& f) {
    GIGA_ROLLED
    for (int begin = 0; begin < n; begin += groups) {
      const int item = begin + groups - 1 - group;
      f(lanes, item < n ? item : 0, item < n);
    }
  }
  /// Those who share the sorted agents.
  GIGA_HD GridLanes sorters() const { return sorts_by_block ? of_block() : *this; }
  /// Shared memory of the block, between stages that write rows: the stages of all its warps.
  GIGA_HD int32_t* words() const { return reinterpret_cast<int32_t*>(stage - thread / kWarp * kStage); }
  /// One item goes to the last worker, which has the least to do otherwise.
  template <class F>
  GIGA_HD void each(int n, F&& f) const {
    if (n <= 0) return;
    if (n == 1) {
      if (first == stride - 1) f(0);
    } else {
      for (int i = first; i < n; i += stride) f(i);
    }
    wait();
  }
  template <class F>
  GIGA_HD void each_agent(int n, F&& f) const {
    if (n <= 0) return;
    // One after the other: reading of two agents before writing of them made 48.9 M agent-steps/s, of four 46.6 M
    // instead of 53.5 M (2,000 agents, one H100).
    GIGA_ROLLED
    for (int i = first; i < n; i += stride) f(i);
    wait();
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
    wait();
  }
  /// Writes rows that begin with pieces of some numbers each, Piece::number: row_of(row)[...] = piece(row, k, of(row,
  /// k)).number[...] for all k, or nothing where that row is null. A thread works out a piece, some before it hands on
  /// the first, and reads first what all of them are of; its warp puts them together and writes them, neighboring lanes
  /// neighboring numbers.
  template <class Rows, class Of, class MakePiece>
  GIGA_HD void write_pieces(int rows, int pieces, Rows&& row_of, Of&& of, MakePiece&& piece) const {
    using About = decltype(of(0, 0));
    using Piece = decltype(piece(0, 0, of(0, 0)));
    constexpr int kNumbers = sizeof(Piece) / sizeof(float);
    static_assert(kNumbers * kWarp <= kStageNumbers, "the stage of a warp has room for pieces of an agent");
    if (rows <= 0 || pieces <= 0) return;
    const int lane = first % kWarp, together = pieces < kWarp ? kWarp / pieces : 1;  // rows of a warp at a time
    const int slot = lane / pieces, taken = slot < together ? slot : 0;
    const int step = stride / kWarp * together;
    // As often for each warp: they may share a barrier in the place of their own.
    GIGA_ROLLED
    for (int begin = 0; begin < rows; begin += kPiecesAtOnce * step) {
      const int base = begin + first / kWarp * together;
      GIGA_ROLLED
      for (int front = 0; front < pieces; front += kWarp) {
        const int k = front + lane - slot * pieces;
        const bool some = slot < together && k < pieces;
        const auto row_at = [&](int turn) {
          const int row = base + turn * step + taken;
          return row < rows ? row : rows - 1;
        };
        About about[kPiecesAtOnce];
        Piece made[kPiecesAtOnce];
        GIGA_UNROLL
        for (int turn = 0; turn < kPiecesAtOnce; ++turn) about[turn] = of(row_at(turn), some ? k : 0);
        GIGA_UNROLL
        for (int turn = 0; turn < kPiecesAtOnce; ++turn) made[turn] = piece(row_at(turn), some ? k : 0, about[turn]);
        GIGA_UNROLL
        for (int turn = 0; turn < kPiecesAtOnce; ++turn) {
          GIGA_UNROLL
          for (int c = 0; c < kNumbers; ++c) stage[lane * kNumbers + c] = made[turn].number[c];
          sync.wait_for_warp();
          for (int s = 0; s < together; ++s) {
            const int row = base + turn * step + s, left = pieces - front;
            float* to = row < rows ? row_of(row) : nullptr;
            const int count = to ? (left < kWarp ? left : kWarp) * kNumbers : 0;
            for (int c = lane; c < count; c += kWarp) to[front * kNumbers + c] = stage[s * pieces * kNumbers + c];
          }
          sync.wait_for_warp();
        }
      }
    }
    wait();
  }
  template <int kUnrolled = 1, class Sum, class F, class Merge>
  GIGA_HD void gather(int n, Sum sum, F&& f, Merge&& merge) const {
    if (n <= 0) return;
    GIGA_UNROLL_BY(kUnrolled)
    for (int i = first; i < n; i += stride) f(sum, i);
    sync.wait_for_warp();  // those that come late merge with the others, and not one by one
    merge(sum);
    wait();
  }
  /// The same where all workers would add to the same few numbers, one after the other: the sums of a block are first
  /// put together, merge(sum, block's), then hand_in(sum) adds that to the sum of all.
  template <int kUnrolled = 1, class Sum, class F, class Merge, class HandIn>
  GIGA_HD void gather_by_block(int n, const Sum& start, F&& f, Merge&& merge, HandIn&& hand_in) const {
    if (n_blocks == 1) return gather<kUnrolled>(n, start, f, hand_in);
    if (n <= 0) return;
    static_assert(sizeof(Sum) <= sizeof(float) * kStageNumbers);
    const GridLanes block_lanes = of_block();
    Sum& of_all = *reinterpret_cast<Sum*>(words());
    if (thread == 0) of_all = start;
    Sum sum = start;
    GIGA_UNROLL_BY(kUnrolled)
    for (int i = first; i < n; i += stride) f(sum, i);
    block_lanes.wait();
    merge(sum, of_all);
    block_lanes.wait();
    if (thread == 0) hand_in(of_all);
    wait();
  }
  /// Adds up numbers in their order for each of n items: count_of(item) many, number(item, k), to add_to(item, sum).
  /// Of more than kMost numbers these are sums of sums: of each kMost, and of at most kMost such. Half a warp reads
  /// them together, and two of its lanes add.
  template <int kMost, class CountOf, class Number, class AddTo>
  GIGA_HD void each_sum(int n, CountOf&& count_of, Number&& number, AddTo&& add_to) const {
    constexpr int kHalf = kWarp / 2, kPitch = kMost + 1;  // so that the two read from two banks
    static_assert(kMost % kHalf == 0 && 2 * (2 * kPitch + 2) <= kStageNumbers);
    if (n <= 0) return;
    const int lane = first % kHalf, sums = stride / kHalf;
    float* const numbers = stage + first % kWarp / kHalf * (2 * kPitch + 2);
    GIGA_ROLLED
    for (int begin = 0; begin < n; begin += sums) {  // as often for each warp
      const int item = begin + first / kHalf, count = item < n ? count_of(item) : 0;
      float of_all = 0;
      GIGA_ROLLED
      for (int front = 0; sync.any_of_warp(front < count); front += kMost) {
        const int left = count - front, some = left < 0 ? 0 : left < kMost ? left : kMost;
        StepSum read[kMost / kHalf];
        GIGA_UNROLL
        for (int turn = 0; turn < kMost / kHalf; ++turn)
          if (turn * kHalf + lane < some) read[turn] = number(item, front + turn * kHalf + lane);
        GIGA_UNROLL
        for (int turn = 0; turn < kMost / kHalf; ++turn) {
          numbers[turn * kHalf + lane] = read[turn].sum;
          numbers[kPitch + turn * kHalf + lane] = read[turn].masked;
        }
        sync.wait_for_warp();
        if (lane < 2) {
          float sum = 0;
          GIGA_UNROLL_BY(16)
          for (int k = 0; k < some; ++k) sum += numbers[lane * kPitch + k];
          of_all = front == 0 ? sum : of_all + sum;
        }
        sync.wait_for_warp();
      }
      if (lane < 2) numbers[2 * kPitch + lane] = of_all;
      sync.wait_for_warp();
      if (lane == 0 && item < n) add_to(item, StepSum{numbers[2 * kPitch], numbers[2 * kPitch + 1]});
    }
    wait();
  }
  /// Of a warp or a block: adds up numbers in their order, number(row, k), to add_to(row, sum), for each of so many
  /// rows of `count`, of at most kMost. All lanes read some rows, a lane adds up a row; number(row, k) is read by the
  /// lane to which each_agent(count) gives item k. Ends with a barrier of the warp or block.
  template <int kMost, class Number, class AddTo>
  GIGA_HD void sum_rows(int rows, int count, Number&& number, AddTo&& add_to) const {
    constexpr int kPitch = kMost + 1;  // so that those who add read from as many banks
    static_assert(kPitch <= kStage, "a warp has room for a row");
    float* const numbers = reinterpret_cast<float*>(words());
    const int room = n_threads / kWarp * kStage / kPitch, at_once = room < kWarp ? room : kWarp;
    GIGA_ROLLED
    for (int front = 0; front < rows; front += at_once) {
      const int some = rows - front < at_once ? rows - front : at_once;
      GIGA_ROLLED
      for (int k = first; k < count; k += stride) {
        GIGA_UNROLL_BY(4)
        for (int row = 0; row < some; ++row) numbers[row * kPitch + k] = number(front + row, k);
      }
      wait();
      if (first < some) {
        float sum = 0;
        GIGA_UNROLL_BY(16)
        for (int k = 0; k < count; ++k) sum += numbers[first * kPitch + k];
        add_to(front + first, sum);
      }
      wait();
    }
  }
  /// Of what the workers of a block hand in: the sum of those before this one, and of all. Before it is used again, or
  /// words() are, come another barrier.
  struct SumBefore {
    int32_t before, all;
  };
  GIGA_HD SumBefore sum_before(int32_t value) const {
    const int lane = thread % kWarp, warp = thread / kWarp;
    int32_t* const of_warps = words();
    int32_t up_to = value;
#if defined(__CUDA_ARCH__)
    GIGA_UNROLL
    for (int apart = 1; apart < kWarp; apart *= 2) {
      const int32_t other = __shfl_up_sync(~0u, up_to, apart);
      up_to += lane >= apart ? other : 0;
    }
#else
    int32_t* const said = reinterpret_cast<int32_t*>(stage) + kStageNumbers - kWarp;
    said[lane] = value;
    sync.wait_for_warp();
    for (int k = 0; k < lane; ++k) up_to += said[k];
#endif
    if (lane == kWarp - 1) of_warps[warp] = up_to;
    wait();
    SumBefore sum{up_to - value, 0};
    for (int k = 0; k < n_threads / kWarp; ++k) {
      sum.before += k < warp ? of_warps[k] : 0;
      sum.all += of_warps[k];
    }
    return sum;
  }
  GIGA_HD void wait_sent() const {}
  GIGA_HD void wait_delivered() const {}
  /// They share one world, so all hand in the same. Where it is true, what it was read from may change next: nobody
  /// goes on before all have read it.
  GIGA_HD bool any(bool flag) const {
    if (flag) sync.wait();
    return flag;
  }
};

}  // namespace giga
