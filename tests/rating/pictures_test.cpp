// The pictures: well-formed, complete, and true to the figures.
#include "rating/pictures.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "chart/heat_map.hpp"
#include "chart/line_chart.hpp"
#include "chart/markup.hpp"
#include "games.hpp"
#include "io/temporary_folder.hpp"
#include "sheets.hpp"
#include "support/xml.hpp"

namespace giga::test {
namespace {

constexpr TrainingAxis kSteps = TrainingAxis::agent_steps, kTime = TrainingAxis::seconds;
using Elements = std::vector<XmlElement>;

int count(const Elements& elements, const std::string& name, const std::string& attribute, const std::string& value) {
  return static_cast<int>(std::count_if(elements.begin(), elements.end(), [&](const XmlElement& e) {
    const auto found = e.attributes.find(attribute);
    return e.name == name && found != e.attributes.end() && found->second == value;
  }));
}
int count_texts(const Elements& elements, const std::string& text) {
  return static_cast<int>(
      std::count_if(elements.begin(), elements.end(), [&](const XmlElement& e) { return e.text == text; }));
}
/// The element whose <title> child has this text.
const XmlElement& hinted(const Elements& elements, const std::string& hint) {
  for (size_t k = 1; k < elements.size(); ++k)
    if (elements[k].name == "title" && elements[k].text == hint) return elements[k - 1];
  throw Error("no element with the hint " + hint);
}
double number(const XmlElement& element, const char* attribute) { return std::stod(element.attributes.at(attribute)); }

/// No text and no mark lies outside of the picture.
void expect_inside(const Elements& elements) {
  const double width = number(elements[0], "width"), height = number(elements[0], "height");
  for (const XmlElement& e : elements)
    for (const auto& [name, limit] : {std::pair{"x", width}, {"y", height}, {"cx", width}, {"cy", height}}) {
      if (!e.attributes.contains(name)) continue;
      EXPECT_GE(number(e, name), 0) << e.name << " " << e.text;
      EXPECT_LE(number(e, name), limit) << e.name << " " << e.text;
    }
}

TEST(RatingPictures, RatingOverTraining) {
  const RatingSheet sheet = make_sheet({});
  const Elements svg = parse_xml(rating_picture(sheet, kSteps));
  EXPECT_EQ(svg[0].name, "svg");
  for (const char* text : {"Rating over training: duel", "Elo", "agent-steps (millions)", "random", "noop", "circle",
                           "duel-mappo-seed1", "best checkpoint"})
    EXPECT_EQ(count_texts(svg, text), 1) << text;
  EXPECT_EQ(count(svg, "circle", "fill", line_colour(0)), 4 + 1);  // four checkpoints and the legend
  EXPECT_EQ(count(svg, "circle", "r", "6.5"), 1 + 1);              // one best checkpoint and the legend
  expect_inside(svg);
  // Equal distances of agent-steps are equal distances in the picture; a higher rating stands higher.
  const auto mark = [&](int k) -> const XmlElement& {
    const Rating& r = sheet.ratings.list[static_cast<size_t>(2 + k)];
    return hinted(svg, cat(sheet.ratings.name(r), ": ", std::lround(r.rating.value), " +- ",
                           std::lround(r.rating.high() - r.rating.value)));
  };
  EXPECT_NEAR(number(mark(2), "cx") - number(mark(1), "cx"), number(mark(4), "cx") - number(mark(3), "cx"), 0.02);
  const double per_elo = (number(mark(1), "cy") - number(mark(4), "cy")) /
                         (sheet.ratings.list[6].rating.value - sheet.ratings.list[3].rating.value);
  EXPECT_GT(per_elo, 0.1);
  EXPECT_NEAR((number(mark(1), "cy") - number(mark(2), "cy")) /
                  (sheet.ratings.list[4].rating.value - sheet.ratings.list[3].rating.value),
              per_elo, 0.001);
}

// A run whose later updates take longer: along time its checkpoints stand apart as the seconds say.
TEST(RatingPictures, OverWallClockTime) {
  RatingSheet sheet = make_sheet({});
  const double seconds[] = {100, 200, 500, 800};
  for (size_t k = 0; k < 4; ++k) sheet.infos[3 + k].seconds = seconds[k];  // behind the three scripts
  const auto x_of = [](const Elements& svg, const std::string& hint) { return number(hinted(svg, hint), "cx"); };
  const Elements ratings = parse_xml(rating_picture(sheet, kTime)), wins = parse_xml(win_rate_picture(sheet, kTime));
  double x_rating[4], x_wins[4];
  for (size_t k = 0; k < 4; ++k) {
    const Rating& r = sheet.ratings.list[3 + k];
    x_rating[k] = x_of(ratings, cat(sheet.ratings.name(r), ": ", std::lround(r.rating.value), " +- ",
                                    std::lround(r.rating.high() - r.rating.value)));
    const Games& g = sheet.table.games[(3 + k) * sheet.table.players.size() + 2];  // against circle
    x_wins[k] = x_of(wins, cat(sheet.table.players[3 + k], ", team 0: won ", g.wins, " of 200"));
  }
  for (const double* x : {x_rating, x_wins}) {
    EXPECT_NEAR((x[2] - x[1]) / (x[1] - x[0]), 3, 0.01);  // 300 s after 100 s
    EXPECT_NEAR((x[3] - x[2]) / (x[1] - x[0]), 3, 0.01);
  }
  for (const Elements& svg : {ratings, wins}) {
    EXPECT_EQ(count_texts(svg, "wall-clock time of training (minutes)"), 1);
    EXPECT_GE(count_texts(svg, "10"), 1) << "a tick at ten minutes, of 13.3";
    expect_inside(svg);
  }
}

TEST(RatingPictures, TimeIsInTheUnitThatIsEasyToRead) {
  RatingSheet sheet = make_sheet({.n_checkpoints = 1});
  for (const auto& [seconds, label, tick] : {std::tuple{1.5, "wall-clock time of training (seconds)", "1.4"},
                                             {100.0, "wall-clock time of training (seconds)", "80"},
                                             {3600.0, "wall-clock time of training (minutes)", "60"},
                                             {36000.0, "wall-clock time of training (hours)", "10"}}) {
    sheet.infos[3].seconds = seconds;
    const Elements svg = parse_xml(rating_picture(sheet, kTime));
    EXPECT_EQ(count_texts(svg, label), 1) << seconds;
    EXPECT_GE(count_texts(svg, tick), 1) << seconds;
  }
}

TEST(RatingPictures, APanelPerTeamWhereSidesAreApart) {
  const Elements svg = parse_xml(rating_picture(make_sheet({.sides = Sides::apart}), kSteps));
  EXPECT_EQ(count_texts(svg, "Team 0"), 2);  // panel and legend
  EXPECT_EQ(count_texts(svg, "Team 1"), 2);
  EXPECT_EQ(count(svg, "circle", "fill", line_colour(1)), 4 + 1);
  EXPECT_EQ(count_texts(svg, "circle"), 2);
  expect_inside(svg);
}

TEST(RatingPictures, InfiniteRatingsAreTrianglesAtTheEdge) {
  const RatingSheet sheet = make_sheet({.gain = 700, .n_games = 20});
  const Elements svg = parse_xml(rating_picture(sheet, kSteps));
  const auto infinite = std::count_if(sheet.ratings.list.begin(), sheet.ratings.list.end(),
                                      [](const Rating& r) { return r.standing == Standing::above; });
  ASSERT_GT(infinite, 0);
  const auto triangles = std::count_if(svg.begin(), svg.end(), [](const XmlElement& e) {
    return e.name == "path" && e.attributes.contains("fill") && e.attributes.at("fill") == line_colour(0);
  });
  EXPECT_EQ(triangles, infinite);
  for (const XmlElement& e : svg)
    for (const auto& [name, value] : e.attributes)
      EXPECT_TRUE(value.find("nan") == std::string::npos && value.find("inf") == std::string::npos) << name << value;
}

TEST(RatingPictures, WhereTheAnchorNeverWinsCheckpointsAreShownAmongThemselves) {
  RatingSheet sheet;
  sheet.table = table_of({"random", "run@1", "run@2"});
  add(sheet.table, "run@2", "run@1", {30, 10, 0});
  for (const char* strong : {"run@1", "run@2"}) add(sheet.table, strong, "random", {20, 0, 0});
  sheet.infos = {
      {}, {PlayerKind::checkpoint, "run", 1, 100, 1, false, {}}, {PlayerKind::checkpoint, "run", 2, 200, 2, false, {}}};
  sheet.ratings = rate(sheet.table, {});
  const Elements svg = parse_xml(rating_picture(sheet, kSteps));
  EXPECT_EQ(count_texts(svg, "Elo by maximum likelihood, run@1 = 0; bars: 95 % intervals; grey: baselines"), 1);
  EXPECT_NO_THROW(hinted(svg, "run@2: 191 +- 124"));  // 30 : 10, see ratings_test.cpp
}

TEST(RatingPictures, WinRatesAgainstEachScript) {
  const RatingSheet sheet = make_sheet({.runs = {"duel-a", "duel-b"}});
  const Elements svg = parse_xml(win_rate_picture(sheet, kSteps));
  for (const char* text : {"against random", "against noop", "against circle", "a, team 0", "a, team 1", "b, team 0",
                           "games won", "100 %", "agent-steps (millions)"})
    EXPECT_GE(count_texts(svg, text), 1) << text;
  // Two runs, two sides, three scripts, four checkpoints; and two lines of each colour in the legend.
  EXPECT_EQ(count(svg, "circle", "fill", line_colour(1)), 2 * 3 * 4 + 2);
  // Player 6, "duel-a@400", on side 1 against circle, player 2: its wins are losses of side 0.
  const Games& g = sheet.table.games[2 * sheet.table.players.size() + 6];
  EXPECT_NO_THROW(hinted(svg, cat("duel-a@400, team 1: won ", g.losses, " of 200")));
  expect_inside(svg);
}

TEST(RatingPictures, CrossPlayMatrixShowsEachShare) {
  const RatingSheet sheet = make_sheet({.n_checkpoints = 1});
  const Elements svg = parse_xml(matrix_picture(sheet));
  const Games& g = sheet.table.games[0 * 4 + 3];  // random on side 0 against the checkpoint
  const double share = (g.wins + g.ties / 2.0) / 200;
  EXPECT_EQ(hinted(svg, cat("random against duel-mappo-seed1@100: ", g.wins, " won, 0 tied, ", g.losses, " lost"))
                .attributes.at("fill"),
            share_colour(share));
  EXPECT_GE(count_texts(svg, std::to_string(std::lround(100 * share))), 1);
  for (const char* text : {"plays side 0", "plays side 1", "points of side 0"}) EXPECT_EQ(count_texts(svg, text), 1);
  EXPECT_EQ(count_texts(svg, "update 100"), 2);
  expect_inside(svg);
}

TEST(RatingPictures, NothingToDrawIsNoPicture) {
  RatingSheet sheet = make_sheet({.n_checkpoints = 0});
  for (const TrainingAxis along : {kSteps, kTime}) {
    EXPECT_EQ(rating_picture(sheet, along), "");
    EXPECT_EQ(win_rate_picture(sheet, along), "");
  }
  EXPECT_NE(matrix_picture(sheet), "");
}

TEST(RatingPictures, NamesAreOnlyText) {
  RatingSheet sheet = make_sheet({.runs = {"<a&\"b\"'>\x01\xff"}});
  sheet.scenario = "</svg><script>";
  const std::string broken = "<a&\"b\"'>\xEF\xBF\xBD\xEF\xBF\xBD";  // what XML cannot hold, replaced
  EXPECT_EQ(count_texts(parse_xml(rating_picture(sheet, kSteps)), broken), 1);
  EXPECT_EQ(count_texts(parse_xml(matrix_picture(sheet)), "Cross-play: </svg><script>"), 1);
  EXPECT_NO_THROW(parse_xml(win_rate_picture(sheet, kSteps)));
}

}  // namespace
}  // namespace giga::test
