// Configurations of runs: what is read, and mistakes that show only in the combination of keys, with their place.
#include "learn/run_config.hpp"

#include "config_file.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

class LearnRunConfig : public ConfigFile {};

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

// A value that could not be read is reported once, and nothing is said about what was taken in its place.
TEST_F(LearnRunConfig, NoErrorsThatFollowFromOthers) {
  const std::pair<const char*, const char*> cases[] = {
      {"environment: {team_1: 3}",
       "run.yaml:2:23: environment.team_1: '3' is not a list of groups, [{key: value, ...}, ...]"},
      {"environment: {max_episode_length: x}\nmappo: {horizon: 600, n_minibatches: 1}",
       "run.yaml:2:35: environment.max_episode_length: 'x' is not an integer in [1, 1000000] or none"},
      {"train: {n_worlds: x}\nmappo: {n_minibatches: 7}",
       "run.yaml:2:19: train.n_worlds: 'x' is not an integer in [1, 16777216]"},
      {"environment: {limit_x: x, map_definitions: {m: {team_0: {area: [1, 1, 99, 9]}}}, maps: m}",
       "run.yaml:2:24: environment.limit_x: 'x' is not a number >= 0.01"},
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
  // 0.3 of 64 worlds is 9 a team, and 0.7 of them 23: all of them.
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\ntrain: {n_worlds: 64}\nmappo: {freeze_lead: 0.1}\n"
                     "opponents: {pool_size: 2, pool_share: 0.7, scripted: [circle], scripted_share: 0.3}\n"),
            "run.yaml:3:22: mappo.freeze_lead: it goes by games between the learning teams, and opponents.pool_share "
            "0.7 and opponents.scripted_share 0.3 leave no world of 64 for them");
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

TEST_F(LearnRunConfig, ImagesNeedTablesOfPairs) {
  const std::string start = "scenario: identical_2_vs_2_rgb\ntrain: {pairs: ";
  const std::string actor = "}\nmappo: {actor: {encoder: nature}, critic: {kind: independent, encoder: nature}}\n";
  EXPECT_EQ(error_of(start + "tables" + actor), "no error");
  EXPECT_EQ(error_of(start + "by_place" + actor),
            "run.yaml:2:16: train.pairs: by_place: agents of 'identical_2_vs_2_rgb' are given images, which need "
            "tables; allowed: auto, tables");
  EXPECT_EQ(error_of("scenario: identical_2_vs_2\ntrain: {pairs: by_place}\n"), "no error");
}

TEST_F(LearnRunConfig, MistakesInTheEnvironment) {
  const std::string message = error_of("scenario: identical_2_vs_2\nenvironment:\n  limit_xx: 3\n");
  EXPECT_NE(message.find("run.yaml:3:"), std::string::npos) << message;
  EXPECT_NE(message.find("environment.limit_xx"), std::string::npos) << message;
  EXPECT_NE(message.find("limit_x"), std::string::npos) << message;
}

}  // namespace
}  // namespace giga::test
