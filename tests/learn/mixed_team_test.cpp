// Mixed teams: who plays which games, as a player and as the opponent of a learning team, and which files are refused.
#include "learn/mixed_team.hpp"

#include <gtest/gtest.h>

#include <filesystem>

#include "cuda/runtime.hpp"
#include "eval/match.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "learn/players/player.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

class LearnMixedTeam : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  /// A file of a mixed team.
  std::string mixed(const std::string& name, const std::string& text) const {
    write_file(path(name), text);
    return path(name);
  }

  TemporaryFolder folder_;
};

/// Wins of either side and ties of the first games of a match against random, who plays side 1.
std::array<int, 3> counts(Player& player, const SimSpec& spec, int episodes, Device device = kCpu) {
  Player random = Player::load("random", {.device = device});
  const MatchResult r =
      play_match(spec, player.controller(0, spec), random.controller(1, spec), {episodes, 5, device, 2});
  return {r.wins[0], r.wins[1], r.ties};
}

/// What members win of a match of 33 episodes: a third of the games each, in their order, with the draws of these.
void expect_thirds(Player& team, std::array<Player, 3>& members, const SimSpec& spec, Device device) {
  std::array<int, 3> sum{};
  for (size_t k = 0; k < members.size(); ++k) {
    const auto n = static_cast<int>(11 * k);
    const std::array<int, 3> before = n > 0 ? counts(members[k], spec, n, device) : std::array<int, 3>{};
    const std::array<int, 3> after = counts(members[k], spec, n + 11, device);
    for (size_t j = 0; j < sum.size(); ++j) sum[j] += after[j] - before[j];
  }
  EXPECT_EQ(counts(team, spec, 33, device), sum);
  for (Player& member : members) EXPECT_NE(counts(member, spec, 33, device), sum) << "as if it played all";
}

TEST_F(LearnMixedTeam, EachPlaysAThirdOfTheGames) {
  SmallRun sharp;
  sharp.actor = "hidden: [8], output_gain: 1";  // what it does depends on what it sees
  save(sharp, path("policy.h5"));
  Player team = Player::load(mixed("team.yaml", "policies: [pursuer, ./policy.h5, circle]\n"), {});
  std::array<Player, 3> members = {Player::load("pursuer", {}), Player::load(path("policy.h5"), {}),
                                   Player::load("circle", {})};
  EXPECT_TRUE(team.is_mixed());
  EXPECT_EQ(team.members().size(), 3u);
  EXPECT_EQ(team.origin(), nullptr);
  EXPECT_TRUE(team.can_play(0) && team.can_play(1));
  expect_thirds(team, members, SmallRun{}.load().spec, kCpu);
  // What they remember stays theirs.
  sharp.actor += ", memory: gru, memory_size: 4";
  save(sharp, path("policy.h5"));
  team = Player::load(path("team.yaml"), {});
  members[1] = Player::load(path("policy.h5"), {});
  expect_thirds(team, members, SmallRun{}.load().spec, kCpu);
}

TEST_F(LearnMixedTeam, EachMeetsEachOfAnotherMixedTeam) {
  const SimSpec spec = SmallRun{}.load().spec;
  const std::string one = mixed("one.yaml", "policies: [pursuer, circle, evader]\n");
  const std::string other = mixed("other.yaml", "policies: [circle, noop]\n");
  Player team0 = Player::load(one, {}), team1 = Player::load(other, {});
  const auto play = [&](int episodes) {
    return play_match(spec, team0.controller(0, spec), team1.controller(1, spec), {episodes, 5, kCpu, 2});
  };
  const MatchResult together = play(6 * 12);
  // Games 12 k to 12 k + 11 are those of pair k, as a match of that pair would have them.
  using Counts = std::array<int, 3>;
  const auto counts_of = [](const MatchResult& r) { return Counts{r.wins[0], r.wins[1], r.ties}; };
  Counts sum{};
  std::array<Counts, 3> of_first{};
  std::array<Counts, 2> of_second{};
  const char* const first[] = {"pursuer", "circle", "evader"};
  const char* const second[] = {"circle", "noop"};
  for (size_t k = 0; k < 6; ++k) {
    Player a = Player::load(first[k / 2], {}), b = Player::load(second[k % 2], {});
    const int before = static_cast<int>(12 * k);
    for (const int n : {before, before + 12}) {
      if (n == 0) continue;
      const Counts r = counts_of(play_match(spec, a.controller(0, spec), b.controller(1, spec), {n, 5, kCpu, 2}));
      for (Counts* to : {&sum, &of_first[k / 2], &of_second[k % 2]})
        for (size_t j = 0; j < 3; ++j) (*to)[j] += (n == before ? -1 : 1) * r[j];
    }
  }
  EXPECT_EQ(counts_of(together), sum);
  ASSERT_EQ(together.of_each[0].size(), 3u);
  ASSERT_EQ(together.of_each[1].size(), 2u);
  for (size_t k = 0; k < 3; ++k) EXPECT_EQ(counts_of(together.of_each[0][k]), of_first[k]) << first[k];
  for (size_t k = 0; k < 2; ++k) EXPECT_EQ(counts_of(together.of_each[1][k]), of_second[k]) << second[k];
  EXPECT_EQ(together.of_each[1][1].episodes, 36);
  // Where there are too few games for all pairs, those of each policy are all the same, and each has some.
  const MatchResult few = play(5);
  EXPECT_EQ(few.episodes, 5);
  for (const std::vector<MatchResult>& side : few.of_each) {
    Counts all{};
    int episodes = 0;
    for (const MatchResult& r : side) {
      EXPECT_GE(r.episodes, 1);
      episodes += r.episodes;
      for (size_t j = 0; j < 3; ++j) all[j] += counts_of(r)[j];
    }
    EXPECT_EQ(episodes, 5);
    EXPECT_EQ(all, counts_of(few));
  }
  EXPECT_THROW(play(2), InputError);  // three policies of the first
}

TEST_F(LearnMixedTeam, SideBySideIsOneAfterTheOther) {
  const SimSpec spec = SmallRun{}.load().spec;
  Player team = Player::load(mixed("team.yaml", "policies: [circle_random, random]\n"), {});  // both draw
  Player random = Player::load("random", {});
  const MatchOptions options{33, 5, kCpu, 2};
  const std::shared_ptr<TeamController> own = team.controller(0, spec), other = random.controller(1, spec);
  // Games 17 to 33 of each match are another member's, and draw as these do.
  const std::vector<MatchResult> together = play_matches(spec, {{{own, other}}, {{own, other}}}, options);
  const MatchResult alone = play_match(spec, own, other, options);
  for (const MatchResult& r : together) {
    EXPECT_EQ(r.wins[0], alone.wins[0]);
    EXPECT_EQ(r.wins[1], alone.wins[1]);
    EXPECT_EQ(r.mean_length, alone.mean_length);
    EXPECT_EQ(r.mean_return[0], alone.mean_return[0]);
  }
}

// The kernels of scripts see each row by itself, so that it is exact on a GPU too.
TEST(LearnMixedTeamGpu, EachPlaysAThirdOfTheGames) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const TemporaryFolder folder;
  const std::string file = (folder / "team.yaml").string();
  write_file(file, "policies: [pursuer, circle, evader]\n");
  const Device gpu{Device::Kind::cuda, 0};
  const PlayerOptions loading{.device = gpu};
  Player team = Player::load(file, loading);
  std::array<Player, 3> members = {Player::load("pursuer", loading), Player::load("circle", loading),
                                   Player::load("evader", loading)};
  expect_thirds(team, members, SmallRun{}.load().spec, gpu);
}

TEST_F(LearnMixedTeam, MayBeTheOpponentOfALearningTeam) {
  const auto learner_against = [&](const std::string& name, const std::string& mappo = "") {
    SmallRun run;
    run.train = cat("learning_team: 1, opponent: '", name, "'");
    run.mappo = mappo;
    return run.learner();
  };
  // One who is there twice is one, with any number of shards.
  const std::string twice = mixed("twice.yaml", "policies: [circle, circle]\n");
  for (const char* shards : {"shards: 1", "shards: 3"}) {
    const auto both = learner_against(twice, shards), one = learner_against("circle", shards);
    for (int k = 0; k < 2; ++k) EXPECT_EQ(difference(both->update(), one->update()), "");
    NamedArrays learned = saved(*both);
    std::erase_if(learned, [](const NamedArray& array) { return array.name == "opponent/crc32c"; });
    EXPECT_EQ(difference(learned, saved(*one)), "");
  }
  // Another one in half of the worlds makes another run.
  const auto other = learner_against(mixed("other.yaml", "policies: [circle, pursuer]\n"));
  EXPECT_NE(difference(other->update(), learner_against(twice)->update()), "");

  // A run goes on against the same policies only, scripts among them, in their order.
  const NamedArrays begun = saved(*other);
  learner_against(path("other.yaml"))->load(begun);
  for (const char* changed : {"policies: [circle, evader]\n", "policies: [pursuer, circle]\n"}) {
    const std::string file = mixed("other.yaml", changed);
    EXPECT_THROW(learner_against(file)->load(begun), InputError) << changed;
  }
  SmallRun frozen;
  frozen.actor = "hidden: [8]";
  save(frozen, path("frozen.h5"));
  const std::string file = mixed("team.yaml", "policies: [./frozen.h5, circle]\n");
  const auto learner = learner_against(file);
  const NamedArrays before = saved(*learner);
  for (int k = 0; k < 2; ++k) expect_finite(learner->update(), 1);
  EXPECT_NE(difference(before, saved(*learner)).find("team_1/actor/"), std::string::npos);
  learner_against(file)->load(before);
  save(SmallRun{}, path("frozen.h5"), 7);
  EXPECT_THROW(learner_against(file)->load(before), InputError);
}

// Mistakes are told with the config, before anything starts. Nobody is left without worlds: 24 of them in three shards
// are 8 each.
TEST_F(LearnMixedTeam, AConfigIsRefusedThatLeavesSomeWithoutWorlds) {
  const auto load = [&](const std::string& team, int n) {
    std::string text = "policies: [circle";
    for (int k = 1; k < n; ++k) text += ", random";
    mixed("team.yaml", text + "]\n");
    mixed("run.yaml", cat("train: {n_worlds: 24, opponent: ", path(team), "}\nmappo: {shards: 3}\n"));
    load_run_config(path("run.yaml"), {});
  };
  load("team.yaml", 8);
  EXPECT_TRUE(contains(input_error_of([&] { load("team.yaml", 9); }),
                       {"run.yaml:1:33: train.opponent: 9 policies play in ", "team.yaml, and only 8 worlds"}));
  EXPECT_TRUE(
      contains(input_error_of([&] { load("team.yaml", 1); }), {"run.yaml:1:33", "team.yaml:1:11: policies: has 1"}));
  // All members of a population meet the same opponents.
  mixed("team.yaml", "policies: [circle, pursuer]\n");
  mixed("run.yaml", cat("train: {algorithm: des, opponent: ", path("team.yaml"), "}\n"));
  EXPECT_TRUE(contains(input_error_of([&] { load_run_config(path("run.yaml"), {}); }),
                       {"run.yaml:1:35: train.opponent: ", "is a mixed team", "allowed with train.algorithm des"}));
}

TEST_F(LearnMixedTeam, WhatCannotPlayTogetherIsRefused) {
  const auto refusal = [&](const std::string& text) {
    return input_error_of([&] { Player::load(mixed("bad.yaml", text), {}); });
  };
  EXPECT_TRUE(contains(refusal("polices: [circle, random]\n"),
                       {"bad.yaml:1:1: polices: unknown key", "policies", "is a mixed team"}));
  EXPECT_TRUE(contains(refusal("policies: [circle]\n"), {"bad.yaml:1:11: policies: has 1 item,", "2 to 64"}));
  EXPECT_TRUE(contains(refusal("policies: [circle, cirle]\n"),
                       {"bad.yaml:1:11: policies: 'cirle' is no script", "nearest: 'circle'", "./cirle"}));
  EXPECT_TRUE(contains(refusal("policies: [circle, ./nobody]\n"), {"bad.yaml:1:11: policies[1]: ", "nobody"}));
  EXPECT_TRUE(contains(refusal("policies: [circle, ./no.yaml]\n"), {"policies[1]: there is no ", "no.yaml"}));
  EXPECT_TRUE(contains(refusal("{}\n"), {"bad.yaml: policies: is missing"}));
  mixed("inner.yaml", "policies: [circle, random]\n");
  EXPECT_TRUE(contains(refusal("policies: [circle, ./inner.yaml]\n"), {"bad.yaml:1:11", "is a mixed team itself"}));

  // All must play the game, the same side, and remember as much.
  SmallRun small, larger, alone, remembering, much;
  larger.scenario = "team_1: [{type: default, count: 3}]\n";
  alone.train = "learning_team: 1, opponent: circle";
  remembering.actor = "hidden: [8], memory: gru, memory_size: 4";
  much.actor = "hidden: [8], memory: gru, memory_size: 6";
  save(small, path("small.h5"));
  save(larger, path("larger.h5"));
  save(alone, path("alone.h5"));
  save(remembering, path("four.h5"));
  save(much, path("six.h5"));
  const SimSpec spec = small.load().spec;
  const auto load = [&](const std::string& text) { return Player::load(mixed("team.yaml", text), {}); };
  Player team = load("policies: [./small.h5, ./larger.h5]\n");
  EXPECT_TRUE(contains(input_error_of([&] { team.check_plays(spec); }), {"larger.h5 was trained in 'small'"}));
  team = load("policies: [./small.h5, ./alone.h5]\n");
  EXPECT_FALSE(team.can_play(0));
  EXPECT_TRUE(team.can_play(1));
  alone.train = "learning_team: 0, opponent: circle";
  save(alone, path("other.h5"));
  EXPECT_TRUE(contains(refusal("policies: [./alone.h5, ./other.h5]\n"),
                       {"there is no team that all can play", "alone.h5 none of team 0", "other.h5 none of team 1"}));
  team = load("policies: [./four.h5, ./six.h5]\n");
  EXPECT_TRUE(contains(input_error_of([&] { team.controller(0, spec); }),
                       {"team.yaml: its policies remember 4 and 6 numbers"}));
  team = load("policies: [./four.h5, circle, ./small.h5]\n");
  EXPECT_EQ(team.controller(0, spec)->memory_size(), 4);
}

}  // namespace
}  // namespace giga::test
