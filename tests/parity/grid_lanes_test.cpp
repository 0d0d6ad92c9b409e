// What the lanes of a world of many agents add up together (cuda/grid_lanes.hpp), without a GPU.
#include "cuda/grid_lanes.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "parity/lockstep_threads.hpp"

namespace giga::test {
namespace {

/// Threads of which as many share all barriers as LockstepThreads has in a group; it counts which they asked for.
struct WarpsSync {
  LockstepThreads* threads;
  int* of_block_waits = nullptr;
  int* of_warp_waits = nullptr;

  void wait() const {
    if (of_block_waits) ++*of_block_waits;
    threads->wait();
  }
  void wait_for_warp() const {
    if (of_warp_waits) ++*of_warp_waits;
    threads->wait();
  }
  bool any_of_warp(bool flag) const { return threads->any(flag); }
  WarpsSync of_block() const { return *this; }
};

/// Numbers whose sum depends on their order.
float number_of(int item, int k) { return 1.0f / static_cast<float>(1 + (k * 37 + item * 11) % 101); }

/// By blocks of 64, then over these.
float sum_of(int item, int count) {
  float all = 0;
  for (int front = 0; front < count; front += 64) {
    float block = 0;
    for (int k = front; k < count && k < front + 64; ++k) block += number_of(item, k);
    all += block;
  }
  return all;
}

// Two halves of a warp see to five items, so that one of them has none at last: of 65 numbers, of as many as are added
// up at once, of one block and one number, and of none.
TEST(GridLanes, AddUpSumsOfSums) {
  const std::vector<int> counts = {65, 512, 64, 1, 0};
  const int n = static_cast<int>(counts.size());
  float in_order = 0;
  for (int k = 0; k < 512; ++k) in_order += number_of(1, k);
  EXPECT_NE(in_order, sum_of(1, 512)) << "blocks matter";
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    LockstepThreads threads(kWarp);
    std::vector<float> stage(kStageNumbers, -1), sums(counts.size(), -1), masked(counts.size(), -1);
    threads.run(kWarp, order, [&](int lane) {
      const GridLanes<WarpsSync, 1> lanes{lane, kWarp, 0, 1, lane, kWarp, WarpsSync{&threads}, stage.data(), false};
      lanes.each_sum<64>(
          n, [&](int item) { return counts[static_cast<size_t>(item)]; },
          [&](int item, int k) {
            return StepSum{number_of(item, k), 2 * number_of(item, k)};
          },
          [&](int item, const StepSum& sum) {
            sums[static_cast<size_t>(item)] = sum.sum;
            masked[static_cast<size_t>(item)] = sum.masked;
          });
    });
    for (int item = 0; item < n; ++item) {
      const float expected = sum_of(item, counts[static_cast<size_t>(item)]);
      EXPECT_EQ(sums[static_cast<size_t>(item)], expected) << "item " << item;
      EXPECT_EQ(masked[static_cast<size_t>(item)], 2 * expected) << "item " << item << ": twice each number";
      const StepSum alone = add_up(counts[static_cast<size_t>(item)], [&](int k) {
        return StepSum{number_of(item, k), 2 * number_of(item, k)};
      });
      EXPECT_EQ(alone.sum, expected) << "item " << item << ", by one worker";
      EXPECT_EQ(alone.masked, 2 * expected) << "item " << item << ", by one worker";
    }
  }
}

// A block of 64 threads has room for 640 / 65 = 9 rows at a time, a warp for 320 / 65 = 4: eleven rows are two turns or
// three, of as many numbers as threads, one less, one more than a warp, one, and none. Five items are three turns of
// two blocks and two of four warps, so that groups have several items, and some have none at last.
TEST(GridLanes, AddUpRows) {
  constexpr int kRows = 11, kItems = 5, kBlock = 64, kBlocks = 2, kThreads = kBlocks * kBlock;
  for (const int count : {64, 63, 33, 1, 0})
    for (const bool by_warp : {false, true})
      for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
        LockstepThreads threads(kThreads);
        std::vector<float> stage(kThreads / kWarp * kStageNumbers, -1), sums(kItems * kRows, -1);
        int of_block_waits = 0, of_warp_waits = 0, none = 0;
        threads.run(by_warp ? kWarp : kBlock, order, [&](int thread) {
          const GridLanes<WarpsSync, 1> lanes{thread,
                                              kThreads,
                                              thread / kBlock,
                                              kBlocks,
                                              thread % kBlock,
                                              kBlock,
                                              WarpsSync{&threads, &of_block_waits, &of_warp_waits},
                                              &stage[static_cast<size_t>(thread / kWarp * kStageNumbers)],
                                              false};
          const auto add_up = [&](const auto& group, int item, bool some) {
            none += some ? 0 : 1;
            group.template sum_rows<64>(
                kRows, some ? count : 0, [&](int row, int k) { return number_of(row + item, k); },
                [&](int row, float sum) {
                  if (some) sums[static_cast<size_t>(item * kRows + row)] = sum;
                });
          };
          if (by_warp)
            lanes.each_warp(kItems, add_up);
          else
            lanes.each_block(kItems, add_up);
        });
        for (int item = 0; item < kItems; ++item)
          for (int row = 0; row < kRows; ++row)
            EXPECT_EQ(sums[static_cast<size_t>(item * kRows + row)], sum_of(row + item, count))
                << "item " << item << ", row " << row << " of " << count << (by_warp ? ", by a warp" : ", by a block");
        EXPECT_EQ(none, by_warp ? 3 * kWarp : kBlock) << "without an item at last: three warps, one block";
        EXPECT_EQ(of_warp_waits > 0, by_warp) << "a block waits for all its warps";
        EXPECT_EQ(of_block_waits > 0, !by_warp) << "a warp waits for none but itself";
      }
}

}  // namespace
}  // namespace giga::test
