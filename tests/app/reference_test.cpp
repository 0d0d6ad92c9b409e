// What the program tells about all keys: the reference in docs/, and the JSON schemas, which a validator of Python
// tries on the files that come with gigastep and on bad ones.
#include <gtest/gtest.h>

#include <filesystem>

#include "io/files.hpp"
#include "program.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {
namespace fs = std::filesystem;

TEST(Reference, ThePageInTheDocsIsCurrent) {
  const Outcome page = Workplace().run({"config", "--reference"});
  ASSERT_EQ(page.code, 0) << page.err;
  EXPECT_TRUE(
      contains(page.out, {"| `gamma` | float | `0.99` | [0, 1] | discount of one step |",
                          "| `n_minibatches` | int | `8` | [1, 1000000] |", "### `map_definitions.NAME.team_0`"}));
  EXPECT_EQ(read_file(source_path("docs/reference.md")), page.out) << "scripts/docs writes it anew";
}

TEST(Schema, IsPrintedForEveryKindOfFile) {
  const Workplace here;
  const std::string run = here.run({"config", "--schema"}).out;
  EXPECT_EQ(here.run({"config", "--schema", "run"}).out, run);
  const Document schema = parse_yaml_text(run, "schema");
  EXPECT_EQ(at(schema, {"$schema"}).text, "http://json-schema.org/draft-07/schema#");
  EXPECT_EQ(at(schema, {"properties", "mappo", "properties", "gamma", "description"}).text, "discount of one step");
  EXPECT_EQ(number_at(schema, {"properties", "mappo", "properties", "gamma", "anyOf", "0", "maximum"}), 1);
  EXPECT_EQ(at(schema, {"properties", "environment", "additionalProperties"}).text, "false");
  const Document scenario = parse_yaml_text(here.run({"config", "--schema", "scenario"}).out, "schema");
  EXPECT_EQ(at(scenario, {"properties", "team_0", "items", "properties", "type", "default"}).text, "default");
  const Outcome wrong = here.run({"config", "--schema", "scenari"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_TRUE(contains(wrong.err, {"--schema", "scenari", "run", "scenario"}));
  EXPECT_EQ(here.run({"config"}).code, 2);
  EXPECT_EQ(here.run({"config", "quickstart", "--schema"}).code, 2);
}

class SchemaWithValidator : public testing::Test {
 protected:
  void SetUp() override {
    if (python_.empty()) GTEST_SKIP() << "no Python with jsonschema and PyYAML: scripts/bootstrap --dev installs them";
  }
  /// Exit code of the check of files against a schema: 0 all fit, 1 none fits; its output says which.
  Outcome check(const std::string& kind, const std::vector<std::string>& files) const {
    here_.write("schema.json", here_.run({"config", "--schema", kind}).out);
    std::vector<std::string> arguments = {source_path("tests/app/check_schema.py"), "schema.json"};
    arguments.insert(arguments.end(), files.begin(), files.end());
    return here_.run(arguments, python_);
  }

  const std::string python_ = python_with("jsonschema, yaml");
  Workplace here_;
};

std::vector<std::string> shipped(const std::string& folder) {
  std::vector<std::string> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(source_path(folder)))
    if (entry.path().extension() == ".yaml" && entry.path().filename() != "agent_types.yaml")
      files.push_back(entry.path().string());
  return files;
}

TEST_F(SchemaWithValidator, AcceptsWhatComesWithGigastep) {
  const std::pair<const char*, std::vector<std::string>> kinds[] = {
      {"run", shipped("configs")},
      {"run", shipped("examples")},
      {"scenario", shipped("scenarios")},
      {"map", shipped("scenarios/maps")},
      {"scenario", {source_path("examples/games/canyon.yaml")}},
      {"map", {source_path("examples/games/canyon_map.yaml")}},
      {"agent_type", {source_path("examples/games/scout.yaml")}},
      {"agent_types", {source_path("scenarios/agent_types.yaml")}}};
  for (const auto& [kind, files] : kinds) {
    ASSERT_FALSE(files.empty()) << kind;
    const Outcome outcome = check(kind, files);
    EXPECT_EQ(outcome.code, 0) << outcome.out << outcome.err;
  }
}

TEST_F(SchemaWithValidator, AcceptsResolvedFiles) {
  here_.write("run.yaml", here_.run({"config", "mappo", "--set", "mappo.target_kl=0.02"}).out);
  here_.write("game.yaml", here_.run({"scenarios", "show", "special_5_vs_1_fobs"}).out);
  EXPECT_EQ(check("run", {"run.yaml"}).out, "run.yaml: fits\n");
  EXPECT_EQ(check("scenario", {"game.yaml"}).out, "game.yaml: fits\n");
}

TEST_F(SchemaWithValidator, RefusesBadFiles) {
  const std::vector<std::string> runs = {"mappo: {gama: 0.9}",
                                         "mappo: {gamma: 1.5}",
                                         "mappo: {learning_rate: 0}",
                                         "train: {n_worlds: many}",
                                         "train: {n_worlds: 2.5}",
                                         "train: {n_worlds: '64'}",
                                         "train: 3",
                                         "train: {opponent: circel}",
                                         "eval: {opponents: [randm]}",
                                         "mappo: {actor: {hidden: []}}",
                                         "mappo: {value_norm: 3}",
                                         "seed: -1",
                                         "environment: {limt_x: 3}",
                                         "environment: {team_0: [{cuont: 3}]}",
                                         "[]"};
  const std::vector<std::string> games = {"maps: 3", "limit_x: 0", "map_definitions: {m: {boxes: [[1, 2, 3]]}}",
                                          "map_definitions: {m: {team_0: {area: [1, 2, 3]}}}", "rules: orignal"};
  for (const auto& [kind, texts] : {std::pair{"run", runs}, std::pair{"scenario", games}}) {
    std::vector<std::string> files;
    for (const std::string& text : texts) {
      files.push_back(kind + std::to_string(files.size()) + ".yaml");
      here_.write(files.back(), text + "\n");
    }
    const Outcome outcome = check(kind, files);
    EXPECT_EQ(outcome.code, 1) << outcome.err;
    EXPECT_EQ(outcome.out.find(": fits"), std::string::npos) << outcome.out;
  }
}

TEST_F(SchemaWithValidator, AcceptsNumbersAsPeopleWriteThem) {
  here_.write("run.yaml",
              "train: {total_agent_steps: 3e8, n_worlds: 1_024}\nmappo: {learning_rate: 3e-4, target_kl: none}\n");
  EXPECT_EQ(check("run", {"run.yaml"}).out, "run.yaml: fits\n");
}

}  // namespace
}  // namespace giga::test
