// What mappo changes so that both teams go on learning: each option by its arithmetic, and in a run.
#include "learn/mappo/balance.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "cuda/runtime.hpp"
#include "learn/mappo/step_back.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

Metrics figures(double entropy, double wins_0, double wins_1) {
  return {{"entropy_0", entropy}, {"entropy_1", std::nan("")}, {"win_rate_0", wins_0}, {"win_rate_1", wins_1}};
}

TEST(LearnBalance, NothingIsChangedByDefault) {
  Balance balance{MappoConfig{}};
  balance.note(figures(0.5, 1, 0));
  for (int team = 0; team < kNTeams; ++team) {
    EXPECT_EQ(balance.entropy_coef(team, 0.5), MappoConfig{}.entropy_coef);
    EXPECT_EQ(balance.actor_factor(team), 1);
    EXPECT_EQ(balance.critic_factor(team), 1);
  }
  for (const double done : {0.0, 0.5, 1.0}) {
    EXPECT_EQ(balance.shaping_factor(done), 1);
    EXPECT_EQ(balance.gamma(done), MappoConfig{}.gamma);
    EXPECT_EQ(balance.clip_coef(done), MappoConfig{}.clip_coef);
  }
  Metrics columns;
  NamedArrays arrays;
  balance.add_metrics(0.5, columns);
  balance.save("", arrays);
  EXPECT_TRUE(columns.empty());
  EXPECT_TRUE(arrays.empty());
}

TEST(LearnBalance, ShapingFadesToItsFloor) {
  MappoConfig config;
  config.shaping_final_factor = 0.25f;
  config.shaping_fade_start = 0.2f;
  config.shaping_fade_end = 0.6f;
  const Balance balance{config};
  EXPECT_EQ(balance.shaping_factor(0.1), 1);
  EXPECT_NEAR(balance.shaping_factor(0.4), 0.625, 1e-6);  // halfway from 1 to 0.25
  EXPECT_NEAR(balance.shaping_factor(0.6), 0.25, 1e-6);
  EXPECT_EQ(balance.shaping_factor(1), 0.25);
  config.shaping_fade_start = config.shaping_fade_end = 0.5f;  // at once
  EXPECT_EQ(Balance{config}.shaping_factor(0.49), 1);
  EXPECT_EQ(Balance{config}.shaping_factor(0.5), 0.25);
}

TEST(LearnBalance, SingleRewardsFadeToFloorsOfTheirOwn) {
  MappoConfig config;
  EXPECT_FALSE(Balance{config}.terms_fade());
  config.shaping_final_factor = 0.5f;
  config.shaping_fade_start = 0.2f;
  config.shaping_fade_end = 0.6f;
  EXPECT_FALSE(Balance{config}.terms_fade()) << "all fade alike";
  const auto own = [&config](RewardTerm term) -> std::optional<float>& {
    return config.shaping_final_factors.of_term[static_cast<size_t>(term)];
  };
  own(RewardTerm::detection) = 1.0f;
  own(RewardTerm::damage) = 0.0f;
  const Balance balance{config};
  EXPECT_TRUE(balance.terms_fade());
  for (const RewardTerm term : {RewardTerm::detection, RewardTerm::damage, RewardTerm::idle, RewardTerm::game_won})
    EXPECT_EQ(balance.shaping_factor(term, 0.2), 1);
  // Halfway: from 1 to 1, to 0, to that of all others, 0.5; a win is paid in full.
  EXPECT_EQ(balance.shaping_factor(RewardTerm::detection, 0.4), 1);
  EXPECT_NEAR(balance.shaping_factor(RewardTerm::damage, 0.4), 0.5, 1e-6);
  EXPECT_NEAR(balance.shaping_factor(RewardTerm::idle, 0.4), 0.75, 1e-6);
  EXPECT_EQ(balance.shaping_factor(RewardTerm::game_won, 0.4), 1);
  EXPECT_EQ(balance.shaping_factor(RewardTerm::damage, 1), 0);
  EXPECT_EQ(balance.shaping_factor(RewardTerm::idle, 1), 0.5);
  Metrics columns;
  balance.add_metrics(0.4, columns);
  ASSERT_EQ(columns.size(), 3u) << "of all, and of those that have one of their own";
  EXPECT_NEAR(metric(columns, "shaping_factor"), 0.75, 1e-6);
  EXPECT_EQ(metric(columns, "shaping_factor_detection"), 1);
  EXPECT_NEAR(metric(columns, "shaping_factor_damage"), 0.5, 1e-6);
}

TEST(LearnBalance, GammaClipAndEntropyGoToTheirLastValues) {
  MappoConfig config;
  config.gamma = 0.9f;
  config.final_gamma = 0.98f;
  config.clip_coef = 0.3f;
  config.final_clip_coef = 0.1f;
  config.entropy_coef = 0.01f;
  config.final_entropy_coef = 0.0f;
  const Balance balance{config};
  EXPECT_EQ(balance.gamma(0), 0.9f);
  EXPECT_NEAR(balance.gamma(0.25), 0.92, 1e-6) << "a quarter of the way from 0.9 to 0.98";
  EXPECT_EQ(balance.gamma(1), 0.98f);
  EXPECT_EQ(balance.gamma(1.5), 0.98f) << "a run that goes on beyond its end";
  EXPECT_NEAR(balance.clip_coef(0.5), 0.2, 1e-6);
  EXPECT_EQ(balance.clip_coef(1), 0.1f);
  for (int team = 0; team < kNTeams; ++team) EXPECT_NEAR(balance.entropy_coef(team, 0.75), 0.0025, 1e-7);
  Metrics columns;
  balance.add_metrics(0.5, columns);
  EXPECT_NEAR(metric(columns, "gamma"), 0.94, 1e-6);
  EXPECT_NEAR(metric(columns, "clip_coef"), 0.2, 1e-6);
  EXPECT_NEAR(metric(columns, "entropy_coef"), 0.005, 1e-6);
}

// Each of them changes what is learned, from the update on in which it differs; in the first one it does not yet.
TEST(LearnBalance, WhatChangesOverTheRunActsInIt) {
  SmallRun plain;
  plain.mappo = "learning_rate: 0.01, clip_coef: 0.02";
  const auto learner = plain.learner();
  learner->update();
  const NamedArrays after_one = saved(*learner);
  learner->update();
  const NamedArrays after_two = saved(*learner);
  for (const char* setting : {"final_gamma: 0.5", "final_clip_coef: 5", "final_entropy_coef: 0.5"}) {
    SmallRun run;
    run.mappo = cat(plain.mappo, ", ", setting);
    const auto other = run.learner();
    other->update();
    EXPECT_EQ(difference(after_one, saved(*other)), "") << setting;
    other->update();
    EXPECT_NE(difference(after_two, saved(*other)), "") << setting;
  }
}

TEST(LearnBalance, TheBonusFollowsTheEntropy) {
  MappoConfig config;
  config.entropy_coef = 0.01f;
  config.entropy_target = 2.0f;
  config.entropy_rate = 0.5f;
  Balance balance{config};
  balance.note(figures(1.0, 0, 0));  // one nat is missing: x exp(0.5)
  EXPECT_NEAR(balance.entropy_coef(0, 0.5), 0.01 * std::exp(0.5), 1e-7);
  EXPECT_EQ(balance.entropy_coef(1, 0.5), 0.01f) << "a figure that is not known changes nothing";
  balance.note(figures(3.0, 0, 0));  // one too many: back
  EXPECT_NEAR(balance.entropy_coef(0, 0.5), 0.01, 1e-7);
  for (int k = 0; k < 100; ++k) balance.note(figures(0, 0, 0));
  EXPECT_NEAR(balance.entropy_coef(0, 0.5), 0.1, 1e-7) << "ten times the first at most";
  for (int k = 0; k < 100; ++k) balance.note(figures(3.3, 0, 0));
  EXPECT_NEAR(balance.entropy_coef(0, 0.5), 0.0001, 1e-8) << "a hundredth at least";
}

TEST(LearnBalance, ATeamThatIsFarAheadRests) {
  MappoConfig config;
  config.freeze_lead = 0.3f;
  config.team_learning_rate_factors = {0.5f, 2.0f};
  Balance balance{config};
  // Leads of 0.8: the running mean is 0.8 (1 - 0.9^k): 0.08, 0.152, 0.2168, 0.27512, 0.327608.
  for (int k = 0; k < 4; ++k) balance.note(figures(1, 0.9, 0.1));
  EXPECT_FALSE(balance.is_frozen(0));
  balance.note(figures(1, 0.9, 0.1));
  EXPECT_TRUE(balance.is_frozen(0));
  EXPECT_FALSE(balance.is_frozen(1));
  EXPECT_EQ(balance.actor_factor(0), 0);
  EXPECT_EQ(balance.critic_factor(0), 0.5f) << "its critic goes on";
  EXPECT_EQ(balance.actor_factor(1), 2);
  balance.note(figures(1, std::nan(""), 0.1));
  EXPECT_TRUE(balance.is_frozen(0)) << "no game has ended: nothing is known";
  balance.note(figures(1, 0.4, 0.6));  // 0.9 x 0.327608 - 0.02 = 0.2748
  EXPECT_FALSE(balance.is_frozen(0));
}

TEST(LearnBalance, EvidenceIsMoreThanLuck) {
  // 64 decided games: 1.65 x 8 = 13.2 more wins than losses are needed; ties count for nobody.
  EXPECT_FALSE((GameCount{70, 38, 6}).is_evidence());  // 38 - 26 = 12
  EXPECT_TRUE((GameCount{70, 39, 6}).is_evidence());   // 39 - 25 = 14
  EXPECT_FALSE((GameCount{50, 0, 50}).is_evidence());
  EXPECT_FALSE(GameCount{}.is_evidence());
}

// Its entropy stays what it is, so a weight that follows it would go to its limit.
TEST(LearnBalance, TheBonusOfATeamThatRestsStays) {
  MappoConfig config;
  config.entropy_coef = 0.01f;
  config.entropy_target = 2.0f;
  config.entropy_rate = 0.5f;
  config.freeze_lead = 0.05f;
  Balance balance{config};
  balance.note(figures(1.0, 1, 0));  // one nat is missing: x exp(0.5); a lead of 0.1
  ASSERT_TRUE(balance.is_frozen(0));
  for (int k = 0; k < 3; ++k) balance.note(figures(1.0, 1, 0));
  EXPECT_NEAR(balance.entropy_coef(0, 0.5), 0.01 * std::exp(0.5), 1e-7);
}

/// Ends a window as the learner does: what the team is then, is what it was when the next one began.
StepBack::Verdict window(StepBack& record, int team, const GameCount& games, int64_t updates_done, float now) {
  const StepBack::Verdict verdict = record.note(team, games, updates_done);
  if (verdict != StepBack::Verdict::goes_on) record.begin(team, {make_array<float>("actor/values", {now})});
  return verdict;
}
float best_of(const StepBack& record, int team) {
  return array_values<float>(find_array(record.best(team), "actor/values")).at(0);
}

TEST(LearnStepBack, ATeamGoesBackToItsBest) {
  using Verdict = StepBack::Verdict;
  StepBack record(0.1, 2);
  EXPECT_EQ(window(record, 0, {800, 640, 0}, 2, 1), Verdict::judged) << "0.8, but of a team that nobody has kept";
  EXPECT_EQ(window(record, 0, {300, 150, 0}, 3, 2), Verdict::goes_on) << "the window has two updates";
  EXPECT_EQ(window(record, 0, {300, 210, 0}, 4, 2), Verdict::judged);
  EXPECT_EQ(best_of(record, 0), 1) << "360 / 600 = 0.6, the first; what it was before those games";
  EXPECT_EQ(window(record, 0, {100, 0, 0}, 6, 3), Verdict::goes_on) << "too few games";
  EXPECT_EQ(window(record, 0, {400, 260, 100}, 8, 3), Verdict::judged) << "260 / 500 = 0.52: less, but not 0.1 less";
  EXPECT_EQ(window(record, 0, {400, 190, 0}, 10, 4), Verdict::judged)
      << "0.475: 0.125 less, but 0.1 + 2 sqrt(0.6 x 0.4 / 600 + 0.475 x 0.525 / 400) = 0.164 may be luck";
  EXPECT_EQ(window(record, 0, {400, 172, 0}, 12, 5), Verdict::fallen) << "0.43: 0.17 less";
  EXPECT_EQ(window(record, 0, {400, 240, 0}, 14, 6), Verdict::judged);
  EXPECT_EQ(best_of(record, 0), 5) << "0.6 again";
  EXPECT_EQ(window(record, 1, {400, 10, 0}, 14, 7), Verdict::judged) << "of the other team";
  EXPECT_EQ(window(record, 1, {400, 10, 0}, 16, 8), Verdict::judged);

  NamedArrays saved;
  record.save("s/", saved);
  StepBack loaded(0.1, 2);
  loaded.load("s/", saved);
  Metrics metrics;
  loaded.add_metrics(metrics);
  EXPECT_EQ(metrics, (Metrics{{"stepped_back_0", 1}, {"stepped_back_1", 0}}));
  EXPECT_EQ(best_of(loaded, 0), 5);
  EXPECT_EQ(best_of(loaded, 1), 7);
  EXPECT_EQ(window(loaded, 0, {400, 160, 0}, 16, 9), Verdict::fallen) << "0.4: the best is known still";
  EXPECT_EQ(window(loaded, 0, {400, 260, 0}, 18, 10), Verdict::judged);
  EXPECT_EQ(best_of(loaded, 0), 9) << "and so is what it was when the window began";
  loaded.forget();
  EXPECT_EQ(window(loaded, 0, {400, 4, 0}, 20, 11), Verdict::judged);
  EXPECT_EQ(window(loaded, 0, {400, 8, 0}, 22, 12), Verdict::judged) << "against other scripts it is the first";
  EXPECT_EQ(best_of(loaded, 0), 11);
}

// A team that stays as it is has its best window by luck, and must not pay for that with what it learns. 400 games a
// window at 0.5 and a drop of 0.05: the best of some hundred windows is 0.56 to 0.57, and of that a window of 0.5 would
// fall short by 0.05 more often than not.
TEST(LearnStepBack, LuckTakesNobodyBack) {
  StepBack record(0.05, 1);
  std::mt19937 numbers(1);
  std::binomial_distribution<int> wins(400, 0.5);
  constexpr int kWindows = 100;
  for (int k = 1; k <= kWindows; ++k) window(record, 0, {400, static_cast<double>(wins(numbers)), 0}, k, 0);
  Metrics metrics;
  record.add_metrics(metrics);
  EXPECT_LE(metrics[0].second, 3);
}

TEST(LearnBalance, AFrozenTeamKeepsItsPolicyAndItsCriticLearns) {
  SmallRun run;
  run.mappo = "team_learning_rate_factors: [0, 1], freeze_lead: 1";
  const auto learner = run.learner();
  const NamedArrays before = saved(*learner);
  for (int k = 0; k < 2; ++k) learner->update();
  const std::string changed = difference(before, saved(*learner));
  EXPECT_EQ(changed.find("team_0/actor/"), std::string::npos) << changed;
  EXPECT_NE(changed.find("team_1/actor/"), std::string::npos) << changed;
}

// A checkpoint that says that team 0 won all of its 1,000 games in its best window, when it was what it is now and the
// weight of its bonus was 0.007, and none since: the next update takes it back, in all that it is. 24 worlds, of which
// each team has 6 against scripts: team 0 learns in the first 18.
TEST(LearnStepBack, AFallenTeamGoesBackInAllThatItIs) {
  SmallRun run;
  run.actor = "hidden: [16], memory: gru, memory_size: 8";
  run.critic = "hidden: [16], memory: gru, memory_size: 8";
  run.mappo = "entropy_target: 2, step_back: 0.1";
  run.more = "opponents: {scripted: [circle], scripted_share: 0.5, pool_every_updates: 2}\n";
  const auto learner = run.learner();
  learner->update();
  NamedArrays checkpoint = saved(*learner);
  NamedArrays best = {make_array<double>("entropy_coef", {0.007})};
  for (const NamedArray& array : checkpoint)
    if (array.name.starts_with("team_0/") && array.name != "team_0/critic_memory") {
      best.push_back(array);
      best.back().name = array.name.substr(7);
    }
  for (NamedArray array : best)
    for (const char* place : {"step_back/team_0/begun/", "step_back/team_0/snapshot/"}) {
      NamedArray kept = array;
      kept.name = place + array.name;
      checkpoint.push_back(kept);
    }
  for (NamedArray& array : checkpoint)
    if (array.name == "step_back/team_0/record") array = make_array<double>(array.name, {1000, 0, 0, 0, 1000, 1000, 0});
  const auto other = run.learner();
  other->load(checkpoint);
  EXPECT_EQ(metric(other->update(), "stepped_back_0"), 1);
  const NamedArrays after = saved(*other);
  for (const NamedArray& array : best) {
    if (array.name == "entropy_coef") continue;
    EXPECT_EQ(find_array(after, "team_0/" + array.name).bytes, array.bytes) << array.name;
  }
  EXPECT_EQ(array_values<double>(find_array(after, "balance/entropy_coef"))[0], 0.007);
  EXPECT_NE(array_values<double>(find_array(after, "balance/entropy_coef"))[1], 0.007);
  const auto remembered = [&after](const std::string& name, size_t first, size_t last) {  // shares of [24, ...]
    const std::vector<float> values = array_values<float>(find_array(after, name));
    const size_t each = values.size() / 24;
    return std::count_if(values.begin() + static_cast<std::ptrdiff_t>(first * each),
                         values.begin() + static_cast<std::ptrdiff_t>(last * each), [](float x) { return x != 0; });
  };
  EXPECT_EQ(remembered("collector/memory_0", 0, 18), 0);
  EXPECT_GT(remembered("collector/memory_1", 6, 24), 0);
  EXPECT_EQ(remembered("team_0/critic_memory", 0, 24), 0);
  EXPECT_GT(remembered("team_1/critic_memory", 0, 24), 0);
}

TEST(LearnBalance, ARunWithAllOptionsGoesOnExactly) {
  SmallRun run;
  run.mappo = "entropy_target: 2, freeze_lead: 0.5, step_back: 0.1, team_reward_share: 0.5, shaping_final_factor: 0.5";
  run.scenario = "rewards: {game_won: 10, damage: 50}\n";
  run.more =
      "opponents: {pool_size: 3, pool_every_updates: 2, pool_share: 0.5, pool_promotion: evidence, "
      "scripted_share: 0.2}\n";
  const auto learner = run.learner(), other = run.learner();
  for (int k = 0; k < 5; ++k) learner->update();
  const NamedArrays checkpoint = saved(*learner);
  for (const char* name :
       {"balance/entropy_coef", "balance/lead", "step_back/team_1/record", "league/team_0/since_kept"})
    EXPECT_NO_THROW(find_array(checkpoint, name)) << name;
  other->load(checkpoint);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(difference(learner->update(), other->update()), "");
  EXPECT_EQ(difference(saved(*learner), saved(*other)), "");
}

// What fades is what the simulator pays: with a factor of 0 only the win is left of the return.
TEST(LearnBalance, FadedRewardsAreNotPaid) {
  SmallRun run;
  run.scenario = "rewards: {game_won: 10, damage: 50, detection: 5, collision_obstacle: 20, agent_disabled: 10}\n";
  run.mappo = "shaping_final_factor: 0, shaping_fade_end: 0";
  const auto learner = run.learner();
  double won = 0;
  for (int k = 0; k < 8; ++k) {
    const Metrics metrics = learner->update();
    EXPECT_EQ(metric(metrics, "shaping_factor"), 0);
    if (metric(metrics, "episodes") == 0) continue;
    for (int team = 0; team < kNTeams; ++team) {
      EXPECT_EQ(metric(metrics, cat("reward_collision_obstacle_", team)), 0);
      EXPECT_NEAR(metric(metrics, cat("return_", team)), metric(metrics, cat("reward_game_won_", team)), 1e-4);
      won += metric(metrics, cat("reward_game_won_", team));
    }
  }
  EXPECT_GT(won, 0);
}

// Policies that do not learn play alike whatever they are paid, so that the same things happen in both runs.
void expect_single_rewards_fade(Device device) {
  SmallRun plain;
  plain.scenario = "rewards: {game_won: 10, detection: 5, collision_obstacle: 20, agent_disabled: 10}\n";
  plain.mappo = "team_learning_rate_factors: [0, 0]";
  SmallRun faded = plain;
  faded.mappo += ", shaping_final_factors: {detection: 0, agent_disabled: 0.25}, shaping_fade_end: 0";
  const auto paid_in_full = plain.learner(device), paid_less = faded.learner(device);
  double seen = 0, died = 0, left = 0;
  for (int k = 0; k < 8; ++k) {
    const Metrics whole = paid_in_full->update(), rest = paid_less->update();
    EXPECT_EQ(metric(rest, "shaping_factor_detection"), 0);
    EXPECT_EQ(metric(rest, "shaping_factor_agent_disabled"), 0.25);
    ASSERT_EQ(metric(rest, "episodes"), metric(whole, "episodes"));
    if (metric(whole, "episodes") == 0) continue;
    for (int team = 0; team < kNTeams; ++team) {
      const auto of = [team](const Metrics& metrics, const char* term) {
        return metric(metrics, cat("reward_", term, "_", team));
      };
      EXPECT_EQ(of(rest, "detection"), 0);
      EXPECT_NEAR(of(rest, "agent_disabled"), 0.25 * of(whole, "agent_disabled"), 1e-5);
      for (const char* term : {"collision_obstacle", "game_won"}) EXPECT_EQ(of(rest, term), of(whole, term)) << term;
      EXPECT_NEAR(metric(rest, cat("return_", team)),
                  metric(whole, cat("return_", team)) - of(whole, "detection") - 0.75 * of(whole, "agent_disabled"),
                  1e-4);
      seen += std::abs(of(whole, "detection"));
      died += std::abs(of(whole, "agent_disabled"));
      left += std::abs(of(whole, "collision_obstacle"));
    }
  }
  EXPECT_GT(std::min({seen, died, left}), 0);
}

TEST(LearnBalance, SingleFadedRewardsAreNotPaid) { expect_single_rewards_fade({}); }

TEST(LearnBalanceGpu, SingleFadedRewardsAreNotPaid) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  expect_single_rewards_fade({Device::Kind::cuda, 0});
}

// A run that was stopped within the fade goes on in it. On a GPU its steps are recorded, with other factors later.
void expect_fade_from_update_to_update(Device device) {
  SmallRun run;
  run.scenario = "rewards: {game_won: 10, detection: 5, agent_disabled: 10}\n";
  run.mappo = "shaping_final_factors: {detection: 0}, shaping_fade_end: 0.04";
  const auto learner = run.learner(device), other = run.learner(device);
  // 131 updates (LearnLearner.ScheduleAndCounters), of which the fade takes 5.24: update u is made with u - 1 done.
  for (int u = 1; u <= 8; ++u) {
    const Metrics metrics = learner->update();
    EXPECT_NEAR(metric(metrics, "shaping_factor_detection"), std::max(0.0, 1 - (u - 1) / 5.24), 1e-6) << u;
    if (u == 3) other->load(saved(*learner));
    if (u > 3) {
      EXPECT_EQ(difference(metrics, other->update()), "") << u;
    }
  }
  EXPECT_EQ(difference(saved(*learner), saved(*other)), "");
}

TEST(LearnBalance, SingleRewardsFadeFromUpdateToUpdate) { expect_fade_from_update_to_update({}); }

TEST(LearnBalanceGpu, SingleRewardsFadeFromUpdateToUpdate) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  expect_fade_from_update_to_update({Device::Kind::cuda, 0});
}

}  // namespace
}  // namespace giga::test
