// How many runs at once: what rates decide, and how the rates are read from rows that come.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "sweep/parallel_search.hpp"
#include "sweep/rate_meter.hpp"
#include "sweep/run_tail.hpp"

namespace giga {
namespace {

TEST(SweepParallel, OneMoreWhileItPaysAndThenBackByOne) {
  ParallelSearch search(8);
  EXPECT_EQ(search.runs(), 1);
  EXPECT_EQ(search.measured(1e6), "parallel: 1 run at once: 1.00 M agent-steps/s; trying 2");
  EXPECT_EQ(search.measured(1.6e6), "parallel: 2 runs at once: 1.60 M agent-steps/s, 60 % more than with 1; trying 3");
  EXPECT_EQ(search.runs(), 3);
  EXPECT_FALSE(search.is_settled());
  // 1.632 / 1.6 = 1.02: less than 1.05.
  EXPECT_EQ(
      search.measured(1.632e6),
      "parallel: 3 runs at once: 1.63 M agent-steps/s, 2 % more than with 2, where 5 % more are wanted; 2 runs at "
      "once from here on");
  EXPECT_EQ(search.runs(), 2);
  EXPECT_TRUE(search.is_settled());
  EXPECT_THROW(search.measured(9e9), Error) << "it stays";
}

TEST(SweepParallel, TheShareThatAGainMustHave) {
  for (const auto& [rate, runs] : {std::pair{104.0, 1}, {106.0, 3}, {50.0, 1}}) {
    ParallelSearch search(8);
    search.measured(100);
    search.measured(rate);
    EXPECT_EQ(search.runs(), runs) << rate;
    EXPECT_EQ(search.is_settled(), runs == 1) << rate;
  }
}

// Each step is compared with the one before, not with the first.
TEST(SweepParallel, ManySmallGainsAreNotOne) {
  ParallelSearch search(8);
  search.measured(100);
  search.measured(150);
  search.measured(153);
  EXPECT_EQ(search.runs(), 2);
}

TEST(SweepParallel, NeverMoreThanTheBound) {
  ParallelSearch one(1), two(2);
  EXPECT_EQ(one.measured(100),
            "parallel: 1 run at once: 100 agent-steps/s, the most that this machine has cores for; 1 run at once from "
            "here on");
  EXPECT_TRUE(one.is_settled());
  two.measured(100);
  EXPECT_FALSE(two.is_settled());
  two.measured(190);
  EXPECT_TRUE(two.is_settled());
  EXPECT_EQ(two.runs(), 2);
  EXPECT_THROW(ParallelSearch(0), Error);
}

TEST(SweepParallel, AFailureOfOneMoreGoesBack) {
  ParallelSearch search(8);
  EXPECT_THROW(search.failed(), Error) << "one run alone fails by itself";
  search.measured(100);
  EXPECT_EQ(search.failed(), "parallel: a run failed while 2 runs at once were tried; 1 run at once from here on");
  EXPECT_TRUE(search.is_settled());
  EXPECT_EQ(search.runs(), 1);
}

TEST(SweepRate, OfOneRunIsThatOfItsWholeUpdates) {
  RateMeter meter(4, 2);  // 4 seconds and 2 readings
  meter.begin(1);
  meter.look({{1, 0, 0, false}});
  meter.look({{1, 100, 9, true}});  // loading is in this update
  meter.look({{1, 100, 9, true}});
  EXPECT_FALSE(meter.rate());
  meter.look({{1, 200, 11, true}});
  EXPECT_FALSE(meter.rate()) << "one reading, 2 seconds";
  meter.look({{1, 300, 13, true}});
  // 200 agent-steps in 4 seconds.
  EXPECT_EQ(meter.rate(), 50);
}

TEST(SweepRate, OfTwoRunsCountsWhatBothDidSideBySide) {
  RateMeter meter(2, 1);
  meter.begin(2);
  meter.look({{1, 100, 1, true}});
  meter.look({{1, 900, 2, true}, {2, 0, 0, false}});   // fast while the other loads
  meter.look({{1, 1700, 3, true}, {2, 50, 5, true}});  // these updates may have begun before
  EXPECT_FALSE(meter.rate());
  meter.look({{1, 1800, 4, true}, {2, 70, 6, true}});
  EXPECT_FALSE(meter.rate()) << "2 seconds of updates, of 2 runs 4 are wanted";
  meter.look({{1, 1900, 5, true}, {2, 90, 7, true}});
  // 100 agent-steps/s of the one, 20 of the other: 240 in 4 seconds of updates, twice.
  EXPECT_EQ(meter.rate(), 120);
  meter.begin(3);
  EXPECT_FALSE(meter.rate());
}

TEST(SweepRate, ARunThatEndsMakesTheOthersNoFaster) {
  RateMeter meter(1, 0);
  meter.begin(2);
  const auto both = [&](double first, double second) {
    meter.look({{1, first, first / 10, true}, {2, second, second / 10, true}});
  };
  both(10, 10);
  both(20, 20);
  meter.ended({1, 0, 0, false}, {1, 20, 2, true});  // no whole update of it was seen: 20 agent-steps in 2 seconds
  meter.look({{2, 120, 3, true}});                  // alone
  meter.look({{2, 220, 4, true}, {3, 0, 0, false}});
  EXPECT_EQ(meter.rate(), 20) << "twice 10/s";
}

std::string row_of_run(int update, double value) {
  // 100 agent-steps each, in half a second.
  return cat(update, ",", 100 * update, ",", update, ",0.5,200,", value, "\n");
}

TEST(SweepTail, ReadsWhatIsNewAndACutFileAnew) {
  const test::TemporaryFolder folder;
  SweepSpec spec;
  spec.metric = {"a"};
  spec.last_values = 2;
  const std::filesystem::path file = folder / "metrics.csv";
  RunTail tail(spec, folder.path());
  tail.look();
  EXPECT_EQ(tail.agent_steps(), 0) << "there is no file yet";
  const std::string head = "update,agent_steps,seconds,update_seconds,agent_steps_per_second,a\n";
  write_file(file, head);
  tail.look();
  EXPECT_FALSE(tail.metric());
  const auto append = [&](const std::string& text) { std::ofstream(file, std::ios::app) << text; };
  append(row_of_run(1, 0.5) + "2,200,2,0.5,20");
  tail.look();
  EXPECT_EQ(tail.agent_steps(), 100) << "half a row is none";
  append("0,0.7\n3,300,3,0.5,200,\n" + row_of_run(4, 0.9));
  tail.look();
  EXPECT_EQ(tail.agent_steps(), 400);
  EXPECT_EQ(tail.update_seconds(), 2);
  EXPECT_EQ(tail.speed(), 200);
  EXPECT_NEAR(tail.metric().value(), 0.8, 1e-12) << "the last two that are known";
  // Resumed after update 1.
  write_file(file, head + row_of_run(1, 0.5));
  tail.look();
  EXPECT_EQ(tail.agent_steps(), 100);
  EXPECT_EQ(tail.update_seconds(), 0.5);
  EXPECT_EQ(tail.metric(), 0.5);
  // Cut and grown again between two looks, to the same length and beyond.
  write_file(file, head);
  append(row_of_run(1, 0.25) + row_of_run(2, 0.35));
  for (int k = 0; k < 2; ++k) tail.look();
  EXPECT_EQ(tail.agent_steps(), 200);
  std::filesystem::remove(file);
  tail.look();
  EXPECT_EQ(tail.agent_steps(), 0);
}

}  // namespace
}  // namespace giga
