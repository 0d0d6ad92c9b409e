// gigastep sweep, end to end: small sweeps are trained, killed and resumed; bad ones are refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <map>
#include <memory>
#include <thread>

#include "io/run_lock.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

/// Runs of 4 updates of 256 agent-steps, evaluated after updates 2 and 4.
const std::string kSweep = R"(config: short.yaml
parameters:
  mappo.learning_rate: {log_uniform: [1e-4, 1e-2]}
  mappo.gamma: {choices: [0.9, 0.99]}
trials: 3
seeds: [1, 2]
metric: [win_rate_0_vs_random, win_rate_1_vs_random]
parallel: 2
)";

TEST(AppSweep, TriesAllAndSaysWhatIsBest) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("rates.yaml", kSweep);
  const Outcome done = here.run({"sweep", "rates.yaml", "--out", "s", "--json", "result.json"});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_TRUE(contains(done.out, {"best trials by smallest of win_rate_0_vs_random, win_rate_1_vs_random",
                                  "95 % interval", "mappo.learning_rate", "s/report.html"}));
  const CsvTable table = parse_csv(here.read("s/trials.csv"));
  ASSERT_EQ(table.rows.size(), 3u);
  EXPECT_EQ(table.cell(0, "seeds"), "2");
  for (const char* run : {"000-seed1", "000-seed2", "001-seed1", "002-seed2"}) {
    EXPECT_EQ(metrics_rows(here, std::string("s/trials/") + run), 4u) << run;
    EXPECT_TRUE(here.has(std::string("s/trials/") + run + "/checkpoints/update_00000004.h5")) << run;
  }
  const Document json = parse_yaml_text(here.read("result.json"), "json");
  EXPECT_EQ(at(json, {"trials"}).items.size(), 3u);
  EXPECT_EQ(at(json, {"parameters"}).items.size(), 2u);
  EXPECT_TRUE(contains(here.read("s/report.html"), {"Best settings", "Importance over 3 trials"}));

  // The same command trains nothing again.
  const std::string journal = here.read("s/sweep.jsonl");
  EXPECT_EQ(here.run({"sweep", "rates.yaml", "--out", "s"}).code, 0);
  EXPECT_EQ(here.read("s/sweep.jsonl"), journal);
  here.write("rates.yaml", kSweep + "last_values: 2\n");
  const Outcome other = here.run({"sweep", "rates.yaml", "--out", "s"});
  EXPECT_EQ(other.code, 2);
  EXPECT_TRUE(contains(other.err, {"holds another sweep than rates.yaml (last_values: 1 there, 2 now): "}));
}

TEST(AppSweep, HalvingLetsTheBestGoOn) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("h.yaml", kSweep + "halving: {first_agent_steps: 512, factor: 3}\n");
  const Outcome done = here.run({"sweep", "h.yaml", "--out", "h", "--quiet"});
  ASSERT_EQ(done.code, 0) << done.err;
  const CsvTable table = parse_csv(here.read("h/trials.csv"));
  ASSERT_EQ(table.rows.size(), 3u);
  std::map<std::string, int> rungs;
  for (size_t row = 0; row < 3; ++row) ++rungs[table.cell(row, "rung")];
  EXPECT_EQ(rungs, (std::map<std::string, int>{{"0", 2}, {"1", 1}}));
  // The best went on in its folder: 512 agent-steps are 2 updates, the whole run is 4.
  std::map<size_t, int> updates;
  for (int trial = 0; trial < 3; ++trial)
    ++updates[metrics_rows(here, "h/trials/00" + std::to_string(trial) + "-seed1")];
  EXPECT_EQ(updates, (std::map<size_t, int>{{2, 2}, {4, 1}}));
  EXPECT_EQ(rows_of_column(here, "h/trials/00" + table.cell(0, "trial") + "-seed1", "win_rate_0_vs_random"), 2u);
}

TEST(AppSweep, AKilledSweepGoesOnAndRepeatsNothing) {
  const Workplace here;
  std::string config = kShortConfig;
  config.replace(config.find("1024"), 4, "5120");  // 20 updates
  here.write("short.yaml", config);
  here.write("k.yaml", kSweep);
  {
    const auto process = here.start({"sweep", "k.yaml", "--out", "k"});
    ASSERT_TRUE(wait_until([&] { return metrics_rows(here, "k/trials/000-seed1") >= 3; }));
    process->send(SIGKILL);
    process->wait();
  }
  const Outcome done = here.run({"sweep", "k.yaml", "--out", "k"});
  ASSERT_EQ(done.code, 0) << done.err;
  std::map<std::string, int> results;
  std::istringstream lines(here.read("k/sweep.jsonl"));
  for (std::string line; std::getline(lines, line);) ++results[line.substr(0, line.find("\"value\""))];
  int count = 0;
  for (const auto& [line, times] : results) {
    EXPECT_EQ(times, 1) << line;
    count += line.find("\"result\"") != std::string::npos ? 1 : 0;
  }
  EXPECT_EQ(count, 6) << "three trials, two seeds";
  EXPECT_EQ(metrics_rows(here, "k/trials/000-seed1"), 20u);
  // Trained in two pieces or in one, it is the same run, and its seconds are those of both.
  const CsvTable table = parse_csv(here.read("k/trials.csv"));
  ASSERT_EQ(table.columns.back(), "mappo.learning_rate");
  double seconds = 0;
  for (const char* run : {"k/trials/000-seed1/metrics.csv", "k/trials/000-seed2/metrics.csv"}) {
    const CsvTable metrics = parse_csv(here.read(run));
    seconds += std::stod(metrics.cell(metrics.rows.size() - 1, "seconds"));
  }
  for (size_t row = 0; row < table.rows.size(); ++row)
    if (table.cell(row, "trial") == "0") {
      EXPECT_NEAR(std::stod(table.cell(row, "seconds")), seconds, 0.01 * seconds);
    }
  EXPECT_TRUE(here.has("k/trials/002-seed2/report.html"));
}

/// Whether a page is named where there is one, and only there.
void expect_report_as_written(const Workplace& here, const Outcome& outcome, const std::string& sweep) {
  EXPECT_EQ(outcome.out.find("report: ") != std::string::npos, here.has(sweep + "/report.html")) << outcome.out;
}

TEST(AppSweep, OneWhoseTimeIsOverBeforeAnyRunHasStepsNamesNoReport) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("t.yaml", kSweep);
  ASSERT_EQ(here.run({"sweep", "t.yaml", "--out", "t", "--ask"}).code, 0);  // trial 0 has begun
  {
    // All runs are held, as by processes that are saving still: the sweep waits for them until its time is over.
    std::vector<std::unique_ptr<RunLock>> held;
    for (const char* run : {"000-seed1", "000-seed2", "001-seed1", "001-seed2", "002-seed1", "002-seed2"}) {
      std::filesystem::create_directories(here.path() / "t/trials" / run);
      held.push_back(std::make_unique<RunLock>(here.path() / "t/trials" / run));
    }
    here.write("t.yaml", kSweep + "max_wall_time: 1s\n");
    const Outcome ended = here.run({"sweep", "t.yaml", "--out", "t"});
    EXPECT_EQ(ended.code, 124) << ended.err;
    EXPECT_TRUE(contains(ended.err, {"stopped (max_wall_time is over), all runs are saved"}));
    EXPECT_TRUE(contains(ended.out, {"none has a value yet", "table:  t/trials.csv\n"}));
    EXPECT_FALSE(here.has("t/report.html"));
    expect_report_as_written(here, ended, "t");
    EXPECT_EQ(parse_csv(here.read("t/trials.csv")).rows.size(), 3u);
  }
  // The same command goes on, and then there is one.
  here.write("t.yaml", kSweep);
  const Outcome done = here.run({"sweep", "t.yaml", "--out", "t"});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_TRUE(here.has("t/report.html"));
  expect_report_as_written(here, done, "t");
  EXPECT_EQ(metrics_rows(here, "t/trials/000-seed1"), 4u);
}

TEST(AppSweep, OneWhoseTimeIsOverSavesItsRuns) {
  const Workplace here;
  std::string config = kShortConfig;
  config.replace(config.find("1024"), 4, "2560000000");  // more than the time is enough for
  here.write("short.yaml", config);
  here.write("t.yaml", kSweep + "max_wall_time: 4s\n");
  const Outcome ended = here.run({"sweep", "t.yaml", "--out", "t"});
  EXPECT_EQ(ended.code, 124) << ended.err;
  EXPECT_TRUE(contains(ended.err, {"stopped (max_wall_time is over)"}));
  expect_report_as_written(here, ended, "t");
  const std::string journal = here.read("t/sweep.jsonl");
  EXPECT_EQ(journal.find("\"result\""), std::string::npos) << "a run that was stopped has no result:\n" << journal;
}

// A signal comes while the first runs are being started, which do not listen yet.
TEST(AppSweep, AStopReachesRunsThatAreJustBeingStarted) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("s.yaml", kSweep);
  const Outcome stopped =
      here.run({"sweep", "s.yaml", "--out", "s"}, kGigastep,
               {{"LD_PRELOAD", fault_library()}, {"FAULT_EXEC", "500"}, {"FAULT_SIGNAL", std::to_string(SIGTERM)}});
  EXPECT_EQ(stopped.code, 128 + SIGTERM) << stopped.err;
  EXPECT_TRUE(contains(stopped.err, {"stopped (SIGTERM), all runs are saved"}));
  EXPECT_EQ(here.read("s/sweep.jsonl").find("\"result\""), std::string::npos);
  EXPECT_EQ(here.run({"sweep", "s.yaml", "--out", "s"}).code, 0);
}

// Runs of a second say little about rates: what counts is that all are trained as with a number.
TEST(AppSweep, AutoTrainsAllTrials) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  std::string text = kSweep;
  text.replace(text.find("parallel: 2"), 11, "parallel: auto");
  here.write("auto.yaml", text);
  const Outcome done = here.run({"sweep", "auto.yaml", "--out", "s"});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_EQ(done.err.find("\x1b["), std::string::npos) << "no panel without a terminal";
  EXPECT_TRUE(contains(done.err, {"agent-steps: ", "3 of 3 trials, best: trial "}));
  for (const char* run : {"000-seed1", "001-seed2", "002-seed2"})
    EXPECT_EQ(metrics_rows(here, std::string("s/trials/") + run), 4u) << run;
  // The number is no part of the sweep: it may change.
  here.write("auto.yaml", kSweep);
  EXPECT_EQ(here.run({"sweep", "auto.yaml", "--out", "s"}).code, 0);
}

TEST(AppSweep, AskAndTell) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("a.yaml", kSweep);
  const auto json_of_run = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = {"sweep", "a.yaml", "--out", "a"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = here.run(words);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return parse_yaml_text(outcome.out, "json");
  };
  const Document first = json_of_run({"--ask"});
  EXPECT_EQ(number_at(first, {"trial"}), 0);
  EXPECT_EQ(number_at(first, {"agent_steps"}), 1024);
  EXPECT_GT(number_at(first, {"settings", "mappo.learning_rate"}), 0);
  EXPECT_EQ(number_at(json_of_run({"--ask"}), {"trial"}), 1);
  EXPECT_EQ(number_at(json_of_run({"--tell", R"({"trial": 0, "value": 0.25})"}), {"open"}), 2);
  // Somebody else's settings are tried too.
  EXPECT_EQ(number_at(json_of_run({"--tell", R"({"settings": {"mappo.gamma": 0.9, "mappo.learning_rate": 0.001}})"}),
                      {"trial"}),
            3);
  for (const auto& [text, part] :
       {std::pair{R"({"trial": 0, "value": 1})", "trial 0, rung 0, seed 1 has a result already"},
        {R"({"trial": 2, "value": 1})", "trial 2, rung 0, seed 1 was not asked for"},
        {R"({"settings": {"mappo.gama": 1}})",
         "mappo.gama is no parameter of this sweep; allowed: mappo.gamma, mappo.learning_rate"},
        {R"({"settings": null})",
         "\"settings\" is an object with values of some of: mappo.gamma, mappo.learning_rate; not null"},
        {"", "--tell: expected a JSON object"},
        {"{", "expected a JSON object"},
        {R"({"trial": 1, "value": NaN})", "no NaN and no Infinity (null says"},
        {R"({"trial": 1, "value": 1, "sed": 1})",
         "unknown key \"sed\"; allowed: trial, rung, seed, value, or settings alone"},
        {R"({"settings": {}, "trial": 0})", "unknown key \"trial\"; allowed: settings alone"},
        {R"({"trial": 1, "value": 1, "seed": "1"})", "\"seed\" is one of the sweep's seeds"},
        {R"({"trial": 4294967297, "value": 1})", "\"trial\" is a whole number from 0 on, not 4294967297"},
        {R"({"trial": 1.5, "value": 1})", "\"trial\" is a whole number from 0 on, not 1.5"},
        {R"({"trial": 1})", "\"value\" is missing"}}) {
    const Outcome wrong = here.run({"sweep", "a.yaml", "--out", "a", "--tell", text});
    EXPECT_EQ(wrong.code, 2) << text;
    EXPECT_TRUE(contains(wrong.err, {part}));
  }
  // What is refused for one seed is noted for none.
  EXPECT_EQ(number_at(json_of_run({"--tell", R"({"trial": 1, "seed": 2, "value": 0.5})"}), {"open"}), 1);
  const Outcome half = here.run({"sweep", "a.yaml", "--out", "a", "--tell", R"({"trial": 1, "value": 0.5})"});
  EXPECT_EQ(half.code, 2);
  EXPECT_TRUE(contains(half.err, {"trial 1, rung 0, seed 2 has a result already"}));
  EXPECT_EQ(number_at(json_of_run({"--tell", R"({"trial": 1, "seed": 1, "value": 0.5})"}), {"open"}), 0);
  // As a file, where one is asked for.
  EXPECT_EQ(here.run({"sweep", "a.yaml", "--out", "a", "--ask", "--json", "asked.json"}).out, "");
  EXPECT_EQ(number_at(parse_yaml_text(here.read("asked.json"), "json"), {"trial"}), 2);
}

// As a kill leaves it before the first trial: the same command begins anew.
TEST(AppSweep, OneThatWasStoppedWhileItWasSetUpBeginsAnew) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("a.yaml", kSweep);
  std::filesystem::create_directories(here.path() / "a/trials");
  here.write("a/config.yaml", "scenario: of_which_half_is_wri");
  EXPECT_EQ(here.run({"sweep", "a.yaml", "--out", "a", "--ask"}).code, 2) << "somebody's folder";
  here.write("a/setting_up", "");
  const Outcome outcome = here.run({"sweep", "a.yaml", "--out", "a", "--ask"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_FALSE(here.has("a/setting_up"));
}

// Whoever sets a folder up holds its lock, so that another process neither takes it for a leftover nor removes it.
TEST(AppSweep, ASweepThatAnotherProcessSetsUpIsLeftAlone) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("a.yaml", kSweep);
  std::filesystem::create_directories(here.path() / "a");
  here.write("a/setting_up", "");
  {
    const RunLock lock(here.path() / "a");
    const Outcome outcome = here.run({"sweep", "a.yaml", "--out", "a", "--ask"});
    EXPECT_EQ(outcome.code, 2);
    EXPECT_TRUE(contains(outcome.err, {"a is in use by process "}));
    EXPECT_TRUE(here.has("a/setting_up"));
    EXPECT_FALSE(here.has("a/sweep.yaml"));
  }
  EXPECT_EQ(here.run({"sweep", "a.yaml", "--out", "a", "--ask"}).code, 0);
}

// Somebody resumes a trial by hand: the others are trained meanwhile, and then the sweep says for whom it waits.
TEST(AppSweep, WaitsForATrialInUseOnlyWhenNothingElseIsLeft) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("w.yaml", kSweep);
  ASSERT_EQ(here.run({"sweep", "w.yaml", "--out", "w", "--ask"}).code, 0);  // trial 0 has begun
  std::filesystem::create_directories(here.path() / "w/trials/000-seed1");
  auto lock = std::make_unique<RunLock>(here.path() / "w/trials/000-seed1");
  const auto sweep = here.start({"sweep", "w.yaml", "--out", "w"});
  const auto trained = [&] {
    const std::vector<std::string> others = {"000-seed2", "001-seed1", "001-seed2", "002-seed1", "002-seed2"};
    return std::all_of(others.begin(), others.end(), [&](const std::string& run) {
      return here.has("w/trials/" + run + "/checkpoints/update_00000004.h5");
    });
  };
  for (int k = 0; k < 1200 && !trained(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_TRUE(trained());
  std::this_thread::sleep_for(std::chrono::seconds(1));
  lock.reset();
  const Outcome done = sweep->wait();
  EXPECT_EQ(done.code, 0) << done.err;
  EXPECT_TRUE(contains(done.err, {"waiting for w/trials/000-seed1, which process "}));
  EXPECT_TRUE(here.has("w/trials/000-seed1/checkpoints/update_00000004.h5"));
}

TEST(AppSweep, MistakesAreToldBeforeTheFirstTrial) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  const auto refused = [&](std::string from, const std::string& to, std::initializer_list<std::string> parts) {
    std::string text = kSweep;
    text.replace(text.find(from), from.size(), to);
    here.write("bad.yaml", text);
    const Outcome outcome = here.run({"sweep", "bad.yaml", "--out", "bad"});
    EXPECT_EQ(outcome.code, 2) << to;
    EXPECT_TRUE(contains(outcome.err, parts)) << outcome.err;
    EXPECT_FALSE(here.has("bad")) << to;
  };
  refused("mappo.gamma", "mappo.gama", {"bad.yaml:4:3: parameters.mappo.gama", "nearest: 'gamma'"});
  refused("[0.9, 0.99]", "[0.9, 1.5]", {"bad.yaml:4:3: parameters.mappo.gamma: '1.5' is not a number in [0, 1]"});
  // The end of a range, which no trial may have drawn.
  refused("{choices: [0.9, 0.99]}", "{uniform: [0.9, 1.01]}",
          {"bad.yaml:4:3: parameters.mappo.gamma: '1.01' is not a number in [0, 1]"});
  // A mistake that only shows with a value is told without the place in a copy that is gone.
  refused("mappo.gamma: {choices: [0.9, 0.99]}", "train.algorithm: {choices: [mappo, snes]}",
          {"bad.yaml:4:3: parameters.train.algorithm: ", "snes"});
  EXPECT_FALSE(contains(here.run({"sweep", "bad.yaml", "--out", "bad"}).err, {"config.yaml"}));
  refused("[1e-4, 1e-2]", "[1e-2, 1e-4]", {"bad.yaml:3:3", "the range 0.01 to 0.0001 is empty"});
  refused("win_rate_0_vs_random", "win_rate_0_vs_circle",
          {"bad.yaml:7:", "this run logs no column 'win_rate_0_vs_circle'", "win_rate_0_vs_random"});
  refused("parallel: 2", "parallel: all", {"bad.yaml:8:11: parallel: 'all' is not an integer in [1, 1024] or auto"});
  refused("short.yaml", "long.yaml", {"bad.yaml:1:9: config: there is no config long.yaml"});
  refused("parallel: 2", "set: [seed_of_mine=1, train.n_world=2]",
          {"bad.yaml:8:7: set: seed_of_mine: unknown key", "bad.yaml:8:23: set: train.n_world: unknown key"});
  // A run has 1024 agent-steps.
  refused("parallel: 2", "halving: {first_agent_steps: 1e9}",
          {"bad.yaml:8:30: halving.first_agent_steps: 1000000000 is not before the end", "1024"});
  refused("mappo.gamma: {choices: [0.9, 0.99]}", "eval.opponents: {choices: [[random], [circle]]}",
          {"bad.yaml:4:3: parameters.eval.opponents: with [circle] the run logs no column 'win_rate_0_vs_random'"});
  refused("mappo.gamma: {choices: [0.9, 0.99]}", "population.sigma_init: {choices: [0.1, 0.2]}",
          {"bad.yaml:4:3: parameters.population.sigma_init: this means nothing with mappo (train.algorithm)"});
  // Team 0 alone is evaluated; that of the other team would stay empty.
  refused("parallel: 2", "set: [train.opponent=circle, train.learning_team=1]",
          {"bad.yaml:7:", "this run logs no column 'win_rate_0_vs_random'", "win_rate_1_vs_random"});
}

// Wherever the command is given; one of the same name there is another.
TEST(AppSweep, PathsCountFromTheFileOfTheSweep) {
  const Workplace here;
  here.write("sub/short.yaml", kShortConfig);
  here.write("sub/game.yaml", "base: identical_1_vs_1\n");
  here.write("game.yaml", "base: identical_2_vs_2\n");
  here.write("sub/a.yaml",
             "config: short.yaml\nset: [train.n_worlds=8]\nparameters: {scenario: {choices: [game.yaml]}}\n"
             "metric: [win_rate_0]\n");
  const Outcome outcome = here.run({"sweep", "sub/a.yaml", "--out", "a", "--ask"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"/sub/game.yaml\""}));
}

// A learner's own column: a gamma that stays as it is has none.
TEST(AppSweep, AColumnThatTheLearnerOfOneTrialLacksIsTold) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("bad.yaml", R"(config: short.yaml
set: [mappo.final_gamma=0.999]
parameters: {mappo.final_gamma: {choices: [0.99, none]}}
method: grid
metric: [gamma]
)");
  const Outcome outcome = here.run({"sweep", "bad.yaml", "--out", "bad"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(
      contains(outcome.err, {"bad.yaml:3:14: parameters.mappo.final_gamma: with none the run logs no column 'gamma'"}));
  EXPECT_FALSE(here.has("bad"));
}

TEST(AppSweep, ATrialSetsItsThreadsItself) {
  const Workplace here;
  std::string config = kShortConfig;
  config.replace(config.find("n_threads: 1"), 12, "n_threads: 0");
  here.write("short.yaml", config);
  here.write("threads.yaml", R"(config: short.yaml
parameters: {train.n_threads: {choices: [1, 2]}}
method: grid
metric: [win_rate_0_vs_random]
parallel: 2
)");
  const Outcome done = here.run({"sweep", "threads.yaml", "--out", "s"});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_TRUE(contains(here.read("s/trials/000-seed1/config.yaml"), {"n_threads: 1 "}));
  EXPECT_TRUE(contains(here.read("s/trials/001-seed1/config.yaml"), {"n_threads: 2 "}));
}

// The first step throws the parameters out of range, the second minibatch notices.
TEST(AppSweep, TheExitCodeTellsOfRunsThatFailed) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  here.write("f.yaml", R"(config: short.yaml
parameters: {mappo.learning_rate: {choices: [1e38]}, mappo.critic_learning_rate: {choices: [1e38]}}
metric: [win_rate_0_vs_random]
)");
  const std::vector<std::string> command = {"sweep", "f.yaml", "--out", "f"};
  const Outcome diverged = here.run(command);
  EXPECT_EQ(diverged.code, 3) << diverged.err;
  EXPECT_TRUE(contains(diverged.err, {"1 run failed: training diverged"}));
  EXPECT_TRUE(contains(diverged.out, {"none has a value yet", "the spread of 0 trials"}));
  const std::string journal = here.read("f/sweep.jsonl");
  EXPECT_EQ(here.run(command).code, 3);
  EXPECT_EQ(here.read("f/sweep.jsonl"), journal) << "it is not tried again";
  // The same as a failure that the machine may have caused: once more, and then it diverges.
  std::string failed = journal;
  const size_t at = failed.find("\"exit_code\":3");
  ASSERT_NE(at, std::string::npos) << journal;
  failed.replace(at, 13, "\"exit_code\":1");
  here.write("f/sweep.jsonl", failed);
  EXPECT_EQ(here.run(command).code, 3);
  EXPECT_GT(here.read("f/sweep.jsonl").size(), failed.size()) << "it was tried again";
}

}  // namespace
}  // namespace giga::test
