// Evolution from the command line: a run, its files, stopping and going on bit for bit, and evaluation.
#include <gtest/gtest.h>
#include <signal.h>

#include "core/error.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

constexpr const char* kConfig = R"(scenario: identical_1_vs_1_fobs_vec_void_disc
device: cpu
train: {algorithm: openai_es, total_agent_steps: 30000}
population: {population_size: 8, episodes_per_member: 2, max_steps: 60, actor: {hidden: [8]}}
opponents: {pool_size: 2, pool_every_updates: 3, pool_share: 0.5}
eval: {episodes: 8, every_updates: 4}
checkpoint: {every_updates: 2}
)";

class EvolutionRun : public ::testing::Test {
 protected:
  EvolutionRun() { here_.write("es.yaml", kConfig); }
  Outcome train(const std::string& run, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"train", "es.yaml", "--run-dir", run};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return here_.run(arguments);
  }
  Workplace here_;
};

TEST_F(EvolutionRun, StoppedAndKilledRunsGoOnBitForBit) {
  const Outcome whole = train("whole");
  ASSERT_EQ(whole.code, 0) << whole.err;
  EXPECT_TRUE(contains(whole.err, {"with openai_es on cpu: 30.0 k agent-steps", "wins vs random"}));
  // A generation is 2 teams x 8 members x 2 episodes of 2 agents for at most 60 steps: at most 3840 agent-steps.
  const size_t generations = metrics_rows(here_, "whole");
  EXPECT_GE(generations, 8u);
  const CsvTable table = parse_csv(here_.read("whole/metrics.csv"));
  const auto steps = [&](size_t row) { return std::stoll(table.cell(row, "agent_steps")); };
  EXPECT_LT(steps(generations - 2), 30000);
  EXPECT_GE(steps(generations - 1), 30000) << "the generation in which the budget is reached is the last";
  for (const int signal : {SIGTERM, SIGKILL}) {
    const std::string run = cat("signal_", signal);
    const auto process = here_.start({"train", "es.yaml", "--run-dir", run});
    ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, run) >= 5; }));
    process->send(signal);
    process->wait();
    const Outcome resumed = here_.run({"resume", run});
    ASSERT_EQ(resumed.code, 0) << resumed.err;
    EXPECT_EQ(state_hash(here_, run), state_hash(here_, "whole"));
    EXPECT_EQ(metrics_difference(timeless_metrics(here_, run), timeless_metrics(here_, "whole")), "");
  }
  // Complete; and further on with one agent-step more.
  EXPECT_TRUE(contains(here_.run({"resume", "whole"}).out, {"is complete", "--set train.total_agent_steps=N"}));
  EXPECT_EQ(here_.run({"resume", "whole", "--set", cat("train.total_agent_steps=", steps(generations - 1) + 1)}).code,
            0);
  EXPECT_EQ(metrics_rows(here_, "whole"), generations + 1);
}

TEST_F(EvolutionRun, IsEvaluatedInspectedAndBenchmarked) {
  for (const char* algorithm : {"snes", "des"}) {
    ASSERT_EQ(
        train(algorithm, {"--set", cat("train.algorithm=", algorithm), "--set", "train.total_agent_steps=4000"}).code,
        0);
    const Outcome eval = here_.run({"eval", algorithm, "--vs", "circle", "--episodes", "8", "--device", "cpu"});
    EXPECT_EQ(eval.code, 0) << eval.err;
    const Outcome inspect = here_.run({"inspect", algorithm});
    EXPECT_TRUE(contains(inspect.out, {"team_0/strategy/sigma", "team_1/pool/networks"})) << inspect.out;
  }
  const Outcome bench = here_.run({"bench", "es", "--config", "es.yaml", "--device", "cpu", "--steps", "1", "--repeats",
                                   "1", "--scenario", "identical_1_vs_1_fobs_vec_void_disc", "--json", "-"});
  ASSERT_EQ(bench.code, 0) << bench.err;
  const Document json = parse_yaml_text(bench.out, "json");
  EXPECT_EQ(number_at(json, {"results", "0", "worlds"}), 32);
  EXPECT_GT(number_at(json, {"results", "0", "checksum", "share_of_closed_loop"}), 0);
  EXPECT_GT(number_at(json, {"results", "0", "checksum", "generations_per_second"}), 0);
  EXPECT_EQ(here_.run({"bench", "train", "--config", "es.yaml", "--device", "cpu"}).code, 2);
  EXPECT_EQ(here_.run({"bench", "es", "--config", "quickstart", "--device", "cpu"}).code, 2);
}

}  // namespace
}  // namespace giga::test
