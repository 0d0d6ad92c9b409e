// Runs of one config become one curve; long curves are thinned.
#include "report/curves.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/error.hpp"
#include "io/temporary_folder.hpp"
#include "synthetic_run.hpp"

namespace giga::test {
namespace {

RunData run_of(const std::string& name, const std::string& config, const std::string& metrics) {
  RunData run;
  run.name = name;
  run.config = parse_yaml_text(config, "config.yaml").root;
  run.scenario = parse_yaml_text("max_health: 1\n", "scenario.yaml").root;
  run.metrics = parse_metrics(metrics, "metrics.csv");
  return run;
}

const std::string kTwoRows = "agent_steps,seconds,x\n100,1,0\n200,2,0\n";

TEST(Curves, SeedsMakeAMeanAndABand) {
  const std::vector<RunData> runs = {
      run_of("a", config_with(1, "0.99"), "agent_steps,seconds,x,y\n100,1,2,\n200,3,5,\n"),
      run_of("b", config_with(2, "0.99"), "agent_steps,seconds,x,y\n100,2,3,\n200,5,5,7\n"),
      run_of("c", config_with(3, "0.99"), "agent_steps,seconds,x,y\n100,3,7,\n200,7,8,\n")};
  const std::vector<RunGroup> groups = group_runs(runs, 100);
  ASSERT_EQ(groups.size(), 1u);
  const RunGroup& group = groups[0];
  EXPECT_EQ(group.runs.size(), 3u);
  EXPECT_EQ(group.label, "duel");
  EXPECT_TRUE(group.has_band());
  EXPECT_EQ(group.agent_steps, (std::vector<double>{100, 200}));
  EXPECT_EQ(group.seconds, (std::vector<double>{2, 5}));          // (1 + 2 + 3) / 3, (3 + 5 + 7) / 3
  EXPECT_EQ(group.find("x")->mean, (std::vector<double>{4, 6}));  // (2 + 3 + 7) / 3, (5 + 5 + 8) / 3
  EXPECT_EQ(group.find("x")->low, (std::vector<double>{2, 5}));
  EXPECT_EQ(group.find("x")->high, (std::vector<double>{7, 8}));
  EXPECT_TRUE(std::isnan(group.find("y")->mean[0]));  // nobody knows it
  EXPECT_EQ(group.find("y")->mean[1], 7);             // one of three knows it
  EXPECT_EQ(group.find("seconds"), nullptr);
}

TEST(Curves, WhatIsNotLearnedDoesNotDivideAGroup) {
  const std::string rest = "mappo: {gamma: 0.99}\n";
  const std::vector<RunData> runs = {
      run_of("a",
             "seed: 1\ndevice: cpu\ntrain: {n_threads: 2, max_wall_time: 4s}\ncheckpoint: {keep: 1}\n"
             "eval: {record: 0}\n" +
                 rest,
             kTwoRows),
      run_of("b",
             "seed: 2\ndevice: cuda:1\ntrain: {n_threads: 0, max_wall_time: none}\ncheckpoint: {keep: 9}\n"
             "eval: {record: 2}\n" +
                 rest,
             kTwoRows)};
  EXPECT_EQ(group_runs(runs, 100).size(), 1u);
}

TEST(Curves, ARunThatChangedOnTheWayIsAnotherGroup) {
  std::vector<RunData> runs;
  for (const char* name : {"a", "b", "c"}) runs.push_back(run_of(name, "mappo: {gamma: 0.9}\n", kTwoRows));
  const auto resumed = [](const std::string& change) {
    return parse_yaml_text("changes: [\"" + change + "\"]\n", "resume_001.json").root;
  };
  runs[1].resumes.push_back(resumed("train.stop_at_agent_steps: 100 -> none"));
  EXPECT_EQ(group_runs(runs, 100).size(), 1u) << "nothing that is learned by";
  runs[2].resumes.push_back(resumed("mappo.gamma: 0.99 -> 0.9"));
  const std::vector<RunGroup> groups = group_runs(runs, 100);
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[0].label, "resume=-");
  EXPECT_EQ(groups[1].label, "resume=mappo.gamma: 0.99 -> 0.9");
}

TEST(Curves, ConfigsAreLabelledByWhatDiffers) {
  const std::vector<RunData> runs = {
      run_of("a", "seed: 1\nmappo: {gamma: 0.99, actor: {hidden: [8]}, critic: {hidden: [8]}}\n", kTwoRows),
      run_of("b", "seed: 1\nmappo: {gamma: 0.9, actor: {hidden: [8]}, critic: {hidden: [16]}}\n", kTwoRows),
      run_of("c", "seed: 2\nmappo: {gamma: 0.99, actor: {hidden: [8]}, critic: {hidden: [8]}}\n", kTwoRows)};
  const std::vector<RunGroup> groups = group_runs(runs, 100);
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[0].label, "gamma=0.9, hidden=[16]") << "the smaller number first";
  EXPECT_EQ(groups[1].label, "gamma=0.99, hidden=[8]");
  EXPECT_EQ(groups[1].runs.size(), 2u);
  const std::vector<DifferingSetting> differing = differing_settings(groups);
  ASSERT_EQ(differing.size(), 2u);
  EXPECT_EQ(differing[0].path, "mappo.gamma");
  EXPECT_EQ(differing[0].values, (std::vector<std::string>{"0.9", "0.99"}));
  EXPECT_EQ(differing[1].path, "mappo.critic.hidden");
}

TEST(Curves, ConfigsAreSortedAsNumbers) {
  std::vector<RunData> runs;
  for (const char* rate : {"0.001", "1e-4", "3e-4", "none"})
    runs.push_back(run_of(rate, cat("mappo: {learning_rate: ", rate, "}\n"), kTwoRows));
  std::vector<std::string> labels;
  for (const RunGroup& group : group_runs(runs, 100)) labels.push_back(group.letter + " " + group.label);
  EXPECT_EQ(labels, (std::vector<std::string>{"A learning_rate=1e-4", "B learning_rate=3e-4", "C learning_rate=0.001",
                                              "D learning_rate=none"}));
}

// Settings that an algorithm does not read tell its runs apart no more than they divide them.
TEST(Curves, LabelsNameWhatTheAlgorithmReads) {
  const auto config = [](const char* algorithm, const char* rate, const char* sigma) {
    return cat("train: {algorithm: ", algorithm, ", n_worlds: 64}\nmappo: {learning_rate: ", rate,
               "}\npopulation: {sigma_init: ", sigma, "}\n");
  };
  const std::vector<RunData> two = {run_of("a", config("openai_es", "1e-3", "0.1"), kTwoRows),
                                    run_of("b", config("openai_es", "1e-4", "0.1"), kTwoRows)};
  EXPECT_EQ(group_runs(two, 100).size(), 1u) << "evolution does not read mappo";
  const std::vector<RunData> runs = {run_of("a", config("openai_es", "1e-3", "0.1"), kTwoRows),
                                     run_of("b", config("mappo", "1e-3", "0.2"), kTwoRows),
                                     run_of("c", config("mappo", "1e-4", "0.3"), kTwoRows)};
  std::vector<std::string> labels;
  for (const RunGroup& group : group_runs(runs, 100)) labels.push_back(group.label);
  EXPECT_EQ(labels, (std::vector<std::string>{"mappo, learning_rate=1e-4", "mappo, learning_rate=1e-3", "openai_es"}));
}

// Beside a run of another algorithm, whose settings differ in much, two that differ in one key are told apart by it.
TEST(Curves, LabelsTellApartTheRunsOfAnAlgorithm) {
  const auto evolution = [](const char* sigma) {
    return cat(
        "train: {algorithm: openai_es, total_agent_steps: 1e6, precision: fp16}\neval: {episodes: 64}\n"
        "population: {population_size: 64, sigma_init: ",
        sigma, "}\n");
  };
  const std::vector<RunData> runs = {
      run_of("a", evolution("0.02"), kTwoRows), run_of("b", evolution("0.05"), kTwoRows),
      run_of("c", "train: {algorithm: mappo, total_agent_steps: 2e6, precision: tf32}\neval: {episodes: 512}\n",
             kTwoRows)};
  std::vector<std::string> labels;
  for (const RunGroup& group : group_runs(runs, 100)) labels.push_back(group.label);
  // Five keys differ, sigma_init between runs of evolution alone; mappo does not read it.
  EXPECT_EQ(labels, (std::vector<std::string>{"mappo, total_agent_steps=2e6, precision=tf32 and 1 more",
                                              "openai_es, sigma_init=0.02, total_agent_steps=1e6 and 2 more",
                                              "openai_es, sigma_init=0.05, total_agent_steps=1e6 and 2 more"}));
  EXPECT_EQ(group_runs(runs, 100).at(1).short_label(), "B: openai_es, sigma_init=0.02, ...");
  const std::vector<DifferingSetting> differing = differing_settings(group_runs(runs, 100));
  const auto sigma = std::find_if(differing.begin(), differing.end(),
                                  [](const DifferingSetting& d) { return d.path == "population.sigma_init"; });
  ASSERT_NE(sigma, differing.end());
  EXPECT_EQ(sigma->values, (std::vector<std::string>{"", "0.02", "0.05"})) << "mappo has none";
}

TEST(Curves, LabelsOfManyDifferencesAreShort) {
  const std::vector<RunData> runs = {run_of("a", "k1: 1\nk2: 1\nk3: 1\nk4: 1\n", kTwoRows),
                                     run_of("b", "k1: 1\nk2: 1\nk3: 1\nk4: 2\n", kTwoRows),
                                     run_of("c", "k1: 2\nk2: 2\nk3: 2\nk4: 2\n", kTwoRows)};
  const std::vector<RunGroup> groups = group_runs(runs, 100);
  EXPECT_EQ(groups[0].label, "k4=1, k1=1, k2=1 and 1 more") << "k4 tells it from the second";
  EXPECT_EQ(groups[1].label, "k1=1, k4=2, k2=1 and 1 more");
  EXPECT_EQ(groups[2].label, "k1=2, k2=2, k3=2 and 1 more");
  EXPECT_EQ(groups[0].letter + groups[1].letter + groups[2].letter, "ABC");
}

// A sweep that changes one key at a time: the run with none of the changes needs all keys to be told from the others.
TEST(Curves, ALabelIsAsLongAsItTakes) {
  std::vector<RunData> runs;
  for (const char* config : {"1, k2: 1, k3: 1, k4: 1", "2, k2: 1, k3: 1, k4: 1", "1, k2: 2, k3: 1, k4: 1",
                             "1, k2: 1, k3: 2, k4: 1", "1, k2: 1, k3: 1, k4: 2"})
    runs.push_back(run_of(config, cat("a: {k1: ", config, "}\n"), kTwoRows));
  std::set<std::string> labels;
  for (const RunGroup& group : group_runs(runs, 100)) labels.insert(group.label);
  EXPECT_EQ(labels, (std::set<std::string>{"k1=1, k2=1, k3=1, k4=1", "k1=2, k2=1, k3=1 and 1 more",
                                           "k2=2, k1=1, k3=1 and 1 more", "k3=2, k1=1, k2=1 and 1 more",
                                           "k4=2, k1=1, k2=1 and 1 more"}));
}

TEST(Curves, AnEditedScenarioIsAnotherGroup) {
  std::vector<RunData> runs = {run_of("a", "seed: 1\n", kTwoRows), run_of("b", "seed: 2\n", kTwoRows)};
  runs[1].scenario = parse_yaml_text("max_health: 2\n", "scenario.yaml").root;
  const std::vector<RunGroup> groups = group_runs(runs, 100);
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[1].label, "max_health=2");
  EXPECT_EQ(differing_settings(groups).at(0).path, "scenario.max_health");

  // Beside others, whose configs differ, those two are still told apart.
  const std::string more = "mappo: {gamma: 0.99}\n", less = "mappo: {gamma: 0.9}\n";
  runs = {run_of("a", more, kTwoRows), run_of("b", more, kTwoRows), run_of("c", less, kTwoRows)};
  runs[1].scenario = parse_yaml_text("max_health: 2\n", "scenario.yaml").root;
  std::vector<std::string> labels;
  for (const RunGroup& group : group_runs(runs, 100)) labels.push_back(group.label);
  EXPECT_EQ(labels, (std::vector<std::string>{"gamma=0.9, max_health=1", "gamma=0.99, max_health=1",
                                              "gamma=0.99, max_health=2"}));
}

TEST(Curves, ThinningKeepsMeanLeastAndGreatest) {
  const std::vector<RunData> runs = {run_of(
      "a", "seed: 1\n", "agent_steps,seconds,x,e\n10,1,1,\n20,2,9,\n30,3,2,4\n40,4,3,\n50,5,4,\n60,6,5,\n70,7,8,\n")};
  const std::vector<RunGroup> groups = group_runs(runs, 3);  // 7 rows, at most 3 points: 3 rows each, the last has 1
  const RunGroup& group = groups[0];
  EXPECT_EQ(group.rows_per_point, 3u);
  EXPECT_TRUE(group.has_band());
  EXPECT_EQ(group.agent_steps, (std::vector<double>{30, 60, 70}));
  EXPECT_EQ(group.seconds, (std::vector<double>{3, 6, 7}));
  EXPECT_EQ(group.find("x")->mean, (std::vector<double>{4, 4, 8}));  // (1 + 9 + 2) / 3, (3 + 4 + 5) / 3, 8
  EXPECT_EQ(group.find("x")->low, (std::vector<double>{1, 3, 8}));
  EXPECT_EQ(group.find("x")->high, (std::vector<double>{9, 5, 8}));
  EXPECT_EQ(group.find("e")->mean[0], 4);  // the one evaluation among three rows
  EXPECT_TRUE(std::isnan(group.find("e")->mean[1]));
}

TEST(Curves, ShortCurvesAreNotThinned) {
  const std::vector<RunData> runs = {run_of("a", "seed: 1\n", kTwoRows)};
  const std::vector<RunGroup> groups = group_runs(runs, 2);
  EXPECT_EQ(groups[0].rows_per_point, 1u);
  EXPECT_FALSE(groups[0].has_band());
}

TEST(Curves, SeedsOfDifferentLength) {
  const std::vector<RunData> runs = {
      run_of("a", config_with(1, "0.99"), "agent_steps,seconds,x\n100,10,1\n200,20,2\n"),
      run_of("b", config_with(2, "0.99"), "agent_steps,seconds,x\n100,2,3\n200,4,4\n300,6,9\n")};
  const std::vector<RunGroup> groups = group_runs(runs, 100);
  EXPECT_EQ(groups[0].agent_steps, (std::vector<double>{100, 200, 300}));
  EXPECT_EQ(groups[0].find("x")->mean, (std::vector<double>{2, 3, 9}));
  // (10 + 2) / 2, (20 + 4) / 2; then the slow run is gone, and 6 would run back.
  EXPECT_EQ(groups[0].seconds, (std::vector<double>{6, 12, 12}));
}

TEST(Curves, AColumnWithoutAFiniteValueHasNone) {
  const std::vector<RunData> runs = {run_of("a", "seed: 1\n", "agent_steps,seconds,x,y\n100,1,inf,inf\n200,2,inf,1\n")};
  const std::vector<RunGroup> groups = group_runs(runs, 100);
  EXPECT_EQ(groups[0].find("x"), nullptr);
  EXPECT_NE(groups[0].find("y"), nullptr);
}

// Generations of an evolution differ in length from seed to seed.
TEST(Curves, AgentStepsAreTheMeanOfTheRuns) {
  const std::vector<RunData> runs = {run_of("a", config_with(1, "0.99"), "agent_steps,seconds\n100,1\n200,2\n"),
                                     run_of("b", config_with(2, "0.99"), "agent_steps,seconds\n100,1\n250,2\n")};
  EXPECT_EQ(group_runs(runs, 100).at(0).agent_steps, (std::vector<double>{100, 225}));
}

TEST(Curves, ManyColumnsGetFewerPoints) {
  std::string header = "agent_steps,seconds", row = "1,1";
  for (int k = 0; k < 400; ++k) {
    header += ",c" + std::to_string(k);
    row += ",0";
  }
  const std::vector<RunData> wide = {run_of("a", "seed: 1\n", header + "\n" + row + "\n")};
  EXPECT_EQ(points_for(wide), 333u);  // 400'000 / (1 + 3 x 400) = 333.05
  EXPECT_EQ(points_for({run_of("a", "seed: 1\n", kTwoRows)}), 2000u);
}

}  // namespace
}  // namespace giga::test
