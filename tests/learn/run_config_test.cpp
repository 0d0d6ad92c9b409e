// Configurations of runs: what is read, and mistakes that show only in the combination of keys, with their place.
#include "learn/run_config.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

#include "core/error.hpp"

namespace giga::test {
namespace {

class LearnRunConfig : public testing::Test {
 protected:
  // Not fs::remove_all: in programs with LibTorch it is that of libtorch.so, which crashes (torch 2.11).
  void TearDown() override { std::remove((prefix_ + "run.yaml").c_str()); }

  LoadedRun load(const std::string& text, const std::vector<std::string>& overrides = {}) const {
    std::ofstream(prefix_ + "run.yaml") << text;
    return load_run_config(prefix_ + "run.yaml", overrides);
  }
  /// The message, without the folder and the number of the process.
  std::string error_of(const std::string& text, const std::vector<std::string>& overrides = {}) const {
    try {
      load(text, overrides);
    } catch (const InputError& e) {
      std::string message = e.what();
      for (size_t at; (at = message.find(prefix_)) != std::string::npos;) message.erase(at, prefix_.size());
      return message;
    }
    return "no error";
  }

  const std::string prefix_ = cat(testing::TempDir(), getpid(), "-");
};

TEST_F(LearnRunConfig, EnvironmentAndRulesChangeTheScenario) {
  const LoadedRun run = load(
      "scenario: identical_2_vs_2\nrules: original\nenvironment: {max_episode_length: 77, team_1: [{type: default}]}\n"
      "train: {n_worlds: 6}\nmappo: {horizon: 4}\n",
      {"train.total_agent_steps=100"});
  EXPECT_EQ(run.spec.params.max_episode_length, 77);
  EXPECT_EQ(run.spec.params.rules, Rules::original);
  EXPECT_EQ(run.spec.params.n_team[0], 2);
  EXPECT_EQ(run.spec.params.n_team[1], 1);
  // 6 worlds x 4 steps x 3 agents = 72 agent-steps an update: 100 take two.
  EXPECT_EQ(agent_steps_per_update(run.config, 3), 72);
  EXPECT_EQ(total_updates(run.config, 3), 2);
}

TEST_F(LearnRunConfig, MinibatchesMustDivide) {
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\ntrain:\n  n_worlds: 10\nmappo:\n  horizon: 5\n  n_minibatches: 4\n"),
            "run.yaml:6:18: mappo.n_minibatches: 4 does not divide train.n_worlds x mappo.horizon = 10 x 5 = 50");
  // From the command line, and by default.
  EXPECT_EQ(
      error_of("scenario: identical_2_vs_2\ntrain: {n_worlds: 10}\nmappo: {horizon: 5}\n", {"mappo.n_minibatches=3"}),
      "--set mappo.n_minibatches: mappo.n_minibatches: 3 does not divide train.n_worlds x mappo.horizon = 10 x 5 "
      "= 50");
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\ntrain: {n_worlds: 10}\nmappo: {horizon: 5}\n"),
            "default of mappo.n_minibatches: mappo.n_minibatches: 8 does not divide train.n_worlds x mappo.horizon = "
            "10 x 5 = 50");
}

TEST_F(LearnRunConfig, HorizonFitsIntoAnEpisode) {
  const std::string text = "scenario: identical_2_vs_2\nenvironment: {max_episode_length: 20}\nmappo:\n  horizon: ";
  EXPECT_EQ(error_of(text + "24\n"),
            "run.yaml:4:12: mappo.horizon: 24 is longer than an episode of scenario 'identical_2_vs_2' "
            "(max_episode_length 20)");
  EXPECT_EQ(error_of(text + "20\n"), "no error");
}

TEST_F(LearnRunConfig, BothMistakesAtOnce) {
  const std::string message = error_of(
      "scenario: identical_2_vs_2\nenvironment: {max_episode_length: 3}\ntrain: {n_worlds: 10}\n"
      "mappo: {horizon: 5, n_minibatches: 4}\n");
  EXPECT_NE(message.find("run.yaml:4:18: mappo.horizon"), std::string::npos) << message;
  EXPECT_NE(message.find("run.yaml:4:36: mappo.n_minibatches"), std::string::npos) << message;
}

TEST_F(LearnRunConfig, MistakesInTheEnvironment) {
  const std::string message = error_of("scenario: identical_2_vs_2\nenvironment:\n  limit_xx: 3\n");
  EXPECT_NE(message.find("run.yaml:3:"), std::string::npos) << message;
  EXPECT_NE(message.find("environment.limit_xx"), std::string::npos) << message;
  EXPECT_NE(message.find("limit_x"), std::string::npos) << message;
}

}  // namespace
}  // namespace giga::test
