// Matches between scripts whose outcome is known, and Wilson's interval.
#include "eval/match.hpp"

#include <gtest/gtest.h>

#include <map>

#include "cuda/runtime.hpp"
#include "game/game.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

std::unique_ptr<TeamController> script(Scripted kind) { return script_controller(kind); }

/// 1 against 1 on an empty map of 10 x 10 where nobody shoots or collides: who circles (radius 0.33) stays inside, who
/// flies straight on leaves it after at most 9 / 0.13 = 70 steps.
SimSpec peaceful(const std::string& limit = "150") {
  return load_run_config_text("seed: 1\n", "max_episode_length: " + limit + R"(
maps: empty
team_0: [{type: default, count: 1}]
team_1: [{type: default, count: 1}]
damage: {damage_cone_depth: 0}
collision: {collision_range: 0}
rewards: {defeat_one_opponent: 0, detection: 0, damage: 0, idle: 0, collision_agent: 0, collision_obstacle: 3,
          agent_disabled: 0, game_won: 0, divide_reward_by_team_size: false}
)")
      .spec;
}

TEST(LearnMatch, CircleAgainstCircleIsATie) {
  const MatchResult r = play_match(peaceful(), script(Scripted::circle), script(Scripted::circle), {65, 4, {}, 2});
  EXPECT_EQ(r.episodes, 65);
  EXPECT_EQ(r.ties, 65);
  EXPECT_EQ(r.wins[0] + r.wins[1], 0);
  EXPECT_EQ(r.mean_length, 150);
  EXPECT_EQ(r.mean_return[0], 0);
}

TEST(LearnMatch, AnObserverSeesEveryStep) {
  struct Counter final : GameObserver {
    void after_step(int64_t t, const GameStep&) override { last = t; }
    int64_t last = -2;
  } counter;
  play_match(peaceful(), script(Scripted::circle), script(Scripted::circle), {65, 4, {}, 2}, {&counter});
  EXPECT_EQ(counter.last, 149) << "the last of 150 steps";
}

TEST(LearnMatch, WhoFliesStraightOnLoses) {
  for (const int loser : {0, 1}) {
    const MatchResult r = play_match(peaceful(), script(loser == 0 ? Scripted::noop : Scripted::circle),
                                     script(loser == 1 ? Scripted::noop : Scripted::circle), {65, 4, {}, 2});
    EXPECT_EQ(r.wins[1 - loser], 65);
    EXPECT_EQ(r.wins[loser] + r.ties, 0);
    EXPECT_EQ(r.mean_return[loser], -3);  // collision_obstacle 3, once
    EXPECT_EQ(r.mean_return[1 - loser], 0);
    EXPECT_EQ(r.mean_survivors[loser], 0);
    EXPECT_EQ(r.mean_survivors[1 - loser], 1);
    EXPECT_EQ(r.mean_deaths[loser][3], 1) << "out of bounds";
    for (size_t cause = 0; cause < kNDeaths; ++cause) EXPECT_EQ(r.mean_deaths[1 - loser][cause], 0);
    EXPECT_GT(r.mean_length, 40);  // starts are 6 to 9 from the wall ahead, at 0.13 or a little more a step
    EXPECT_LT(r.mean_length, 71);
  }
}

TEST(LearnMatch, AtTheTimeLimitHidersWin) {
  SimSpec spec = peaceful();
  spec.params.win.at_time_limit = LimitWinner::team_1;
  const MatchResult r = play_match(spec, script(Scripted::circle), script(Scripted::circle), {65, 4, {}, 2});
  EXPECT_EQ(r.wins[1], 65);
  EXPECT_EQ(r.mean_length, 150);
}

TEST(LearnMatch, WithoutATimeLimitItIsCutOff) {
  SimSpec spec = peaceful("none");
  spec.params.win.at_time_limit = LimitWinner::team_1;
  const MatchResult r = play_match(spec, script(Scripted::circle), script(Scripted::circle), {1, 4, {}, 1});
  EXPECT_EQ(r.ties, 1) << "a cut is no time limit";
  EXPECT_EQ(r.mean_length, kEpisodeLimit);
}

bool same_result(const MatchResult& a, const MatchResult& b) {
  return a.wins[0] == b.wins[0] && a.wins[1] == b.wins[1] && a.ties == b.ties && a.mean_length == b.mean_length &&
         a.mean_return[0] == b.mean_return[0] && a.mean_return[1] == b.mean_return[1] &&
         a.mean_return_masked[0] == b.mean_return_masked[0] && a.mean_score[0] == b.mean_score[0];
}

TEST(LearnMatch, CountsAddUpAndTheSeedDecides) {
  const SimSpec spec = SmallRun{}.load().spec;
  const auto play = [&](uint64_t seed, int n_threads) {
    return play_match(spec, script(Scripted::random), script(Scripted::circle_random), {129, seed, {}, n_threads});
  };
  const MatchResult first = play(1, 2);
  EXPECT_EQ(first.episodes, 129);
  EXPECT_EQ(first.wins[0] + first.wins[1] + first.ties, 129);
  EXPECT_GT(first.wins[0], 0);
  EXPECT_GT(first.wins[1], 0);
  EXPECT_GT(first.mean_length, 1);
  EXPECT_LE(first.mean_length, 40);
  EXPECT_TRUE(same_result(first, play(1, 2)));
  EXPECT_TRUE(same_result(first, play(1, 3)));  // whatever the number of threads
  EXPECT_FALSE(same_result(first, play(2, 2)));
}

TEST(LearnMatch, SideBySideIsOneAfterTheOther) {
  const SmallRun small;
  const auto learner = small.learner();
  const SimSpec spec = small.load().spec;
  const std::shared_ptr<TeamController> learned[] = {policy_controller(*learner->actor(0)),
                                                     policy_controller(*learner->actor(1))};
  const std::shared_ptr<TeamController> random = script(Scripted::random), circle = script(Scripted::circle_random);
  // Neighbours with the same controller, controllers of both sides, a script against itself.
  const std::vector<Pairing> pairs = {{{learned[0], random}}, {{learned[0], circle}}, {{random, learned[1]}},
                                      {{random, circle}},     {{circle, circle}},     {{learned[0], learned[1]}}};
  for (const int episodes : {1, 33}) {
    const MatchOptions options{episodes, 5, {}, 2};
    const std::vector<MatchResult> together = play_matches(spec, pairs, options);
    ASSERT_EQ(together.size(), pairs.size());
    for (size_t k = 0; k < pairs.size(); ++k)
      EXPECT_TRUE(same_result(together[k], play_match(spec, pairs[k].side[0], pairs[k].side[1], options)))
          << "pair " << k << ", " << episodes << " episodes";
    EXPECT_FALSE(same_result(together[0], together[1]));
  }
}

TEST(LearnMatch, MoreThanFitSideBySide) {
  const std::vector<Pairing> pairs(3, {{script(Scripted::random), script(Scripted::circle_random)}});
  const MatchOptions options{20'000, 3, {}, 2};  // 40,000 agents each, of 65,536 at once
  const SimSpec spec = peaceful("16");
  const MatchResult one = play_match(spec, pairs[0].side[0], pairs[0].side[1], options);
  const std::vector<MatchResult> all = play_matches(spec, pairs, options);
  ASSERT_EQ(all.size(), 3u);
  for (const MatchResult& r : all) EXPECT_TRUE(same_result(r, one));
}

TEST(LearnMatch, LearnedPolicyPlaysBothSides) {
  const SmallRun small;
  const auto learner = small.learner();
  const SimSpec spec = small.load().spec;
  const auto play = [&](bool greedy) {
    return play_match(spec, policy_controller(*learner->actor(0), greedy), policy_controller(*learner->actor(1)),
                      {33, 1, {}, 2});
  };
  const MatchResult a = play(false);
  EXPECT_EQ(a.wins[0] + a.wins[1] + a.ties, 33);
  EXPECT_TRUE(same_result(a, play(false)));
  EXPECT_FALSE(same_result(a, play(true)));
}

/// The same controller, which does not say that it repeats itself: its games are played step by step.
class NotRecorded final : public TeamController {
 public:
  explicit NotRecorded(std::shared_ptr<TeamController> one) : one_(std::move(one)) {}

  ObservationSet reads() const override { return one_->reads(); }
  void act(std::span<const TeamStep> parts) override { one_->act(parts); }

 private:
  std::shared_ptr<TeamController> one_;
};

/// Whether steps were recorded.
struct Periods final : GameObserver {
  bool repeats() const override { return true; }
  void after_recorded(const GameStep&) override { ++count; }
  int count = 0;
};

// Where nothing is recorded each step is queued by itself, so the figures must be the same to the last bit.
TEST(LearnMatchGpu, RecordedStepsAreTheSame) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const auto teams = [](int n) {
    return cat("team_0: [{type: default, count: ", n, "}]\nteam_1: [{type: default, count: ", n,
               "}]\nmaps: two_rooms1\nlimit_x: 10\nlimit_y: 10\nmax_episode_length: 100\n");
  };
  // Those of five and of two are kernels of their own.
  for (const std::string& scenario : {teams(5), teams(2), teams(4), teams(5) + "action: continuous\n",
                                      teams(3) + "observation: {egocentric_view: true}\n"}) {
    SmallRun small;
    small.scenario = scenario;
    small.precision = "tf32";
    const auto learner = small.learner(gpu);
    const SimSpec spec = small.load().spec;
    const std::shared_ptr<TeamController> learned[] = {policy_controller(*learner->actor(0)),
                                                       policy_controller(*learner->actor(1), true)};
    ASSERT_TRUE(learned[0]->repeats() && learned[1]->repeats()) << "no fused kernel: nothing is tested";
    const std::shared_ptr<TeamController> random = script(Scripted::random), pursuer = script(Scripted::pursuer),
                                          circle = script(Scripted::circle_random);
    const std::vector<Pairing> pairs = {{{learned[0], random}}, {{learned[0], circle}}, {{learned[0], pursuer}},
                                        {{random, learned[1]}}, {{circle, learned[1]}}, {{pursuer, learned[1]}}};
    std::vector<Pairing> plain = pairs;
    std::map<TeamController*, std::shared_ptr<TeamController>> wrapped;
    for (Pairing& pair : plain)
      for (auto& controller : pair.side) {
        auto& one = wrapped[controller.get()];
        if (!one) one = std::make_shared<NotRecorded>(controller);
        controller = one;
      }
    for (const int episodes : {1, 129}) {
      const MatchOptions options{episodes, 5, gpu, 2};
      Periods queued, one_by_one;
      const MatchResult a = play_match(spec, learned[0], circle, options, {&queued});
      const auto wrapped_policy = std::make_shared<NotRecorded>(learned[0]);
      EXPECT_TRUE(same_result(a, play_match(spec, wrapped_policy, circle, options, {&one_by_one})));
      EXPECT_GT(queued.count, 0) << "no graph was queued";
      EXPECT_EQ(one_by_one.count, 0);
      const std::vector<MatchResult> expected = play_matches(spec, plain, options);
      for (int again = 0; again < 2; ++again) {
        const std::vector<MatchResult> recorded = play_matches(spec, pairs, options);
        for (size_t k = 0; k < pairs.size(); ++k)
          EXPECT_TRUE(same_result(recorded[k], expected[k])) << "pair " << k << ", " << episodes << " episodes";
      }
      EXPECT_FALSE(same_result(expected[0], expected[1]));
    }
  }
}

}  // namespace
}  // namespace giga::test
