// Tables and files of ratings.
#include "rating/sheet.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "config/document.hpp"
#include "games.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "rating/find_rating.hpp"
#include "sheets.hpp"

namespace giga::test {
namespace {

/// random, a checkpoint that wins 30 of 40, and one that won all of its 20.
RatingSheet small_sheet() {
  RatingSheet sheet;
  sheet.scenario = "duel";
  sheet.table = table_of({"random", "run, 1@100", "run, 1@200"});
  add(sheet.table, "run, 1@100", "random", {20, 5, 10});
  add(sheet.table, "random", "run, 1@100", {0, 5, 0});
  add(sheet.table, "run, 1@200", "random", {20, 0, 0});
  sheet.infos = {{},
                 {PlayerKind::checkpoint, "run, 1", 100, 25600, 1.5, false, {}},
                 {PlayerKind::checkpoint, "run, 1", 200, 51200, 3, true, {}}};
  sheet.ratings = rate(sheet.table, {});
  return sheet;
}

TEST(RatingSheet, CsvHasARowPerRating) {
  const std::string csv = ratings_csv(small_sheet());
  // 190.849 and 63.433: see ratings_test.cpp.
  EXPECT_TRUE(contains(
      csv, {"player,side,standing,rating,standard_error,ci95_low,ci95_high,group,group_reference,group_rating,"
            "group_standard_error,games,wins,ties,losses,score,paper_elo,run,updates,agent_steps,seconds,best\r\n",
            "random,both,rated,0,0,0,0,0,random,0,0,60,5,10,45,", "\"run, 1@100\",both,rated,190.8485", ",63.43276",
            ",40,25,10,5,0.75,", ",\"run, 1\",100,25600,1.5,0\r\n",
            "\"run, 1@200\",both,above,inf,,,,1,\"run, 1@200\",0,0,20,20,0,0,1,", ",\"run, 1\",200,51200,3,1\r\n"}));
}

TEST(RatingSheet, MatrixHasTheSharesOfSide0) {
  EXPECT_EQ(matrix_csv(small_sheet()),
            "side 0 \\ side 1,random,\"run, 1@100\",\"run, 1@200\"\r\n"
            "random,,0,\r\n"
            "\"run, 1@100\",0.7142857142857143,,\r\n"  // (20 + 10 / 2) / 35
            "\"run, 1@200\",1,,\r\n");
}

TEST(RatingSheet, JsonHoldsAll) {
  const Document json = parse_yaml_text(json_text(ratings_json(small_sheet(), "ratings")), "json");
  const auto text = [](const Node* node) { return node ? node->text : "missing"; };
  EXPECT_EQ(text(json.root.find("scenario")), "duel");
  EXPECT_EQ(text(json.root.find("anchor")), "random");
  EXPECT_EQ(text(json.root.find("sides")), "alike");
  EXPECT_NEAR(std::stod(text(json.root.find("log_likelihood"))), -22.4934, 1e-4);
  EXPECT_EQ(text(json.root.find("paper_elo")->find("k")), "32");
  // One pair is in a group, the other is that of who won all: no test. A chain has no cyclic part.
  EXPECT_EQ(print_node(*json.root.find("goodness_of_fit")->find("p_value")), "null");
  EXPECT_EQ(text(json.root.find("goodness_of_fit")->find("pairs")), "1");
  EXPECT_EQ(text(json.root.find("intransitivity")->find("pairs")), "2");
  EXPECT_NEAR(std::stod(text(json.root.find("intransitivity")->find("share"))), 0, 1e-12);
  ASSERT_EQ(json.root.find("players")->items.size(), 3u);
  EXPECT_EQ(text(json.root.find("players")->items[2].find("best")), "true");
  EXPECT_EQ(print_node(*json.root.find("games")),
            "{wins: [[0, 0, 0], [20, 0, 0], [20, 0, 0]], "
            "losses: [[0, 5, 0], [5, 0, 0], [0, 0, 0]], "
            "ties: [[0, 0, 0], [10, 0, 0], [0, 0, 0]]}");
  const std::vector<Node>& ratings = json.root.find("ratings")->items;
  ASSERT_EQ(ratings.size(), 3u);
  EXPECT_NEAR(std::stod(text(ratings[1].find("rating"))), 190.8485, 1e-3);
  EXPECT_NEAR(std::stod(text(&ratings[1].find("ci95")->items[1])), 190.8485 + 1.96 * 63.4328, 0.01);
  EXPECT_EQ(text(ratings[2].find("standing")), "above");
  EXPECT_TRUE(ratings[2].find("rating")->is_null());
  EXPECT_EQ(json.root.find("remarks")->items.size(), 1u);
}

TEST(RatingSheet, TableIsSortedAndSaysWhatIsInfinite) {
  const std::string table = ratings_table(small_sheet());
  EXPECT_TRUE(contains(table, {"random = 0; a tie is half a win", "\nFit: ", "\nIntransitive: 0.0 % of",
                               "note: run, 1@200: won all of its 20 games"}));
  const size_t best = table.find("run, 1@200  both  +infinity        -"),
               second = table.find("run, 1@100  both       +191      124"),
               last = table.find("random      both          0        0");
  ASSERT_NE(last, std::string::npos) << table;
  EXPECT_LT(best, second);
  EXPECT_LT(second, last);
}

TEST(RatingSheet, TheSidesAdvantageIsTold) {
  RatingSheet sheet = make_sheet({.sides = Sides::apart});
  const std::string table = ratings_table(sheet);
  EXPECT_TRUE(contains(table, {"Side 0 is ahead by ", " +- "}));
  sheet.ratings.side_advantage->value = -71.3;
  EXPECT_TRUE(contains(ratings_table(sheet), {"Side 1 is ahead by 71 +- "})) << "the right side, without a sign";
  sheet.ratings.side_advantage->value = 71.3;
  EXPECT_TRUE(contains(ratings_table(sheet), {"Side 0 is ahead by 71 +- "}));
  sheet = make_sheet({.sides = Sides::apart});
  const Document json = parse_yaml_text(json_text(ratings_json(sheet, "ratings")), "json");
  const double advantage = std::stod(json.root.find("side_advantage")->find("value")->text);
  EXPECT_NEAR(advantage, 80, 3 * sheet.ratings.side_advantage->standard_error);
}

// a and b are one: their games against c add up, and those between them are games of the pool against itself.
TEST(RatingSheet, PooledPlayersAreOne) {
  GameTable table{{"a", "c", "b"}, {}};
  for (int k = 1; k <= 9; ++k) table.games.push_back({k, 10 * k, 100 * k});  // row a: 1 2 3, c: 4 5 6, b: 7 8 9
  const GameTable pool = pooled(table, {"ab", "c", "ab"});
  EXPECT_EQ(pool.players, (std::vector<std::string>{"ab", "c"}));
  const int wins[] = {1 + 3 + 7 + 9, 2 + 8, 4 + 6, 5};
  ASSERT_EQ(pool.games.size(), 4u);
  for (size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(pool.games[k].wins, wins[k]);
    EXPECT_EQ(pool.games[k].losses, 10 * wins[k]);
    EXPECT_EQ(pool.games[k].ties, 100 * wins[k]);
  }
}

TEST(RatingSheet, NamesForPicturesAreShort) {
  using Names = std::vector<std::string>;
  EXPECT_EQ(short_names(make_sheet({.runs = {"duel-mappo-seed1-001"}, .n_checkpoints = 1})),
            (Names{"random", "noop", "circle", "update 100"}));
  EXPECT_EQ(short_names(make_sheet({.runs = {"duel-mappo-seed1-001", "duel-mappo-seed2-001"}, .n_checkpoints = 1})),
            (Names{"random", "noop", "circle", "seed1-001@100", "seed2-001@100"}));
  EXPECT_EQ(short_names(make_sheet({.runs = {"run-1", "run-"}, .n_checkpoints = 1}))[4], "run-@100");
}

TEST(RatingSheet, WritesAFolder) {
  const TemporaryFolder folder;
  const RatingSheet sheet = make_sheet({});
  const std::filesystem::path out = folder / "new/ratings";
  Json json = ratings_json(sheet, out);
  json["seed"] = 7;
  write_ratings(out, sheet, json);
  EXPECT_EQ(read_file(out / "ratings.csv"), ratings_csv(sheet));
  EXPECT_EQ(read_file(out / "matrix.csv"), matrix_csv(sheet));
  EXPECT_EQ(parse_yaml_text(read_file(out / "ratings.json"), "json").root.find("seed")->text, "7");
  for (const char* name : {"rating.svg", "win_rate.svg", "matrix.svg"})
    EXPECT_TRUE(contains(read_file(out / name), {"<svg", "</svg>"})) << name;
  for (const char* name : {"rating.svg", "win_rate.svg"})
    EXPECT_TRUE(contains(read_file(out / name), {">agent-steps (millions)<"})) << name;
  for (const char* name : {"rating_seconds.svg", "win_rate_seconds.svg"})
    EXPECT_TRUE(contains(read_file(out / name), {">wall-clock time of training (minutes)<"})) << name;
  const RatingSheet scripts = make_sheet({.n_checkpoints = 0});
  write_ratings(out, scripts, ratings_json(scripts, out));
  for (const char* name : {"rating.svg", "rating_seconds.svg", "win_rate.svg", "win_rate_seconds.svg"})
    EXPECT_FALSE(std::filesystem::exists(out / name)) << name << " would belong to other ratings";
  write_file(folder / "file", "");
  EXPECT_TRUE(
      contains(input_error_of([&] { write_ratings(folder / "file", scripts, {}); }), {"cannot create the folder"}));
}

/// `small_sheet()` whose run is in the folder `run` of `folder`, written to run/ratings.
RatingSheet sheet_of_run(const TemporaryFolder& folder) {
  std::filesystem::create_directories(folder / "run/ratings");
  RatingSheet sheet = small_sheet();
  for (PlayerInfo& info : sheet.infos)
    if (!info.is_baseline()) info.folder = std::filesystem::canonical(folder / "run");
  return sheet;
}

TEST(RatingSheet, TheRatingOfACheckpointIsFound) {
  const TemporaryFolder folder;
  const std::filesystem::path run = folder / "run", out = run / "ratings", file = out / "ratings.json";
  Json json = ratings_json(sheet_of_run(folder), out);
  json["episodes"] = 20;
  write_file(file, json_text(json));
  const auto text_of = [&](const RatedPolicy& policy) { return json_text(find_rating(file, policy)); };
  EXPECT_TRUE(contains(text_of({run, 100, 1}),
                       {"\"scenario\": \"duel\"", "\"anchor\": \"random\"", "\"episodes\": 20", "\"side\": \"both\"",
                        "\"standing\": \"rated\"", "\"rating\": 190.8485", "\"ci95\": [", "\"games\": 40"}));
  EXPECT_TRUE(contains(text_of({run, 200, 0}), {"\"standing\": \"above\"", "\"rating\": null"}));
  EXPECT_EQ(text_of({run, 300, 0}), "{}");

  RatingSheet apart = sheet_of_run(folder);
  RatingOptions options;
  options.sides = Sides::apart;
  add(apart.table, "random", "random", {5, 0, 5});
  apart.ratings = rate(apart.table, options);
  write_file(file, json_text(ratings_json(apart, out)));
  EXPECT_TRUE(contains(text_of({run, 100, 1}), {"\"side\": 1", "\"games\": 5"}));
  EXPECT_TRUE(contains(text_of({run, 100, 0}), {"\"side\": 0", "\"games\": 35"}));

  write_file(file, "[1, 2]");
  EXPECT_EQ(text_of({run, 100, 0}), "{}");
  write_file(file, "{1: ");
  EXPECT_TRUE(contains(input_error_of([&] { text_of({run, 100, 0}); }), {"ratings.json"}));
}

// The ratings of two runs whose folders have the same name, kept in the folder of the second one.
TEST(RatingSheet, RunsAreKnownByTheirPlaceNotByTheirName) {
  const TemporaryFolder folder;
  const std::filesystem::path first = folder / "first/seed1", second = folder / "second/seed1";
  for (const auto& run : {first, second}) std::filesystem::create_directories(run / "ratings");
  RatingSheet sheet = small_sheet();
  sheet.infos[1] = {PlayerKind::checkpoint, "first/seed1", 100, 25600, 1.5, false, std::filesystem::canonical(first)};
  sheet.infos[2] = {PlayerKind::checkpoint, "second/seed1", 100, 25600, 1.5, false, std::filesystem::canonical(second)};
  const auto file_of = [](const std::filesystem::path& run) { return run / "ratings/ratings.json"; };
  const auto games_of = [&](const std::filesystem::path& file, const std::filesystem::path& run) {
    return print_node(*parse_yaml_text(json_text(find_rating(file, {run, 100, 0})), "json").root.find("games"));
  };
  write_file(file_of(second), json_text(ratings_json(sheet, second / "ratings")));
  EXPECT_TRUE(contains(read_file(file_of(second)), {"\"folder\": \"..\"", "\"folder\": \"../../../first/seed1\""}));
  EXPECT_EQ(games_of(file_of(second), first), "40");
  EXPECT_EQ(games_of(file_of(second), second), "20");
  EXPECT_EQ(games_of(file_of(second), folder / "second/../second/seed1/"), "20") << "the same place by another path";
  std::filesystem::create_directory_symlink(second, folder / "link");
  EXPECT_EQ(games_of(folder / "link/ratings/ratings.json", folder / "link"), "20");
  std::filesystem::rename(folder / "second", folder / "moved");
  EXPECT_EQ(games_of(file_of(folder / "moved/seed1"), folder / "moved/seed1"), "20") << "with its ratings";
}

}  // namespace
}  // namespace giga::test
