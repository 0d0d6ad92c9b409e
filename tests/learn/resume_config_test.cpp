// What may change when a run goes on, and what is said of the rest.
#include "learn/resume_config.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <utility>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

ResumedRun resumed(const std::vector<std::string>& overrides) {
  const LoadedRun run = SmallRun{}.load();
  return resume_config(print_yaml(run.config, true), print_scenario(run.scenario), overrides);
}

std::string refusal(const std::vector<std::string>& overrides) {
  try {
    resumed(overrides);
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

TEST(LearnResumeConfig, WithoutChangesItIsTheSameConfig) {
  const LoadedRun before = SmallRun{}.load();
  const ResumedRun after = resumed({});
  EXPECT_EQ(print_yaml(after.run.config, true), print_yaml(before.config, true));
  EXPECT_EQ(print_scenario(after.run.scenario), print_scenario(before.scenario));
  EXPECT_TRUE(after.changes.empty());
  EXPECT_TRUE(resumed({"train.n_worlds=24"}).changes.empty()) << "the same value is no change";
  EXPECT_TRUE(after.run.policies_are_saved);
  EXPECT_FALSE(after.run.opponents_move);
  EXPECT_FALSE(resumed({"mappo.shards=2"}).run.opponents_move) << "there are none";
  EXPECT_TRUE(resumed({"opponents.scripted_share=0.5"}).run.opponents_move);
}

// Members of a mixed team share out the worlds of each shard: with other shards their games go on by others.
TEST(LearnResumeConfig, OtherShardsMoveTheMembersOfAMixedTeam) {
  const TemporaryFolder folder;
  const std::string team = (folder / "team.yaml").string();
  write_file(team, "policies: [circle, pursuer]\n");
  SmallRun small;
  small.train = cat("learning_team: 0, opponent: '", team, "'");
  const LoadedRun run = small.load();
  const auto with = [&](const std::vector<std::string>& overrides) {
    return resume_config(print_yaml(run.config, true), print_scenario(run.scenario), overrides).run;
  };
  EXPECT_TRUE(with({"mappo.shards=2"}).opponents_move);
  EXPECT_FALSE(with({"mappo.learning_rate=0.5"}).opponents_move);
  const auto learner = small.learner();
  learner->update();
  make_learner(with({"mappo.shards=2"}), kCpu)->load(saved(*learner));
  // 24 shards of one world each have none for one of the two.
  EXPECT_TRUE(
      contains(input_error_of([&] {
                 with({"mappo.shards=24", "mappo.n_minibatches=1"});
               }),
               {"--set mappo.shards: train.opponent: 2 policies play in", "only 1 worlds are to be shared by them"}));
}

TEST(LearnResumeConfig, TheWeightOfABonusThatFollowsATargetIsNotSet) {
  SmallRun small;
  small.mappo = "entropy_target: 2, entropy_coef: 0.01";
  const LoadedRun run = small.load();
  const std::string refused = input_error_of(
      [&] { resume_config(print_yaml(run.config, true), print_scenario(run.scenario), {"mappo.entropy_coef=0.05"}); });
  EXPECT_NE(refused.find("mappo.entropy_coef: 0.05 instead of 0.01: this may not change when a run goes on: the weight "
                         "of the bonus follows mappo.entropy_target"),
            std::string::npos)
      << refused;
}

TEST(LearnResumeConfig, WhatMayChangeChanges) {
  const ResumedRun after =
      resumed({"train.total_agent_steps=3e5", "mappo.learning_rate=0.5", "train.max_wall_time=3h30m"});
  EXPECT_EQ(after.run.config.train.total_agent_steps, 300'000);
  EXPECT_EQ(after.run.config.mappo.learning_rate, 0.5f);
  EXPECT_EQ(after.run.config.train.max_wall_time->seconds, 3 * 3600 + 30 * 60);
  EXPECT_EQ(after.changes,
            (std::vector<std::string>{"train.total_agent_steps: 100000 -> 300000", "train.max_wall_time: none -> 3h30m",
                                      "mappo.learning_rate: 0.001 -> 0.5"}));
}

TEST(LearnResumeConfig, TheRestIsRefusedWithTheReasonAllAtOnce) {
  const std::string all = refusal({"train.n_worlds=48", "mappo.actor.hidden=[8]", "scenario=identical_2_vs_2",
                                   "mappo.gamma=0.5", "eval.opponents=[random]"});
  for (const char* part :
       {"train.n_worlds: 48 instead of 24", "the checkpoint holds the state of so many worlds", "mappo.actor.hidden",
        "the saved parameters fit their networks only", "the policies and the saved worlds belong to their scenario",
        "mappo.gamma", "what has been learned so far rests on it", "metrics.csv has columns",
        "what may change: train.total_agent_steps"})
    EXPECT_NE(all.find(part), std::string::npos) << part << " is not in " << all;
  EXPECT_NE(refusal({"train.total_agent_step=5"}).find("nearest: 'total_agent_steps'"), std::string::npos);
  EXPECT_NE(refusal({"mappo.learning_rate=-1"}).find("a number > 0"), std::string::npos);
}

TEST(LearnResumeConfig, AnOpponentMayHaveMoved) {
  const TemporaryFolder folder;
  const std::string old_place = (folder / "old.h5").string(), new_place = (folder / "new.h5").string();
  save(SmallRun{}, old_place);
  save(SmallRun{}, new_place);
  SmallRun small;
  small.train = cat("opponent: '", old_place, "'");
  const LoadedRun run = small.load();
  const auto go_on = [&](const std::string& opponent) {
    return resume_config(print_yaml(run.config, true), print_scenario(run.scenario), {"train.opponent=" + opponent});
  };
  std::filesystem::remove(old_place);
  EXPECT_EQ(go_on(new_place).run.config.train.opponent.name, new_place);
  EXPECT_THROW(go_on((folder / "nobody.h5").string()), InputError);
  for (const char* other : {"circle", "self_play"}) EXPECT_THROW(go_on(other), InputError) << other;
  EXPECT_TRUE(contains(refusal({"train.opponent=" + new_place}), {"instead of self_play", "who learns is decided"}));
}

TEST(LearnResumeConfig, TheLongestRuleDecides) {
  EXPECT_EQ(resumed({"openai_es.learning_rate=0.02"}).changes.size(), 1u);  // openai_es. may change
  EXPECT_NE(refusal({"openai_es.sigma_decay=0.9"}).find("counts from the first generation"), std::string::npos);
  EXPECT_NE(refusal({"openai_es.optimizer=momentum"}).find("the moments of this optimizer"), std::string::npos);
}

/// The words of a text that end where a space, a comma or a line does.
std::set<std::string> words(const std::string& text) {
  std::set<std::string> found;
  std::string word;
  for (const char c : text + " ") {
    if (c != ' ' && c != ',' && c != '\n') {
      word += c;
    } else if (!word.empty()) {
      found.insert(std::exchange(word, {}));
    }
  }
  return found;
}

// Every key is either allowed or refused, and the help names those that are allowed, as does the message.
TEST(LearnResumeConfig, TheHelpListsWhatMayChange) {
  for (const std::string& text : {resumable_settings(), refusal({"seed=4"})}) {
    const std::set<std::string> listed = words(text.substr(text.find("what may change") + 1));
    for (const char* key : {"train.total_agent_steps", "train.max_wall_time", "mappo.learning_rate", "checkpoint.keep",
                            "snes.*", "openai_es.*", "des.*", "population.shaping.*"})
      EXPECT_TRUE(listed.contains(key)) << key << " is not in " << text;
    for (const char* key : {"train.n_worlds", "seed"}) EXPECT_FALSE(listed.contains(key)) << key;
    for (const std::string& word : listed) EXPECT_FALSE(word.ends_with('.')) << word;
  }
}

}  // namespace
}  // namespace giga::test
