// Reading of run folders.
#include "report/run_data.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "io/temporary_folder.hpp"
#include "synthetic_run.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

TEST(ReadRun, GivesConfigInfoAndColumns) {
  const TemporaryFolder folder;
  SyntheticRun run;
  run.metrics = "update,agent_steps,seconds,return_0\r\n1,100,0.5,\r\n2,200,1.25,-1e-3\r\n";
  run.write(folder / "first");
  const RunData data = read_run((folder / "first").string() + "/");
  EXPECT_EQ(data.name, "first");
  EXPECT_EQ(data.config.find("mappo")->find("gamma")->text, "0.99");
  EXPECT_EQ(data.info.find("hardware")->find("cpu")->text, "A \"fast\" one");
  EXPECT_EQ(data.metrics.names, (std::vector<std::string>{"update", "agent_steps", "seconds", "return_0"}));
  EXPECT_EQ(*data.metrics.find("seconds"), (std::vector<double>{0.5, 1.25}));
  EXPECT_TRUE(std::isnan((*data.metrics.find("return_0"))[0]));
  EXPECT_EQ((*data.metrics.find("return_0"))[1], -0.001);
  EXPECT_EQ(data.metrics.find("return_1"), nullptr);
}

TEST(ReadRun, ARunThatGoesOnEndsAtItsLastCompleteLine) {
  const MetricsTable table = parse_metrics("agent_steps,seconds\r\n100,1\r\n200,2\r\n30", "m.csv");
  EXPECT_EQ(*table.find("agent_steps"), (std::vector<double>{100, 200}));
}

TEST(ReadRun, ColumnsOfOlderRunsHaveTodaysNames) {
  const MetricsTable table = parse_metrics(
      "agent_steps,seconds,pool_win_share_1,tie_share,information_0,mutual_information_1\n1,1,1,1,1,1\n", "m.csv");
  EXPECT_EQ(table.names, (std::vector<std::string>{"agent_steps", "seconds", "pool_win_rate_1", "tie_rate",
                                                   "mutual_information_0", "mutual_information_1"}));
}

TEST(ReadRun, DamageIsToldWithFileAndLine) {
  struct Case {
    std::string text, message;
  };
  const std::vector<Case> cases = {
      {"", "m.csv: there is no row yet"},
      {"agent_steps,seconds\r\n", "m.csv: there is no row yet"},
      {"agent_steps,seconds\r\n100", "m.csv: there is no row yet"},
      {"agent_steps,time\r\n100,1\r\n", "m.csv:1: there is no column seconds"},
      {"agent_steps,seconds,seconds\r\n100,1,1\r\n", "m.csv:1: the column seconds is there twice"},
      {"agent_steps,,seconds\r\n100,1,1\r\n", "m.csv:1: column 2 has no name"},
      {"agent_steps,seconds\r\n100,1\r\n200\r\n", "m.csv:3: 1 fields, but the header names 2 columns"},
      {"agent_steps,seconds\r\n100,1\r\n200,2,3\r\n", "m.csv:3: 3 fields"},
      {"agent_steps,seconds\r\n100,1x\r\n", "m.csv:2: column seconds: '1x' is not a number"},
      {"agent_steps,seconds\r\n100,1\r\n100,2\r\n", "m.csv:3: agent_steps is 100; it must grow"},
      {"agent_steps,seconds\r\n100,2\r\n200,1\r\n", "m.csv:3: seconds is 1; it must not fall"},
      {"agent_steps,seconds\r\n100,\r\n", "m.csv:2: seconds is nan"},
      {"agent_steps,seconds\r\ninf,1\r\n", "m.csv:2: agent_steps is inf"},
  };
  for (const Case& c : cases)
    EXPECT_TRUE(contains(input_error_of([&] { parse_metrics(c.text, "m.csv"); }), {c.message.c_str()}));
}

TEST(ReadRun, AMissingFileIsToldByName) {
  const TemporaryFolder folder;
  EXPECT_TRUE(contains(input_error_of([&] { read_run(folder / "none"); }), {"there is no run folder", "none"}));
  EXPECT_TRUE(contains(input_error_of([&] { read_run(folder.path()); }), {"is not a run", "no metrics.csv"}));
  for (const char* name : {"config.yaml", "scenario.yaml", "run.json"}) {
    const fs::path run = folder / (std::string("without_") + name);
    SyntheticRun().write(run);
    fs::remove(run / name);
    EXPECT_TRUE(contains(input_error_of([&] { read_run(run); }), {name}));
  }
}

TEST(ReadRun, ADamagedConfigOrInfoIsToldWithItsPlace) {
  const TemporaryFolder folder;
  SyntheticRun run;
  run.config = "seed: 1\nseed: 2\n";
  run.write(folder / "twice");
  EXPECT_TRUE(contains(input_error_of([&] { read_run(folder / "twice"); }), {"twice/config.yaml:2:1"}));
  run = {};
  run.info = "{\"seed\": 1";  // cut off
  run.write(folder / "cut");
  EXPECT_TRUE(contains(input_error_of([&] { read_run(folder / "cut"); }), {"cut/run.json:1"}));
  run.info = "[1, 2]";
  run.write(folder / "list");
  EXPECT_TRUE(contains(input_error_of([&] { read_run(folder / "list"); }), {"list/run.json:1: a map is needed"}));
}

TEST(ReadRun, SettingsAreFlat) {
  const Document config = parse_yaml_text("a: 1\nb: {c: [1, 2], d: {}, e: {f: \"x\"}}\n", "config");
  const Settings settings = flatten(config.root);
  EXPECT_EQ(settings, (Settings{{"a", "1"},
                                {"b.c", "[1, 2]"},
                                {"b.d", "{}"},
                                {"b.e.f", print_node(*config.root.find("b")->find("e")->find("f"))}}));
  EXPECT_EQ(setting(settings, "b.c"), "[1, 2]");
  EXPECT_EQ(setting(settings, "b.x"), "");
}

}  // namespace
}  // namespace giga::test
