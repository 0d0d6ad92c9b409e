// gigastep rate: two tiny runs rated end to end, the files, the report, and the messages for mistakes.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "program.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// Two runs of one config with two seeds, for all tests of this file.
class RatedRuns : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    here_ = new Workplace();
    here_->write("short.yaml", kShortConfig);
    for (const std::string seed : {"1", "2"})
      ready_ =
          here_->run({"train", "short.yaml", "--quiet", "--run-dir", "run-seed" + seed, "--seed", seed}).code == 0 &&
          ready_;
  }
  static void TearDownTestSuite() {
    delete here_;
    here_ = nullptr;
  }
  void SetUp() override { ASSERT_TRUE(ready_); }

  static Outcome rate(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "rate");
    arguments.insert(arguments.end(), {"--device", "cpu"});
    return here_->run(arguments);
  }

  static Workplace* here_;
  static bool ready_;
};
Workplace* RatedRuns::here_ = nullptr;
bool RatedRuns::ready_ = true;

std::vector<std::string> names_of(const Document& json) {
  std::vector<std::string> names;
  for (const Node& player : at(json, {"players"}).items) names.push_back(player.find("name")->text);
  return names;
}
using Names = std::vector<std::string>;

TEST_F(RatedRuns, ARunGetsAFolderOfRatingsAndItsReportShowsThem) {
  const Outcome outcome = rate({"run-seed1", "--episodes", "16"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"player", "paper's Elo", "reverse_circle", "run-seed1@4", "random = 0",
                                     "Written: run-seed1/ratings"}));
  EXPECT_TRUE(contains(outcome.err, {" matches of 16 episodes, about ", "\nplayed in "}));
  const CsvTable csv = parse_csv(here_->read("run-seed1/ratings/ratings.csv"));
  EXPECT_EQ(csv.cell(0, "player"), "random");
  EXPECT_EQ(csv.cell(0, "rating"), "0");
  bool best = false;
  for (size_t row = 10; row < csv.rows.size(); ++row) {  // behind the ten scripts
    EXPECT_EQ(csv.cell(row, "run"), "run-seed1");
    const int updates = std::stoi(csv.cell(row, "updates"));
    EXPECT_EQ(std::stoi(csv.cell(row, "agent_steps")), 256 * updates);
    EXPECT_EQ(csv.cell(row, "player"), "run-seed1@" + std::to_string(updates));
    best = best || csv.cell(row, "best") == "1";
  }
  EXPECT_TRUE(best);
  EXPECT_EQ(csv.cell(csv.rows.size() - 1, "updates"), "4");
  for (const char* name : {"ratings.json", "matrix.csv", "rating.svg", "rating_seconds.svg", "win_rate.svg",
                           "win_rate_seconds.svg", "matrix.svg"})
    EXPECT_TRUE(here_->has(std::string("run-seed1/ratings/") + name)) << name;
  EXPECT_TRUE(contains(here_->read("run-seed1/report.html"),
                       {"class=\"card picture\"", "Cross%2Dplay%3A%20identical%5F1%5Fvs%5F1"}));
}

// From within a run, too, the table of a single checkpoint is not that of the run.
TEST_F(RatedRuns, ACheckpointIsRatedBesideItsRunWhereverItIsNamedFrom) {
  const Outcome outcome =
      here_->run({"-c", "cd run-seed2 && exec \"$0\" \"$@\"", kGigastep, "rate", "checkpoints/update_00000004.h5",
                  "--episodes", "4", "--scripted", "circle", "--device", "cpu"},
                 "/bin/sh");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"Written: ../ratings"}));
  EXPECT_TRUE(here_->has("ratings/ratings.csv"));
  std::filesystem::remove_all(here_->path() / "ratings");
}

// A run that was stopped and resumed: its checkpoints have the seconds of metrics.csv, which go on where they were.
TEST_F(RatedRuns, SecondsAreThoseOfMetricsAlsoOfAResumedRun) {
  ASSERT_EQ(here_
                ->run({"train", "short.yaml", "--quiet", "--run-dir", "resumed", "--set", "checkpoint.keep=9", "--set",
                       "train.total_agent_steps=512"})
                .code,
            0);
  ASSERT_EQ(here_->run({"resume", "resumed", "--quiet", "--set", "train.total_agent_steps=1024"}).code, 0);
  ASSERT_EQ(rate({"resumed", "--scripted", "random", "--episodes", "4", "--checkpoints", "0"}).code, 0);
  const CsvTable rated = parse_csv(here_->read("resumed/ratings/ratings.csv"));
  const CsvTable metrics = parse_csv(here_->read("resumed/metrics.csv"));
  const auto seconds = [](const CsvTable& table, size_t row) { return std::stod(table.cell(row, "seconds")); };
  size_t seen = 0;
  for (size_t row = 1; row < rated.rows.size(); ++row) {  // behind random
    const auto updates = static_cast<size_t>(std::stoi(rated.cell(row, "updates")));
    if (updates == 0) continue;  // before the first row of metrics.csv
    ++seen;
    ASSERT_EQ(metrics.cell(updates - 1, "update"), rated.cell(row, "updates"));
    // A checkpoint is written after its row of metrics.csv and before the next.
    EXPECT_GE(seconds(rated, row), seconds(metrics, updates - 1)) << updates;
    if (updates < metrics.rows.size()) {
      EXPECT_LE(seconds(rated, row), seconds(metrics, updates)) << updates;
    }
    if (row > 1) {
      EXPECT_GT(seconds(rated, row), seconds(rated, row - 1)) << updates;
    }
  }
  EXPECT_EQ(seen, 4u);
  EXPECT_TRUE(contains(here_->read("resumed/ratings/rating_seconds.svg"), {"wall-clock time of training (seconds)"}));
}

TEST_F(RatedRuns, TwoRunsInOneTableAsJson) {
  const Outcome outcome = rate({"run-seed1", "run-seed2/", "--scripted", "random,circle", "--checkpoints", "1",
                                "--episodes", "20", "--sides", "apart", "--out", "both", "--seed", "7", "--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  const Names names = names_of(json);
  EXPECT_EQ(Names(names.begin(), names.begin() + 2), (Names{"random", "circle"}));
  for (const char* newest : {"run-seed1@4", "run-seed2@4"})
    EXPECT_EQ(std::count(names.begin(), names.end(), newest), 1) << newest;
  EXPECT_EQ(at(json, {"sides"}).text, "apart");
  EXPECT_EQ(number_at(json, {"seed"}), 7);
  EXPECT_EQ(at(json, {"ratings"}).items.size(), 2 * names.size());
  for (size_t i = 0; i < names.size(); ++i)
    for (size_t j = 0; j < names.size(); ++j) {
      double sum = 0;
      for (const char* count : {"wins", "losses", "ties"})
        sum += number_at(json, {"games", count, std::to_string(i), std::to_string(j)});
      EXPECT_EQ(sum, 20) << names[i] << " against " << names[j];
    }
  EXPECT_EQ(here_->read("both/ratings.json"), outcome.out);
}

TEST_F(RatedRuns, AreAFunctionOfTheSeed) {
  const auto rated = [](const std::string& seed) {
    return rate({"run-seed1", "--scripted", "random", "--episodes", "12", "--out", "again", "--json", "-", "--seed",
                 seed})
        .out;
  };
  const std::string first = rated("1");
  EXPECT_TRUE(contains(first, {"\"ratings\""}));
  EXPECT_EQ(rated("1"), first);
  EXPECT_NE(rated("2"), first);
}

TEST_F(RatedRuns, WithoutScriptsTheFirstCheckpointIsTheAnchor) {
  const Outcome outcome = rate({"run-seed1/checkpoints/update_00000003.h5", "run-seed2/checkpoints/update_00000004.h5",
                                "--scripted", "none", "--episodes", "32", "--out", "files", "--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  EXPECT_EQ(names_of(json), (Names{"run-seed1@3", "run-seed2@4"}));
  EXPECT_EQ(at(json, {"anchor"}).text, "run-seed1@3");
  EXPECT_FALSE(here_->has("files/win_rate.svg"));
}

TEST_F(RatedRuns, AnyPlayerCanBeTheAnchor) {
  const auto rated = [](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"run-seed1",  "--scripted", "random,circle", "--checkpoints", "1",
                                          "--episodes", "16",         "--out",         "anchored"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return rate(arguments);
  };
  const Outcome outcome = rated({"--anchor", "run-seed1@4", "--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  EXPECT_EQ(at(json, {"anchor"}).text, "run-seed1@4");
  for (const Node& rating : at(json, {"ratings"}).items) {
    if (rating.find("player")->text == "run-seed1@4") {
      EXPECT_EQ(rating.find("rating")->text, "0");
      EXPECT_EQ(rating.find("standard_error")->text, "0");
    }
  }
  const double n = static_cast<double>(names_of(json).size());
  EXPECT_EQ(number_at(json, {"intransitivity", "pairs"}), n * (n - 1) / 2);
  EXPECT_LE(number_at(json, {"goodness_of_fit", "pairs"}), n * (n - 1) / 2);
  const double share = number_at(json, {"intransitivity", "share"});
  EXPECT_TRUE(share >= 0 && share <= 1) << share;
  EXPECT_TRUE(contains(rated({"--anchor", "circle"}).out, {"circle = 0; a tie", "\nFit: ", "\nIntransitive: "}));
}

TEST_F(RatedRuns, ATeamThatDidNotLearnIsNotRated) {
  here_->write("one.yaml", kShortConfig);
  ASSERT_EQ(here_->run({"train", "one.yaml", "--quiet", "--run-dir", "one", "--set", "train.opponent=circle"}).code, 0);
  const Outcome outcome = rate(
      {"one", "--scripted", "random", "--sides", "apart", "--checkpoints", "1", "--json", "-", "--episodes", "32"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  int ratings = 0;
  for (const Node& rating : at(json, {"ratings"}).items) {
    if (rating.find("player")->text == "random") continue;
    EXPECT_EQ(rating.find("side")->text, "0");
    ++ratings;
  }
  EXPECT_GE(ratings, 1);
  const Outcome one_sided = rate({"one", "--scripted", "random", "--sides", "apart", "--checkpoints", "1", "--anchor",
                                  "one@4", "--out", "one_sided"});
  EXPECT_EQ(one_sided.code, 2);
  EXPECT_TRUE(contains(one_sided.err, {"--anchor: 'one@4' does not play both sides; allowed: random"}));
  EXPECT_FALSE(here_->has("one_sided"));
  const Outcome nobody = rate({"one", "--scripted", "none"});
  EXPECT_EQ(nobody.code, 2);
  EXPECT_TRUE(contains(nobody.err, {"no player plays both sides", "--scripted random"}));
}

TEST_F(RatedRuns, PlayInAnotherScenarioThatFits) {
  const Outcome outcome = rate({"run-seed1", "--scenario", "identical_1_vs_1_pobs_vec_void_disc", "--scripted",
                                "random", "--checkpoints", "1", "--episodes", "4", "--out", "maps"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"identical_1_vs_1_pobs_vec_void_disc, 4 episodes"}));
  const Outcome misfit = rate({"run-seed1", "--scenario", "identical_2_vs_2", "--out", "misfit"});
  EXPECT_EQ(misfit.code, 2);
  EXPECT_TRUE(contains(misfit.err,
                       {"run-seed1@", "was trained in", ", not in 'identical_2_vs_2'; what differs: ", " there, "}));
  EXPECT_FALSE(here_->has("misfit"));
}

// A run that was paid otherwise played the same game.
TEST_F(RatedRuns, OtherRewardsAreNoOtherGame) {
  here_->write("paid.yaml", std::string(kShortConfig) + "environment: {rewards: {damage: 7}}\n");
  ASSERT_EQ(here_->run({"train", "paid.yaml", "--quiet", "--run-dir", "paid"}).code, 0);
  const Outcome outcome = rate({"run-seed1", "paid", "--scripted", "random", "--episodes", "4", "--out", "ablation"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"run-seed1@4", "paid@4"}));
}

TEST_F(RatedRuns, KeysOfTheGameCanBeChanged) {
  const Outcome outcome = rate({"run-seed1", "--scripted", "random", "--episodes", "4", "--out", "changed", "--set",
                                "environment.max_episode_length=3", "--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  EXPECT_TRUE(contains(at(json, {"win"}).text, {"3 steps"}));
  EXPECT_EQ(at(json, {"changes", "0"}).text, "environment.max_episode_length=3");
}

// Nor of policies that play otherwise: both are in folders of their own, and the same once more takes the place of its
// like.
TEST_F(RatedRuns, OfAnotherGameLeaveThoseOfTheOwnAlone) {
  std::filesystem::copy(here_->path() / "run-seed2", here_->path() / "games",
                        std::filesystem::copy_options::recursive);  // no other test rates it
  const auto rated = [](std::vector<std::string> more) {
    more.insert(more.begin(), {"games", "--scripted", "random", "--episodes", "4"});
    const Outcome outcome = rate(more);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return outcome.out.substr(outcome.out.find("Written: "));
  };
  const std::vector<std::string> changed = {"--set", "environment.max_episode_length=3"};
  EXPECT_EQ(rated({"--greedy"}), "Written: games/ratings-2\n") << "a run's own folder is kept for its own game";
  EXPECT_EQ(rated({}), "Written: games/ratings\n");
  const std::string own = here_->read("games/ratings/ratings.json");
  EXPECT_EQ(rated(changed), "Written: games/ratings-3\n");
  EXPECT_EQ(rated({"--greedy"}), "Written: games/ratings-2\n");
  EXPECT_EQ(here_->read("games/ratings/ratings.json"), own);
}

// Two seeds of one config: what each of them won and lost is what their pool did.
TEST_F(RatedRuns, SeedsOfOneConfigArePooled) {
  const std::vector<std::string> arguments = {"run-seed1", "run-seed2", "--scripted", "random", "--episodes",
                                              "8",         "--json",    "-",          "--out",  "pooled"};
  std::vector<std::string> with_group = arguments;
  with_group.push_back("--group");
  const Outcome outcome = rate(with_group);
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  EXPECT_EQ(names_of(json), (Names{"random", "run (2 seeds)"}));
  double games = 0;
  for (const char* count : {"wins", "losses", "ties"}) games += number_at(json, {"games", count, "0", "1"});
  EXPECT_EQ(games, 16) << "8 against each of two seeds";

  const auto copy = std::filesystem::copy_options::recursive;
  std::filesystem::copy(here_->path() / "run-seed2", here_->path() / "run-seed2-again", copy);
  with_group.insert(with_group.begin(), "run-seed2-again");
  const Outcome twice = rate(with_group);
  ASSERT_EQ(twice.code, 0) << twice.err;
  EXPECT_EQ(names_of(parse_yaml_text(twice.out, "json")), (Names{"random", "run (3 runs of 2 seeds)"}));
}

TEST_F(RatedRuns, SeveralAreWrittenBesideThemAndToldBeforehand) {
  std::filesystem::create_directory(here_->path() / "runs");
  for (const char* run : {"run-seed1", "run-seed2"})
    std::filesystem::copy(here_->path() / run, here_->path() / "runs" / run, std::filesystem::copy_options::recursive);
  const Outcome outcome =
      rate({"runs/run-seed1/", "runs/run-seed2", "--scripted", "random,circle,pursuer", "--episodes", "8"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"Written: runs/ratings"}));
  EXPECT_TRUE(here_->has("runs/ratings/ratings.csv"));
  EXPECT_TRUE(contains(outcome.err, {" matches of 8 episodes, about ", "\nplayed in "}));
  // Those of other runs do not take their place; the same once more do.
  std::filesystem::copy(here_->path() / "run-seed2", here_->path() / "runs/third",
                        std::filesystem::copy_options::recursive);
  const auto written = [](const char* first, const char* second) {
    return rate({first, second, "--scripted", "random", "--episodes", "2", "--checkpoints", "1"}).out;
  };
  EXPECT_TRUE(contains(written("runs/run-seed1", "runs/third"), {"Written: runs/ratings-2\n"}));
  EXPECT_TRUE(contains(written("runs/third", "runs/run-seed1"), {"Written: runs/ratings-2\n"}));
  EXPECT_TRUE(contains(written("runs/run-seed1", "runs/run-seed2"), {"Written: runs/ratings\n"}));
  // A report of several runs beside them is not that of one run.
  here_->write("runs/report.html", "of both");
  EXPECT_TRUE(contains(written("runs/run-seed1", "runs/run-seed2"), {"Written: runs/ratings\n"}));
  EXPECT_EQ(here_->read("runs/report.html"), "of both");
}

// Players without a run folder are others too: groups of runs, and exported policies.
TEST_F(RatedRuns, RatingsOfOtherGroupsAndPoliciesStay) {
  const std::filesystem::path home = here_->path();
  std::filesystem::create_directory(home / "groups");
  for (const char* copy : {"groups/a-seed1", "groups/a-seed2", "groups/b-seed1", "groups/b-seed2"})
    std::filesystem::copy(home / (std::string(copy).ends_with("1") ? "run-seed1" : "run-seed2"), home / copy,
                          std::filesystem::copy_options::recursive);
  const auto written = [](std::vector<std::string> players) {
    for (const char* word : {"--scripted", "random", "--episodes", "2", "--checkpoints", "1"}) players.push_back(word);
    return rate(players).out;
  };
  EXPECT_TRUE(contains(written({"groups/a-seed1", "groups/a-seed2", "--group"}), {"Written: groups/ratings\n"}));
  EXPECT_TRUE(contains(written({"groups/b-seed1", "groups/b-seed2", "--group"}), {"Written: groups/ratings-2\n"}));
  EXPECT_TRUE(contains(written({"groups/a-seed1", "groups/a-seed2", "--group"}), {"Written: groups/ratings\n"}));
  for (const char* name : {"exported/a", "exported/b"})
    ASSERT_EQ(here_->run({"export", "run-seed1", "--team", "0", "--format", "safetensors", "--out", name}).code, 0);
  EXPECT_TRUE(contains(written({"exported/a"}), {"Written: exported/ratings\n"}));
  EXPECT_TRUE(contains(written({"exported/b"}), {"Written: exported/ratings-2\n"}));
}

TEST_F(RatedRuns, WhereNothingCanBeWrittenNothingIsPlayed) {
  std::filesystem::copy(here_->path() / "run-seed1", here_->path() / "taken", std::filesystem::copy_options::recursive);
  std::filesystem::remove_all(here_->path() / "taken/ratings");  // of another test
  here_->write("taken/ratings", "a file");
  const Outcome outcome = rate({"taken", "--scripted", "random", "--episodes", "2"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(contains(outcome.err, {"taken/ratings is a file, not a folder; --out takes another folder"}));
  EXPECT_EQ(outcome.err.find("played in"), std::string::npos) << outcome.err;
}

TEST_F(RatedRuns, ADamagedCheckpointIsLeftOut) {
  std::filesystem::copy(here_->path() / "run-seed2", here_->path() / "damaged",
                        std::filesystem::copy_options::recursive);
  here_->write("damaged/checkpoints/update_00000003.h5", "not HDF5");
  const Outcome outcome = rate({"damaged", "--scripted", "random", "--episodes", "8", "--checkpoints", "0"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.err, {"warning: ", "update_00000003.h5", "it is left out"}));
  EXPECT_TRUE(contains(outcome.out, {"damaged@4"}));
}

TEST_F(RatedRuns, WhereTheNewestIsDamagedAnOlderOnePlays) {
  std::filesystem::copy(here_->path() / "run-seed2", here_->path() / "torn", std::filesystem::copy_options::recursive);
  here_->write("torn/checkpoints/update_00000004.h5", "not HDF5");
  std::filesystem::remove(here_->path() / "torn/checkpoints/best.h5");
  const Outcome outcome = rate({"torn", "--scripted", "random", "--episodes", "8"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.err, {"update_00000004.h5", "it is left out"}));
  EXPECT_TRUE(contains(outcome.out, {"torn@3"}));
}

// A ratings.json of any shape: what was played is kept beside it.
TEST_F(RatedRuns, WhatIsNoRatingsLosesNoGames) {
  std::filesystem::copy(here_->path() / "run-seed2", here_->path() / "odd", std::filesystem::copy_options::recursive);
  std::filesystem::remove(here_->path() / "odd/report.html");  // which would show the ratings
  here_->write("odd/ratings/ratings.json", R"({"scenario": 5, "players": 3})");
  const Outcome outcome = rate({"odd", "--scripted", "random", "--episodes", "8"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(here_->has("odd/ratings-2/ratings.json"));
}

TEST_F(RatedRuns, TooFewEpisodesForAMixedTeamAreToldBeforeTheGames) {
  here_->write("two.yaml", "policies: [random, circle]\n");
  const Outcome outcome = rate({"run-seed1", "two.yaml", "--scripted", "random", "--episodes", "1", "--out", "few"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_EQ(outcome.err,
            "gigastep: episodes: 1, and 2 policies of a mixed team are to share them; needed: 2 or more\n");
  EXPECT_FALSE(here_->has("few"));
}

// Descriptions are for people.
TEST_F(RatedRuns, ADescribedMapIsTheSameGame) {
  for (const char* name : {"first", "second"}) {
    here_->write(cat(name, ".yaml"),
                 cat(kShortConfig, "environment: {maps: [mine], map_definitions: {mine: {description: ", name,
                     ", boxes: [[4, 4, 6, 6]]}}}\n"));
    ASSERT_EQ(here_->run({"train", cat(name, ".yaml"), "--quiet", "--run-dir", cat(name, "-map")}).code, 0);
  }
  const Outcome outcome =
      rate({"first-map", "second-map", "--scripted", "none", "--episodes", "2", "--out", "of-maps"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
}

// By the keys that a person would change: not every wall of a map that only one of them has.
TEST_F(RatedRuns, OtherGamesAreToldByWhatDiffers) {
  here_->write("other.yaml", std::string(kShortConfig) + "environment: {max_episode_length: 90, maps: four_rooms}\n");
  ASSERT_EQ(here_->run({"train", "other.yaml", "--quiet", "--run-dir", "other"}).code, 0);
  const Outcome outcome = rate({"run-seed1", "other", "--out", "none"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(contains(outcome.err, {"were trained in different games: say with --scenario which one is played",
                                     "\n  max_episode_length: 500 in run-seed1@", "\n  maps: "}));
  EXPECT_EQ(outcome.err.find("map_definitions"), std::string::npos) << outcome.err;
  EXPECT_FALSE(here_->has("none"));
}

TEST_F(RatedRuns, MistakesAreToldAndLeaveNothing) {
  std::filesystem::create_directory(here_->path() / "empty");
  struct Mistake {
    std::vector<std::string> arguments;
    std::string part;
  };
  const Mistake mistakes[] = {
      {{"nowhere"}, "there is no checkpoint or run folder nowhere"},
      {{"empty"}, "the folder empty holds no whole checkpoint"},
      {{"run-seed1", "./run-seed1"}, "the run ./run-seed1 is given twice"},
      {{"run-seed1", "--scripted", "cirle"},
       "'cirle' is no scripted team; nearest: 'circle'; allowed: all, none, or out of random"},
      {{"run-seed1", "--scripted", "circle,circle"}, "'circle' is there twice"},
      {{"run-seed1", "--scripted", "random,circle", "--anchor", "cirle"},
       "--anchor: 'cirle' is none of the players; nearest: 'circle'; allowed: random, circle, run-seed1@"},
      {{"run-seed1", "--sides", "both"}, "--sides: 'both' is not one of: auto, alike, apart"},
      {{"run-seed1", "--episodes", "0"}, "--episodes: '0' is not an integer in [1, 10000000]"},
      {{"circle"}, "'circle' is a scripted team: it plays with --scripted circle"},
      {{"run-seed1/checkpoints/update_00000004.h5", "--scripted", "none"},
       "run-seed1@4 alone has nobody to play against: name another run, --checkpoints 0, or --scripted all"},
      {{"run-seed1", "--scenario", "identical_1_vs_l"}, "identical_1_vs_l"},
      {{"run-seed1", "--set", "mappo.gamma=0.9"}, "--set mappo.gamma: mappo: unknown key"},
      {{}, "RUN"},
  };
  const auto stride = static_cast<size_t>(thinned(4));
  for (size_t k = stride / 2; k < std::size(mistakes); k += stride) {
    const Mistake& mistake = mistakes[k];
    std::vector<std::string> arguments = mistake.arguments;
    arguments.insert(arguments.end(), {"--out", "none"});
    const Outcome outcome = rate(arguments);
    EXPECT_EQ(outcome.code, 2) << mistake.part;
    EXPECT_TRUE(contains(outcome.err, {mistake.part}));
    EXPECT_FALSE(here_->has("none"));
  }
}

TEST_F(RatedRuns, ExportedPoliciesPlayToo) {
  const auto exported = [](const std::string& run, const std::string& format, const std::string& out) {
    return here_->run({"export", run, "--team", "0", "--format", format, "--out", out}).code;
  };
  ASSERT_EQ(exported("run-seed1", "safetensors", "duellist"), 0);
  ASSERT_EQ(exported("run-seed2", "torchscript", "module"), 0);
  const std::vector<std::string> arguments = {"duellist",
                                              "module/",
                                              "run-seed1/checkpoints/update_00000004.h5",
                                              "--scripted",
                                              "random,pursuer",
                                              "--episodes",
                                              "16",
                                              "--out",
                                              "exported",
                                              "--json",
                                              "-"};
  const Outcome distrusted = rate(arguments);
  EXPECT_EQ(distrusted.code, 2);
  EXPECT_TRUE(contains(distrusted.err, {"module/policy.pt is a TorchScript module", "--trust"}));
  std::vector<std::string> trusting = arguments;
  trusting.push_back("--trust");
  const Outcome outcome = rate(trusting);
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  EXPECT_EQ(names_of(json), (Names{"random", "pursuer", "duellist", "module", "run-seed1@4"}));
  EXPECT_EQ(at(json, {"players", "1", "kind"}).text, "script");
  EXPECT_EQ(at(json, {"players", "2", "kind"}).text, "exported");
  EXPECT_EQ(at(json, {"players", "4", "kind"}).text, "checkpoint");
  for (const char* i : {"0", "1", "2", "3", "4"})
    for (const char* j : {"0", "1", "2", "3", "4"}) {
      double sum = 0;
      for (const char* count : {"wins", "losses", "ties"}) sum += number_at(json, {"games", count, i, j});
      EXPECT_EQ(sum, 16) << i << " against " << j;
    }
  EXPECT_TRUE(contains(here_->read("exported/win_rate.svg"), {"against duellist"}));

  const Outcome alone = rate({"duellist", "--scripted", "random,circle", "--episodes", "8"});
  ASSERT_EQ(alone.code, 0) << alone.err;
  EXPECT_TRUE(contains(alone.out, {"duellist", "circle"}));
  EXPECT_TRUE(here_->has("ratings/matrix.svg") && !here_->has("ratings/win_rate.svg"));
  EXPECT_FALSE(here_->has("duellist/ratings")) << "an export stays as it was written";
}

// A folder of its own, so that no other test rates it.
TEST_F(RatedRuns, AnExportedPolicyCarriesItsRating) {
  std::filesystem::copy(here_->path() / "run-seed2", here_->path() / "carrier",
                        std::filesystem::copy_options::recursive);
  const auto ratings_of = [](const std::string& out) {
    const Outcome outcome = here_->run(
        {"export", "carrier/checkpoints/update_00000004.h5", "--team", "1", "--format", "safetensors", "--out", out});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return parse_yaml_text(here_->read(out + "/manifest.json"), "manifest");
  };
  EXPECT_TRUE(at(ratings_of("unrated"), {"ratings"}).entries.empty());
  ASSERT_EQ(rate({"carrier", "--scripted", "random,circle", "--sides", "apart", "--episodes", "16"}).code, 0);
  const Document manifest = ratings_of("rated");
  EXPECT_EQ(at(manifest, {"ratings", "anchor"}).text, "random");
  EXPECT_EQ(number_at(manifest, {"ratings", "episodes"}), 16);
  EXPECT_EQ(number_at(manifest, {"ratings", "side"}), 1);
  const CsvTable csv = parse_csv(here_->read("carrier/ratings/ratings.csv"));
  bool found = false;
  for (size_t row = 0; row < csv.rows.size(); ++row) {
    if (csv.cell(row, "player") != "carrier@4" || csv.cell(row, "side") != "1") continue;
    found = true;
    EXPECT_EQ(csv.cell(row, "wins"), at(manifest, {"ratings", "wins"}).text);
    EXPECT_EQ(csv.cell(row, "standing"), at(manifest, {"ratings", "standing"}).text);
    const bool finite = csv.cell(row, "standing") == "rated";  // JSON has no infinity
    EXPECT_EQ(finite ? csv.cell(row, "rating") : "null", at(manifest, {"ratings", "rating"}).text);
  }
  EXPECT_TRUE(found);
  here_->write("carrier/ratings/ratings.json", "{");
  const Outcome damaged = here_->run({"export", "carrier/checkpoints/update_00000004.h5", "--team", "1", "--format",
                                      "safetensors", "--out", "without"});
  EXPECT_EQ(damaged.code, 0);
  EXPECT_TRUE(
      contains(damaged.err, {"warning: ", "carrier/ratings/ratings.json:1:1: ", "the manifest has no ratings"}));
}

// Two runs in folders of the same name, rated together into the folder of one of them.
TEST_F(RatedRuns, CopiesOfCheckpointsAreNamedAfterTheirFiles) {
  for (const auto& [from, to] : {std::pair{"run-seed1", "a.h5"}, {"run-seed2", "b.h5"}})
    std::filesystem::copy_file(here_->path() / from / "checkpoints/update_00000004.h5", here_->path() / to);
  const Outcome outcome = rate({"a.h5", "b.h5", "--scripted", "random", "--episodes", "32", "--out", "copies"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"a.h5@4", "b.h5@4"})) << outcome.out;
}

TEST_F(RatedRuns, OfTheSameNameAreToldApart) {
  for (const auto& [from, to] : {std::pair{"run-seed1", "first"}, {"run-seed2", "second"}}) {
    std::filesystem::create_directory(here_->path() / to);
    std::filesystem::copy(here_->path() / from, here_->path() / to / "twin", std::filesystem::copy_options::recursive);
  }
  const Outcome outcome = rate({"second/twin", "first/twin/checkpoints/update_00000004.h5", "--checkpoints", "1",
                                "--scripted", "random", "--episodes", "32", "--out", "first/twin/ratings"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"first/twin@4", "second/twin@4"}));
  const CsvTable csv = parse_csv(here_->read("first/twin/ratings/ratings.csv"));
  std::string of_first, of_second;
  for (size_t row = 0; row < csv.rows.size(); ++row) {
    if (csv.cell(row, "run") == "first/twin") of_first = csv.cell(row, "paper_elo");
    if (csv.cell(row, "player") == "second/twin@4") of_second = csv.cell(row, "paper_elo");
  }
  ASSERT_NE(of_first, of_second);
  const Outcome exported = here_->run({"export", "first/twin/checkpoints/update_00000004.h5", "--team", "0", "--format",
                                       "safetensors", "--out", "twin_policy"});
  ASSERT_EQ(exported.code, 0) << exported.err;
  EXPECT_EQ(at(parse_yaml_text(here_->read("twin_policy/manifest.json"), "json"), {"ratings", "paper_elo"}).text,
            of_first);
}

TEST_F(RatedRuns, HelpHasExamples) {
  const Outcome help = here_->run({"rate", "--help"});
  EXPECT_EQ(help.code, 0);
  EXPECT_TRUE(contains(help.out, {"--scripted", "--checkpoints", "--sides", "Examples:", "gigastep rate runs/"}));
}

}  // namespace
}  // namespace giga::test
