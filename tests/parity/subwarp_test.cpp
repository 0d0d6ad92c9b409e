// What the lanes of a crew say to each other (cuda/subwarp.hpp), without a GPU.
#include "cuda/subwarp.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <numeric>
#include <vector>

#include "parity/lockstep_threads.hpp"

namespace giga::test {
namespace {

constexpr int kLanes = 4;
struct WarpSync {
  LockstepThreads* threads;
  void wait_for_warp() const { threads->wait(); }
  bool any_of_warp(bool flag) const { return threads->any(flag); }
};
using Crew = Subwarp<kLanes, WarpSync>;

/// Runs body(crew, lane) for the 32 lanes of a warp, in each order.
void run_warp(const std::function<void(const Crew&, int)>& body) {
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    LockstepThreads threads(kWarp);
    std::vector<int32_t> words(Crew::kWords, -1);
    threads.run(kWarp, order, [&](int lane) { body(Crew(WarpSync{&threads}, lane, words.data()), lane); });
  }
}

TEST(Subwarp, SaysWhatItsMembersSay) {
  run_warp([](const Crew& crew, int lane) {
    EXPECT_EQ(crew.index(), lane % 4);
    EXPECT_EQ(crew.leads(), lane % 4 == 0);
    // Of lanes 4 k to 4 k + 3 only the last is odd and above 1: bit 3.
    EXPECT_EQ(crew.ballot(lane % 4 == 3), 8u);
    EXPECT_EQ(crew.ballot(lane < 6), lane < 4 ? 15u : lane < 8 ? 3u : 0u);
    EXPECT_EQ(crew.from(static_cast<uint32_t>(10 * lane), 2), static_cast<uint32_t>(10 * (lane / 4 * 4 + 2)));
    EXPECT_EQ(crew.sum(lane), 4 * (lane / 4 * 4) + 6);  // 4 k + (4 k + 1) + (4 k + 2) + (4 k + 3)
    EXPECT_EQ(crew.either(1u << lane), 15u << (lane / 4 * 4));
    EXPECT_TRUE(crew.any(lane == 31));
    EXPECT_FALSE(crew.any(false));
  });
}

TEST(Subwarp, CountsTogether) {
  std::vector<int> taken(3 * kWarp);
  run_warp([&](const Crew& crew, int lane) {
    Crew::Counter counter(crew);
    for (int k = 0; k < lane % 4; ++k) taken[static_cast<size_t>(3 * lane + k)] = counter.take();
    EXPECT_EQ(counter.count(), 0 + 1 + 2 + 3);
    if (!crew.leads()) return;
    std::vector<int> all;
    for (int member = 1; member < 4; ++member)
      for (int k = 0; k < member; ++k) all.push_back(taken[static_cast<size_t>(3 * (lane + member) + k)]);
    std::ranges::sort(all);
    std::vector<int> expected(6);
    std::iota(expected.begin(), expected.end(), 0);
    EXPECT_EQ(all, expected);
  });
}

// Crew k lists 3 k places or none, is asked up to three times about each, and takes those that are even.
TEST(Subwarp, ListsAndAsks) {
  run_warp([](const Crew& crew, int lane) {
    const int group = lane / 4, n = group == 5 ? 0 : 3 * group;
    Crew::List list(crew);
    for (int round = 0; round < 2; ++round) {
      list.clear();
      bool more = true;
      for (int begin = 0; crew.any(more); begin += kLanes) {
        EXPECT_TRUE(list.has_room());
        const int place = begin + crew.index();
        list.add(place < n, 100 * round + place);
        more = begin + kLanes < n;
      }
      EXPECT_EQ(list.empty(), n == 0);
      list.ask([&](int32_t place, int turn) {
        if (turn < place % 3) return Answer::ask_again;
        return place % 2 == 0 ? Answer::yes : Answer::no;
      });
      int32_t place = -1;
      for (int k = 0; k < n; k += 2) {
        ASSERT_TRUE(list.take(place));
        EXPECT_EQ(place, 100 * round + k);
      }
      EXPECT_FALSE(list.take(place));
    }
  });
}

}  // namespace
}  // namespace giga::test
