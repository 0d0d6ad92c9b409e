// The command line: help, mistakes and their exit codes, and the commands that only print.
#include <gtest/gtest.h>

#include <filesystem>

#include "program.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

TEST(CommandLine, EveryCommandHasHelpWithExamples) {
  const Workplace here;
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{{},
                                                                                       {"train"},
                                                                                       {"eval"},
                                                                                       {"scenarios"},
                                                                                       {"scenarios", "show"},
                                                                                       {"config"},
                                                                                       {"report"},
                                                                                       {"bench"},
                                                                                       {"bench", "sim"},
                                                                                       {"bench", "closed-loop"},
                                                                                       {"bench", "train"}}) {
    std::vector<std::string> arguments = command;
    arguments.emplace_back("--help");
    const Outcome help = here.run(arguments);
    EXPECT_EQ(help.code, 0);
    EXPECT_EQ(help.err, "");
    EXPECT_TRUE(contains(help.out, {"Usage: ", "Example", "gigastep "}));
  }
  EXPECT_TRUE(contains(here.run({"--help"}).out, {"train", "eval", "scenarios", "config", "bench", "Exit codes"}));
}

TEST(CommandLine, Version) {
  const Workplace here;
  const Outcome version = here.run({"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_TRUE(contains(version.out, {"0.", "(commit "}));
}

TEST(CommandLine, MistakesNameTheNearest) {
  struct Case {
    std::vector<std::string> arguments;
    std::vector<std::string> messages;
  };
  const Workplace here;
  const std::vector<Case> cases = {
      {{}, {"no command given", "train, resume, eval"}},
      {{"tarin", "quickstart"}, {"unknown command 'tarin'", "nearest: 'train'"}},
      {{"train", "quickstart", "--divice", "cpu"},
       {"unknown option '--divice'", "nearest: '--device'", "train --help"}},
      {{"train"}, {"CONFIG is required"}},
      {{"train", "a.yaml", "b.yaml"}, {"unexpected argument 'b.yaml'"}},
      {{"train", "quikstart"}, {"there is no config quikstart", "nearest: 'quickstart'"}},
      {{"train", "quickstart", "--seed", "x"}, {"--seed", "x"}},
      {{"train", "quickstart", "--device", "tpu"}, {"--set device: 'tpu' is not auto, cpu, cuda"}},
      {{"eval", "runs/x"}, {"--vs is required"}},
      {{"eval", "runs/x", "--vs", "circel"},
       {"'circel' is neither a scripted team nor a file or folder", "nearest: 'circle'"}},
      {{"eval", "runs/x", "--vs", "circle"}, {"there is no checkpoint or run folder runs/x"}},
      {{"eval", "circle", "--vs", "runs/x.h5"}, {"there is no checkpoint or run folder runs/x.h5"}},
      {{"eval", "circle", "--vs", "pursuer"},
       {"neither circle nor pursuer says which scenario is played", "--scenario"}},
      {{"eval", "circle", "--vs", "pursuer", "--scenario", "identical_2_v_2"}, {"nearest: 'identical_2_vs_2'"}},
      {{"eval", "runs/x", "--vs", "circle", "--episodes", "0"}, {"--episodes"}},
      {{"scenarios", "shwo", "x"}, {"unknown command 'shwo'", "nearest: 'show'", "gigastep scenarios --help"}},
      {{"scenarios", "show", "no_such_game"}, {"no_such_game"}},
      {{"report"}, {"RUN is required"}},
      {{"report", "runs/x"}, {"there is no run folder runs/x"}},
      {{"bench", "smi"}, {"unknown command 'smi'", "nearest: 'sim'"}},
      {{"bench", "sim", "--worlds", "0"}, {"--worlds"}},
  };
  for (const Case& c : cases) {
    const Outcome outcome = here.run(c.arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    for (const std::string& message : c.messages) EXPECT_TRUE(contains(outcome.err, {message}));
  }
  EXPECT_EQ(here.entries(), std::vector<std::string>()) << "something was created";
}

TEST(CommandLine, ABadConfigIsToldByPositionAndCreatesNothing) {
  const Workplace here;
  here.write("bad.yaml", "scenario: identical_2_vs_2\ntrain:\n  n_wrlds: 64\nmappo:\n  gamma: 1.5\n");
  const Outcome outcome = here.run({"train", "bad.yaml", "--device", "cpu"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(contains(outcome.err, {"bad.yaml:3:3", "n_wrlds", "nearest: 'n_worlds'", "bad.yaml:5:10", "gamma"}));
  EXPECT_EQ(here.entries(), std::vector<std::string>{"bad.yaml"});
  EXPECT_EQ(here.run({"config", "bad.yaml"}).code, 2);
  EXPECT_EQ(here.run({"config", "quickstart", "--set", "train.n_worlds=none"}).code, 2);
}

TEST(CommandLine, ConfigPrintsWhatReadsBackToTheSame) {
  const Workplace here;
  here.write("mine.yaml", kTinyConfig);
  const Outcome first = here.run({"config", "mine.yaml", "--set", "mappo.gamma=0.995", "--set", "seed=7"});
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_TRUE(contains(first.out, {"gamma: 0.995", "seed: 7", "n_worlds: 64", "# "}));
  here.write("resolved.yaml", first.out);
  EXPECT_EQ(here.run({"config", "resolved.yaml"}).out, first.out);
}

TEST(CommandLine, ScenariosAreListedAndShown) {
  const Workplace here;
  const Outcome list = here.run({"scenarios"});
  EXPECT_EQ(list.code, 0) << list.err;
  EXPECT_TRUE(contains(list.out, {"identical_5_vs_5 ", "5 vs 5", "hide_and_seek_5_vs_10", "waypoint_3_vs_3"}));

  const Outcome shown = here.run({"scenarios", "show", "identical_5_vs_3_void"});
  ASSERT_EQ(shown.code, 0) << shown.err;
  EXPECT_TRUE(contains(shown.out, {"team_0:", "cone_depth:", "(units)"}));
  here.write("identical_5_vs_3_void.yaml", shown.out);
  EXPECT_EQ(here.run({"scenarios", "show", "./identical_5_vs_3_void.yaml"}).out, shown.out);
}

// As `cmake --install` lays the files out: bin/gigastep beside share/gigastep.
TEST(CommandLine, AnInstalledTreeFindsItsOwnData) {
  namespace fs = std::filesystem;
  const Workplace here;
  fs::create_directories(here.path() / "bin");
  fs::create_directories(here.path() / "share/gigastep/configs");
  fs::copy_file(kGigastep, here.path() / "bin/gigastep");
  fs::copy(source_path("scenarios"), here.path() / "share/gigastep/scenarios", fs::copy_options::recursive);
  here.write("share/gigastep/scenarios/only_here.yaml",
             "description: mine\nteam_0: [{count: 1}]\nteam_1: [{count: 2}]\n");
  here.write("share/gigastep/configs/small.yaml", "scenario: only_here\n");
  const std::string program = (here.path() / "bin/gigastep").string();
  EXPECT_TRUE(contains(here.run({"scenarios"}, program).out, {"only_here", "mine", "identical_5_vs_5"}));
  EXPECT_TRUE(contains(here.run({"config", "small"}, program).out, {"scenario: only_here"}));
}

// The tests themselves start other programs by name, as a user's python3.
TEST(CommandLine, AProgramWithoutASlashIsLookedForInPath) {
  EXPECT_EQ(Workplace().run({"-c", "exit 7"}, "sh").code, 7);
  EXPECT_EQ(Workplace().run({}, "no_such_program_of_gigastep").code, 127);
}

}  // namespace
}  // namespace giga::test
