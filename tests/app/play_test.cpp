// gigastep play as a user runs it. What its page does is in tests/play.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "program.hpp"

namespace giga::test {
namespace {

constexpr const char* kWithoutModule = "scripts/bootstrap --web";

/// Whether this build has the module; if not, the program says what to install.
bool has_module(const Workplace& here) {
  const Outcome outcome = here.run({"play", "circle", "--scenario", "identical_1_vs_1", "--out", "probe"});
  if (outcome.code == 0) return true;
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(contains(outcome.err, {kWithoutModule}));
  return false;
}

TEST(Play, WritesAPageAndAFolder) {
  const Workplace here;
  if (!has_module(here)) GTEST_SKIP() << "no compiler for WebAssembly: " << kWithoutModule;
  const Outcome page = here.run({"play", "circle", "--vs", "pursuer", "--scenario", "identical_2_vs_2", "--scenario",
                                 "waypoint_3_vs_3", "--out", "game.html"});
  ASSERT_EQ(page.code, 0) << page.err;
  EXPECT_TRUE(contains(page.out, {"game.html: ", " KB; open it in a browser"}));
  EXPECT_TRUE(contains(here.read("game.html"), {"<title>circle and pursuer - gigastep play</title>",
                                                "\"name\":\"waypoint_3_vs_3\"", "\"mates\":2,\"opponents\":5"}));
  const Outcome folder = here.run({"play", "evader", "--scenario", "identical_2_vs_2", "--folder", "site"});
  ASSERT_EQ(folder.code, 0) << folder.err;
  EXPECT_TRUE(here.has("site/index.html") && here.has("site/play.wasm") && here.has("site/game.json"));

  // A run: its best checkpoint, and earlier ones as levels.
  here.write("tiny.yaml", kTinyConfig);
  const Outcome training = here.run({"train", "tiny.yaml", "--run-dir", "run", "--quiet"});
  ASSERT_EQ(training.code, 0) << training.err;
  const Outcome levels = here.run({"play", "run", "--levels", "2"});
  ASSERT_EQ(levels.code, 0) << levels.err;
  const std::string html = here.read("play.html");
  size_t named = 0;
  for (size_t at = 0; (at = html.find("\"name\":\"run after ", at)) != std::string::npos; ++at) ++named;
  EXPECT_EQ(named, 2u);
}

// Levels of a run: first what was named, its best policy; then the others from the strongest to the weakest, whenever
// they were saved.
TEST(Play, LevelsStandByTheirRatings) {
  const Workplace here;
  if (!has_module(here)) GTEST_SKIP() << "no compiler for WebAssembly: " << kWithoutModule;
  here.write("tiny.yaml", kTinyConfig);
  const Outcome training = here.run({"train", "tiny.yaml", "--run-dir", "run", "--quiet", "--set",
                                     "train.total_agent_steps=20000", "--set", "checkpoint.keep=5"});
  ASSERT_EQ(training.code, 0) << training.err;
  const Outcome rated = here.run({"rate", "run", "--checkpoints", "0", "--scripted", "random", "--episodes", "4"});
  ASSERT_EQ(rated.code, 0) << rated.err;

  const auto names = [&] {
    const Outcome page = here.run({"play", "run", "--levels", "9", "--folder", "site"});
    EXPECT_EQ(page.code, 0) << page.err;
    std::vector<std::string> all;
    const nlohmann::json game = nlohmann::json::parse(here.read("site/game.json"));
    for (const nlohmann::json& player : game.at("players"))
      if (const std::string name = player.at("name"); name.rfind("run after ", 0) == 0) all.push_back(name);
    return all;
  };
  // The n-th that was saved gets rating `first` + n `more`.
  nlohmann::json sheet = nlohmann::json::parse(here.read("run/ratings/ratings.json"));
  const auto rate = [&](int first, int more) {
    for (const nlohmann::json& player : sheet.at("players"))
      for (nlohmann::json& rating : sheet.at("ratings"))
        if (player.contains("updates") && player.at("updates").is_number() && rating.at("player") == player.at("name"))
          rating["rating"] = first + more * player.at("updates").get<int>();
    here.write("run/ratings/ratings.json", sheet.dump());
  };
  for (const int more : {-100, 100}) {
    rate(1000, more);
    const std::vector<std::string> shown = names();
    ASSERT_GE(shown.size(), 4u);
    std::vector<int> ratings;
    for (const std::string& name : shown) {
      const int updates = std::stoi(name.substr(std::string("run after ").size()));
      ratings.push_back(1000 + more * updates);
      EXPECT_TRUE(contains(name, {", rated " + std::to_string(ratings.back())}));
    }
    EXPECT_TRUE(std::is_sorted(ratings.begin() + 1, ratings.end(), std::greater<>())) << shown[1] << ", " << shown[2];
  }
  // One that won all of its games has no number, and stands above all that have one.
  const std::string last = names().back();
  const std::string updates = std::to_string(std::stoi(last.substr(std::string("run after ").size())));
  for (nlohmann::json& rating : sheet.at("ratings"))
    if (rating.at("player") == "run@" + updates) {
      rating["rating"] = nullptr;
      rating["standing"] = "above";
    }
  here.write("run/ratings/ratings.json", sheet.dump());
  EXPECT_TRUE(contains(names().at(1), {"run after " + updates + " update"})) << names().at(1);
  EXPECT_FALSE(contains(names().at(1), {"rated"}));

  const size_t whole = names().size();
  const std::string number = names().at(0).rfind("run after 2 ", 0) == 0 ? "3" : "2";  // not that of the best
  const std::string damaged = "run/checkpoints/update_0000000" + number + ".h5";
  here.write(damaged, here.read(damaged).substr(0, 3000));
  const Outcome page = here.run({"play", "run", "--levels", "9", "--folder", "site"});
  EXPECT_EQ(page.code, 0) << page.err;
  EXPECT_TRUE(contains(page.err, {"warning: ", number + ".h5: is truncated", "it is left out"}));
  EXPECT_EQ(names().size(), whole - 1);

  here.write("run/ratings/ratings.json", "{");
  const Outcome unrated = here.run({"play", "run", "--levels", "9", "--folder", "site"});
  EXPECT_EQ(unrated.code, 0) << unrated.err;
  EXPECT_TRUE(contains(unrated.err, {"warning: ", "ratings.json:1:1: ", "the page names no ratings"}));
}

// An exported policy computes the egocentric view where nobody offers it. On a page of a game that does, it must read
// that: its network is the run's, weight by weight.
TEST(Play, AnExportedPolicyPlaysAsItsRun) {
  const Workplace here;
  if (!has_module(here)) GTEST_SKIP() << "no compiler for WebAssembly: " << kWithoutModule;
  here.write("tiny.yaml", kTinyConfig);
  const std::vector<std::string> train = {"train",     "tiny.yaml",
                                          "--set",     "environment.observation.egocentric_view=true",
                                          "--set",     "mappo.actor.inputs=egocentric",
                                          "--run-dir", "run",
                                          "--quiet"};
  const Outcome training = here.run(train);
  ASSERT_EQ(training.code, 0) << training.err;
  ASSERT_EQ(here.run({"export", "run", "--team", "1", "--format", "safetensors", "--out", "exported"}).code, 0);
  const auto networks = [&](const std::string& policy) {
    const Outcome outcome = here.run({"play", policy, "--levels", "1", "--folder", policy + "_page"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return nlohmann::json::parse(here.read(policy + "_page/game.json")).at("networks");
  };
  const nlohmann::json of_run = networks("run"), of_export = networks("exported");
  ASSERT_EQ(of_run.size(), 2u);
  ASSERT_EQ(of_export.size(), 1u);
  EXPECT_EQ(of_export[0], of_run[1]);
  EXPECT_NE(of_export[0], of_run[0]);
  const Outcome other = here.run({"play", "exported", "--set", "environment.observation.egocentric_view=false"});
  EXPECT_EQ(other.code, 2);
  EXPECT_TRUE(contains(other.err, {"exported computes the egocentric view itself"}));
}

// Two folders of one name: the second is told with its path, and is the one that is played against.
TEST(Play, RunsOfOneNameStayApart) {
  const Workplace here;
  if (!has_module(here)) GTEST_SKIP() << "no compiler for WebAssembly: " << kWithoutModule;
  here.write("tiny.yaml", kTinyConfig);
  for (const std::string folder : {"run", "other/run"})
    ASSERT_EQ(here.run({"train", "tiny.yaml", "--run-dir", folder, "--quiet"}).code, 0);
  const Outcome page = here.run({"play", "run", "--vs", "other/run", "--levels", "1", "--folder", "site"});
  ASSERT_EQ(page.code, 0) << page.err;
  const nlohmann::json game = nlohmann::json::parse(here.read("site/game.json"));
  EXPECT_EQ(game.at("mates"), 0);
  EXPECT_EQ(game.at("opponents"), 1);
  EXPECT_TRUE(contains(game.at("players")[1].at("name"), {"run after ", " (other/run)"}));
}

TEST(Play, WhatIsWrong) {
  const Workplace here;
  if (!has_module(here)) GTEST_SKIP() << "no compiler for WebAssembly: " << kWithoutModule;
  const auto refused = [&](const std::vector<std::string>& arguments, const std::string& message) {
    const Outcome outcome = here.run(arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.out << outcome.err;
    EXPECT_TRUE(contains(outcome.err, {message}));
  };
  refused({"play"}, "POLICY is required");
  refused({"play", "cirle"}, "nearest: 'circle'");
  refused({"play", "circle"}, "name one with --scenario");
  refused({"play", "circle", "--scenario", "identical_5_vs_55"}, "identical_5_vs_5");
  here.write("large.yaml", "base: identical_100_vs_100\nteam_1:\n  - {type: default, count: 101}\n");
  refused({"play", "circle", "--scenario", "large.yaml"}, "has 201 agents; allowed are at most 200");
  refused({"play", "circle", "--scenario", "identical_1_vs_1", "--folder", "a", "--out", "b"}, "--folder");
  refused({"play", "circle", "--scenario", "identical_1_vs_1", "--levels", "0"}, "--levels");
}

}  // namespace
}  // namespace giga::test
