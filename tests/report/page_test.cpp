// The page: complete, self-contained, and safe with whatever names and settings say.
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>

#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "report/report.hpp"
#include "synthetic_run.hpp"

namespace giga::test {
namespace {

/// The data of a page, read back.
Document data_of(const std::string& page) {
  const std::string start = "id=\"report-data\">";
  const size_t begin = page.find(start) + start.size();
  return parse_yaml_text(page.substr(begin, page.find("</script>", begin) - begin), "data");
}

const Node* section_of(const Document& data, const std::string& title) {
  for (const Node& section : data.root.find("sections")->items)
    if (section.find("title")->text == title) return &section;
  return nullptr;
}

/// The cells of a table's rows.
std::vector<std::vector<std::string>> rows_of(const Node& table) {
  std::vector<std::vector<std::string>> rows;
  for (const Node& row : table.find("rows")->items) {
    rows.emplace_back();
    for (const Node& cell : row.items) rows.back().push_back(cell.text);
  }
  return rows;
}

FieldInfo key(const std::string& path, const std::string& default_value) {
  FieldInfo info;
  info.path = path;
  info.default_value = default_value;
  info.doc = "about " + path;
  return info;
}

class ReportPage : public ::testing::Test {
 protected:
  std::string page_of(const std::vector<std::string>& names, const std::vector<FieldInfo>& keys = {}) const {
    std::vector<RunData> runs;
    for (const std::string& name : names) runs.push_back(read_run(folder_ / name));
    return report_page(runs, keys);
  }
  TemporaryFolder folder_;
};

TEST_F(ReportPage, AsksNothingOfTheNetwork) {
  SyntheticRun().write(folder_ / "run");
  const std::string page = page_of({"run"});
  EXPECT_FALSE(std::regex_search(page, std::regex(R"((src|href)\s*=\s*["']?(https?:)?//)"))) << "an outside file";
  EXPECT_FALSE(std::regex_search(page, std::regex(R"(@import|url\(\s*["']?(https?:)?//)"))) << "an outside style";
  EXPECT_EQ(page.find("sourceMappingURL"), std::string::npos);
  EXPECT_TRUE(contains(page, {"default-src 'none'"}));  // and the browser sees to it
}

TEST_F(ReportPage, NamesAndSettingsAreOnlyText) {
  SyntheticRun run;
  run.config = "scenario: \"</script><b id=evil>&\"\ntrain: {total_agent_steps: 300}\n";
  run.write(folder_ / "<i>run");
  const std::string page = page_of({"<i>run"});
  EXPECT_EQ(page.find("<b id=evil>"), std::string::npos);
  EXPECT_EQ(page.find("<i>run"), std::string::npos);
  EXPECT_TRUE(contains(page, {"<title>", "&lt;/script&gt;&lt;b id=evil&gt;&amp;"}));
  const Document data = data_of(page);  // and it is all there
  EXPECT_TRUE(contains(data.root.find("title")->text, {"</script><b id=evil>&"}));
}

TEST_F(ReportPage, APageThatLooksLikeItsTemplateIsLeftAlone) {
  SyntheticRun run;
  run.config = "scenario: \"{{data}}\"\ntrain: {total_agent_steps: 300}\n";
  run.write(folder_ / "run");
  EXPECT_TRUE(contains(page_of({"run"}), {"{{data}}"}));
}

TEST_F(ReportPage, ShowsWhatIsNotTheDefaultFirst) {
  SyntheticRun run;
  run.config =
      "scenario: duel\nseed: 1\ntrain: {total_agent_steps: 300, hidden: [64, 64], epsilon: 1e-05}\nenvironment: "
      "{extra: 1}\n";
  run.write(folder_ / "run");
  const Document data =
      data_of(page_of({"run"}, {key("scenario", "duel"), key("seed", "1"), key("train.total_agent_steps", "250"),
                                key("train.hidden", "[64, 64]"), key("train.epsilon", "1e-05")}));
  const Node& tables = *section_of(data, "Configuration")->find("tables");
  ASSERT_EQ(tables.items.size(), 2u);
  using Rows = std::vector<std::vector<std::string>>;
  EXPECT_EQ(rows_of(tables.items[0]), (Rows{{"train.total_agent_steps", "300", "250", "about train.total_agent_steps"},
                                            {"environment.extra", "1", "", ""}}));
  EXPECT_EQ(rows_of(tables.items[1]).size(), 6u);
  EXPECT_EQ(tables.items[1].find("folded")->text, "true");
}

TEST_F(ReportPage, FinalFiguresAreThoseOfTheLastEvaluation) {
  const std::string header = "agent_steps,seconds,win_rate_0_vs_circle\n100,1,0.1\n";
  SyntheticRun run;
  run.config = config_with(1, "0.99");
  run.metrics = header + "200,2,0.25\n300,3,\n";
  run.write(folder_ / "a");
  run.config = config_with(2, "0.99");
  run.metrics = header + "200,2,0.75\n300,3,\n";
  run.write(folder_ / "b");
  const Document data = data_of(page_of({"a", "b"}));
  const Node& group = section_of(data, "Final figures")->find("groups")->items[0];
  EXPECT_EQ(group.find("episodes")->text, "64");
  const Node& result = group.find("results")->items[0];
  EXPECT_EQ(result.find("opponent")->text, "circle");
  const Node& team = result.find("teams")->items[0];
  EXPECT_EQ(team.find("mean")->text, "0.5");  // (0.25 + 0.75) / 2
  EXPECT_EQ(team.find("low")->text, "0.25");
  EXPECT_EQ(team.find("high")->text, "0.75");
  EXPECT_TRUE(result.find("teams")->items[1].text.empty() || result.find("teams")->items[1].text == "null");
}

TEST_F(ReportPage, TellsHowTheCurvesAreToBeRead) {
  SyntheticRun run;
  run.config = config_with(1, "0.99");
  run.write(folder_ / "a");
  run.config = config_with(2, "0.99");
  run.write(folder_ / "b");
  const auto reading = [](const Document& data) { return data.root.find("groups")->items[0].find("reading")->text; };
  EXPECT_EQ(reading(data_of(page_of({"a", "b"}))), "Line: mean of 2 seeds; band: smallest to largest");
  run.metrics = "agent_steps,seconds\n";
  for (int k = 1; k <= 4001; ++k) run.metrics += std::to_string(k) + "," + std::to_string(k) + "\n";
  run.write(folder_ / "long");
  EXPECT_EQ(reading(data_of(page_of({"long"}))),  // 4001 rows, at most 2000 points
            "One run; each point stands for 3 updates (line: mean; band: smallest to largest)");
}

TEST_F(ReportPage, ShowsCommandsMachineAndTime) {
  SyntheticRun run;
  run.metrics = "agent_steps,seconds,update_seconds,evaluation_seconds\n100,4,3,0\n200,10,4,2\n";
  run.write(folder_ / "run");
  const Document data = data_of(page_of({"run"}));
  EXPECT_EQ(section_of(data, "Commands")->find("lines")->items[0].text, "gigastep train 'it'\\''s here'");
  using Rows = std::vector<std::vector<std::string>>;
  EXPECT_EQ(rows_of(section_of(data, "Hardware and versions")->find("tables")->items[0]),
            (Rows{{"versions.gigastep", "0.1.0"},
                  {"hardware.device", "cpu"},
                  {"hardware.cpu", "A \"fast\" one"},
                  {"hardware.memory", "16 GiB"}}));  // 17179869184 = 16 x 2^30
  const Node& parts = *section_of(data, "Time spent")->find("groups")->items[0].find("parts");
  EXPECT_EQ(parts.items[0].find("seconds")->text, "7");  // 3 + 4
  EXPECT_EQ(parts.items[1].find("seconds")->text, "2");
  EXPECT_EQ(parts.items[3].find("seconds")->text, "1");  // 10 - 7 - 2
}

TEST_F(ReportPage, ALongRunStaysSmall) {
  std::string header = "agent_steps,seconds", metrics;
  for (int c = 0; c < 80; ++c) header += ",figure_" + std::to_string(c);
  metrics = header + "\n";
  for (int k = 1; k <= 20'000; ++k) {
    metrics += std::to_string(k * 65536) + "," + std::to_string(k * 0.37);
    for (int c = 0; c < 80; ++c) metrics += "," + std::to_string(1.0 / (k + c));
    metrics += "\n";
  }
  SyntheticRun run;
  run.metrics = metrics;
  run.write(folder_ / "run");
  EXPECT_LT(page_of({"run"}).size(), 6u << 20);
}

TEST_F(ReportPage, WritesTheFileAndRefusesARunGivenTwice) {
  SyntheticRun().write(folder_ / "run");
  write_report({folder_ / "run"}, folder_ / "page.html", {});
  EXPECT_TRUE(contains(read_file(folder_ / "page.html"), {"<!doctype html>", "</html>"}));
  const std::string again = (folder_ / "run").string() + "/.";
  EXPECT_TRUE(contains(input_error_of([&] {
                         write_report({folder_ / "run", again}, folder_ / "two.html", {});
                       }),
                       {"is given twice"}));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "two.html"));
}

}  // namespace
}  // namespace giga::test
