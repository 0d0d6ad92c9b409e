// The ratings of a run in its report.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "io/temporary_folder.hpp"
#include "read_page.hpp"
#include "report/report.hpp"
#include "synthetic_run.hpp"

namespace giga::test {
namespace {

constexpr const char* kResults = R"({"scenario": "duel", "anchor": "random", "remarks": ["best: won all"], "ratings": [
  {"player": "run@3", "side": "both", "standing": "rated", "rating": 190.85, "ci95": [66.53, 315.17], "games": 40,
   "wins": 30, "ties": 0, "losses": 10, "score": 0.75, "paper_elo": 1216},
  {"player": "best", "side": 1, "standing": "above", "rating": null, "ci95": [null, null], "games": 20, "wins": 20,
   "ties": 0, "losses": 0, "score": 1, "paper_elo": 1230.5}]})";

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

TEST(ReportRatings, PicturesAndTableOfARatedRun) {
  const TemporaryFolder folder;
  SyntheticRun().write(folder / "run");
  write_text(folder / "run/ratings/ratings.json", kResults);
  write_text(folder / "run/ratings/rating.svg", "<svg>1</svg>");
  write_text(folder / "run/ratings/rating_seconds.svg", "<svg>2</svg>");
  write_text(folder / "run/ratings/matrix.svg", "<svg>3</svg>");
  const Elements section = section_of(report_page({read_run(folder / "run")}, {}), "Ratings");
  EXPECT_TRUE(contains(texts_of(section, "p", "note").at(0), {"duel, random = 0", "Note: best: won all."}));
  Rows pictures;  // there is no win_rate.svg
  for (const XmlElement& e : section) {
    const auto along = e.attributes.find("data-along");
    if (e.name == "div" && e.attributes.contains("class") && e.attributes.at("class") == "card picture")
      pictures.push_back({along == e.attributes.end() ? "" : along->second});
    if (e.name == "img") pictures.back().push_back(e.attributes.at("src"));
  }
  const std::string start = "data:image/svg+xml;charset=utf-8,%3Csvg%3E", end = "%3C%2Fsvg%3E";
  EXPECT_EQ(pictures,
            (Rows{{"agent_steps", start + "1" + end}, {"seconds", start + "2" + end}, {"", start + "3" + end}}));
  EXPECT_EQ(tables_of(section).at(0), (Rows{{"run@3", "both", "191", "124", "0.75", "40", "30", "0", "10", "1216"},
                                            {"best", "1", "+infinity", "-", "1.00", "20", "20", "0", "0", "1231"}}));
}

TEST(ReportRatings, OfSeveralRunsThoseThatWereRated) {
  const TemporaryFolder folder;
  for (const char* name : {"a", "b"}) SyntheticRun().write(folder / name);
  write_text(folder / "b/ratings/ratings.json", kResults);
  const std::string page = report_page({read_run(folder / "a"), read_run(folder / "b")}, {});
  EXPECT_FALSE(section_of(page, "Ratings of b").empty());
  EXPECT_TRUE(section_of(page, "Ratings of a").empty());
  EXPECT_TRUE(section_of(page, "Ratings").empty());
}

TEST(ReportRatings, ADamagedFileIsNamed) {
  const TemporaryFolder folder;
  SyntheticRun().write(folder / "run");
  write_text(folder / "run/ratings/ratings.json", "[1]");
  EXPECT_TRUE(contains(input_error_of([&] { read_run(folder / "run"); }), {"ratings.json:1: a map is needed here"}));
}

}  // namespace
}  // namespace giga::test
