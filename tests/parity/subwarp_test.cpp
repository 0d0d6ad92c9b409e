// What the lanes of a crew say to each other (cuda/subwarp.hpp, cuda/search_crew.hpp), without a GPU.
#include "cuda/subwarp.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <type_traits>
#include <vector>

#include "cuda/search_crew.hpp"
#include "parity/lockstep_threads.hpp"

namespace giga::test {
namespace {

struct WarpSync {
  LockstepThreads* threads;
  void wait_for_warp() const { threads->wait(); }
  bool any_of_warp(bool flag) const { return threads->any(flag); }
};

/// By the lanes of a crew.
template <class Lanes>
class SubwarpOf : public ::testing::Test {
 protected:
  static constexpr int kLanes = Lanes::value;
  using Crew = Subwarp<kLanes, WarpSync>;

  /// Runs body(crew, lane) for the 32 lanes of a warp, in each order.
  template <class Body>
  static void run_warp(Body&& body) {
    for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
      LockstepThreads threads(kWarp);
      std::vector<int32_t> words(Crew::kWords, -1);
      threads.run(kWarp, order, [&](int lane) { body(Crew(WarpSync{&threads}, lane, words.data()), lane); });
    }
  }
};
using CrewLanes = ::testing::Types<std::integral_constant<int, 4>, std::integral_constant<int, 8>>;
TYPED_TEST_SUITE(SubwarpOf, CrewLanes);

TYPED_TEST(SubwarpOf, SaysWhatItsMembersSay) {
  constexpr int kMembers = TestFixture::kLanes;
  constexpr uint32_t kAll = (1u << kMembers) - 1;
  this->run_warp([](const auto& crew, int lane) {
    const int first = lane / kMembers * kMembers;  // of the crew
    EXPECT_EQ(crew.index(), lane % kMembers);
    EXPECT_EQ(crew.leads(), lane % kMembers == 0);
    EXPECT_EQ(crew.ballot(lane % kMembers == 3), 8u);  // member 3 alone: bit 3
    // Lanes 0 to 9 are two crews of four and two members of the third, or one of eight and two members of the second.
    EXPECT_EQ(crew.ballot(lane < 10), first + kMembers <= 10 ? kAll : first < 10 ? 3u : 0u);
    EXPECT_EQ(crew.from(static_cast<uint32_t>(10 * lane), 2), static_cast<uint32_t>(10 * (first + 2)));
    EXPECT_EQ(crew.sum(lane), kMembers * first + kMembers * (kMembers - 1) / 2);  // first + (first + 1) + ...
    EXPECT_EQ(crew.either(1u << lane), kAll << first);
    EXPECT_TRUE(crew.any(lane == 31));
    EXPECT_FALSE(crew.any(false));
  });
}

/// Runs body(crew, lane) for the 32 lanes of a warp, in each order.
template <int kLanes, class Body>
void run_search_crews(Body&& body) {
  using Crew = SearchCrew<kLanes, WarpSync>;
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    LockstepThreads threads(kWarp);
    std::vector<uint64_t> words(Crew::kWords / 2 + 1);
    threads.run(kWarp, order, [&](int lane) { body(Crew(WarpSync{&threads}, lane, words.data()), lane); });
  }
}

TEST(SearchCrew, OfAWarpSaysWhatItsMembersSay) {
  run_search_crews<32>([](const auto& warp, int lane) {
    EXPECT_EQ(warp.index(), lane);
    EXPECT_EQ(warp.leads(), lane == 0);
    EXPECT_TRUE(warp.any(true));
    EXPECT_EQ(warp.ballot(lane == 3 || lane == 31), 0x80000008u);
    EXPECT_EQ(warp.from(10 * lane, 31 - lane), 10 * (31 - lane)) << "each asks another one";
    EXPECT_EQ(warp.sum_up_to(lane), lane * (lane + 1) / 2);
  });
}

TEST(SearchCrew, OfHalfAWarpSaysWhatItsMembersSay) {
  run_search_crews<16>([](const auto& half, int lane) {
    const int member = lane % 16, first = lane - member;
    EXPECT_EQ(half.index(), member);
    EXPECT_EQ(half.leads(), lane == 0 || lane == 16);
    EXPECT_TRUE(half.any(lane >= 16)) << "of any of the two";
    EXPECT_FALSE(half.any(false));
    EXPECT_EQ(half.ballot(lane == 3 || lane == 31), lane < 16 ? 0x8u : 0x8000u);
    EXPECT_EQ(half.from(10 * lane, 15 - member), 10 * (first + 15 - member)) << "each asks another one";
    EXPECT_EQ(half.sum_up_to(lane), (member + 1) * first + member * (member + 1) / 2);  // first + (first + 1) + ...
    half.search().places[member] = lane;
    half.meet();
    EXPECT_EQ(half.search().places[15 - member], first + 15 - member) << "each half has memory of its own";
  });
}

// Member m takes m numbers: together 0 + 1 + ... + (lanes - 1), each once.
TYPED_TEST(SubwarpOf, CountsTogether) {
  constexpr int kMembers = TestFixture::kLanes, kTaken = kMembers * (kMembers - 1) / 2;
  std::vector<int> taken(kMembers * kWarp);
  this->run_warp([&](const auto& crew, int lane) {
    typename TestFixture::Crew::Counter counter(crew);
    for (int k = 0; k < lane % kMembers; ++k) taken[static_cast<size_t>(kMembers * lane + k)] = counter.take();
    EXPECT_EQ(counter.count(), kTaken);
    if (!crew.leads()) return;
    std::vector<int> all;
    for (int member = 1; member < kMembers; ++member)
      for (int k = 0; k < member; ++k) all.push_back(taken[static_cast<size_t>(kMembers * (lane + member) + k)]);
    std::ranges::sort(all);
    std::vector<int> expected(kTaken);
    std::iota(expected.begin(), expected.end(), 0);
    EXPECT_EQ(all, expected);
  });
}

// Crew k lists 3 k places or, the third one, none; is asked up to three times about each, and takes those that are
// even.
TYPED_TEST(SubwarpOf, ListsAndAsks) {
  constexpr int kMembers = TestFixture::kLanes;
  this->run_warp([](const auto& crew, int lane) {
    const int group = lane / kMembers, n = group == 2 ? 0 : 3 * group;
    typename TestFixture::Crew::List list(crew);
    for (int round = 0; round < 2; ++round) {
      list.clear();
      bool more = true;
      for (int begin = 0; crew.any(more); begin += kMembers) {
        EXPECT_TRUE(list.has_room());
        const int place = begin + crew.index();
        list.add(place < n, 100 * round + place);
        more = begin + kMembers < n;
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
