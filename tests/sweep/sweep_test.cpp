// What a sweep tries, in which order trials go on, what is remembered of it, and what its results say.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "support/source.hpp"
#include "sweep/analysis.hpp"
#include "sweep/journal.hpp"
#include "sweep/outcome.hpp"
#include "sweep/progress.hpp"
#include "sweep/sobol.hpp"
#include "sweep/space.hpp"

namespace giga {
namespace {
namespace fs = std::filesystem;

class Sweep : public testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, text);
    return folder_ / name;
  }
  SweepSpec read(const std::string& text) const {
    KeyPositions given;
    return read_sweep(write("s.yaml", text), given);
  }
  std::string error_of(const std::string& text) const {
    try {
      read(text);
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  }
  const test::TemporaryFolder folder_;
};

constexpr const char* kHead = "config: quickstart\nmetric: [win_rate_0]\nparameters:\n";

TEST_F(Sweep, AGridHasEveryCombinationAndItsLastParameterChangesFastest) {
  const SweepSpec spec = read(cat(kHead, "  a.x: {choices: [1, [2, 3]]}\n  b.y: {integers: [4, 6]}\nmethod: grid\n"));
  const std::vector<TrialSettings> trials = draw_trials(spec, sobol_points);
  ASSERT_EQ(trials.size(), 6u);
  // All of them, however many; so many where that is said.
  const std::string large = cat(kHead, "  a.x: {integers: [1, 9]}\n  b.y: {integers: [1, 9]}\nmethod: grid\n");
  EXPECT_EQ(draw_trials(read(large), sobol_points).size(), 81u);
  EXPECT_EQ(draw_trials(read(large + "trials: 20\n"), sobol_points).size(), 20u);
  EXPECT_EQ(trials[0], (TrialSettings{{"a.x", "1"}, {"b.y", "4"}}));
  EXPECT_EQ(trials[1], (TrialSettings{{"a.x", "1"}, {"b.y", "5"}}));
  EXPECT_EQ(trials[5], (TrialSettings{{"a.x", "[2, 3]"}, {"b.y", "6"}}));
  EXPECT_EQ(assignments_of(trials[5]), (std::vector<std::string>{"a.x=[2, 3]", "b.y=6"}));
}

// One that --tell named with some of the parameters only.
TEST_F(Sweep, ATrialWithoutASettingHasAnEmptyField) {
  SweepOutcome outcome;
  outcome.spec = read(cat(kHead, "  a.x: {choices: [1, 2]}\n  b.y: {integers: [4, 6]}\nmethod: grid\n"));
  outcome.trials.emplace_back();
  outcome.trials[0].settings = {{"b.y", "5"}};
  const std::string csv = outcome_csv(outcome);
  EXPECT_NE(csv.find(",a.x,b.y\r\n"), std::string::npos) << csv;
  EXPECT_EQ(csv.substr(csv.rfind(','), 4), ",5\r\n") << csv;
  EXPECT_EQ(csv[csv.rfind(',') - 1], ',') << csv;
}

TEST(SweepExample, NumbersStayAsTheyAreWritten) {
  KeyPositions given;
  const std::vector<TrialSettings> trials =
      draw_trials(read_sweep(test::source_path("examples/sweeps/rates.yaml"), given), sobol_points);
  ASSERT_EQ(trials.size(), 3u);
  EXPECT_EQ(assignments_of(trials[0]), std::vector<std::string>{"mappo.learning_rate=3e-4"});  // once a text in quotes
}

TEST_F(Sweep, RandomDrawsStayInTheirRanges) {
  const SweepSpec spec = read(cat(kHead, "  a: {log_uniform: [1e-4, 1e-2]}\n  b: {uniform: [-1, 1]}\n",
                                  "  c: {integers: [1, 3]}\nmethod: random\ntrials: 300\n"));
  const std::vector<TrialSettings> trials = draw_trials(spec, sobol_points);
  ASSERT_EQ(trials.size(), 300u);
  int below = 0;
  std::set<std::string> integers;
  for (const TrialSettings& t : trials) {
    const double a = std::stod(t[0].second), b = std::stod(t[1].second);
    EXPECT_TRUE(a >= 1e-4 && a <= 1e-2 && b >= -1 && b <= 1) << t[0].second << " " << t[1].second;
    below += a < 1e-3 ? 1 : 0;
    integers.insert(t[2].second);
  }
  // Half of the orders of magnitude lie below 1e-3: 150 +- 4 deviations of sqrt(300 / 4) = 8.7.
  EXPECT_NEAR(below, 150, 35);
  EXPECT_EQ(integers, (std::set<std::string>{"1", "2", "3"}));
  EXPECT_EQ(draw_trials(spec, sobol_points), trials) << "the same again";
}

// Of six draws from 3 x 2 settings some come out twice: they are left out, and what is left stays in its place.
TEST_F(Sweep, DrawsThatComeOutTwiceAreLeftOut) {
  const auto draw = [&](int trials) {
    return draw_trials(
        read(cat(kHead, "  a: {integers: [1, 3]}\n  b: {choices: [x, y]}\nmethod: random\ntrials: ", trials, "\n")),
        sobol_points);
  };
  const std::vector<TrialSettings> six = draw(6), hundred = draw(100);
  EXPECT_EQ(std::set<TrialSettings>(six.begin(), six.end()).size(), six.size());
  ASSERT_EQ(hundred.size(), 6u);
  ASSERT_LE(six.size(), 6u);
  EXPECT_TRUE(std::equal(six.begin(), six.end(), hundred.begin()));
}

// Four digits of 0.99998 are 1, and of the numbers from 0.99981 on 0.9998: both outside.
TEST_F(Sweep, DrawsFromANarrowRangeHaveMoreDigits) {
  const SweepSpec spec = read(cat(kHead, "  a: {uniform: [0.99996, 0.99999]}\n  b: {log_uniform: [0.99981, 0.99984]}\n",
                                  "  c: {uniform: [0.1, 0.9]}\nmethod: random\ntrials: 50\n"));
  std::set<std::string> drawn;
  for (const TrialSettings& t : draw_trials(spec, sobol_points)) {
    const double a = std::stod(t[0].second), b = std::stod(t[1].second);
    EXPECT_TRUE(a >= 0.99996 && a <= 0.99999 && b >= 0.99981 && b <= 0.99984) << t[0].second << " " << t[1].second;
    EXPECT_LE(t[2].second.size(), 6u) << "0.1234 and no more";
    drawn.insert(t[0].second);
  }
  EXPECT_GT(drawn.size(), 40u);
}

TEST_F(Sweep, SobolFillsTheSpaceEvenly) {
  // The first eight points of the sequence in two dimensions (Bratley and Fox 1988, in the order of Gray codes).
  const std::vector<double> points = sobol_points(2, 8);
  const std::vector<double> expected = {0,     0,     0.5,   0.5,   0.75,  0.25,  0.25,  0.75,
                                        0.375, 0.375, 0.875, 0.875, 0.625, 0.125, 0.125, 0.625};
  EXPECT_EQ(points, expected);
  // Sixteen trials of two parameters: each quarter of each range gets four, whatever the shift.
  for (const char* seed : {"1", "2"}) {
    const SweepSpec spec =
        read(cat(kHead, "  a: {uniform: [0, 1]}\n  b: {uniform: [0, 1]}\ntrials: 16\nseed: ", seed, "\n"));
    std::vector<int> count(8);
    for (const TrialSettings& t : draw_trials(spec, sobol_points))
      for (size_t j = 0; j < 2; ++j) ++count[4 * j + static_cast<size_t>(std::stod(t[j].second) * 4)];
    for (const int c : count) EXPECT_NEAR(c, 4, 1);
  }
}

TEST_F(Sweep, MistakesInTheFileAreTold) {
  const auto contains = [&](const std::string& text, const std::string& part) {
    const std::string error = error_of(text);
    EXPECT_NE(error.find(part), std::string::npos) << error;
  };
  contains(cat(kHead, "  a: {uniform: [2, 1]}\n"), "s.yaml:4:3: parameters.a: the range 2 to 1 is empty");
  contains(cat(kHead, "  a: {uniform: [0, 1]}\nmethod: grid\n"), "a grid needs choices or integers");
  contains(cat(kHead, "  a: {integers: [-9000000000000000000, 9000000000000000000]}\n"),
           "s.yaml:4:3: parameters.a: the range is too wide: at most 9007199254740992 integers");
  contains(cat(kHead, "  a: {integers: [1, 1000]}\n  b: {integers: [1, 101]}\nmethod: grid\n"),
           "s.yaml:4:3: parameters: a grid of 101000 points; trials says how many of them are tried");
  contains(cat(kHead, "  train.total_agent_steps: {choices: [1, 2]}\nhalving: {first_agent_steps: 5}\n"),
           "s.yaml:4:3: parameters.train.total_agent_steps: with halving all trials have the same stops");
  contains(cat(kHead, "  a: {uniform: [0, 1], choices: [1]}\n"), "exactly one of");
  contains(cat(kHead, "  a: {log_uniform: [0, 1]}\n"), "parameters.a.log_uniform[0]: '0' is not a number > 0");
  contains(cat(kHead, "  a: {choices: [1, 1]}\n"), "the choice 1 is there twice");
  contains(cat(kHead, "  a: {choice: [1]}\n"), "choices");
  contains(cat(kHead, "  a: {choices: [1]}\nseeds: [1, 1]\n"), "seeds: one of them is there twice");
  contains(cat(kHead, "  seed: {choices: [1, 2]}\n"),
           "s.yaml:4:3: parameters.seed: the sweep sets this itself, by seeds");
  contains(cat(kHead, "  a: {choices: [1]}\nset: [train.stop_at_agent_steps=5]\n"),
           "s.yaml:5:6: set: train.stop_at_agent_steps: the sweep sets this itself, by halving");
  // A group that holds what is given elsewhere would undo it without a word.
  contains(
      cat(kHead, "  train: {choices: [{n_worlds: 16}]}\nset: [train.total_agent_steps=20_000]\n"),
      "s.yaml:4:3: parameters.train: a group is set as a whole, and train.total_agent_steps of set is in it; name the "
      "keys of the group that differ");
  contains(
      cat(kHead, "  train: {choices: [{n_worlds: 16}]}\n"),
      "parameters.train: a group is set as a whole, and train.max_wall_time is in it: the sweep sets this itself, by "
      "max_wall_time");
  contains(cat(kHead, "  mappo: {choices: [{gamma: 0.9}]}\n  mappo.gamma: {choices: [0.9, 0.99]}\n"),
           "s.yaml:4:3: parameters.mappo: a group is set as a whole, and the parameter mappo.gamma is in it");
  contains(cat(kHead, "  a: {choices: [1]}\nset: [train.max_wall_time=1s]\n"),
           "s.yaml:5:6: set: train.max_wall_time: the sweep sets this itself, by max_wall_time");
  for (const char* value : {"0", "1025", "2.5", "many", "none", "[2]", "-1", "AUTO"}) {
    const std::string error = error_of(cat(kHead, "  a: {choices: [1]}\nparallel: ", value, "\n"));
    EXPECT_TRUE(error.find("s.yaml:5:11: parallel: ") != std::string::npos &&
                error.find("is not an integer in [1, 1024] or auto") != std::string::npos)
        << error;
  }
  contains("config: quickstart\nparameters: {a: {choices: [1]}}\n", "metric: the sweep needs a column");
  contains("config: quickstart\nmetric: [x]\n", "parameters: the sweep needs something to try");
}

TEST_F(Sweep, RunsAtOnceAreANumberOrAuto) {
  const auto with = [&](const std::string& line) { return read(cat(kHead, "  a: {choices: [1]}\n", line)); };
  EXPECT_EQ(with("").parallel.number, 1);
  EXPECT_FALSE(with("").parallel.is_auto());
  EXPECT_EQ(with("parallel: 3\n").parallel.number, 3);
  const SweepSpec measured = with("parallel: auto\n");
  EXPECT_TRUE(measured.parallel.is_auto());
  // As the folder of the sweep keeps it.
  EXPECT_TRUE(read(print_yaml(measured, true)).parallel.is_auto());
  for (const FieldInfo& field : list_fields<SweepSpec>()) {
    if (field.path != "parallel") continue;
    EXPECT_EQ(field.type, "int or name");
    EXPECT_EQ(field.default_value, "1");
  }
}

/// Nine trials, of which a third goes on, for three times the agent-steps each time.
SweepSpec halving_spec() {
  SweepSpec spec;
  spec.seeds = {1, 2};
  spec.halving.first_agent_steps = 100;
  return spec;
}

TEST(SweepHalving, RungsGrowByTheFactor) {
  EXPECT_EQ(rungs_of(halving_spec().halving, 1000), (std::vector<int64_t>{100, 300, 900, 1000}));
  EXPECT_EQ(rungs_of(halving_spec().halving, 900), (std::vector<int64_t>{100, 300, 900}));
  EXPECT_EQ(rungs_of({}, 1000), (std::vector<int64_t>{1000}));
  const int64_t most =
      std::numeric_limits<int64_t>::max();  // 9.2e18: 100 x 3^35 is 5.0e18, and three times that too much
  EXPECT_EQ(rungs_of(halving_spec().halving, most).size(), 37u);
  EXPECT_EQ(rungs_of(halving_spec().halving, most)[35], 5003154509899970700);
}

TEST(SweepHalving, TheBestGoOnAsSoonAsThereAreEnough) {
  SweepProgress progress(halving_spec(), 9, 3);
  const auto run = [&](int trial, int rung, double value) {
    for (const uint64_t seed : {1, 2}) progress.finish({trial, rung, seed}, {value, 0, 1, 100});
  };
  for (int trial = 0; trial < 3; ++trial) {
    const SweepJob job = progress.next().value();
    EXPECT_EQ(std::pair(job.trial, job.rung), std::pair(trial, 0));
    progress.begin(job.trial, job.rung);
  }
  EXPECT_EQ(progress.open().size(), 6u) << "three trials with two seeds";
  EXPECT_EQ(progress.open()[3], (SweepRun{1, 0, 2}));
  run(0, 0, 0.2);
  run(1, 0, 0.5);
  EXPECT_EQ(progress.next()->trial, 3) << "one of two is not a third";
  run(2, 0, 0.4);
  // Of three the best goes on.
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(1, 1));
  progress.begin(1, 1);
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(3, 0));
  for (int trial = 3; trial < 9; ++trial) run(trial, 0, trial == 5 ? 0.9 : 0.1);
  // Of nine three go on: 1, which has, 5 and 2.
  EXPECT_EQ(progress.next()->trial, 5);
  run(5, 1, 0.95);
  EXPECT_EQ(progress.next()->trial, 2);
  run(2, 1, 0.3);
  EXPECT_FALSE(progress.next()) << "trial 1 is not done yet";
  run(1, 1, 0.6);
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(5, 2));
  run(5, 2, 0.99);
  EXPECT_TRUE(progress.complete());
  EXPECT_EQ(progress.ranking()[0], 5);
  EXPECT_EQ(progress.ranking()[1], 1);
  EXPECT_EQ(progress.ranking()[2], 2);
}

// Nine trials, one at a time, the best third goes on: 0, 3 and 6 to rung 1, and only the best of these three to rung 2,
// although 6 comes last.
TEST(SweepHalving, TheLastOfARungIsWaitedFor) {
  SweepSpec spec = halving_spec();
  spec.seeds = {1};
  SweepProgress progress(spec, 9, 3);
  const std::vector<double> first = {0.9, 0.1, 0.1, 0.8, 0.1, 0.1, 0.2, 0.1, 0.1};
  const std::map<int, double> second = {{0, 0.5}, {3, 0.4}, {6, 0.7}};
  std::vector<std::pair<int, int>> further;
  while (const std::optional<SweepJob> job = progress.next()) {
    progress.begin(job->trial, job->rung);
    if (job->rung > 0) further.emplace_back(job->trial, job->rung);
    const double value = job->rung == 0 ? first[static_cast<size_t>(job->trial)] : second.at(job->trial);
    progress.finish({job->trial, job->rung, 1}, {value, 0, 1, 100});
  }
  EXPECT_EQ(further, (std::vector<std::pair<int, int>>{{0, 1}, {3, 1}, {6, 1}, {6, 2}}));
}

TEST(SweepHalving, OfFewTrialsTheBestGoesOnAndOneThatFailedNever) {
  SweepProgress progress(halving_spec(), 2, 2);
  for (const uint64_t seed : {1, 2}) progress.finish({0, 0, seed}, {0.3, 0, 1, 100});
  EXPECT_EQ(progress.next()->trial, 1);
  progress.finish({1, 0, 1}, {0.9, 0, 1, 100});
  progress.finish({1, 0, 2}, {std::nullopt, 3, 1, 50});  // it diverged
  EXPECT_FALSE(progress.value(1, 0));
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(0, 1));
}

// Of three the best goes on and diverges: the next best takes its place, and the one without a value is the last.
TEST(SweepHalving, WhatFailsFurtherOnLeavesItsPlace) {
  SweepSpec spec = halving_spec();
  spec.seeds = {1};
  SweepProgress progress(spec, 3, 2);
  for (const auto& [trial, value] : {std::pair(0, 0.5), {1, 0.9}, {2, 0.7}})
    progress.finish({trial, 0, 1}, {value, 0, 1, 100});
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(1, 1));
  progress.finish({1, 1, 1}, {std::nullopt, 3, 1, 50});
  EXPECT_EQ(progress.ranking(), (std::vector<int>{2, 0, 1}));
  EXPECT_EQ(progress.best(), std::pair(2, 0.7));
  EXPECT_EQ(std::pair(progress.next()->trial, progress.next()->rung), std::pair(2, 1));
  progress.finish({2, 1, 1}, {0.6, 0, 1, 100});
  EXPECT_FALSE(progress.next());
  EXPECT_EQ(progress.ranking(), (std::vector<int>{2, 0, 1}));
  EXPECT_EQ(progress.best(), std::pair(2, 0.6));
}

// A first stop at or behind the end would compare nothing before it.
TEST_F(Sweep, AFirstStopOfHalvingLiesBeforeTheEndOfTheRun) {
  KeyPositions given;
  const SweepSpec spec =
      read_sweep(write("s.yaml", cat(kHead, "  a: {choices: [1]}\nhalving: {first_agent_steps: 1e3}\n")), given);
  EXPECT_NO_THROW(check_halving(spec.halving, 1001, given));
  EXPECT_NO_THROW(check_halving({}, 1, given));
  for (const int64_t total : {1000, 999}) {
    try {
      check_halving(spec.halving, total, given);
      ADD_FAILURE() << total;
    } catch (const InputError& e) {
      EXPECT_NE(std::string(e.what()).find("s.yaml:5:30: halving.first_agent_steps: 1000 is not before the end"),
                std::string::npos)
          << e.what();
    }
  }
}

// Trial 0 has done more than the sweep's config says, trial 1 less, and trial 2 failed at its start.
TEST_F(Sweep, AgentStepsAreThoseThatWereDone) {
  SweepSpec spec;
  spec.seeds = {1, 2};
  spec.metric = {"a"};
  SweepProgress progress(spec, 3, 1);
  progress.finish({0, 0, 1}, {0.9, 0, 1, 600'064});
  progress.finish({0, 0, 2}, {0.8, 0, 1, 600'064});
  progress.finish({1, 0, 1}, {0.5, 0, 1, 163'840});
  progress.finish({1, 0, 2}, {0.4, 0, 1, 163'840});
  for (const uint64_t seed : {1, 2}) progress.finish({2, 0, seed}, {std::nullopt, 1, 1, 0});
  const SweepOutcome outcome = outcome_of(spec, std::vector<TrialSettings>(3), progress, folder_ / "nothing");
  ASSERT_EQ(outcome.trials.size(), 3u);
  EXPECT_EQ(outcome.trials[0].agent_steps, 600'064);
  EXPECT_EQ(outcome.trials[1].agent_steps, 163'840);
  EXPECT_EQ(outcome.trials[2].number, 2);
  EXPECT_EQ(outcome.trials[2].agent_steps, 0);
}

// Values rise with `a`; a trial that somebody told without it says nothing of it, and takes nothing from it.
TEST_F(Sweep, ATrialWithoutAParameterIsLeftOutOfItsImportance) {
  SweepSpec spec = read(cat(kHead, "  a: {uniform: [0, 1]}\n"));
  spec.seeds = {1};
  std::vector<TrialSettings> trials;
  SweepProgress progress(spec, 9, 1);
  for (int k = 0; k < 9; ++k) {
    trials.push_back(k < 8 ? TrialSettings{{"a", cat("0.", k + 1)}} : TrialSettings{});
    progress.finish({k, 0, 1}, {0.1 * k, 0, 1, 100});
  }
  const SweepOutcome outcome = outcome_of(spec, trials, progress, folder_ / "nothing");
  ASSERT_EQ(outcome.parameters.size(), 1u);
  EXPECT_EQ(outcome.parameters[0].correlation, 1);
  EXPECT_GT(outcome.parameters[0].share, 0.5);
}

TEST(SweepFailures, AreTriedAgainUnlessTheyDiverged) {
  SweepProgress progress(SweepSpec(), 4, 1);  // with seed 1
  progress.finish({0, 0, 1}, {0.5, 0, 1, 100});
  EXPECT_EQ(progress.failure_code(), 0);
  progress.finish({1, 0, 1}, {std::nullopt, 0, 0, 0});  // somebody else's, told without a value
  EXPECT_EQ(progress.failure_code(), 0);
  progress.finish({2, 0, 1}, {std::nullopt, 3, 1, 50});  // a learning rate too high, for example
  EXPECT_EQ(progress.failure_code(), 0);
  progress.finish({3, 0, 1}, {std::nullopt, 137, 1, 50});  // killed, as where memory is short
  EXPECT_EQ(progress.failure_code(), 1);
  EXPECT_EQ(progress.n_failed(), 2);
  EXPECT_TRUE(progress.complete());
  progress.reopen_failed();
  EXPECT_EQ(progress.open(), (std::vector<SweepRun>{{3, 0, 1}}));
  progress.finish({3, 0, 1}, {0.7, 0, 1, 100});
  EXPECT_EQ(progress.failure_code(), 0);
  SweepProgress all(SweepSpec(), 1, 1);
  all.finish({0, 0, 1}, {std::nullopt, 3, 1, 50});
  EXPECT_EQ(all.failure_code(), 3);
}

TEST_F(Sweep, TheJournalLosesATornLineAndNothingElse) {
  const fs::path file = folder_ / "sweep.jsonl";
  {
    SweepJournal journal(file);
    journal.write({{"event", "begin"}, {"trial", 0}});
    journal.write({{"event", "result"}, {"value", 0.1}});
  }
  std::ofstream(file, std::ios::app) << "{\"event\": \"resu";
  {
    SweepJournal journal(file);
    ASSERT_EQ(journal.events().size(), 2u);
    EXPECT_EQ(journal.events()[1].at("value"), 0.1);
    journal.write({{"event", "begin"}, {"trial", 1}});
  }
  EXPECT_EQ(SweepJournal(file).events().size(), 3u);
  write("sweep.jsonl", "{\"event\": \"begin\"}\n?\n{}\n");
  EXPECT_THROW(SweepJournal{file}, InputError);
}

TEST(SweepAnalysis, InterquartileMeans) {
  EXPECT_EQ(interquartile_mean({9}), 9);
  EXPECT_EQ(interquartile_mean({0, 3, 6}), 3);
  EXPECT_EQ(interquartile_mean({100, 1, 2, 3, 0}), 2) << "the least and the greatest of five are left out";
  EXPECT_EQ(interquartile_mean({1, 2, 3, 4, 5, 6, 7, 800}), 4.5);
  const Interval band = bootstrap_interval({0, 0, 0, 1, 1, 1});
  EXPECT_LT(band.lo, 0.3);
  EXPECT_GT(band.hi, 0.7);
  const Interval same = bootstrap_interval({2, 2, 2});
  EXPECT_EQ(same.lo, 2);
  EXPECT_EQ(same.hi, 2);
}

TEST(SweepAnalysis, IntervalsOfMeans) {
  // Mean 2, deviation 1, three values: 2 +- 4.303 / sqrt(3).
  const Interval three = mean_interval({1, 2, 3});
  EXPECT_NEAR(three.lo, 2 - 4.303 / std::sqrt(3), 1e-9);
  EXPECT_NEAR(three.hi, 2 + 4.303 / std::sqrt(3), 1e-9);
  EXPECT_EQ(mean_interval({5}).lo, 5);
}

TEST(SweepAnalysis, WhatAParameterExplains) {
  // Two groups of two: 0, 0 and 1, 1. All of the spread lies between them.
  EXPECT_EQ(explained_share({0, 0, 1, 1}, {0, 0, 1, 1}), 1);
  EXPECT_EQ(explained_share({0, 1, 0, 1}, {0, 0, 1, 1}), 0) << "none of it";
  // Total 5, within 2 x 0.5 = 1, between 4; less (2 - 1) x 1 / (4 - 2) = 0.5: 3.5 / 5.
  EXPECT_NEAR(explained_share({0, 0, 1, 1}, {0, 1, 2, 3}), 0.7, 1e-12);
  EXPECT_TRUE(std::isnan(explained_share({0, 0, 0}, {1, 2, 3})));
  EXPECT_EQ(groups_of({"0.5", "0.1", "0.9", "0.2", "0.8", "0.3", "0.7", "0.4"}, 4),
            (std::vector<size_t>{2, 0, 3, 0, 3, 1, 2, 1}));
  EXPECT_EQ(groups_of({"gelu", "tanh", "gelu"}), (std::vector<size_t>{0, 1, 0}));
  EXPECT_EQ(rank_correlation({"1", "10", "100"}, {0.1, 0.2, 0.9}), 1);
  EXPECT_EQ(rank_correlation({"1", "10", "100"}, {9, 8, 7}), -1);
  EXPECT_EQ(rank_correlation({"10_000", "2e4", "+30_000"}, {1, 2, 3}), 1) << "numbers as YAML has them";
  EXPECT_TRUE(std::isnan(rank_correlation({"a", "b"}, {1, 2})));
}

TEST_F(Sweep, TheWorstOfSeveralColumnsCountsByItsLastKnownValues) {
  fs::create_directories(folder_ / "run");
  write("run/metrics.csv", "update,agent_steps,seconds,a,b\n1,10,1,0.5,0.9\n2,20,2,,\n3,30,3,0.7,0.2\n4,40,4,,\n");
  SweepSpec spec;
  spec.metric = {"a", "b"};
  EXPECT_EQ(metric_of_run(spec, folder_ / "run"), 0.2);
  spec.last_values = 2;  // means 0.6 and 0.55
  EXPECT_NEAR(metric_of_run(spec, folder_ / "run").value(), 0.55, 1e-12);
  spec.goal = SweepGoal::minimize;
  EXPECT_NEAR(metric_of_run(spec, folder_ / "run").value(), 0.6, 1e-12);
  EXPECT_EQ(agent_steps_of_run(folder_ / "run"), 40);
  // Trials were compared at 20 agent-steps; somebody has trained this one further.
  spec.last_values = 1;
  EXPECT_EQ(metric_of_run(spec, folder_ / "run", 20), 0.9);
  EXPECT_EQ(agent_steps_of_run(folder_ / "run", 11), 20) << "the first row with as many";
  EXPECT_EQ(seconds_of_run(folder_ / "run", 20), 2);
  EXPECT_EQ(agent_steps_of_run(folder_ / "run", 50), 40) << "not there yet";
  EXPECT_EQ(agent_steps_of_run(folder_ / "nothing"), 0);
  spec.metric = {"c"};
  EXPECT_THROW(metric_of_run(spec, folder_ / "run"), InputError);
}

}  // namespace
}  // namespace giga
