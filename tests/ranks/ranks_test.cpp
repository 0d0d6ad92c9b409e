// What ranks tell each other, and what the others learn of one that is gone. The ranks are threads of this process.
#include <ATen/ATen.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>
#include <future>
#include <thread>

#include "core/error.hpp"
#include "ranks/divided_arrays.hpp"
#include "ranks/ranks.hpp"

namespace giga {
namespace {

using std::chrono::milliseconds;

/// Runs `work` as each of n ranks. -> what each threw; empty where nothing.
std::vector<std::string> as_ranks(int n, const std::function<void(Ranks&)>& work, RankPatience patience = {}) {
  const RankServer server;
  std::vector<std::string> errors(static_cast<size_t>(n));
  std::vector<std::thread> threads;
  for (int rank = 0; rank < n; ++rank)
    threads.emplace_back([&, rank] {
      try {
        const auto ranks =
            join_ranks({.rank = rank, .size = n, .port = server.port(), .served = true, .attempt = "0"}, patience);
        work(*ranks);
      } catch (const Error& e) {
        errors[static_cast<size_t>(rank)] = e.what();
      }
    });
  for (std::thread& thread : threads) thread.join();
  return errors;
}

TEST(Ranks, GatherAddAndBroadcastInOrder) {
  const std::vector<std::string> errors = as_ranks(8, [](Ranks& ranks) {
    for (int round = 0; round < 3; ++round) {
      const std::vector<std::string> all = ranks.gather(cat("rank ", ranks.rank(), " round ", round));
      ASSERT_EQ(all.size(), 8u);
      for (int r = 0; r < 8; ++r) EXPECT_EQ(all[static_cast<size_t>(r)], cat("rank ", r, " round ", round));
    }
    // fp32: 1e8 + 1 = 1e8, so ((1e8 + 1) + ... + 1) - 1e8 = 0; the other order gives 6.
    at::Tensor x = at::ones({2});
    if (ranks.rank() == 0) x.fill_(1e8);
    if (ranks.rank() == 7) x.fill_(-1e8);
    ranks.all_reduce_sum(x);
    EXPECT_TRUE(at::equal(x, at::zeros({2}))) << x;
    const auto tensors =
        ranks.gather_tensors({at::full({2, 3}, ranks.rank(), at::kDouble), at::full({}, -ranks.rank(), at::kInt)});
    ASSERT_EQ(tensors.size(), 8u);
    for (int r = 0; r < 8; ++r) {
      EXPECT_TRUE(at::equal(tensors[static_cast<size_t>(r)].at(0), at::full({2, 3}, r, at::kDouble)));
      EXPECT_TRUE(at::equal(tensors[static_cast<size_t>(r)].at(1), at::full({}, -r, at::kInt)));
    }
    at::Tensor y = at::full({4}, ranks.rank(), at::kLong);
    ranks.broadcast(y, 5);
    EXPECT_TRUE(at::equal(y, at::full({4}, 5, at::kLong)));
    ranks.leave();
  });
  for (const std::string& error : errors) EXPECT_EQ(error, "");
}

TEST(Ranks, ShareTheRowsOfAnArrayAndPutThemTogetherAgain) {
  const auto errors = as_ranks(2, [](Ranks& ranks) {
    NamedArray whole = make_array<float>("x", {0, 1, 2, 3, 4, 5, 6, 7});
    whole.shape = {4, 2};
    NamedArray mine = own_rows(ranks, whole);
    EXPECT_EQ(mine.shape, (std::vector<int64_t>{2, 2}));
    EXPECT_EQ(array_values<float>(mine).front(), ranks.rank() == 0 ? 0 : 4);
    gather_rows(ranks, mine);
    EXPECT_EQ(mine.shape, whole.shape);
    EXPECT_EQ(mine.bytes, whole.bytes);
    EXPECT_THROW(own_rows(ranks, make_array<float>("y", {1, 2, 3})), InputError);
    // Of one rank, which may have another number of them.
    NamedArray some = make_array<float>("z", std::vector<float>(ranks.rank() == 0 ? 0 : 6, 5.0f));
    some.shape = {ranks.rank() == 0 ? 0 : 3, 2};
    broadcast_rows(ranks, some, 1);
    EXPECT_EQ(some.shape, (std::vector<int64_t>{3, 2}));
    EXPECT_EQ(array_values<float>(some), std::vector<float>(6, 5.0f));
    ranks.leave();
  });
  for (const std::string& error : errors) EXPECT_EQ(error, "");
}

TEST(Ranks, TakeTextsThatTheStoreDoesNotTakeInOnePiece) {
  // 9 MiB, and again: pieces of 4 MiB, of which those of an earlier call are cleared.
  const auto errors = as_ranks(2, [](Ranks& ranks) {
    for (int round = 0; round < 3; ++round) {
      const auto letter = [&](int rank) { return static_cast<char>('a' + 2 * round + rank); };
      const std::vector<std::string> all = ranks.gather(std::string(9 << 20, letter(ranks.rank())));
      for (int r = 0; r < 2; ++r) EXPECT_TRUE(all[static_cast<size_t>(r)] == std::string(9 << 20, letter(r)));
    }
    ranks.leave();
  });
  for (const std::string& error : errors) EXPECT_EQ(error, "");
}

TEST(Ranks, LearnWhyAnotherOneFailed) {
  const auto errors = as_ranks(3, [](Ranks& ranks) {
    if (ranks.rank() == 1) return ranks.report_failure("out of memory");
    ranks.gather("");
  });
  EXPECT_EQ(errors[0], "rank 1 has failed: out of memory");
  EXPECT_EQ(errors[2], errors[0]);
}

TEST(Ranks, NameTheOneThatIsGoneAndTheOneThatHangs) {
  const auto gone = as_ranks(2,
                             [](Ranks& ranks) {
                               if (ranks.rank() == 0)
                                 ranks.gather("");  // the other is destroyed, and its heart with it
                             },
                             {.silence = milliseconds(2500)});
  EXPECT_EQ(gone[0], "rank 1 of 2 has not been heard of for 2.5 s: it is dead, stopped or cut off");

  const auto hangs = as_ranks(2,
                              [](Ranks& ranks) {
                                if (ranks.rank() == 0) ranks.gather("");
                                if (ranks.rank() == 1) std::this_thread::sleep_for(milliseconds(2500));
                              },
                              {.answer = milliseconds(1500)});
  EXPECT_EQ(hangs[0], "rank 1 of 2 lives, but hangs: no answer within 1.5 s");
}

/// A wait for the others that only the store can end, as that for a sum of a GPU.
struct Elsewhere {
  std::promise<void> given_up;
  OutsideWait wait(int64_t begun) {
    return {[begun] { return begun; }, [this] { given_up.set_value(); }};
  }
  bool ends(std::chrono::seconds within) { return given_up.get_future().wait_for(within) == std::future_status::ready; }
};

TEST(Ranks, GiveUpAWaitElsewhereForOneThatFailedOrIsGoneOrHangs) {
  // What rank 0 throws while it waits, and rank 1 does not come: `other` is what that one does instead.
  const auto thrown = [](const std::function<void(Ranks&)>& other, RankPatience patience) {
    return as_ranks(
        2,
        [&](Ranks& ranks) {
          if (ranks.rank() == 1) return other(ranks);
          Elsewhere elsewhere;
          ranks.begin_outside(elsewhere.wait(12));
          EXPECT_TRUE(elsewhere.ends(std::chrono::seconds(20)));
          ranks.end_outside();
        },
        patience);
  };
  EXPECT_EQ(thrown([](Ranks& ranks) { ranks.report_failure("out of memory"); }, {})[0],
            "rank 1 has failed: out of memory");
  EXPECT_EQ(thrown([](Ranks&) {}, {.silence = milliseconds(2500)})[0],
            "rank 1 of 2 has not been heard of for 2.5 s: it is dead, stopped or cut off");
  // It waits elsewhere too, but has begun less.
  const auto hangs = thrown(
      [](Ranks& ranks) {
        Elsewhere elsewhere;
        ranks.begin_outside(elsewhere.wait(7));
        EXPECT_TRUE(elsewhere.ends(std::chrono::seconds(20)));
        ranks.end_outside();
      },
      {.answer = milliseconds(2500)});
  // Whoever notices first says it to both.
  EXPECT_EQ(hangs[0], hangs[1]);
  EXPECT_TRUE(hangs[0] == "rank 1 of 2 lives, but hangs: it has begun 7 sums and rank 0 12, no answer within 2.5 s" ||
              hangs[0] == "all 2 ranks live, but rank 1 waits for a sum over them: no answer within 2.5 s")
      << hangs[0];
}

TEST(Ranks, WaitElsewhereAndGoOn) {
  const auto errors = as_ranks(2, [](Ranks& ranks) {
    for (int round = 0; round < 2; ++round) {
      Elsewhere elsewhere;
      ranks.begin_outside(elsewhere.wait(round));
      EXPECT_FALSE(elsewhere.ends(std::chrono::seconds(round == 0 ? 2 : 0)));
      ranks.end_outside();
    }
    ranks.leave();
  });
  for (const std::string& error : errors) EXPECT_EQ(error, "");
}

// A sum that has failed by itself, as by a cut cable, is told to all.
TEST(Ranks, TellOfAWaitElsewhereThatFails) {
  const auto errors = as_ranks(2, [](Ranks& ranks) {
    Elsewhere elsewhere;
    OutsideWait wait = elsewhere.wait(0);
    if (ranks.rank() == 1) wait.begun = []() -> int64_t { throw Error("NCCL: remote error"); };
    ranks.begin_outside(wait);
    EXPECT_TRUE(elsewhere.ends(std::chrono::seconds(20)));
    ranks.end_outside();
  });
  for (const std::string& error : errors) EXPECT_EQ(error, "rank 1 has failed: NCCL: remote error");
}

// The process is ended where giving up does not end the wait.
TEST(RanksDeathTest, EndTheProcessWhereTheWaitDoesNotEnd) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(as_ranks(2,
                       [](Ranks& ranks) {
                         if (ranks.rank() == 1) return ranks.report_failure("out of memory");
                         ranks.begin_outside({[] { return 0; }, [] {}});
                         std::this_thread::sleep_for(std::chrono::seconds(60));
                       },
                       {.giving_up = milliseconds(500)}),
              testing::ExitedWithCode(1), "gigastep: rank 0: rank 1 has failed: out of memory");
}

/// Joins ranks whose store another process serves, and speaks with them when that process is stopped.
void speak_to_a_stopped_store() {
  int port_of_child[2];
  ASSERT_EQ(::pipe(port_of_child), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    const RankServer server;
    const int port = server.port();
    if (::write(port_of_child[1], &port, sizeof port) != sizeof port) ::_exit(1);
    while (true) ::pause();
  }
  int port = 0;
  ASSERT_EQ(::read(port_of_child[0], &port, sizeof port), static_cast<ssize_t>(sizeof port));
  const auto ranks = join_ranks({.rank = 0, .size = 1, .port = port, .served = true, .attempt = "0"},
                                {.silence = milliseconds(2000), .giving_up = milliseconds(500)});
  ::kill(child, SIGSTOP);
  int status = 0;  // it stops some time after the signal, and could answer until then
  ASSERT_EQ(::waitpid(child, &status, WUNTRACED), child);
  ranks->barrier();
}

// A call of the store has no end then: neither the main thread nor the heart comes back.
TEST(RanksDeathTest, EndTheProcessWhereTheStoreDoesNotAnswer) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(speak_to_a_stopped_store(), testing::ExitedWithCode(1),
              "gigastep: rank 0: no answer from the store at 127.0.0.1:[0-9]+ for 3 s: the process "
              "that started the ranks is dead, stopped or cut off");
}

}  // namespace
}  // namespace giga
