// The list of algorithms: every row is whole, and its rules are about keys that there are.
#include "learn/registry.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "core/error.hpp"
#include "runs.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

TEST(LearnRegistry, EveryRowIsWhole) {
  EXPECT_EQ(algorithm_names(), (std::vector<std::string>{"mappo", "openai_es", "snes", "des"}));
  EXPECT_EQ(Algorithms::makers().size(), algorithms().size());
  for (const Algorithm* a : algorithms()) {
    SCOPED_TRACE(a->name);
    EXPECT_EQ(find_algorithm(a->name), a);
    for (const char* text : {a->about, a->figures, a->updates}) EXPECT_GT(std::string(text).size(), 0u);
    for (const ChartRow& chart : a->charts)
      EXPECT_NE(std::string(a->figures).find(chart.stem), std::string::npos) << chart.stem << " is no figure";
    SmallRun small;
    if (a != algorithms().front()) small.train = cat("algorithm: ", a->name);
    LoadedRun run = small.load();
    EXPECT_EQ(&algorithm_of(run.config), a);
    EXPECT_EQ(total_updates(run.config, 4).has_value(), !a->has_populations);
    EXPECT_GT(a->least_bytes(run), 0);
    a->set_size(run.config, 48);
    EXPECT_EQ(a->size(run.config).value, 48);
    a->shorten(run.config);
  }
}

TEST(LearnRegistry, SettingsThatAnAlgorithmDoesNotRead) {
  EXPECT_TRUE(reads_setting("mappo", "mappo.gamma"));
  EXPECT_TRUE(reads_setting("mappo", "train.n_worlds"));
  EXPECT_FALSE(reads_setting("mappo", "population.sigma_init"));
  EXPECT_FALSE(reads_setting("snes", "mappo.gamma"));
  EXPECT_FALSE(reads_setting("snes", "train.n_worlds"));
  EXPECT_FALSE(reads_setting("snes", "openai_es.learning_rate"));
  EXPECT_TRUE(reads_setting("snes", "snes.learning_rate_mean"));
  EXPECT_TRUE(reads_setting("snes", "train.total_agent_steps")) << "the budget of all of them";
  // Each group of settings is read by somebody, and the algorithms name keys that there are.
  for (const FieldInfo& field : list_fields<RunConfig>()) {
    int readers = 0;
    for (const Algorithm* a : algorithms()) readers += reads_setting(a->name, field.path);
    EXPECT_GT(readers, 0) << field.path;
  }
}

// Runs that differ in these alone are seeds of one configuration. They are keys that there are.
TEST(LearnRegistry, SettingsThatChangeNothingThatIsLearned) {
  for (const char* key :
       {"seed", "device", "train.n_threads", "train.compile_step", "mappo.graphs", "eval.record", "checkpoint.keep"}) {
    EXPECT_TRUE(is_run_time_setting(key)) << key;
    const std::vector<FieldInfo> fields = list_fields<RunConfig>();
    EXPECT_TRUE(std::any_of(fields.begin(), fields.end(), [key](const FieldInfo& f) { return f.path == key; })) << key;
  }
  for (const char* key : {"mappo.gamma", "train.total_agent_steps", "eval.opponents", "train.precision"})
    EXPECT_FALSE(is_run_time_setting(key)) << key;
}

TEST(LearnRegistry, AnUnknownNameIsRefusedWithThoseThatThereAre) {
  EXPECT_EQ(find_algorithm("ppo"), nullptr);
  RunConfig config;
  config.train.algorithm = "ppo";
  try {
    algorithm_of(config);
    FAIL();
  } catch (const InputError& e) {
    EXPECT_STREQ(e.what(), "train.algorithm: 'ppo' is not one of: mappo, openai_es, snes, des");
  }
}

// A group that several algorithms share is there once, and keys keep their places.
TEST(LearnRegistry, GroupsOfTheRunConfig) {
  std::vector<std::string> groups;
  const FieldList list = fields_of_default<RunConfig>();
  for (const Field& field : list.fields())
    if (field.shape == FieldShape::group) groups.push_back(field.name);
  EXPECT_EQ(groups, (std::vector<std::string>{"train", "mappo", "population", "openai_es", "snes", "des", "opponents",
                                              "eval", "checkpoint"}));
}

TEST(LearnRegistry, ResumeRulesAreAboutKeysThatThereAre) {
  std::set<std::string> keys;
  for (const FieldInfo& field : list_fields<RunConfig>()) {
    keys.insert(field.path);
    for (size_t dot = 0; (dot = field.path.find('.', dot)) != std::string::npos; ++dot)
      keys.insert(field.path.substr(0, dot + 1));
  }
  for (const ResumeRules& rules : Algorithms::Settings::resume_rules())
    for (const auto& part : {rules.may_change, rules.may_not})
      for (const ResumeRule& rule : part) EXPECT_TRUE(keys.contains(std::string(rule.key))) << rule.key;
}

TEST(LearnRegistry, ShippedConfigsAskForTheFusedKernel) {
  for (const char* name : {"openai_es", "snes", "des"}) {
    const LoadedRun run = load_run_config(source_path(cat("configs/", name, ".yaml")), {});
    EXPECT_EQ(run.config.train.precision, Precision::fp16) << name;
  }
}

}  // namespace
}  // namespace giga::test
