// Configs of networks: what they remember, read and are taught is refused where it cannot be.
#include "config_file.hpp"

namespace giga::test {
namespace {

class LearnNetworkConfig : public ConfigFile {};

TEST_F(LearnNetworkConfig, AMemoryIsRefusedWhereItCannotBe) {
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

TEST_F(LearnNetworkConfig, TheMirrorShowsTheEgocentricViewAlone) {
  const auto error = [this](const char* networks) {
    return error_of(
        cat("scenario: identical_2_vs_2\nenvironment: {observation: {egocentric_view: true}}\nmappo:\n"
            "  mirror: true\n",
            networks));
  };
  const auto refused = [](const char* network) {
    return cat("run.yaml:4:11: mappo.mirror: true, and mappo.", network,
               ".inputs 'all' reads what the mirror does not show, which shows the egocentric view; allowed with it: "
               "false");
  };
  EXPECT_EQ(error(""), cat(refused("actor"), "\n", refused("critic")));
  EXPECT_EQ(error("  actor: {inputs: egocentric}\n"), refused("critic"));
  EXPECT_EQ(error("  actor: {inputs: egocentric}\n  critic: {inputs: egocentric}\n"), "no error");
  EXPECT_EQ(error("  actor: {inputs: egocentric}\n  critic: {kind: state}\n"), "no error");
}

TEST_F(LearnNetworkConfig, AnEncoderOfImagesIsRefusedWhereItCannotBe) {
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

TEST_F(LearnNetworkConfig, ASharedEncoderIsRefusedWhereItCannotBe) {
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

TEST_F(LearnNetworkConfig, TheTrueStateOfACrowdIsRefused) {
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

TEST_F(LearnNetworkConfig, WhatIsTaughtOfTheViewIsRefusedWhereItCannotBe) {
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

TEST_F(LearnNetworkConfig, DeviationsBeginWithinTheirBounds) {
  const auto error = [this](const char* lines) { return error_of(cat("scenario: identical_2_vs_2\n", lines, "\n")); };
  EXPECT_EQ(error("mappo: {actor: {log_std_init: -5, log_std_max: -5}}"), "no error");
  EXPECT_EQ(error("mappo: {actor: {log_std_init: 1.5}}"),
            "run.yaml:2:31: mappo.actor.log_std_init: 1.5 is outside of its bounds; allowed: from "
            "mappo.actor.log_std_min -5 to mappo.actor.log_std_max 1");
  EXPECT_EQ(error("train: {algorithm: snes}\npopulation: {actor: {log_std_min: 0}}"),
            "default of population.actor.log_std_init: -0.5 is outside of its bounds; allowed: from "
            "population.actor.log_std_min 0 to population.actor.log_std_max 1");
}
}  // namespace
}  // namespace giga::test
