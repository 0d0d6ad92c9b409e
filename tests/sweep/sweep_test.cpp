// What a sweep tries, what is remembered of it, and what its results say.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "support/source.hpp"
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
