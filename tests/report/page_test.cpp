// The page: complete, self-contained, and safe with whatever names and settings say.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>

#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "read_page.hpp"
#include "report/report.hpp"
#include "synthetic_run.hpp"

namespace giga::test {
namespace {

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
  const Rows all = tables_of(section_of(page, "Configuration")).at(1);  // and it is all there
  EXPECT_EQ(all.at(0).at(1), "</script><b id=evil>&");
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
  const Elements section =
      section_of(page_of({"run"}, {key("scenario", "duel"), key("seed", "1"), key("train.total_agent_steps", "250"),
                                   key("train.hidden", "[64, 64]"), key("train.epsilon", "1e-05")}),
                 "Configuration");
  const std::vector<Rows> tables = tables_of(section);
  ASSERT_EQ(tables.size(), 2u);
  EXPECT_EQ(tables[0], (Rows{{"train.total_agent_steps", "300", "250", "about train.total_agent_steps"},
                             {"environment.extra", "1", "", ""}}));
  EXPECT_EQ(texts_of(section, "td", "own"), (Texts{"300", "1", "300", "1"})) << "what is not the default stands out";
  EXPECT_EQ(tables[1].size(), 6u);
  EXPECT_EQ(texts_of(section, "summary"), Texts{"All 6 keys"}) << "folded";
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
  const Elements section = section_of(page_of({"a", "b"}), "Final figures");
  EXPECT_TRUE(contains(texts_of(section, "h4").at(0), {"Won against circle"}));
  EXPECT_TRUE(contains(page_of({"a", "b"}), {"in 64 episodes, mean of 2 seeds"}));
  EXPECT_EQ(texts_of(section, "div", "bar").size(), 1u) << "team 1 has no games";
  EXPECT_EQ(texts_of(section, "b"), Texts{"0.50"});  // (0.25 + 0.75) / 2
  EXPECT_TRUE(contains(page_of({"a", "b"}), {"0.25 to 0.75", "style=\"left: 25%; width: 50%\""}));
  run.write(folder_ / "c");
  EXPECT_TRUE(
      contains(page_of({"a", "b", "c"}), {"mean of 3 runs of 2 seeds", "Line: mean of 3 runs of 2 seeds; band"}));
  EXPECT_TRUE(contains(page_of({"b", "c"}), {"mean of 2 runs of 1 seed"}));
}

TEST_F(ReportPage, TellsHowTheCurvesAreToBeRead) {
  SyntheticRun run;
  run.config = config_with(1, "0.99");
  run.write(folder_ / "a");
  run.config = config_with(2, "0.99");
  run.write(folder_ / "b");
  // Above the first charts, which are of the entropy and of a column without another place.
  const auto readings = [&](const std::vector<std::string>& runs, const char* section) {
    const Elements elements = section_of(page_of(runs), section);
    Texts texts;
    for (const XmlElement& e : elements)
      if (e.parent == "li") texts.push_back(e.text);
    return texts;
  };
  EXPECT_EQ(readings({"a", "b"}, "Learning"), Texts{"Line: mean of 2 seeds; band: smallest to largest"});
  run.metrics = "agent_steps,seconds,figure\n";
  for (int k = 1; k <= 4001; ++k) run.metrics += std::to_string(k) + "," + std::to_string(k) + ",1\n";
  run.write(folder_ / "long");
  EXPECT_EQ(readings({"long"}, "Further figures"),  // 4001 rows, at most 2000 points
            Texts{"One run; each point stands for 3 updates (line: mean; band: smallest to largest)"});
}

TEST_F(ReportPage, ShowsCommandsMachineAndTime) {
  SyntheticRun run;
  run.metrics =
      "agent_steps,seconds,update_seconds,evaluation_seconds,agent_steps_per_second\n100,4,3,0,33.3333\n"
      "200,10,4,2,25\n";
  run.write(folder_ / "run");
  const std::string page = page_of({"run"});
  EXPECT_EQ(texts_of(section_of(page, "Commands"), "pre"), Texts{"gigastep train 'it'\\''s here'"});
  EXPECT_EQ(tables_of(section_of(page, "Hardware and versions")).at(0),
            (Rows{{"versions.gigastep", "0.1.0"},
                  {"hardware.device", "cpu"},
                  {"hardware.cpu", "A \"fast\" one"},
                  {"hardware.memory", "16 GiB"}}));  // 17179869184 = 16 x 2^30
  // Of 10 seconds 3 + 4 for updates, 2 for evaluation, 10 - 7 - 2 for the rest.
  Texts times, shares;
  for (const XmlElement& e : section_of(page, "Time spent")) {
    if (e.name != "span" || e.parent == "div") continue;
    times.push_back(e.text);
  }
  EXPECT_EQ(times, (Texts{"0:07", "0:02", "0:00", "0:01"}));
  EXPECT_TRUE(contains(page, {"updates 70.0 %", "evaluation 20.0 %", "checkpoints 0.0 %", "the rest 10.0 %"}));
  // The speed is that of the updates, as metrics.csv has it: 200 agent-steps in 7 seconds, not in 10.
  EXPECT_TRUE(contains(page, {"<dt>agent-steps per second</dt>", "<dd>28.6</dd>"}));
}

// Of ten updates the rows of the first eight were lost, and with them 40 seconds.
TEST_F(ReportPage, OfLostRowsNothingIsCounted) {
  SyntheticRun run;
  run.metrics =
      "update,agent_steps,seconds,update_seconds,evaluation_seconds,agent_steps_per_second\n9,900,44,4,0,25\n"
      "10,1000,50,4,2,25\n";
  run.write(folder_ / "run");
  const std::string page = page_of({"run"});
  // 200 agent-steps in 8 seconds; of 50 - 40 seconds 8 for updates, 2 for evaluation.
  EXPECT_TRUE(contains(page, {"<dt>agent-steps per second</dt>", "<dd>25</dd>"}));
  EXPECT_TRUE(contains(page, {"updates 80.0 %", "evaluation 20.0 %", "the rest 0.0 %"}));
}

TEST_F(ReportPage, EveryCommandStandsAlone) {
  SyntheticRun run;
  run.write(folder_ / "a");
  run.write(folder_ / "b");
  std::ofstream(folder_ / "b" / "resume_001.json") << R"({"command_line": ["gigastep", "resume", "b"]})";
  const std::string train = "gigastep train 'it'\\''s here'";
  EXPECT_EQ(texts_of(section_of(page_of({"a", "b"}), "Commands"), "pre"), (Texts{train, train, "gigastep resume b"}));
}

TEST_F(ReportPage, ChartsAreDrawnInThePage) {
  SyntheticRun run;
  run.metrics = "agent_steps,seconds,entropy_0,entropy_1\n100,1,3,2\n200,2,,2\n300,3,1,2\n";
  run.write(folder_ / "run");
  const std::string page = page_of({"run"});
  const Elements learning = section_of(page, "Learning");
  EXPECT_EQ(texts_of(learning, "h3"), Texts{"Entropy"});
  EXPECT_EQ(texts_of(learning, "span", "name"), (Texts{"team 0", "team 1"}));
  EXPECT_EQ(texts_of(learning, "path", "curve").size(), 2u * 2) << "two lines, and a sample of each";
  EXPECT_TRUE(contains(page, {"data-rows=\"0 2\"", "\"agent_steps\": [100, 200, 300]", "\"seconds\": [1, 2, 3]"}));
}

TEST_F(ReportPage, ManyConfigurationsAreNamedInEachChartAndColoured) {
  SyntheticRun run;
  const std::vector<std::string> runs = {"a", "b", "c"};
  const char* gammas[] = {"0.99", "0.9", "0.995"};
  for (size_t k = 0; k < 3; ++k) {
    run.config = config_with(1, gammas[k]);
    run.write(folder_ / runs[k]);
  }
  const std::string page = page_of(runs);
  EXPECT_TRUE(contains(page, {"data-colour=\"group\""}));
  EXPECT_EQ(texts_of(section_of(page, "Learning"), "span", "name"), (Texts{"gamma=0.9", "gamma=0.99", "gamma=0.995"}));
  EXPECT_TRUE(contains(page_of({"a", "b"}), {"data-colour=\"team\""}));
}

TEST_F(ReportPage, WhatCannotBeReadIsLeftOut) {
  SyntheticRun().write(folder_ / "run");
  std::filesystem::create_directories(folder_ / "no_run");
  const std::vector<std::string> left_out =
      write_report({folder_ / "run", folder_ / "no_run"}, folder_ / "page.html", {});
  ASSERT_EQ(left_out.size(), 1u);
  EXPECT_TRUE(contains(left_out[0], {"no_run is not a run"}));
  EXPECT_TRUE(contains(input_error_of([&] { write_report({folder_ / "no_run"}, folder_ / "none.html", {}); }),
                       {"no_run is not a run"}));
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

TEST_F(ReportPage, RunsOfOneNameAreToldApartByTheirPaths) {
  SyntheticRun().write(folder_ / "first" / "run");
  SyntheticRun().write(folder_ / "second" / "run");
  write_report({folder_ / "first" / "run", folder_ / "second" / "run/"}, folder_ / "page.html", {});
  EXPECT_TRUE(contains(read_file(folder_ / "page.html"), {">first/run<", ">second/run<"}));
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
