// The emulation finds what it is there to find: a barrier that is missing, and threads that part.
#include <gtest/gtest.h>

#include <vector>

#include "core/error.hpp"
#include "parity/lockstep_threads.hpp"

namespace giga::test {
namespace {

constexpr int kThreads = 8;

/// Each thread writes its number, then adds up what its two neighbors (in a ring) have written.
std::vector<int> sums_of_neighbors(ThreadOrder order, bool with_barrier) {
  LockstepThreads threads(kThreads);
  std::vector<int> written(kThreads, 100), sums(kThreads, 0);
  threads.run(kThreads, order, [&](int k) {
    written[static_cast<size_t>(k)] = k;
    if (with_barrier) threads.wait();
    sums[static_cast<size_t>(k)] =
        written[static_cast<size_t>((k + 1) % kThreads)] + written[static_cast<size_t>((k + kThreads - 1) % kThreads)];
  });
  return sums;
}

TEST(LockstepThreads, AMissingBarrierChangesTheResult) {
  const std::vector<int> right = {1 + 7, 0 + 2, 1 + 3, 2 + 4, 3 + 5, 4 + 6, 5 + 7, 6 + 0};
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    EXPECT_EQ(sums_of_neighbors(order, true), right);
    EXPECT_NE(sums_of_neighbors(order, false), right);
  }
  // Forwards thread 1 finds 0 of thread 0 and nothing yet of thread 2; backwards it finds the reverse.
  EXPECT_EQ(sums_of_neighbors(ThreadOrder::forward, false)[1], 0 + 100);
  EXPECT_EQ(sums_of_neighbors(ThreadOrder::backward, false)[1], 100 + 2);
}

TEST(LockstepThreads, AnyAsksTheOwnGroupOnly) {
  LockstepThreads threads(kThreads);
  std::vector<int> answers(kThreads, -1);
  threads.run(4, ThreadOrder::forward, [&](int k) { answers[static_cast<size_t>(k)] = threads.any(k == 5) ? 1 : 0; });
  EXPECT_EQ(answers, (std::vector<int>{0, 0, 0, 0, 1, 1, 1, 1}));
}

TEST(LockstepThreads, GroupsMayHaveDifferentNumbersOfBarriers) {
  LockstepThreads threads(kThreads);
  std::vector<int> steps(kThreads, 0);
  threads.run(4, ThreadOrder::shuffled, [&](int k) {
    for (int round = 0; round < 2 + k / 4; ++round, ++steps[static_cast<size_t>(k)]) threads.wait();
  });
  EXPECT_EQ(steps, (std::vector<int>{2, 2, 2, 2, 3, 3, 3, 3}));
}

TEST(LockstepThreads, ThreadsThatPartAreAnError) {
  LockstepThreads leaves(kThreads), asks(kThreads);
  EXPECT_THROW(leaves.run(kThreads, ThreadOrder::forward,
                          [&](int k) {
                            if (k != 3) leaves.wait();
                          }),
               Error);
  EXPECT_THROW(asks.run(kThreads, ThreadOrder::forward, [&](int k) { k == 3 ? asks.any(true) : (asks.wait(), true); }),
               Error);
}

TEST(LockstepThreads, AnErrorOfAThreadIsRethrown) {
  LockstepThreads threads(kThreads);
  EXPECT_THROW(threads.run(kThreads, ThreadOrder::forward, [&](int k) { GIGA_CHECK(k != 3, "thread ", k); }), Error);
}

}  // namespace
}  // namespace giga::test
