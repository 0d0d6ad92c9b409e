// The command line: help, mistakes and their exit codes, and the commands that only print.
#include <gtest/gtest.h>

#include <filesystem>

#include "program.hpp"
#include "runs.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

TEST(CommandLine, EveryCommandHasHelpWithExamples) {
  const Workplace here;
  const std::vector<std::vector<std::string>> commands = {{},
                                                          {"train"},
                                                          {"eval"},
                                                          {"scenarios"},
                                                          {"scenarios", "show"},
                                                          {"config"},
                                                          {"report"},
                                                          {"bench"},
                                                          {"bench", "sim"},
                                                          {"bench", "closed-loop"},
                                                          {"bench", "train"}};
  const auto stride = static_cast<size_t>(thinned(4));
  for (size_t k = stride / 4; k < commands.size(); k += stride) {
    std::vector<std::string> arguments = commands[k];
    arguments.emplace_back("--help");
    const Outcome help = here.run(arguments);
    EXPECT_EQ(help.code, 0);
    EXPECT_EQ(help.err, "");
    EXPECT_TRUE(contains(help.out, {"Usage: ", "Example", "gigastep "}));
  }
  EXPECT_TRUE(contains(here.run({"--help"}).out, {"train", "eval", "scenarios", "config", "bench", "Exit codes"}));
}

TEST(CommandLine, HelpIsACommandToo) {
  const Workplace here;
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{{}, {"train"}, {"bench", "sim"}}) {
    std::vector<std::string> asked = {"help"}, option = words;
    asked.insert(asked.end(), words.begin(), words.end());
    option.emplace_back("--help");
    const Outcome help = here.run(asked);
    EXPECT_EQ(help.code, 0) << help.err;
    EXPECT_EQ(help.err, "");
    EXPECT_EQ(help.out, here.run(option).out);
  }
  EXPECT_EQ(here.run({"help", "--help"}).out, here.run({"--help"}).out);
  const Outcome unknown = here.run({"help", "tarin"});
  EXPECT_EQ(unknown.code, 2);
  EXPECT_EQ(unknown.out, "");
  EXPECT_TRUE(contains(unknown.err, {"there is no help for 'tarin'; nearest: 'train'", "commands: train, resume"}));
}

TEST(CommandLine, Version) {
  const Workplace here;
  const Outcome version = here.run({"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_TRUE(contains(version.out, {"0.", "(commit ", " tree, build "}));
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
      {{"train", "quickstart", "--seed", "x"}, {"--seed: 'x' is not an integer >= 0"}},
      {{"train", "quickstart", "--seed"}, {"--seed: a value is missing"}},
      {{"train", "quickstart", "--seed", "99999999999999999999"},
       {"--seed: '99999999999999999999' is not an integer in [0, 18446744073709551615]"}},
      {{"train", "quickstart", "--ranks", "2k"}, {"--ranks: '2k' is not an integer in [1, 256] (numbers have no"}},
      {{"record", "circle", "--seed", "1.5"}, {"--seed: '1.5' is not an integer >= 0"}},
      {{"record", "circle", "--episodes", "none"}, {"--episodes: 'none' is not an integer in [1, 1000]"}},
      {{"exploit", "circle", "--seed", "-1"}, {"--seed: '-1' is not an integer in [0, 18446744073709551615]"}},
      {{"exploit", "circle", "--agent-steps", "much"}, {"--agent-steps: 'much' is not an integer in [1, 9e+15]"}},
      {{"picture", "a.replay", "--episode", "-1"}, {"--episode: '-1' is not an integer >= 0"}},
      {{"rate", "runs/x", "--sides", "alkie"},
       {"--sides: 'alkie' is not one of: auto, alike, apart; nearest: 'alike'"}},
      {{"config", "--schema", "scenaro"}, {"--schema: 'scenaro' is not one of: run, scenario", "nearest: 'scenario'"}},
      {{"export", "runs/x", "--team", "2"}, {"--team: '2' is not an integer in [0, 1]"}},
      {{"bench", "closed-loop", "--hidden", "64,x"}, {"--hidden: 'x' is not an integer in [1, 16384]"}},
      {{"bench", "closed-loop", "--precision", "tf23"},
       {"--precision: 'tf23' is not one of: fp32, tf32, bf16; nearest"}},
      {{"train", "quickstart", "--seed", "-1"}, {"--seed: '-1' is not an integer in [0, 18446744073709551615]"}},
      {{"eval", "circle", "--vs", "pursuer", "--seed", "-1"},
       {"--seed: '-1' is not an integer in [0, 18446744073709551615]"}},
      {{"train", "quickstart", "--epochs", "3"}, {"unknown option '--epochs'; keys are set by --set KEY=VALUE"}},
      {{"train", "quickstart", "--name", "a/b"}, {"--name a/b is a path", "--run-dir"}},
      {{"train", "quickstart", "--name", ""}, {"--name: a name is missing; allowed is the name of a folder in runs/"}},
      {{"train", "quickstart", "--run-dir", ""}, {"--run-dir: a folder is missing; without --run-dir one is made"}},
      {{"report", "runs/x", "--out", "-"}, {"--out: this is not written to the standard output; a file of that name"}},
      {{"rate", "runs/x", "--out", "-"}, {"--out: this is not written to the standard output; a file of that name"}},
      {{"train", "quickstart", "--set", "mappo.gamma", "0.9"},
       {"--set mappo.gamma 0.9: expected KEY=VALUE; write --set mappo.gamma=0.9"}},
      {{"train", "quickstart", "--mappo.gamma=0.9"},
       {"unknown option '--mappo.gamma=0.9'; write --set mappo.gamma=0.9"}},
      {{"train", "quickstart", "--mappo.gamma", "0.9"}, {"write --set mappo.gamma=0.9"}},
      {{"train", "quickstart", "--set", "mappo.actor.hidden=[64,", "64]"},
       {"the shell took the list apart at its blanks; write --set 'mappo.actor.hidden=[64, 64]'"}},
      {{"train", "quickstart", "--set", "n_worlds=512"},
       {"--set n_worlds: unknown key; did you mean 'train.n_worlds'?"}},
      {{"train", "quickstart", "--set", "rewards.damage=5"}, {"did you mean 'environment.rewards.damage'?"}},
      {{"train", "quickstart", "--set", "mappo.lr=1"}, {"unknown key; nearest: 'learning_rate'"}},
      {{"eval", "circle", "--vs", "pursuer", "--scenario", "identical_2_vs_2", "--set", "sight.cone_depth=5"},
       {"did you mean 'environment.sight.cone_depth'?"}},
      {{"scenarios", "show", "identical_2_vs_2", "--picture", "a.jpg"}, {"SVG", "PNG"}},
      {{"scenarios", "show", "identical_2_vs_2", "--picture", "a.png"}, {"not given images: add _rgb"}},
      {{"train", "quickstart", "--set", "scenario=identical_2_vs_2_rgb"},
       {"--set scenario: ", "'identical_2_vs_2_rgb'", "images alone", "rgb_vector"}},
      {{"train", "quickstart", "--device", "tpu"}, {"--set device: 'tpu' is not auto, cpu, cuda"}},
      {{"eval", "runs/x"}, {"--vs is required"}},
      {{"eval", "runs/x", "--vs", "circel"},
       {"'circel' is neither a scripted team nor a file or folder", "nearest: 'circle'"}},
      {{"eval", "runs/x", "--vs", "circle"}, {"there is no checkpoint or run folder runs/x"}},
      {{"eval", "circle", "--vs", "runs/x.h5"}, {"there is no checkpoint or run folder runs/x.h5"}},
      {{"eval", "circle", "--vs", "pursuer"},
       {"no checkpoint or manifest says which scenario is played by circle and pursuer", "--scenario"}},
      {{"eval", "circle", "--vs", "pursuer", "--scenario", "identical_2_v_2"}, {"nearest: 'identical_2_vs_2'"}},
      {{"eval", "runs/x", "--vs", "circle", "--episodes", "0"}, {"--episodes: '0' is not an integer in [1, 10000000]"}},
      {{"scenarios", "shwo", "x"}, {"unknown command 'shwo'", "nearest: 'show'", "gigastep scenarios --help"}},
      {{"scenarios", "identical_5_vs_5"}, {"write scenarios show identical_5_vs_5"}},
      {{"scenarios", "list"}, {"unknown command 'list'; commands: show"}},
      {{"train", "quickstart", "--set", "mappo.gamma", "=", "0.9"}, {"write --set mappo.gamma=0.9"}},
      {{"train", "quickstart", "--set", "mappo.gamma:0.9"}, {"expected KEY=VALUE; write --set mappo.gamma=0.9"}},
      {{"train", "quickstart", "--out", "run"}, {"the folder of the run is --run-dir"}},
      {{"scenarios", "show", "no_such_game"}, {"no_such_game"}},
      {{"report"}, {"RUN is required"}},
      {{"report", "runs/x"}, {"there is no run folder runs/x"}},
      {{"bench", "es", "--config", "quickstart"}, {"bench es: quickstart does not evolve; use bench train"}},
      {{"bench", "train", "--config", "snes"}, {"bench train: snes evolves; use bench es"}},
      {{"train", "quickstart", "--name", "a", "--run-dir", "b"},
       {"--run-dir cannot be given together with --name", "train --help"}},
      {{"bench"}, {"no command given; commands: sim, closed-loop, train, es"}},
      {{"sweep", "quickstart"},
       {"quickstart: no such file; a sweep is a YAML file that names a config (docs/sweep.md)"}},
      {{"bench", "smi"}, {"unknown command 'smi'", "nearest: 'sim'"}},
      {{"bench", "sim", "--worlds", "0"}, {"--worlds: '0' is not an integer in [1, 16777216]"}},
      {{"bench", "sim", "--worlds", "64,x"}, {"--worlds: 'x' is not an integer in [1, 16777216]"}},
  };
  const auto stride = static_cast<size_t>(thinned(5));
  for (size_t k = stride / 2; k < cases.size(); k += stride) {
    const Case& c = cases[k];
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

// The scenario and its map are files beside the config, or lie where the command is typed.
TEST(CommandLine, ConfigPrintsFilesAsTheyAreFoundFromAnywhere) {
  const Workplace here;
  std::filesystem::create_directories(here.path() / "games");
  std::filesystem::create_directories(here.path() / "elsewhere");
  here.write("games/wall.yaml", "boxes: [[4.5, 2, 5.5, 8]]\n");
  here.write("wall_2.yaml", "boxes: [[4, 2, 5, 8]]\n");
  here.write("games/duel.yaml", "base: identical_1_vs_1_void\n");
  here.write("games/run.yaml", "scenario: duel.yaml\nenvironment: {maps: [./wall.yaml, empty]}\n");
  for (const bool is_set : {false, true}) {
    std::vector<std::string> command = {"config", "games/run.yaml"};
    if (is_set) command.insert(command.end(), {"--set", "environment.maps=./wall_2.yaml"});
    const Outcome first = here.run(command);
    ASSERT_EQ(first.code, 0) << first.err;
    EXPECT_TRUE(contains(first.out, {"/games/duel.yaml", is_set ? "/wall_2.yaml" : "/games/wall.yaml"}));
    here.write("elsewhere/resolved.yaml", first.out);
    const Outcome again = here.run({"config", "elsewhere/resolved.yaml"});
    EXPECT_EQ(again.code, 0) << again.err;
    EXPECT_EQ(again.out, first.out);
  }
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

// Of the eight maps of a scenario, with both teams' starts; an own scenario's map likewise.
TEST(CommandLine, MapsAreDrawn) {
  const Workplace here;
  const auto count = [](const std::string& text, const std::string& part) {
    size_t n = 0;
    for (size_t at = 0; (at = text.find(part, at)) != std::string::npos; ++at) ++n;
    return n;
  };
  ASSERT_EQ(here.run({"scenarios", "show", "identical_5_vs_5", "--picture", "maps.svg"}).code, 0);
  const std::string maps = here.read("maps.svg");
  EXPECT_EQ(count(maps, "<clipPath"), 8u);
  EXPECT_EQ(count(maps, "team 0 starts here"), 8u);
  EXPECT_TRUE(contains(maps, {"<svg", "two_rooms1", "5 agents of team 0 (blue) against 5 of team 1"}));
  // The sight cone is 3 deep, its half angle 3/4 pi; weapons reach 2.05.
  EXPECT_TRUE(contains(maps, {"an agent of team 0 sees as far as 3<", "an agent of team 1 shoots as far as 2.05<"}));
  here.write("mine.yaml", "base: identical_1_vs_1\nmaps: wall\nmap_definitions: {wall: {boxes: [[4.5, 2, 5.5, 8]]}}\n");
  // Five images, 3 x 2 of them: 3 (84 x 3 + 4) + 4 = 772 by 516 pixels, in the header of the file.
  ASSERT_EQ(here.run({"scenarios", "show", "identical_2_vs_2_rgb", "--picture", "seen.png"}).code, 0);
  EXPECT_EQ(here.read("seen.png").substr(0, 24),
            std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x03\x04\0\0\x02\x04", 24));
  ASSERT_EQ(here.run({"scenarios", "show", "./mine.yaml", "--picture", "mine.svg"}).code, 0);
  EXPECT_TRUE(contains(here.read("mine.svg"), {"obstacle from [4.5, 2] to [5.5, 8]", ">wall<"}));
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

// Commands that are told to be typed next begin as this one did.
TEST(CommandLine, TheProgramIsNamedAsItWasCalled) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  std::filesystem::create_symlink(kGigastep, here.path() / "gigastep");
  const Outcome outcome = here.run({"train", "short.yaml", "--quiet", "--run-dir", "run"}, "./gigastep");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"\nnext:        ./gigastep rate run "}));
}

}  // namespace
}  // namespace giga::test
