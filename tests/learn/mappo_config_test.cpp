// Configs of MAPPO: options of the learner that do not fit each other, or the scenario.
#include "config_file.hpp"

namespace giga::test {
namespace {

class LearnMappoConfig : public ConfigFile {};

TEST_F(LearnMappoConfig, MinibatchesMustDivide) {
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

TEST_F(LearnMappoConfig, HorizonFitsIntoAnEpisode) {
  const std::string text = "scenario: identical_2_vs_2\nenvironment: {max_episode_length: 20}\nmappo:\n  horizon: ";
  EXPECT_EQ(error_of(text + "24\n"),
            "run.yaml:4:12: mappo.horizon: 24 is longer than an episode of scenario 'identical_2_vs_2' "
            "(max_episode_length 20)");
  EXPECT_EQ(error_of(text + "20\n"), "no error");
}

TEST_F(LearnMappoConfig, AnEntropyThatNoPolicyReachesIsRefused) {
  const auto error = [this](const char* more) { return error_of(cat("scenario: identical_2_vs_2\n", more, "\n")); };
  EXPECT_EQ(error("mappo: {entropy_target: 3.2}"), "no error");
  EXPECT_EQ(error("mappo: {entropy_target: 3.5}"),
            "run.yaml:2:25: mappo.entropy_target: 3.5: discrete actions at random have 3.29584 nats; allowed there: "
            "less");
  EXPECT_EQ(error("mappo: {entropy_target: 2.5}\nenvironment: {action: continuous}"),
            "run.yaml:2:25: mappo.entropy_target: 2.5: continuous actions at random have 2.07944 nats; allowed "
            "there: less");
}

TEST_F(LearnMappoConfig, OnePolicyForBothTeamsNeitherRestsNorStepsBack) {
  const auto error = [this](const char* scenario) {
    return error_of(cat("scenario: ", scenario,
                        "\nopponents: {scripted_share: 0.2}\n"
                        "mappo: {one_policy: true, freeze_lead: 0.3, step_back: 0.1}\n"));
  };
  const auto refused = [](int column, const char* key) {
    return cat("run.yaml:3:", column, ": mappo.", key,
               ": this is for the policy of one team, and both play by one; allowed with mappo.one_policy: none");
  };
  EXPECT_EQ(error("identical_5_vs_5"), cat(refused(40, "freeze_lead"), "\n", refused(56, "step_back")));
  EXPECT_EQ(error("identical_5_vs_3"), "no error") << "there each team has its own";
  const auto factors = [this](const char* of_teams) {
    return error_of(
        cat("scenario: identical_2_vs_2\nmappo: {one_policy: true, team_learning_rate_factors: ", of_teams, "}\n"));
  };
  EXPECT_EQ(
      factors("[1, 0.5]"),
      "run.yaml:2:55: mappo.team_learning_rate_factors: both teams play by one policy (mappo.one_policy); allowed "
      "with it: two that are equal");
  EXPECT_EQ(factors("[0.5, 0.5]"), "no error");
}

TEST_F(LearnMappoConfig, RewardsThatFadeArePaid) {
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
  EXPECT_EQ(error("shaping_final_factor: 0.5, shaping_fade_start: 1"),
            "run.yaml:3:31: mappo.shaping_final_factor: 0.5: nothing fades before the end of the run, "
            "mappo.shaping_fade_start 1; allowed there: 1");
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
}  // namespace
}  // namespace giga::test
