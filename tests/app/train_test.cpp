// Train, then evaluate: a tiny run on the CPU from the config to the win rates.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <sstream>
#include <string>
#include <tuple>

#include "core/error.hpp"
#include "io/checkpoint.hpp"
#include "program.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

/// One run for all tests of this file: they only look at it.
class TrainedRun : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    here_ = new Workplace();
    here_->write("tiny.yaml", kTinyConfig);
    training_ = here_->run({"train", "tiny.yaml", "--run-dir", "run", "--seed", "5"});
  }
  static void TearDownTestSuite() {
    delete here_;
    here_ = nullptr;
  }
  void SetUp() override { ASSERT_EQ(training_.code, 0) << training_.err; }

  static Workplace* here_;
  static Outcome training_;
};
Workplace* TrainedRun::here_ = nullptr;
Outcome TrainedRun::training_;

TEST_F(TrainedRun, PrintsTheTableAndWhatToDoNext) {
  EXPECT_TRUE(
      contains(training_.out, {"against", "random", "circle", " rate run ", " report run ", " export run --team 0"}));
  EXPECT_TRUE(contains(training_.err, {"update 3 of 3", "agent-steps", "wins vs random"}));
}

TEST_F(TrainedRun, FolderHoldsEverything) {
  EXPECT_TRUE(contains(here_->read("run/config.yaml"), {"seed: 5", "n_worlds: 64", "gamma: "}));
  EXPECT_TRUE(contains(here_->read("run/scenario.yaml"), {"team_0:"}));
  EXPECT_TRUE(
      contains(here_->read("run/log.txt"), {"info: training identical_2_vs_2_void", "evaluation after update 2"}));
  const Document info = parse_yaml_text(here_->read("run/run.json"), "run.json");
  EXPECT_EQ(number_at(info, {"seed"}), 5);
  EXPECT_EQ(at(info, {"command_line", "1"}).text, "train");
  EXPECT_EQ(at(info, {"hardware", "device"}).text, "cpu");
  EXPECT_GE(number_at(info, {"hardware", "cores"}), 1);
  EXPECT_NE(at(info, {"versions", "torch"}).text, "");
  EXPECT_TRUE(contains(here_->run({"--version"}).out, {"(commit " + at(info, {"versions", "commit"}).text}));
}

TEST_F(TrainedRun, MetricsHaveARowPerUpdate) {
  const CsvTable table = parse_csv(here_->read("run/metrics.csv"));
  ASSERT_EQ(table.rows.size(), 3u);
  for (size_t row = 0; row < 3; ++row) {
    EXPECT_EQ(table.cell(row, "update"), std::to_string(row + 1));
    EXPECT_EQ(table.cell(row, "agent_steps"), std::to_string(4096 * (row + 1)));
    EXPECT_GT(std::stod(table.cell(row, "agent_steps_per_second")), 0);
    EXPECT_GT(std::stod(table.cell(row, "entropy_0")), 0);
    EXPECT_NE(table.cell(row, "value_loss_1"), "");
    // Evaluated after update 2 and at the end.
    EXPECT_EQ(table.cell(row, "win_rate_1_vs_circle").empty(), row == 0);
  }
}

TEST_F(TrainedRun, KeepsTheNewestCheckpoints) {
  EXPECT_FALSE(here_->has("run/checkpoints/update_00000001.h5"));
  EXPECT_TRUE(here_->has("run/checkpoints/update_00000002.h5"));
  const Checkpoint newest = read_checkpoint(here_->path() / "run/checkpoints/update_00000003.h5");
  EXPECT_EQ(newest.updates, 3);
  EXPECT_EQ(newest.agent_steps, 3 * 4096);
  EXPECT_EQ(newest.seed, 5u);
  EXPECT_EQ(newest.scenario_name, "identical_2_vs_2_void");
  EXPECT_EQ(newest.config_yaml, here_->read("run/config.yaml"));
  EXPECT_FALSE(newest.arrays.empty());
}

TEST_F(TrainedRun, IsNotOverwritten) {
  const Outcome again = here_->run({"train", "tiny.yaml", "--run-dir", "run"});
  EXPECT_EQ(again.code, 2);
  EXPECT_TRUE(contains(again.err, {"run", "not empty"}));
}

TEST_F(TrainedRun, EvaluatesToJsonAlone) {
  const Outcome eval = here_->run(
      {"eval", "run", "--vs", "random", "--episodes", "40", "--seed", "3", "--device", "cpu", "--json", "-"});
  ASSERT_EQ(eval.code, 0) << eval.err;
  const Document json = parse_yaml_text(eval.out, "json");
  EXPECT_EQ(at(json, {"a"}).text, "run");
  EXPECT_EQ(at(json, {"b"}).text, "random");
  EXPECT_EQ(at(json, {"scenario"}).text, "identical_2_vs_2_void");
  ASSERT_EQ(at(json, {"sides"}).items.size(), 2u);
  for (const std::string side : {"0", "1"}) {
    const auto n = [&](const char* key) { return number_at(json, {"sides", side, key}); };
    EXPECT_EQ(n("team"), std::stod(side));
    EXPECT_EQ(n("episodes"), 40);
    EXPECT_EQ(n("wins") + n("losses") + n("ties"), 40);
    EXPECT_DOUBLE_EQ(n("win_rate"), n("wins") / 40);
    EXPECT_LE(number_at(json, {"sides", side, "win_rate_ci95", "0"}), n("win_rate"));
    EXPECT_GE(number_at(json, {"sides", side, "win_rate_ci95", "1"}), n("win_rate"));
    EXPECT_GE(n("mean_length"), 1);
    for (const char* key : {"mean_return", "mean_return_original", "mean_score"}) n(key);
  }
}

TEST_F(TrainedRun, EvaluationIsAFunctionOfTheSeed) {
  const auto eval = [&](const std::string& seed, const std::string& file) {
    return here_->run({"eval", file, "--vs", "circle_random", "--episodes", "40", "--seed", seed, "--device", "cpu"})
        .out;
  };
  const std::string file = "run/checkpoints/update_00000003.h5", first = eval("1", file);
  EXPECT_TRUE(contains(first, {"against", "circle_random", "after 3 updates"}));
  EXPECT_EQ(eval("1", file), first);
  EXPECT_NE(eval("2", file), first);
}

TEST_F(TrainedRun, EvaluationWritesJsonToAFile) {
  const Outcome eval = here_->run(
      {"eval", "run", "--vs", "noop", "--episodes", "8", "--device", "cpu", "--greedy", "--json", "result.json"});
  ASSERT_EQ(eval.code, 0) << eval.err;
  EXPECT_TRUE(contains(eval.out, {"against"}));
  EXPECT_EQ(at(parse_yaml_text(here_->read("result.json"), "json"), {"greedy"}).text, "true");
}

TEST_F(TrainedRun, ADamagedCheckpointIsRefused) {
  here_->write("damaged.h5", here_->read("run/checkpoints/update_00000003.h5").substr(0, 4000));
  const Outcome eval = here_->run({"eval", "damaged.h5", "--vs", "random"});
  EXPECT_EQ(eval.code, 2);
  EXPECT_TRUE(contains(eval.err, {"damaged.h5: is truncated: 4000 of "}));
}

TEST(Train, AScriptedOpponentLearnsNothingAndIsLeftOut) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Outcome training = here.run({"train", "tiny.yaml", "--set", "train.opponent=circle", "--set",
                                     "train.learning_team=1", "--set", "train.total_agent_steps=4_096", "--quiet"});
  ASSERT_EQ(training.code, 0) << training.err;
  EXPECT_EQ(training.err, "");
  const std::string run = "runs/identical_2_vs_2_void-mappo-tiny-opponent_circle-learning_team1-seed1";
  ASSERT_TRUE(here.has(run));
  const CsvTable table = parse_csv(here.read(run + "/metrics.csv"));
  EXPECT_EQ(table.cell(0, "win_rate_0_vs_random"), "");
  EXPECT_NE(table.cell(0, "win_rate_1_vs_random"), "");
  EXPECT_EQ(table.cell(0, "value_loss_0"), "");

  const Outcome eval = here.run({"eval", run, "--vs", "random", "--episodes", "8", "--device", "cpu", "--json", "-"});
  ASSERT_EQ(eval.code, 0) << eval.err;
  EXPECT_TRUE(contains(eval.err, {"team 0 is left out, which did not learn in the training of runs/"}));
  const Document json = parse_yaml_text(eval.out, "json");
  ASSERT_EQ(at(json, {"sides"}).items.size(), 1u);
  EXPECT_EQ(number_at(json, {"sides", "0", "team"}), 1);
}

TEST(Train, TheEndNamesThePathsAndWhatIsNext) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Outcome outcome =
      here.run({"train", "tiny.yaml", "--quiet", "--run-dir", "run", "--set", "train.total_agent_steps=1"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(
      outcome.out, {"report:      run/report.html", "run/checkpoints/update_00000001.h5 (the last)",
                    "run/checkpoints/best.h5 (the best", " rate run", " record run ", " report run ", " export run "}));
  EXPECT_TRUE(contains(outcome.out, {"games:       run/replays.html"}));
  EXPECT_EQ(outcome.out.find(" eval run"), std::string::npos) << "its answer stands above";
}

// Folders that are no runs are left out of a report of several.
TEST(Train, AReportOfManyLeavesOutWhatItCannotRead) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  for (const char* run : {"runs/a", "runs/b"})
    ASSERT_EQ(here.run({"train", "tiny.yaml", "--quiet", "--run-dir", run, "--set", "train.total_agent_steps=1"}).code,
              0);
  here.write("runs/b/metrics.csv", "agent_steps,seconds\n");
  std::filesystem::create_directories(here.path() / "runs/ratings");
  const Outcome outcome = here.run({"report", "runs/a/", "runs/b/", "runs/ratings/", "--out", "all.html"});
  EXPECT_EQ(outcome.code, 0);
  EXPECT_TRUE(
      contains(outcome.err, {"warning: runs/b/metrics.csv: there is no row yet", "is not a run", "it is left out"}));
  EXPECT_TRUE(here.has("all.html"));
  const Outcome no_page = here.run({"report", "runs/a", "--out", "tiny.yaml"});
  EXPECT_EQ(no_page.code, 2);
  EXPECT_TRUE(contains(no_page.err, {"--out: 'tiny.yaml' is no .html file"}));
  EXPECT_EQ(here.read("tiny.yaml"), kTinyConfig);
  const Outcome none = here.run({"report", "runs/b", "runs/ratings", "--out", "none.html"});
  EXPECT_EQ(none.code, 2);
  EXPECT_TRUE(contains(none.err, {"none of these can be reported:"}));
}

/// The names with an underscore in a text: those of figures.
std::vector<std::string> figure_names(const std::string& text) {
  constexpr const char* kLetters = "abcdefghijklmnopqrstuvwxyz_";
  std::vector<std::string> names;
  for (size_t end = 0, begin; (begin = text.find_first_of(kLetters, end)) != std::string::npos;) {
    end = std::min(text.find_first_not_of(kLetters, begin), text.size());
    const std::string name = text.substr(begin, end - begin);
    if (name.find('_') != std::string::npos) names.push_back(name);
  }
  return names;
}

TEST(Train, HelpNamesTheFiguresOfEachAlgorithm) {
  const Workplace here;
  here.write("mappo.yaml", kTinyConfig);
  here.write("snes.yaml", R"(scenario: identical_2_vs_2_void
device: cpu
train: {algorithm: snes, total_agent_steps: 1}
population: {population_size: 4, max_steps: 20}
eval: {episodes: 8}
)");
  const std::string help = here.run({"train", "--help"}).out;
  const size_t mappo = help.find("    mappo  "), evolution = help.find("    openai_es, snes, des  "),
               behind = help.find("  win_rate_T_vs_O");
  ASSERT_TRUE(mappo < evolution && evolution < behind && behind != std::string::npos) << help;
  const size_t figures = help.find("  ", evolution + 4);  // behind the names of the algorithms
  for (const auto& [algorithm, text, figure] :
       {std::tuple{"mappo", help.substr(mappo, evolution - mappo), "clip_fraction"},
        {"snes", help.substr(figures, behind - figures), "fitness_best"}}) {
    const std::string run = algorithm;
    const Outcome training = here.run({"train", run + ".yaml", "--quiet", "--run-dir", run});
    ASSERT_EQ(training.code, 0) << training.err;
    const CsvTable table = parse_csv(here.read(run + "/metrics.csv"));
    const std::vector<std::string> names = figure_names(text);
    EXPECT_EQ(std::count(names.begin(), names.end(), figure), 1) << text;
    for (const std::string& name : names) EXPECT_NE(table.cell(0, name + "_1"), "") << name;
  }
}

// With 3 GB of address space. 262,144 worlds need more: 16 observations of 4 agents with 52 numbers each are 3.5 GB.
TEST(Train, WhereMemoryRunsOutItSaysWhatHelps) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Outcome training = here.run(
      {"-c", "ulimit -v 3000000; exec '" + kGigastep + "' train tiny.yaml --quiet --set train.n_worlds=262144"},
      "/bin/sh");
  EXPECT_EQ(training.code, 1);
  EXPECT_TRUE(contains(training.err, {" memory", "\n`gigastep train CONFIG --plan` measures what a run takes",
                                      "; a smaller train.n_worlds takes less"}));
  EXPECT_EQ(training.err.find("frame #"), std::string::npos) << training.err;
  EXPECT_EQ(here.entries(), std::vector<std::string>{"tiny.yaml"}) << "nothing was created yet";
}

// Of 50 games of 10,000 steps as many states wait at once as there is room for, 128 MiB. All else takes 23 MiB.
TEST(Train, ThePlanCountsTheGamesThatEvaluationsKeep) {
  const Workplace here;
  here.write("short.yaml", kShortConfig);
  const Outcome plan = here.run(
      {"train", "short.yaml", "--plan", "--set", "eval.record=50", "--set", "environment.max_episode_length=10000"});
  ASSERT_EQ(plan.code, 0) << plan.err;
  const std::string before = "train.n_worlds 16 takes ";
  const size_t at = plan.out.find(before);
  ASSERT_NE(at, std::string::npos) << plan.out;
  std::istringstream figure(plan.out.substr(at + before.size()));
  double size = 0;
  std::string unit;
  figure >> size >> unit;
  EXPECT_EQ(unit, "MiB") << plan.out;
  EXPECT_GT(size, 128) << plan.out;
  EXPECT_LT(size, 400) << plan.out;
}

TEST(Train, DivergenceHasItsOwnExitCode) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Outcome training = here.run({"train", "tiny.yaml", "--run-dir", "run", "--set", "mappo.learning_rate=1e38",
                                     "--set", "mappo.critic_learning_rate=1e38"});
  EXPECT_EQ(training.code, 3) << training.err;
  // The first step throws the parameters out of range, the second minibatch notices.
  const std::string dump = "run/diverged_update_1_team_0.h5";
  EXPECT_TRUE(contains(training.err, {"training diverged", "gradient of the ", "of team 0", "at update 1, minibatch 2",
                                      "the batch is in " + dump, "run/checkpoints/update_00000000.h5"}));
  EXPECT_TRUE(contains(here.read("run/log.txt"), {"error: training diverged"}));
  EXPECT_TRUE(contains(here.run({"inspect", dump}).out, {"batch/obs", "batch/advantage", "team_0/actor/mlp/0/weight"}));
  // With step sizes that make sense the run goes on from the last good checkpoint.
  EXPECT_EQ(here.run({"resume", "run"}).code, 3) << "the same again, exactly";
  EXPECT_EQ(
      here.run({"resume", "run", "--set", "mappo.learning_rate=1e-3", "--set", "mappo.critic_learning_rate=1e-3"}).code,
      0);
}

// Steps so small that the policies stay what they are: what differs between two evaluations is what they played.
TEST(Evaluation, EachOneOfARunPlaysEpisodesOfItsOwn) {
  const Workplace here;
  here.write("still.yaml", std::string(kTinyConfig) + "seed: 4\n");
  std::vector<CsvTable> tables;
  for (const char* folder : {"one", "two"}) {
    const Outcome training =
        here.run({"train", "still.yaml", "--run-dir", folder, "--quiet", "--set", "eval.every_updates=1", "--set",
                  "mappo.learning_rate=1.0e-30", "--set", "train.n_threads=1"});
    ASSERT_EQ(training.code, 0) << training.err;
    tables.push_back(parse_csv(here.read(std::string(folder) + "/metrics.csv")));
    ASSERT_EQ(tables.back().rows.size(), 3u);
  }
  for (const char* figure : {"mean_return_0_vs_random", "mean_return_1_vs_circle"}) {
    EXPECT_NE(tables[0].cell(0, figure), tables[0].cell(1, figure)) << figure;
    EXPECT_NE(tables[0].cell(1, figure), tables[0].cell(2, figure)) << figure;
    for (size_t row = 0; row < 3; ++row)
      EXPECT_EQ(tables[0].cell(row, figure), tables[1].cell(row, figure)) << figure << ", the same seed";
  }
}

// Worlds above 1,024 agents have another state, another step and other observations from the first update to a game of
// the exported policy.
TEST(TrainedCrowd, IsEvaluatedAndExported) {
  const Workplace here;
  here.write("crowd.yaml", R"(scenario: swarm_1000_vs_1000
device: cpu
train: {n_worlds: 1, total_agent_steps: 16000, n_threads: 2}   # an update is 1 x 4 x 2,000 = 8,000 agent-steps
mappo: {horizon: 4, n_minibatches: 2, n_epochs: 1, actor: {hidden: [8]}, critic: {hidden: [8]}}
eval: {episodes: 1, opponents: [circle]}
environment: {max_episode_length: 30}
)");
  const Outcome training = here.run({"train", "crowd.yaml", "--run-dir", "run", "--quiet"});
  ASSERT_EQ(training.code, 0) << training.err;
  const CsvTable metrics = parse_csv(here.read("run/metrics.csv"));
  ASSERT_EQ(metrics.rows.size(), 2u);
  EXPECT_EQ(metrics.cell(1, "agent_steps"), "16000");
  for (const char* team : {"0", "1"}) {
    for (const char* network : {"actor", "critic"})
      EXPECT_GT(std::stod(metrics.cell(1, cat(network, "_grad_norm_", team))), 0) << network << " of team " << team;
    // Within 8 steps some fly into each other, and not all.
    EXPECT_GT(std::stod(metrics.cell(1, cat("living_share_", team))), 0.1) << team;
    EXPECT_LT(std::stod(metrics.cell(1, cat("living_share_", team))), 1.0) << team;
    EXPECT_FALSE(metrics.cell(1, cat("win_rate_", team, "_vs_circle")).empty());
  }

  const auto sides_of = [&here](const std::string& player) {
    const Outcome outcome = here.run(
        {"eval", player, "--vs", "circle", "--episodes", "1", "--device", "cpu", "--seed", "3", "--json", "-"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return parse_yaml_text(outcome.out, "json");
  };
  const Document played = sides_of("run");
  ASSERT_EQ(at(played, {"sides"}).items.size(), 2u);
  for (const char* side : {"0", "1"}) {
    double agents = number_at(played, {"sides", side, "mean_survivors"});
    for (const char* cause : {"damage", "agent", "obstacle", "out_of_bounds"})
      agents += number_at(played, {"sides", side, std::string("mean_deaths_") + cause});
    EXPECT_EQ(agents, 1000) << "on side " << side << " all live or have died of something";
  }

  const Outcome exported = here.run({"export", "run", "--team", "0", "--format", "safetensors", "--out", "policy"});
  ASSERT_EQ(exported.code, 0) << exported.err;
  EXPECT_EQ(print_node(at(sides_of("policy"), {"sides", "0"})), print_node(at(played, {"sides", "0"})));
}

}  // namespace
}  // namespace giga::test
