// Configurations of runs: what is read, and mistakes that show only in the combination of keys, with their place.
#include "learn/run_config.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "core/error.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

class LearnRunConfig : public testing::Test {
 protected:
  // Not fs::remove_all: in programs with LibTorch it is that of libtorch.so, which crashes (torch 2.11).
  void TearDown() override {
    for (const char* name : {"run.yaml", "below.yaml"}) std::remove((prefix_ + name).c_str());
  }

  /// Writes what `base: BELOW` of a run's file stands for, in tests that begin with that.
  void write_below(const std::string& text) const { std::ofstream(prefix_ + "below.yaml") << text; }
  std::string base_below() const {
    return cat("base: ./", std::filesystem::path(prefix_ + "below.yaml").filename().string(), "\n");
  }

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

// Groups are taken key by key, lists as they are.
TEST_F(LearnRunConfig, StartsFromAnother) {
  write_below(
      "base: mappo\nscenario: identical_2_vs_2\nenvironment: {max_episode_length: 77, rewards: {damage: 3}}\n"
      "mappo: {actor: {hidden: [8]}}\nopponents: {scripted: [circle, pursuer]}\n");
  const LoadedRun run = load(base_below() +
                             "environment: {rewards: {detection: 5}}\nmappo: {actor: {activation: relu}}\n"
                             "opponents: {scripted: [evader]}\n");
  const SimParams& p = run.spec.params;
  EXPECT_EQ(p.n_team[0], 2);
  EXPECT_EQ(p.max_episode_length, 77);
  EXPECT_EQ(p.reward_weight[static_cast<int>(RewardTerm::damage)], 3) << "50 in mappo.yaml, 3 in the file above it";
  EXPECT_EQ(p.reward_weight[static_cast<int>(RewardTerm::detection)], 5);
  EXPECT_EQ(p.reward_weight[static_cast<int>(RewardTerm::collision_obstacle)], 80) << "as in mappo.yaml";
  EXPECT_EQ(run.config.mappo.actor.hidden, std::vector<int>{8});
  EXPECT_EQ(run.config.mappo.actor.activation, Activation::relu);
  EXPECT_EQ(run.config.mappo.actor.inputs, NetworkInputs::egocentric);
  EXPECT_EQ(run.config.opponents.scripted, std::vector<Scripted>{Scripted::evader});
  EXPECT_EQ(run.config.train.n_worlds, 8192);
  // What is printed holds everything, and starts from nothing.
  EXPECT_EQ(print_yaml(load(print_yaml(run.config, true)).config, false), print_yaml(run.config, false));
  EXPECT_EQ(print_yaml(load("base: none\n").config, false), print_yaml(load("seed: 1\n").config, false));
}

TEST_F(LearnRunConfig, MistakesOfWhatItStartsFrom) {
  EXPECT_EQ(error_of("base: mapo\n").substr(0, 73),
            "run.yaml:1:7: base: there is no config 'mapo'; nearest: 'mappo'; allowed:");
  EXPECT_EQ(error_of("base: ./nowhere.yaml\n").substr(0, 57),
            "run.yaml:1:7: base: there is no config './nowhere.yaml'; ");
  EXPECT_EQ(error_of("base: [mappo]\n").substr(0, 20), "run.yaml:1:7: base: ");
  EXPECT_EQ(error_of("seed: 1\n", {"base=mappo"}), "--set base: only a file says what it starts from");

  write_below("train:\n  n_worlds: few\n  n_threads: 1\n");
  EXPECT_EQ(error_of(base_below() + "seed: x\n"),
            "below.yaml:2:13: train.n_worlds: 'few' is not an integer in [1, 16777216]\n"
            "run.yaml:2:7: seed: 'x' is not an integer >= 0");
  EXPECT_EQ(error_of(base_below() + "train: {n_worlds: 64}\n"), "no error") << "nobody reads what is replaced";
  // The place of a value is where it was written last.
  write_below("train: {n_worlds: 64}\nmappo: {n_minibatches: 7}\n");
  EXPECT_EQ(error_of(base_below()).substr(0, 16), "below.yaml:2:24:");

  const std::string run = std::filesystem::path(prefix_ + "run.yaml").filename().string();
  write_below(cat("base: ./", run, "\n"));
  EXPECT_EQ(error_of(base_below()), cat("below.yaml:1:7: base: './", run, "' leads back to this file"));
}

// The original's published setting is that of its rules; the same under ours has a name that says so.
TEST_F(LearnRunConfig, ThePublishedSettingIsTheOriginals) {
  LoadedRun published = load_run_config(source_path("configs/published.yaml"), {});
  const LoadedRun corrected = load_run_config(source_path("configs/published_corrected.yaml"), {});
  EXPECT_EQ(published.spec.params.rules, Rules::original);
  EXPECT_EQ(corrected.spec.params.rules, Rules::corrected);
  // Nothing else differs.
  published.config.rules = corrected.config.rules;
  EXPECT_EQ(print_yaml(published.config, false), print_yaml(corrected.config, false));
}

TEST_F(LearnRunConfig, MinibatchesMustDivide) {
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\ntrain:\n  n_worlds: 10\nmappo:\n  horizon: 5\n  n_minibatches: 4\n"),
            "run.yaml:6:18: mappo.n_minibatches: 4 does not divide train.n_worlds x mappo.horizon = 10 x 5 = 50; "
            "nearest: 2, 5");
  // From the command line, and by default.
  EXPECT_EQ(
      error_of("scenario: identical_2_vs_2\ntrain: {n_worlds: 10}\nmappo: {horizon: 5}\n", {"mappo.n_minibatches=3"}),
      "--set mappo.n_minibatches: 3 does not divide train.n_worlds x mappo.horizon = 10 x 5 = 50; nearest: 2, 5");
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\ntrain: {n_worlds: 10}\nmappo: {horizon: 5}\n"),
            "default of mappo.n_minibatches: 8 does not divide train.n_worlds x mappo.horizon = 10 x 5 = 50; "
            "nearest: 5, 10");
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

TEST_F(LearnRunConfig, AllMistakesOfAllStagesAtOnce) {
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\nenvironment: {team_1: [], max_episode_length: 3}\n"
                     "train: {n_worlds: 10, precision: fp8}\nmappo: {horizon: 5}\n",
                     {"seed=x", "nonsense"}),
            "--set nonsense: expected KEY=VALUE\n"
            "run.yaml:2:23: team_1: the team is empty; it needs at least one entry such as {type: default, count: 5}\n"
            "run.yaml:3:34: train.precision: 'fp8' is not one of: fp32, tf32, bf16, fp16; nearest: 'fp32'\n"
            "run.yaml:4:18: mappo.horizon: 5 is longer than an episode of scenario 'identical_2_vs_2' "
            "(max_episode_length 3)\n"
            "--set seed: 'x' is not an integer >= 0\n"
            "default of mappo.n_minibatches: 8 does not divide train.n_worlds x mappo.horizon = 10 x 5 = 50; "
            "nearest: 5, 10");
}

TEST_F(LearnRunConfig, AMemoryIsRefusedWhereItCannotBe) {
  const auto message = [&](const std::string& lines) { return error_of(cat("scenario: identical_2_vs_2\n", lines)); };
  EXPECT_EQ(
      message("mappo: {horizon: 1, n_minibatches: 1, actor: {memory: gru}, critic: {memory: lstm}}\n"),
      "run.yaml:2:55: mappo.actor.memory: 'gru' learns from the steps of a rollout in a row, and mappo.horizon is "
      "1; allowed with it: none; with memory mappo.horizon is at least 2\n"
      "run.yaml:2:78: mappo.critic.memory: 'lstm' learns from the steps of a rollout in a row, and mappo.horizon "
      "is 1; allowed with it: none; with memory mappo.horizon is at least 2");
  // 10 worlds of 8 steps in 4 minibatches: 80 states can be divided so, 10 worlds cannot.
  const std::string four = "train: {n_worlds: 10}\nmappo: {horizon: 8, n_minibatches: 4";
  EXPECT_EQ(message(four + "}\n"), "no error");
  EXPECT_EQ(message(four + ", critic: {memory: gru}}\n"),
            "run.yaml:3:36: mappo.n_minibatches: 4 does not divide train.n_worlds = 10, whose rollouts stay whole with "
            "memory; nearest: 2, 5");
  EXPECT_EQ(message("train: {algorithm: snes, precision: fp16}\npopulation: {actor: {memory: gru}}\n"),
            "run.yaml:2:37: train.precision: fp16 is computed by one kernel, which knows no memory, and "
            "population.actor.memory is gru; allowed there: fp32, tf32, bf16");
  EXPECT_EQ(message("train: {algorithm: snes}\npopulation: {actor: {memory: gru}}\n"), "no error");
  EXPECT_EQ(message("mappo: {actor: {memory: gruu}}\n"),
            "run.yaml:2:25: mappo.actor.memory: 'gruu' is not one of: none, gru, lstm; nearest: 'gru'");
}

TEST_F(LearnRunConfig, AnEncoderOfImagesIsRefusedWhereItCannotBe) {
  const auto message = [&](const std::string& scenario, const std::string& lines) {
    return error_of(cat("scenario: ", scenario, "\n", lines));
  };
  const std::string state = "mappo: {critic: {kind: state}, actor: {encoder: ";
  EXPECT_EQ(message("identical_2_vs_2_rgb", state + "nature}}\n"), "no error");
  EXPECT_EQ(
      message("identical_2_vs_2", state + "nature}}\n"),
      "run.yaml:2:49: mappo.actor.encoder: 'nature' reads images, and agents of 'identical_2_vs_2' are given none; "
      "environment.observation.type: rgb or rgb_vector gives them; allowed without images: mlp");
  const std::string small = "environment: {observation: {resolution: 35}}\n";
  EXPECT_EQ(message("identical_2_vs_2_rgb", small + state + "nature}}\n"),
            "run.yaml:3:49: mappo.actor.encoder: 'nature' needs images of at least 36 x 36 pixels, and "
            "environment.observation.resolution is 35; allowed with it: impala, compact");
  EXPECT_EQ(message("identical_2_vs_2_rgb", small + state + "impala}}\n"), "no error");
  EXPECT_EQ(message("identical_2_vs_2_rgb", "mappo: {actor: {encoder: nature}, critic: {hidden: [8]}}\n"),
            "run.yaml:1:11: scenario: agents of 'identical_2_vs_2_rgb' are given images alone (observation.type: rgb), "
            "and mappo.critic.encoder mlp reads numbers; nature, impala and compact read images, and "
            "environment.observation.type: rgb_vector gives both");
  EXPECT_EQ(
      message("identical_2_vs_2_rgb", "mappo: {critic: {kind: state, encoder: impala}, actor: {encoder: impala}}\n"),
      "run.yaml:2:40: mappo.critic.encoder: 'impala' reads images, and mappo.critic.kind state the true state of "
      "the world, which is numbers; allowed with it: mlp");
  EXPECT_EQ(
      message("identical_2_vs_2_rgb", state + "impala, inputs: egocentric}}\n"),
      "run.yaml:2:65: mappo.actor.inputs: these are numbers, and the encoder impala reads the image; allowed with "
      "it: all");
  EXPECT_EQ(
      message("identical_2_vs_2_rgb", state + "impala}, obs_norm: true}\n"),
      "run.yaml:2:68: mappo.obs_norm: this normalises the numbers that actors read, and mappo.actor.encoder impala "
      "reads images; allowed with it: false");
  EXPECT_EQ(message("identical_2_vs_2_rgb", "train: {algorithm: snes}\npopulation: {actor: {encoder: nature}}\n"),
            "run.yaml:3:31: population.actor.encoder: 'nature' is not offered to populations, whose networks read "
            "numbers; allowed there: mlp; train.algorithm mappo has it");
  EXPECT_EQ(
      message("identical_2_vs_2", "mappo: {actor: {encoder: nautre}}\n"),
      "run.yaml:2:26: mappo.actor.encoder: 'nautre' is not one of: mlp, nature, impala, compact; nearest: 'nature'");
}

TEST_F(LearnRunConfig, ASharedEncoderIsRefusedWhereItCannotBe) {
  const auto message = [&](const std::string& scenario, const std::string& lines) {
    return error_of(cat("scenario: ", scenario, "\n", lines));
  };
  const std::string numbers = "identical_2_vs_2", images = "identical_2_vs_2_rgb";
  const std::string shared = "mappo: {critic: {shared_encoder: true";
  EXPECT_EQ(message(numbers, shared + "}}\n"), "no error");
  EXPECT_EQ(message(numbers, shared + ", kind: independent, memory: gru}, obs_norm: true}\n"), "no error");
  EXPECT_EQ(message(images, shared + "}, actor: {encoder: impala}}\n"), "no error");
  EXPECT_EQ(message(images, shared + "}}\n"),
            "run.yaml:1:11: scenario: agents of 'identical_2_vs_2_rgb' are given images alone (observation.type: rgb), "
            "and mappo.actor.encoder mlp reads numbers; nature, impala and compact read images, and "
            "environment.observation.type: rgb_vector gives both");
  EXPECT_EQ(message(numbers, shared + ", kind: state}}\n"),
            "run.yaml:2:34: mappo.critic.shared_encoder: the actor's encoder reads what an agent is given, and "
            "mappo.critic.kind state the true state of the world; allowed with it: false");
  EXPECT_EQ(message(images, shared + ", encoder: impala}, actor: {encoder: impala}}\n"),
            "run.yaml:2:49: mappo.critic.encoder: 'impala' would be an encoder of the critic's own, and "
            "mappo.critic.shared_encoder: true gives it the actor's; allowed with it: mlp, which are layers on the "
            "features");
  const std::string view = "environment: {observation: {egocentric_view: true}}\n";
  EXPECT_EQ(message(numbers, cat(view, shared, "}, actor: {inputs: egocentric}}\n")),
            "default of mappo.critic.inputs: 'all' is not what mappo.actor.inputs says, 'egocentric', and "
            "mappo.critic.shared_encoder: true gives it the actor's encoder; allowed with it: egocentric");
  EXPECT_EQ(message(numbers, cat(view, shared, ", inputs: egocentric}}\n")),
            "run.yaml:3:48: mappo.critic.inputs: 'egocentric' is not what mappo.actor.inputs says, 'all', and "
            "mappo.critic.shared_encoder: true gives it the actor's encoder; allowed with it: all");
  EXPECT_EQ(message(numbers, cat(view, shared, ", inputs: egocentric}, actor: {inputs: egocentric}}\n")), "no error");
  EXPECT_EQ(message(images, "mappo: {critic: {shared_encoder: 3}, actor: {encoder: impala}}\n"),
            "run.yaml:2:34: mappo.critic.shared_encoder: '3' is not true or false");
  // The policies of populations have no critic.
  EXPECT_NE(message(numbers, "train: {algorithm: snes}\npopulation: {actor: {shared_encoder: true}}\n")
                .find("run.yaml:3:22: population.actor.shared_encoder: "),
            std::string::npos);
}

TEST_F(LearnRunConfig, TheTrueStateOfACrowdIsRefused) {
  const auto message = [&](int n_team_0, const char* kind) {
    return error_of(cat("scenario: identical_1_vs_1\nenvironment: {team_0: [{type: default, count: ", n_team_0,
                        "}]}\nmappo: {critic: {kind: ", kind, "}}\n"));
  };
  EXPECT_EQ(message(1023, "state"), "no error");  // and one of team 1: 1,024
  EXPECT_EQ(message(1024, "state"),
            "run.yaml:3:24: mappo.critic.kind: state: scenario 'identical_1_vs_1' has 1025 agents in a world, and the "
            "true state tells of at most 1024; allowed: composed, independent");
  for (const char* kind : {"composed", "independent"}) EXPECT_EQ(message(1024, kind), "no error") << kind;
  EXPECT_EQ(error_of("scenario: swarm_million\nmappo: {critic: {kind: state}}\n"),
            "run.yaml:2:24: mappo.critic.kind: state: scenario 'swarm_million' has 1000000 agents in a world, and the "
            "true state tells of at most 1024; allowed: composed, independent");
}

TEST_F(LearnRunConfig, WhatIsTaughtOfTheViewIsRefusedWhereItCannotBe) {
  const auto message = [&](const std::string& observation, const std::string& mappo) {
    return error_of(
        cat("scenario: identical_2_vs_2\nenvironment: {observation: {", observation, "}}\nmappo: {", mappo, "}\n"));
  };
  const std::string both = "type: rgb_vector, egocentric_view: true", sees = ", actor: {encoder: compact}";
  EXPECT_EQ(message(both, "view_coef: 1" + sees), "no error");
  EXPECT_EQ(message(both, "view_coef: 0"), "no error");
  EXPECT_EQ(message(both, "view_coef: 1"),
            "run.yaml:3:20: mappo.view_coef: 1: this teaches an encoder of images, and mappo.actor.encoder mlp reads "
            "numbers; allowed with it: 0");
  EXPECT_EQ(message("type: rgb", "view_coef: 1, critic: {kind: state}" + sees),
            "run.yaml:3:20: mappo.view_coef: 1: agents of 'identical_2_vs_2' are given images alone (observation.type: "
            "rgb), and this teaches what numbers tell; rgb_vector gives both; allowed with rgb: 0");
  EXPECT_EQ(message("type: rgb_vector", "view_coef: 1" + sees),
            "run.yaml:3:20: mappo.view_coef: 1: this teaches the egocentric view, and "
            "environment.observation.egocentric_view is false; allowed with it: 0");
  EXPECT_EQ(message(both, "view_coef: -1" + sees), "run.yaml:3:20: mappo.view_coef: '-1' is not a number >= 0");
}

// A value that could not be read is reported once, and nothing is said about what was taken in its place.
TEST_F(LearnRunConfig, AnEntropyThatNoPolicyReachesIsRefused) {
  const auto error = [this](const char* more) { return error_of(cat("scenario: identical_2_vs_2\n", more, "\n")); };
  EXPECT_EQ(error("mappo: {entropy_target: 3.2}"), "no error");
  EXPECT_EQ(error("mappo: {entropy_target: 3.5}"),
            "run.yaml:2:25: mappo.entropy_target: 3.5: discrete actions at random have 3.29584 nats; allowed there: "
            "less");
  EXPECT_EQ(error("mappo: {entropy_target: 2.5}\nenvironment: {action: continuous}"),
            "run.yaml:2:25: mappo.entropy_target: 2.5: continuous actions at random have 2.07944 nats; allowed "
            "there: less");
}

TEST_F(LearnRunConfig, DeviationsBeginWithinTheirBounds) {
  const auto error = [this](const char* lines) { return error_of(cat("scenario: identical_2_vs_2\n", lines, "\n")); };
  EXPECT_EQ(error("mappo: {actor: {log_std_init: -5, log_std_max: -5}}"), "no error");
  EXPECT_EQ(error("mappo: {actor: {log_std_init: 1.5}}"),
            "run.yaml:2:31: mappo.actor.log_std_init: 1.5 is outside of its bounds; allowed: from "
            "mappo.actor.log_std_min -5 to mappo.actor.log_std_max 1");
  EXPECT_EQ(error("train: {algorithm: snes}\npopulation: {actor: {log_std_min: 0}}"),
            "default of population.actor.log_std_init: -0.5 is outside of its bounds; allowed: from "
            "population.actor.log_std_min 0 to population.actor.log_std_max 1");
}

TEST_F(LearnRunConfig, NoErrorsThatFollowFromOthers) {
  const std::pair<const char*, const char*> cases[] = {
      {"environment: {team_1: 3}", "run.yaml:2:23: environment.team_1: '3' is not a list of maps"},
      {"environment: {max_episode_length: x}\nmappo: {horizon: 600, n_minibatches: 1}",
       "run.yaml:2:35: environment.max_episode_length: 'x' is not an integer >= 1 or none"},
      {"train: {n_worlds: x}\nmappo: {n_minibatches: 7}",
       "run.yaml:2:19: train.n_worlds: 'x' is not an integer in [1, 16777216]"},
      {"environment: {limit_x: x, map_definitions: {m: {team_0: {area: [1, 1, 99, 9]}}}, maps: m}",
       "run.yaml:2:24: environment.limit_x: 'x' is not a number > 0"},
  };
  for (const auto& [lines, expected] : cases)
    EXPECT_EQ(error_of(std::string("scenario: identical_2_vs_2\n") + lines + "\n"), expected);
  // The key that a misspelt one may have meant is not judged either.
  const std::string misspelt =
      error_of("scenario: identical_2_vs_2\ntrain: {n_wrlds: 10}\nmappo: {n_minibatches: 7}\n");
  EXPECT_EQ(misspelt.find("does not divide"), std::string::npos) << misspelt;
  // The type may be defined in the scenario that is not there.
  const std::string missing = error_of("scenario: identical_2_vs_\nenvironment: {team_0: [{type: mine}], limt_x: 1}\n");
  EXPECT_NE(missing.find("run.yaml:1:11: unknown scenario"), std::string::npos) << missing;
  EXPECT_NE(missing.find("run.yaml:2:39: environment.limt_x"), std::string::npos) << missing;
  EXPECT_EQ(missing.find("unknown agent type"), std::string::npos) << missing;
}

TEST_F(LearnRunConfig, RewardsThatFadeArePaid) {
  const auto error = [this](const std::string& mappo, const std::string& rewards = "damage: 5") {
    return error_of(cat("scenario: identical_2_vs_2\nenvironment: {rewards: {", rewards, "}}\nmappo: {", mappo, "}\n"));
  };
  const std::string key = "run.yaml:3:41: mappo.shaping_final_factors.damage: ";
  EXPECT_EQ(error("shaping_final_factors: {damage: 0, defeat_one_opponent: 0.5}"), "no error");
  EXPECT_EQ(error("shaping_final_factors: {damage: 1}, shaping_final_factor: 0.1"), "no error") << "it alone stays";
  EXPECT_EQ(error("shaping_final_factors: {damage: none}, shaping_final_factor: 0.1"), "no error");
  EXPECT_EQ(error("shaping_final_factors: {damage: 2}"), key + "'2' is not a number in [0, 1] or none");
  EXPECT_EQ(error("shaping_final_factors: {game_won: 0.5}").substr(0, 64),
            "run.yaml:3:33: mappo.shaping_final_factors.game_won: unknown key");
  EXPECT_EQ(error("shaping_final_factors: {damage: 0.5}", "damage: 0"),
            key +
                "0.5: scenario 'identical_2_vs_2' does not pay this reward (rewards.damage is 0); allowed there: "
                "none");
  EXPECT_EQ(
      error("shaping_final_factors: {idle_reward: 0.5}"),
      "run.yaml:3:46: mappo.shaping_final_factors.idle_reward: 0.5: scenario 'identical_2_vs_2' does not pay this "
      "reward (no agent type of its teams has idle_reward); allowed there: none");
  EXPECT_EQ(error_of("scenario: hide_and_seek_5_vs_5\nmappo: {shaping_final_factors: {idle_reward: 0.5}}\n"),
            "no error");
  EXPECT_EQ(error("shaping_final_factors: {damage: 1}"),
            key + "1: rewards do not fade where mappo.shaping_final_factor is 1; allowed there: less than 1, or none");
  EXPECT_EQ(error("shaping_final_factors: {damage: 0}, shaping_fade_start: 1"),
            key + "0: nothing fades before the end of the run, mappo.shaping_fade_start 1; allowed there: none");
  // Without a reward that stays whole, or fades by another factor, only the scale of rewards would change.
  const std::string all = "game_won: 0, defeat_one_opponent: 2, damage: 5";
  EXPECT_EQ(error("shaping_final_factor: 0.5", all),
            "run.yaml:3:31: mappo.shaping_final_factor: all rewards but rewards.game_won fade, and that one is off in "
            "this scenario");
  EXPECT_EQ(error("shaping_final_factors: {damage: 0.2, defeat_one_opponent: 0.2}", all),
            key +
                "0.2: all rewards of scenario 'identical_2_vs_2' fade alike, and rewards.game_won, which does not "
                "fade, is off; allowed there: another one than those of the other rewards, or none");
  EXPECT_EQ(error("shaping_final_factors: {damage: 0.2}", all), "no error") << "defeat_one_opponent stays";
  EXPECT_EQ(error("shaping_final_factors: {damage: 0.2}, shaping_final_factor: 0.5", all), "no error");
  // As all of mappo, which evolution does not read.
  EXPECT_EQ(
      error_of("scenario: identical_2_vs_2\ntrain: {algorithm: snes}\nmappo: {shaping_final_factors: {damage: 0}}\n"),
      "no error");
}

TEST_F(LearnRunConfig, OpponentsNeedSelfPlayAndWorlds) {
  const auto error = [this](const std::string& opponents, const std::string& train = "n_worlds: 24") {
    return error_of(cat("scenario: identical_2_vs_2\ntrain: {", train, "}\nopponents: {", opponents, "}\n"));
  };
  EXPECT_EQ(error("pool_size: 4, scripted_share: 0.2"), "no error");
  EXPECT_EQ(error("pool_size: 4, scripted_share: 0.2", "n_worlds: 24, opponent: circle"),
            "run.yaml:3:24: opponents.pool_size: this means nothing with train.opponent circle: the other team plays "
            "that script everywhere; self_play makes both learn\n"
            "run.yaml:3:43: opponents.scripted_share: this means nothing with train.opponent circle: the other team "
            "plays that script everywhere; self_play makes both learn");
  EXPECT_EQ(error("policies: [.]"),
            "run.yaml:3:23: opponents.policies: they join the pool, and opponents.pool_size is 0; needed: 1 or more");
  EXPECT_EQ(error("pool_size: 4, pool_share: 0, policies: [.]"),
            "run.yaml:3:52: opponents.policies: they are met with the pool, and opponents.pool_share is 0; needed: "
            "more");
  EXPECT_EQ(error("pool_size: 4, policies: [./nobody]"),
            "run.yaml:3:37: opponents.policies: there is no run or checkpoint ./nobody");
  EXPECT_EQ(error("pool_size: 4, policies: [.]", "algorithm: snes").substr(0, 70),
            "run.yaml:3:37: opponents.policies: this means nothing to train.algorit");
  EXPECT_EQ(error("pool_size: 4, pool_share: 0.7, scripted_share: 0.5"),
            "run.yaml:3:39: opponents.pool_share: 0.7 and opponents.scripted_share 0.5 are more than 1 together");
  // Half of 24 worlds is 12: 0.04 of it rounds to none, 0.1 of it to one.
  EXPECT_EQ(
      error("pool_size: 4, pool_share: 0.04"),
      "run.yaml:3:39: opponents.pool_share: 0.04 of train.n_worlds 24 leaves each team 0 worlds against the pool; "
      "it needs at least 1");
  EXPECT_EQ(
      error("scripted: [circle, pursuer], scripted_share: 0.1"),
      "run.yaml:3:58: opponents.scripted_share: 0.1 of train.n_worlds 24 leaves each team 1 worlds against scripts "
      "(opponents.scripted); it needs at least 2");
  EXPECT_EQ(
      error_of("scenario: identical_2_vs_2\ntrain: {n_worlds: 8}\nmappo: {horizon: 1}\n"
               "opponents: {pool_size: 2, pool_share: 1}\n"),
      "default of mappo.n_minibatches: 8 minibatches for 4 states of the worlds in which a team learns (opponents)");
}

TEST_F(LearnRunConfig, HalfPrecisionIsForSmallNetworksOfPopulations) {
  const auto error = [this](const std::string& train, const std::string& actor = "") {
    return error_of(
        cat("scenario: identical_2_vs_2\ntrain: {precision: fp16", train, "}\npopulation: {actor: {", actor, "}}\n"));
  };
  for (const char* algorithm : {"openai_es", "snes", "des"})
    EXPECT_EQ(error(cat(", algorithm: ", algorithm), "hidden: [128, 7, 128], activation: gelu"), "no error");
  const std::string at = "run.yaml:2:20: train.precision: fp16 ", allowed = "; allowed there: fp32, tf32, bf16";
  EXPECT_EQ(error(""),
            at + "is for the populations of openai_es, snes and des, and train.algorithm is mappo" + allowed);
  EXPECT_EQ(error(", algorithm: snes", "layer_norm: true"),
            at + "has no layer normalisation, and population.actor.layer_norm is true" + allowed);
  const std::string room = "takes at most 3 hidden layers of at most 128, and population.actor.hidden is ";
  EXPECT_EQ(error(", algorithm: snes", "hidden: [129]"), at + room + "[129]" + allowed);
  EXPECT_EQ(error(", algorithm: snes", "hidden: [8, 8, 8, 8]"), at + room + "[8, 8, 8, 8]" + allowed);
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\ntrain: {algorithm: snes, precision: tf32}\n"
                     "population: {actor: {hidden: [129], layer_norm: true}}\n"),
            "no error");
}

TEST_F(LearnRunConfig, DevicesByName) {
  for (const char* good : {"auto", "cpu", "cuda", "cuda:0", "cuda:15"})
    EXPECT_EQ(error_of(cat("scenario: identical_2_vs_2\ndevice: ", good, "\n")), "no error");
  for (const char* bad : {"gpu", "cuda:1x", "cuda:x", "cuda:-1", "CPU"})
    EXPECT_EQ(error_of(cat("scenario: identical_2_vs_2\ndevice: ", bad, "\n")),
              cat("run.yaml:2:9: device: '", bad, "' is not auto, cpu, cuda or cuda:<number of the GPU>"));
}

TEST_F(LearnRunConfig, MistakesInTheEnvironment) {
  const std::string message = error_of("scenario: identical_2_vs_2\nenvironment:\n  limit_xx: 3\n");
  EXPECT_NE(message.find("run.yaml:3:"), std::string::npos) << message;
  EXPECT_NE(message.find("environment.limit_xx"), std::string::npos) << message;
  EXPECT_NE(message.find("limit_x"), std::string::npos) << message;
}

}  // namespace
}  // namespace giga::test
