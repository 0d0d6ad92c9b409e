// What a run is made of: its config and scenario, which train it again, settings that mean nothing, and its name.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "program.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

// The scenario is a file beside the config, with a map of its own in a folder: all of it is in the run folder.
TEST(TrainConfig, ARunsConfigTrainsAgainFromAnywhere) {
  const Workplace here;
  std::filesystem::create_directories(here.path() / "games/maps");
  std::filesystem::create_directories(here.path() / "elsewhere");
  here.write("games/maps/wall.yaml", "boxes: [[4.5, 2, 5.5, 8]]\n");
  here.write("games/duel.yaml", "base: identical_1_vs_1_void\nmaps: maps/wall.yaml\n");
  here.write("games/run.yaml",
             "scenario: duel.yaml\ndevice: cpu\nenvironment: {maps: [./maps/wall.yaml], max_episode_length: 60}\n"
             "train: {n_worlds: 16, total_agent_steps: 256}\nmappo: {horizon: 8, n_minibatches: 2, n_epochs: 1}\n"
             "eval: {episodes: 8}\n");
  ASSERT_EQ(here.run({"config", "games/run.yaml"}).code, 0) << "paths in a file are relative to it";
  const Outcome first = here.run({"train", "games/run.yaml", "--quiet", "--name", "first"});
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_TRUE(contains(here.read("runs/first/config.yaml"), {"scenario: duel.yaml"}));
  std::filesystem::remove_all(here.path() / "games");
  std::filesystem::rename(here.path() / "runs/first", here.path() / "elsewhere/moved");
  const Outcome again = here.run({"train", "elsewhere/moved/config.yaml", "--quiet", "--run-dir", "second"});
  ASSERT_EQ(again.code, 0) << again.err;
  EXPECT_EQ(here.read("second/scenario.yaml"), here.read("elsewhere/moved/scenario.yaml"));
  EXPECT_EQ(here.read("second/config.yaml"), here.read("elsewhere/moved/config.yaml"));
}

// The catalog may change after a run: then its config names another game.
TEST(TrainConfig, ARunsConfigTrainsItsOwnGameOrSaysSo) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  ASSERT_EQ(here.run({"train", "tiny.yaml", "--quiet", "--run-dir", "run"}).code, 0);
  EXPECT_EQ(here.run({"train", "run/config.yaml", "--quiet", "--run-dir", "again"}).code, 0);
  std::string played = here.read("run/scenario.yaml");
  const size_t at = played.find("max_episode_length: ");
  ASSERT_NE(at, std::string::npos);
  played.replace(at, played.find_first_of(" #\n", at + 20) - at, "max_episode_length: 77");
  here.write("run/scenario.yaml", played);
  const Outcome other = here.run({"train", "run/config.yaml", "--quiet", "--run-dir", "third"});
  EXPECT_EQ(other.code, 2);
  EXPECT_TRUE(contains(other.err, {"run/config.yaml:",
                                   " is another game by now than the one of this run "
                                   "(max_episode_length: 77 there, ",
                                   "--set scenario=run/scenario.yaml"}));
  EXPECT_FALSE(here.has("third"));
  // The rules of the config are part of it.
  ASSERT_EQ(here.run({"train", "tiny.yaml", "--quiet", "--run-dir", "ruled", "--set", "rules=original"}).code, 0);
  const Outcome ruled = here.run({"train", "ruled/config.yaml", "--quiet", "--run-dir", "ruled-again"});
  EXPECT_EQ(ruled.code, 0) << ruled.err;
  const Outcome own =
      here.run({"train", "run/config.yaml", "--quiet", "--run-dir", "third", "--set", "scenario=run/scenario.yaml"});
  ASSERT_EQ(own.code, 0) << own.err;
  EXPECT_TRUE(contains(here.read("third/scenario.yaml"), {"max_episode_length: 77"}));
}

// Each key of the table is one that there is, or the run would not start.
TEST(TrainConfig, WarnsOfSettingsThatMeanNothing) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  here.write("evolution.yaml",
             "scenario: identical_1_vs_1_void\ndevice: cpu\ntrain: {algorithm: openai_es, total_agent_steps: 64}\n"
             "population: {population_size: 4, episodes_per_member: 1, max_steps: 4, actor: {hidden: [4]}}\n"
             "eval: {episodes: 2}\n");
  const auto warnings = [&](const char* config, const std::string& run, const std::vector<std::string>& sets) {
    std::vector<std::string> command = {"train", config, "--quiet", "--run-dir", run};
    for (const std::string& set : sets) command.insert(command.end(), {"--set", set});
    const Outcome outcome = here.run(command);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    std::vector<std::string> keys;
    const std::string start = "warning: --set ", end = ": this means nothing ";
    for (size_t at = 0; (at = outcome.err.find(start, at)) != std::string::npos; ++at) {
      const size_t from = at + start.size();
      keys.push_back(outcome.err.substr(from, outcome.err.find(end, from) - from));
    }
    return std::pair{keys, outcome.err};
  };
  // These mean something, and those that switch others off.
  const std::vector<std::string> switches = {"mappo.gamma=0.9", "mappo.schedule=constant", "mappo.value_norm=false",
                                             "mappo.critic.kind=state", "eval.episodes=8"};
  const std::vector<std::pair<std::string, std::string>> idle = {{"mappo.final_learning_rate_factor", "0.5"},
                                                                 {"mappo.value_clip_coef", "0.3"},
                                                                 {"mappo.huber_delta", "2"},
                                                                 {"mappo.value_norm_beta", "0.5"},
                                                                 {"mappo.entropy_rate", "0.1"},
                                                                 {"mappo.actor.memory_size", "8"},
                                                                 {"mappo.critic.memory_size", "8"},
                                                                 {"mappo.critic.inputs", "all"},
                                                                 {"mappo.actor.impala_width", "2"},
                                                                 {"mappo.critic.impala_width", "2"},
                                                                 {"mappo.shaping_fade_start", "0.1"},
                                                                 {"mappo.shaping_fade_end", "0.9"},
                                                                 {"opponents.pool_hardness", "1"},
                                                                 {"opponents.pool_draw", "uniform"},
                                                                 {"opponents.pool_promotion", "always"},
                                                                 {"opponents.scripted", "[pursuer]"},
                                                                 {"opponents.pool_share", "0.5"},
                                                                 {"snes.learning_rate_mean", "0.5"}};
  std::vector<std::string> sets = switches, expected;
  for (const auto& [key, value] : idle) {
    sets.push_back(key + "=" + value);
    expected.push_back(key);
  }
  const auto [keys, text] = warnings("tiny.yaml", "mappo", sets);
  EXPECT_EQ(keys, expected);
  EXPECT_TRUE(contains(text, {"snes.learning_rate_mean: this means nothing with train.algorithm mappo\n",
                              "huber_delta: this means nothing unless mappo.value_loss is huber\n"}));
  EXPECT_EQ(
      warnings("evolution.yaml", "evolution",
               {"population.actor.memory_size=8", "population.noise_rank=2", "population.generations_per_turn=3",
                "openai_es.momentum=0.5", "openai_es.clip_up_max_speed=1", "openai_es.learning_rate_min=0.1",
                "openai_es.sigma_min=0.1", "mappo.gamma=0.9", "population.shaping.kind=z_score"})
          .first,
      (std::vector<std::string>{"population.actor.memory_size", "population.noise_rank",
                                "population.generations_per_turn", "openai_es.momentum", "openai_es.clip_up_max_speed",
                                "openai_es.learning_rate_min", "openai_es.sigma_min", "mappo.gamma"}));
  EXPECT_EQ(warnings("evolution.yaml", "snes", {"train.algorithm=snes", "population.shaping.kind=z_score"}).first,
            std::vector<std::string>{"population.shaping.kind"});
  // Switched on, they do not.
  EXPECT_EQ(warnings("tiny.yaml", "on",
                     {"mappo.value_loss=huber", "mappo.huber_delta=2", "mappo.entropy_target=2",
                      "mappo.entropy_rate=0.1", "mappo.one_policy=true"})
                .first,
            std::vector<std::string>{});
  EXPECT_TRUE(
      contains(warnings("tiny.yaml", "against", {"mappo.one_policy=true", "train.opponent=circle"}).second,
               {"mappo.one_policy: this means nothing unless both teams learn and have the same agents, and none "
                "wins at the time limit\n"}));
}

TEST(TrainConfig, RunsAreNamedByWhatWasChanged) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const std::vector<std::string> arguments = {"train",
                                              "tiny.yaml",
                                              "--quiet",
                                              "--seed",
                                              "2",
                                              "--set",
                                              "mappo.learning_rate=3e-4",
                                              "--set",
                                              "environment.rewards.damage=5",
                                              "--set",
                                              "train.total_agent_steps=1",
                                              "--set",
                                              "eval.episodes=8"};
  const std::string name = "runs/identical_2_vs_2_void-mappo-tiny-lr3e-4-damage5-seed2";
  ASSERT_EQ(here.run(arguments).code, 0);
  ASSERT_EQ(here.run(arguments).code, 0);
  EXPECT_TRUE(here.has(name + "/config.yaml"));
  EXPECT_TRUE(here.has(name + "-002/config.yaml"));
  const Document info = parse_yaml_text(here.read(name + "/run.json"), "run.json");
  EXPECT_EQ(at(info, {"versions", "commit"}).text.ends_with("-dirty"),
            at(info, {"versions", "clean_tree"}).text == "false");
}

// What only the config changes is told by its name, once.
TEST(TrainConfig, RunsAreNamedByTheirConfig) {
  const Workplace here;
  here.write("duel.yaml", "base: identical_1_vs_1_void\n");
  const std::string settings =
      "scenario: ./duel.yaml\ntrain: {n_worlds: 16, total_agent_steps: 1}\n"
      "mappo: {horizon: 8, n_minibatches: 2, n_epochs: 1}\neval: {episodes: 8}\n";
  std::filesystem::create_directories(here.path() / "configs");
  struct Case {
    const char *config, *run;
  };
  for (const Case& c :
       {Case{"patient.yaml", "duel-mappo-patient-seed1"}, Case{"mappo.yaml", "duel-mappo-seed1"},
        Case{"mappo_big.yaml", "duel-mappo_big-seed1"}, Case{"configs/duel.yaml", "duel-mappo-seed1-002"},
        Case{"config.yaml", "duel-mappo-seed1-003"}, Case{"my own.yaml", "duel-mappo-my_own-seed1"}}) {
    const bool below = std::string(c.config).starts_with("configs/");
    here.write(c.config, below ? "scenario: ../duel.yaml\n" + settings.substr(settings.find('\n') + 1) : settings);
    const Outcome outcome = here.run({"train", c.config, "--quiet", "--device", "cpu"});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(here.has(std::string("runs/") + c.run + "/config.yaml")) << c.config << outcome.out;
  }
}

}  // namespace
}  // namespace giga::test
