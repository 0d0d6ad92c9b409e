// The ratings of a run in its report.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "io/temporary_folder.hpp"
#include "report/report.hpp"
#include "report/sections.hpp"
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

/// The section of a title, from the JSON that the page draws.
Document sections_of(const std::vector<RunData>& runs) {
  return parse_yaml_text(json_text(report_sections(group_runs(runs, points_for(runs)), {})), "sections");
}
const Node* rating_section(const Document& sections, const std::string& title) {
  for (const Node& section : sections.root.items)
    if (section.find("title")->text == title) return &section;
  return nullptr;
}

TEST(ReportRatings, PicturesAndTableOfARatedRun) {
  const TemporaryFolder folder;
  SyntheticRun().write(folder / "run");
  write_text(folder / "run/ratings/ratings.json", kResults);
  write_text(folder / "run/ratings/rating.svg", "<svg>1</svg>");
  write_text(folder / "run/ratings/rating_seconds.svg", "<svg>2</svg>");
  write_text(folder / "run/ratings/matrix.svg", "<svg>3</svg>");
  const Document sections = sections_of({read_run(folder / "run")});
  const Node* section = rating_section(sections, "Ratings");
  ASSERT_TRUE(section);
  EXPECT_EQ(section->find("kind")->text, "pictures");
  EXPECT_TRUE(contains(section->find("note")->text, {"duel, random = 0", "Note: best: won all."}));
  EXPECT_EQ(print_node(*section->find("pictures")),  // there is no win_rate.svg
            R"([{svg: "<svg>1</svg>", along: agent_steps}, {svg: "<svg>2</svg>", along: seconds}, )"
            R"({svg: "<svg>3</svg>", along: ""}])");
  const Node& rows = *section->find("tables")->items[0].find("rows");
  ASSERT_EQ(rows.items.size(), 2u);
  EXPECT_EQ(print_node(rows.items[0]), R"(["run@3", both, "191", "124", "0.75", "40", "30", "0", "10", "1216"])");
  EXPECT_EQ(print_node(rows.items[1]), R"([best, "1", "+infinity", "-", "1.00", "20", "20", "0", "0", "1231"])");
}

TEST(ReportRatings, OfSeveralRunsThoseThatWereRated) {
  const TemporaryFolder folder;
  for (const char* name : {"a", "b"}) SyntheticRun().write(folder / name);
  write_text(folder / "b/ratings/ratings.json", kResults);
  const Document sections = sections_of({read_run(folder / "a"), read_run(folder / "b")});
  EXPECT_TRUE(rating_section(sections, "Ratings of b"));
  EXPECT_FALSE(rating_section(sections, "Ratings of a"));
  EXPECT_FALSE(rating_section(sections, "Ratings"));
}

TEST(ReportRatings, ADamagedFileIsNamed) {
  const TemporaryFolder folder;
  SyntheticRun().write(folder / "run");
  write_text(folder / "run/ratings/ratings.json", "[1]");
  EXPECT_TRUE(contains(input_error_of([&] { read_run(folder / "run"); }), {"ratings.json:1: a map is needed here"}));
}

}  // namespace
}  // namespace giga::test
