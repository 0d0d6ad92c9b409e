// gigastep eval as a user runs it: two runs, both sides, scenarios, exported policies, CSV and JSON.
#include <gtest/gtest.h>

#include "program.hpp"

namespace giga::test {
namespace {

/// Two runs of a second, trained once for all tests.
class Eval : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    here_ = std::make_unique<Workplace>();
    here_->write("tiny.yaml", kTinyConfig);
    for (const char* run : {"first", "second"}) {
      const Outcome training =
          here_->run({"train", "tiny.yaml", "--run-dir", run, "--set", std::string("seed=") + (*run == 'f' ? "1" : "2"),
                      "--set", "train.total_agent_steps=4096", "--quiet"});
      ASSERT_EQ(training.code, 0) << training.err;
    }
  }
  static void TearDownTestSuite() { here_.reset(); }

  static Outcome eval(const std::string& a, const std::string& b, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"eval", a, "--vs", b, "--episodes", "64", "--device", "cpu"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return here_->run(arguments);
  }

  /// The mutual information of a team against circle.
  static double information(const std::string& a, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words = {"--information", "--csv", "-"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = eval(a, "circle", words);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    const CsvTable table = parse_csv(outcome.out);
    EXPECT_EQ(table.cell(0, "mutual_information_b"), "");
    return std::stod(table.cell(0, "mutual_information_a"));
  }

  static std::unique_ptr<Workplace> here_;
};
std::unique_ptr<Workplace> Eval::here_;

TEST_F(Eval, TwoRunsAgainstEachOther) {
  const Outcome outcome = eval("first", "second", {"--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  EXPECT_EQ(at(json, {"a"}).text, "first");
  EXPECT_EQ(at(json, {"b"}).text, "second");
  EXPECT_EQ(at(json, {"origin_a", "file"}).text, "first/checkpoints/best.h5");
  EXPECT_EQ(at(json, {"origin_b", "scenario"}).text, "identical_2_vs_2_void");
  ASSERT_EQ(at(json, {"sides"}).items.size(), 1u) << "A on side 0 only";
  const auto n = [&](const char* key) { return number_at(json, {"sides", "0", key}); };
  EXPECT_EQ(n("wins") + n("losses") + n("ties"), 64);
  EXPECT_DOUBLE_EQ(n("loss_rate"), n("losses") / 64);
  EXPECT_LE(number_at(json, {"sides", "0", "tie_rate_ci95", "0"}), n("tie_rate"));
  EXPECT_GE(number_at(json, {"sides", "0", "tie_rate_ci95", "1"}), n("tie_rate"));
  double of_a = n("mean_survivors"), of_b = number_at(json, {"sides", "0", "opponent", "mean_survivors"});
  for (const char* cause :
       {"mean_deaths_damage", "mean_deaths_agent", "mean_deaths_obstacle", "mean_deaths_out_of_bounds"}) {
    of_a += n(cause);
    of_b += number_at(json, {"sides", "0", "opponent", cause});
  }
  EXPECT_NEAR(of_a, 2, 1e-9) << "survivors and deaths are all agents of the team";
  EXPECT_NEAR(of_b, 2, 1e-9);
}

TEST_F(Eval, MeasuresInformationAndPlaysTheSame) {
  const Outcome plain = eval("first", "circle", {"--json", "-"});
  const Outcome measured = eval("first", "circle", {"--information", "--json", "-"});
  ASSERT_EQ(measured.code, 0) << measured.err;
  const Document a = parse_yaml_text(plain.out, "json"), b = parse_yaml_text(measured.out, "json");
  for (const char* side : {"0", "1"}) {
    for (const char* key : {"wins", "ties", "mean_return", "mean_length"})
      EXPECT_EQ(number_at(a, {"sides", side, key}), number_at(b, {"sides", side, key})) << key;
    EXPECT_GT(number_at(b, {"sides", side, "mutual_information"}), 0);
    EXPECT_EQ(at(b, {"sides", side, "opponent", "mutual_information"}).text, "") << "null: a script";
  }
  EXPECT_FALSE(contains(plain.out, {"mutual_information"}));
  // The likeliest actions of policies that are hardly sure of any yet tell more of what they see than drawn ones.
  EXPECT_GT(information("first", {"--greedy"}), information("first") + 0.01);
  const Outcome text = eval("first", "circle", {"--information"});
  EXPECT_TRUE(contains(text.out, {"mutual information of observation and action: side 0 0.", "nats, side 1 none"}))
      << text.out;
}

TEST_F(Eval, BothSidesAreTheReverseOfTheReverse) {
  const Outcome outcome = eval("first", "second", {"--both-sides", "--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  ASSERT_EQ(at(json, {"sides"}).items.size(), 2u);
  EXPECT_EQ(number_at(json, {"sides", "1", "team"}), 1);
  // Seen from the other run: what is A's side 1 here is B's side 1 there.
  const Document other = parse_yaml_text(eval("second", "first", {"--both-sides", "--json", "-"}).out, "json");
  for (const auto& [here, there] : {std::pair{"0", "1"}, std::pair{"1", "0"}}) {
    EXPECT_EQ(number_at(json, {"sides", here, "wins"}), number_at(other, {"sides", there, "losses"}));
    EXPECT_EQ(number_at(json, {"sides", here, "mean_return"}),
              number_at(other, {"sides", there, "opponent", "mean_return"}));
  }
}

// Before the first game: these would take minutes.
TEST_F(Eval, WhoCannotPlayBothSidesIsToldAtOnce) {
  const Outcome training = here_->run({"train", "tiny.yaml", "--run-dir", "one", "--set", "train.opponent=circle",
                                       "--set", "train.total_agent_steps=4096", "--quiet"});
  ASSERT_EQ(training.code, 0) << training.err;
  const Outcome outcome =
      here_->run({"eval", "one", "--vs", "circle", "--both-sides", "--episodes", "10000000", "--device", "cpu"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(contains(outcome.err, {"one has no policy for team 1"})) << outcome.err;
}

TEST_F(Eval, WritesATableAndCsv) {
  const Outcome outcome = eval("first", "second", {"--both-sides", "--csv", "result.csv", "--seed", "4"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out,
                       {"scenario identical_2_vs_2_void", "first: first/checkpoints/best.h5, after 1 update",
                        "first on side 0 against second, 64 episodes", "first on side 1 against second, 64 episodes",
                        "won ", "lost ", "tied ", "steps an episode", "survivors", "out of bounds"}));
  const CsvTable table = parse_csv(here_->read("result.csv"));
  ASSERT_EQ(table.rows.size(), 2u);
  for (size_t row = 0; row < 2; ++row) {
    EXPECT_EQ(table.cell(row, "a"), "first");
    EXPECT_EQ(table.cell(row, "b"), "second");
    EXPECT_EQ(table.cell(row, "side_of_a"), std::to_string(row));
    EXPECT_EQ(
        std::stoi(table.cell(row, "wins")) + std::stoi(table.cell(row, "losses")) + std::stoi(table.cell(row, "ties")),
        64);
    EXPECT_LE(std::stod(table.cell(row, "win_rate_lo95")), std::stod(table.cell(row, "win_rate")));
    EXPECT_FALSE(table.cell(row, "mean_deaths_out_of_bounds_b").empty());
  }
  const std::string first = here_->read("result.csv");
  eval("first", "second", {"--both-sides", "--csv", "result.csv", "--seed", "4"});
  EXPECT_EQ(here_->read("result.csv"), first) << "same seed, same result";
  eval("first", "second", {"--both-sides", "--csv", "result.csv", "--seed", "5"});
  EXPECT_NE(here_->read("result.csv"), first);
  const Outcome printed = eval("first", "second", {"--both-sides", "--csv", "-", "--seed", "4"});
  ASSERT_EQ(printed.code, 0) << printed.err;
  EXPECT_EQ(printed.out, first) << "and nothing else";
  EXPECT_FALSE(here_->has("-"));
  const Outcome both = eval("first", "second", {"--csv", "-", "--json", "-"});
  EXPECT_EQ(both.code, 2);
  EXPECT_TRUE(contains(both.err, {"--csv - and --json - would both be printed"}));
  EXPECT_TRUE(contains(eval("first", "second", {"--csv", "same", "--json", "same"}).err,
                       {"--csv and --json would both be written to same; name two files"}));
  EXPECT_EQ(eval("first", "second", {"--csv", "same", "--json", "./same"}).code, 2) << "by another name";
  EXPECT_FALSE(here_->has("same"));
}

TEST_F(Eval, ScriptedTeamsPlayWhatScenarioIsNamed) {
  const Outcome outcome = eval("pursuer", "circle", {"--scenario", "identical_2_vs_2", "--both-sides", "--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Document json = parse_yaml_text(outcome.out, "json");
  EXPECT_EQ(at(json, {"scenario"}).text, "identical_2_vs_2");
  for (const char* side : {"0", "1"}) EXPECT_GT(number_at(json, {"sides", side, "win_rate"}), 0.8) << "side " << side;
}

TEST_F(Eval, AScenarioWithOtherObservationsIsRefused) {
  const Outcome outcome = eval("first", "pursuer", {"--scenario", "identical_5_vs_5"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(contains(outcome.err, {"first was trained in 'identical_2_vs_2_void'", "neighbors 3 x 9",
                                     "'identical_5_vs_5'", "neighbors 9 x 9", "what differs: team_0: ", "maps: "}));
  EXPECT_EQ(eval("first", "pursuer", {"--scenario", "identical_2_vs_2_fobs_void"}).code, 0);
  const Outcome waypoints = eval("first", "pursuer", {"--set", "environment.waypoints.enable_waypoints=true"});
  EXPECT_EQ(waypoints.code, 2);
  EXPECT_TRUE(contains(waypoints.err,
                       {"; what differs: waypoints.enable_waypoints: false there, true here; an agent observes "}));
}

/// What came out of the matches of an `eval --json -`, without names.
std::string results_of(const Outcome& outcome) {
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  return print_node(at(parse_yaml_text(outcome.out, "json"), {"sides"}));
}

// A run with the egocentric view, which the scenarios that ship do not give.
TEST_F(Eval, WhatAPolicyObservesComesWithIt) {
  here_->write("seeing.yaml", std::string(kTinyConfig) +
                                  "environment: {observation: {egocentric_view: true}, rewards: {damage: 3}}\n");
  ASSERT_EQ(
      here_->run({"train", "seeing.yaml", "--run-dir", "seeing", "--set", "train.total_agent_steps=4096", "--quiet"})
          .code,
      0);
  for (const char* scenario : {"identical_2_vs_2_void", "identical_2_vs_2_void_fobs"}) {
    const Outcome outcome = eval("seeing", "circle", {"--scenario", scenario, "--json", "-"});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(at(parse_yaml_text(outcome.out, "json"), {"scenario"}).text, scenario);
  }
  // Beside one that was trained without it, each with its own observations: the other's results stay what they are.
  EXPECT_EQ(eval("seeing", "first", {"--both-sides"}).code, 0);
  EXPECT_EQ(
      results_of(eval("first", "circle", {"--json", "-", "--set", "environment.observation.egocentric_view=true"})),
      results_of(eval("first", "circle", {"--json", "-"})));
  ASSERT_EQ(here_->run({"export", "seeing", "--team", "0", "--format", "safetensors", "--out", "seen"}).code, 0);
  EXPECT_EQ(eval("seen", "first", {"--scenario", "identical_2_vs_2_void"}).code, 0);
}

TEST_F(Eval, AScenarioInThePlaceOfAPolicyIsToldAsSuch) {
  here_->write("game.yaml", "base: identical_2_vs_2\nlimit_x: 12\n");
  const Outcome outcome = eval("game.yaml", "circle");
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(
      contains(outcome.err, {"game.yaml: this is a scenario, not a policy; --scenario says which one is played"}));
  EXPECT_FALSE(contains(outcome.err, {"unknown key"}));
}

TEST_F(Eval, KeysOfTheScenarioCanBeChanged) {
  const Document json = parse_yaml_text(
      eval("first", "circle", {"--set", "environment.max_episode_length=7", "--json", "-"}).out, "json");
  EXPECT_LE(number_at(json, {"sides", "0", "mean_length"}), 7);
  EXPECT_EQ(at(json, {"changes", "0"}).text, "environment.max_episode_length=7");
  EXPECT_TRUE(contains(eval("first", "circle", {"--set", "environment.max_episode_length=7"}).out,
                       {"changed: environment.max_episode_length=7"}));
  const Outcome wrong = eval("first", "circle", {"--set", "environment.sight.cone_dept=5"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_TRUE(contains(wrong.err, {"environment.sight.cone_dept: unknown key; nearest: 'cone_depth'"}));
}

TEST_F(Eval, AnExportedPolicyPlaysAsTheCheckpointThatItIsOf) {
  ASSERT_EQ(here_->run({"export", "first", "--team", "0", "--format", "safetensors", "--out", "export0"}).code, 0);
  ASSERT_EQ(here_->run({"export", "second", "--team", "1", "--format", "safetensors", "--out", "export1"}).code, 0);
  const std::string expected = results_of(eval("first", "second", {"--json", "-", "--seed", "3"}));
  EXPECT_EQ(results_of(eval("export0", "export1", {"--json", "-", "--seed", "3"})), expected);
  EXPECT_EQ(results_of(eval("export0/policy.safetensors", "second", {"--json", "-", "--seed", "3"})), expected);
  EXPECT_NE(results_of(eval("export0", "export1", {"--json", "-", "--seed", "4"})), expected);
  // Against a script it plays both sides, the first as its checkpoint does.
  const Document alone = parse_yaml_text(eval("export0", "circle", {"--json", "-"}).out, "json");
  const Document both = parse_yaml_text(eval("first", "circle", {"--json", "-"}).out, "json");
  ASSERT_EQ(at(alone, {"sides"}).items.size(), 2u);
  EXPECT_EQ(print_node(at(alone, {"sides", "0"})), print_node(at(both, {"sides", "0"})));
  EXPECT_EQ(at(alone, {"origin_a", "file"}).text, "export0/policy.safetensors");
  EXPECT_EQ(at(alone, {"scenario"}).text, "identical_2_vs_2_void");
}

TEST_F(Eval, WhatEvolvedToBeGreedyIsPlayedSo) {
  here_->write("evolved.yaml", R"(scenario: identical_2_vs_2_void
device: cpu
train: {algorithm: openai_es, total_agent_steps: 1}
population: {population_size: 4, episodes_per_member: 2, max_steps: 20, actor: {hidden: [8]}}
eval: {episodes: 8, every_updates: 0}
)");
  ASSERT_EQ(here_->run({"train", "evolved.yaml", "--run-dir", "evolved", "--quiet"}).code, 0);
  ASSERT_EQ(here_->run({"export", "evolved", "--team", "0", "--format", "safetensors", "--out", "greedy"}).code, 0);
  EXPECT_TRUE(contains(here_->read("greedy/manifest.json"), {"\"action_selection\": \"greedy\""}));
  const std::string expected = results_of(eval("evolved", "evolved", {"--json", "-"}));
  EXPECT_EQ(results_of(eval("greedy", "evolved", {"--json", "-"})), expected);
  const double greedy = information("greedy");
  EXPECT_EQ(information("evolved"), greedy);
  std::string manifest = here_->read("greedy/manifest.json");
  manifest.replace(manifest.find("\"greedy\""), 8, "\"sampled\"");
  here_->write("greedy/manifest.json", manifest);
  EXPECT_NE(results_of(eval("greedy", "evolved", {"--json", "-"})), expected);
  EXPECT_NE(information("greedy"), greedy);
  EXPECT_EQ(information("greedy", {"--greedy"}), greedy);
}

TEST_F(Eval, ModulesNeedTrustAndGraphsAreNotRead) {
  ASSERT_EQ(here_->run({"export", "first", "--team", "0", "--format", "torchscript", "--out", "module"}).code, 0);
  ASSERT_EQ(here_->run({"export", "first", "--team", "0", "--format", "onnx", "--out", "graph"}).code, 0);
  const Outcome distrusted = eval("module", "circle");
  EXPECT_EQ(distrusted.code, 2);
  EXPECT_TRUE(contains(distrusted.err, {"module/policy.pt is a TorchScript module, which is code", "--trust"}));
  EXPECT_EQ(eval("module", "circle", {"--trust"}).code, 0);
  const Outcome graph = eval("first", "graph");
  EXPECT_EQ(graph.code, 2);
  EXPECT_TRUE(contains(graph.err, {"graph/policy.onnx is an ONNX graph", "--format safetensors"}));
}

}  // namespace
}  // namespace giga::test
