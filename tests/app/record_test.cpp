// gigastep record and picture as a user runs them: a replay, its page, playing it again, pictures, and what train
// keeps.
#include <gtest/gtest.h>

#include "io/files.hpp"
#include "program.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

size_t size_of_file(const Workplace& here, const std::string& name) { return here.read(name).size(); }

TEST(Record, GamesOfAHalfMinuteFitTheirSizes) {
  const Workplace here;
  // Both circle for all 500 steps, ten agents.
  for (const char* episodes : {"1", "2"}) {
    const Outcome outcome = here.run({"record", "circle", "--vs", "circle", "--scenario", "identical_5_vs_5_void",
                                      "--episodes", episodes, "--out", std::string("g") + episodes});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(contains(outcome.out, {std::string("g") + episodes + ".replay: circle against circle, " + episodes}));
  }
  EXPECT_LE(size_of_file(here, "g1.replay"), 15u << 10);
  EXPECT_LE(size_of_file(here, "g2.html"), size_of_file(here, "g1.html") + (25u << 10));
  EXPECT_LE(size_of_file(here, "g1.html"), (400u + 25u) << 10);
}

TEST(Record, PlaysAgainBitForBit) {
  const Workplace here;
  for (const char* scenario :
       {"identical_5_vs_5", "waypoint_5_vs_3_cont", "hide_and_seek_5_vs_5", "special_5_vs_1_fobs"}) {
    const Outcome outcome =
        here.run({"record", "pursuer", "--vs", "evader", "--scenario", scenario, "--episodes", "2"});
    ASSERT_EQ(outcome.code, 0) << scenario << outcome.err;
    const Outcome again = here.run({"record", "--verify", "game.replay"});
    EXPECT_EQ(again.code, 0) << scenario << again.out << again.err;
    EXPECT_EQ(again.out, "game.replay: played again, all 2 episodes are the same bit for bit\n");
  }
}

TEST(Record, PythonReadsIt) {
  const std::string python = python_with("zlib");
  if (python.empty()) GTEST_SKIP() << "no Python";
  const Workplace here;
  for (const char* scenario : {"identical_5_vs_5", "waypoint_5_vs_3_cont"}) {
    ASSERT_EQ(here.run({"record", "circle", "--vs", "pursuer", "--scenario", scenario, "--episodes", "2"}).code, 0);
    const Outcome words = here.run({source_path("examples/read_replay.py"), "game.replay"}, python);
    ASSERT_EQ(words.code, 0) << words.err;
    EXPECT_TRUE(
        contains(words.out, {std::string("circle against pursuer in ") + scenario, "episode 1: ", "death of agent"}));
  }
}

TEST(Record, BesideAnother) {
  const Workplace here;
  const Outcome outcome = here.run({"record", "circle", "--vs", "pursuer", "--beside", "evader", "--scenario",
                                    "identical_2_vs_2", "--episodes", "1", "--out", "both.html"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"both.replay: circle against pursuer",
                                     "both_beside.replay: evader against pursuer", "both.html: open it"}));
  EXPECT_TRUE(contains(here.read("both.html"), {"circle and evader against pursuer"}));
}

TEST(Record, WhatIsWrong) {
  const Workplace here;
  here.write("x.replay", "seed: 3\n");
  const auto refused = [&](const std::vector<std::string>& arguments, const std::string& message) {
    const Outcome outcome = here.run(arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.out << outcome.err;
    EXPECT_TRUE(contains(outcome.err, {message}));
  };
  refused({"record"}, "A is missing");
  refused({"record", "cirle"}, "nearest: 'circle'");
  refused({"record", "circle"}, "name one with --scenario");
  refused({"record", "--verify", "x.replay"}, "x.replay is no replay");
  refused({"picture", "x.replay", "--out", "a.svg"}, "x.replay is no replay");
  refused({"picture", "nowhere.replay", "--out", "a.svg"}, "nowhere.replay");
  ASSERT_EQ(here.run({"record", "circle", "--scenario", "identical_1_vs_1", "--episodes", "1"}).code, 0);
  refused({"picture", "game.replay"}, "--out or --film says what to write");
  refused({"picture", "game.replay", "--out", "a.jpg"}, ".svg or .png");
  refused({"picture", "game.replay", "--film", "a.mp4"}, ".gif");
  refused({"picture", "game.replay", "--film", "a.gif", "--episode", "1"}, "the replay has 1");
}

TEST(Picture, PathsAndFilms) {
  const Workplace here;
  ASSERT_EQ(here.run({"record", "circle", "--vs", "pursuer", "--scenario", "identical_2_vs_2", "--episodes", "2"}).code,
            0);
  ASSERT_EQ(here.run({"picture", "game.replay", "--out", "t.svg"}).code, 0);
  ASSERT_EQ(
      here.run({"picture", "game.replay", "--out", "t.png", "--film", "f.gif", "--every", "10", "--size", "100"}).code,
      0);
  ASSERT_EQ(here.run({"picture", "game.replay", "--film", "frames", "--every", "25", "--size", "100"}).code, 0);
  const std::string svg = here.read("t.svg");
  // A path and a ring where it starts for each of 2 x 4 agents.
  size_t paths = 0;
  for (size_t at = 0; (at = svg.find("stroke-linejoin=\"round\"", at)) != std::string::npos; ++at) ++paths;
  EXPECT_EQ(paths, 8u);
  EXPECT_TRUE(contains(svg, {"circle against pursuer", "episode 1: "}));
  EXPECT_EQ(here.read("t.png").substr(1, 3), "PNG");
  EXPECT_EQ(here.read("f.gif").substr(0, 6), "GIF89a");
  EXPECT_TRUE(here.has("frames/00000.png") && here.has("frames/00001.png"));
}

TEST(Record, TrainingKeepsGames) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Outcome training = here.run({"train", "tiny.yaml", "--run-dir", "run", "--quiet", "--set", "eval.record=1"});
  ASSERT_EQ(training.code, 0) << training.err;
  // Evaluated after updates 2 and 3, the last.
  EXPECT_TRUE(here.has("run/replays/update_00000002.replay") && here.has("run/replays/update_00000003.replay"));
  EXPECT_TRUE(contains(here.read("run/report.html"), {"href=\"replays.html\""}));
  EXPECT_TRUE(contains(here.read("run/replays.html"), {"<title>run - gigastep replay</title>"}));
  const Outcome again = here.run({"record", "--verify", "run/replays/update_00000003.replay"});
  EXPECT_EQ(again.code, 0) << again.out << again.err;

  // A report elsewhere finds the page on the way from there.
  ASSERT_EQ(here.run({"report", "run", "--out", "all.html"}).code, 0);
  EXPECT_TRUE(contains(here.read("all.html"), {"href=\"run/replays.html\""}));
  const Outcome none = here.run({"train", "tiny.yaml", "--run-dir", "none", "--quiet", "--set", "eval.record=0"});
  ASSERT_EQ(none.code, 0) << none.err;
  EXPECT_FALSE(here.has("none/replays") || here.has("none/replays.html"));
  // Recording changes nothing of what is learned.
  const auto hash = [&](const std::string& run) {
    const std::string text = here.run({"inspect", run + "/checkpoints/update_00000003.h5"}).out;
    return text.substr(text.find("sha"), 80);
  };
  EXPECT_EQ(hash("run"), hash("none"));
}

}  // namespace
}  // namespace giga::test
