// The end of an episode: termination, truncation, outcome, returns, statistics, automatic reset, freeze and keep.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

constexpr float kOutside = 9.95f;  // with heading 0 the next step leaves the arena

/// Two a side, far apart, everybody circling so that nobody leaves.
void spread(TestWorld& world) {
  const float places[4][2] = {{2, 2}, {2, 8}, {8, 2}, {8, 8}};
  for (int i = 0; i < world.n_agents(); ++i) {
    world.put(i, places[i][0], places[i][1]);
    world.control(i, 1, 0, 0);
  }
}
void doom(TestWorld& world, int i) {
  world.put(i, kOutside, world.now().y[i]);
  world.control(i, 0, 0, 0);
}

TEST(SimEpisode, TerminatedWhenATeamIsGone) {
  TestWorld world(plain_spec(2, 2));
  spread(world);
  doom(world, 2);
  world.step();
  EXPECT_EQ(world.done(), Done::running);
  EXPECT_EQ(*world.now().outcome, Outcome::open);
  doom(world, 3);
  world.step();
  EXPECT_EQ(world.done(), Done::terminated);
  EXPECT_EQ(*world.now().outcome, Outcome::team_0);
  EXPECT_TRUE(world.neighbors_untouched());
}

TEST(SimEpisode, TeamOneWins) {
  TestWorld world(plain_spec(1, 1));
  spread(world);
  doom(world, 0);
  world.step();
  EXPECT_EQ(world.done(), Done::terminated);
  EXPECT_EQ(*world.now().outcome, Outcome::team_1);
}

TEST(SimEpisode, WipedOutTogetherIsATie) {
  TestWorld world(plain_spec(1, 1));
  spread(world);
  doom(world, 0);
  doom(world, 1);
  world.step();
  EXPECT_EQ(world.done(), Done::terminated);
  EXPECT_EQ(*world.now().outcome, Outcome::tie);
}

TEST(SimEpisode, TimeLimitTruncates) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.max_episode_length = 3;
  TestWorld world(spec);
  spread(world);
  const Done expected[] = {Done::running, Done::running, Done::truncated};
  for (int k = 0; k < 3; ++k) {
    world.step();
    EXPECT_EQ(world.done(), expected[k]) << "step " << k;
    EXPECT_EQ(*world.now().episode_length, k + 1);
    EXPECT_EQ(*world.now().outcome, k < 2 ? Outcome::open : Outcome::tie) << "step " << k;
  }
}

TEST(SimEpisode, DecidedInTheLastStepIsATermination) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.max_episode_length = 1;
  TestWorld world(spec);
  spread(world);
  doom(world, 1);
  world.step();
  EXPECT_EQ(world.done(), Done::terminated);
}

TEST(SimEpisode, NoLimitNeverTruncates) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.max_episode_length = 0;
  TestWorld world(spec);
  spread(world);
  for (int k = 0; k < 700; ++k) {
    world.step();
    ASSERT_EQ(world.done(), Done::running) << "step " << k;
  }
}

TEST(SimEpisode, GoesOnWithOneTeamWhereTheScenarioSaysSo) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.episode_ends_one_team_dead = false;
  TestWorld world(spec);
  spread(world);
  doom(world, 1);
  world.step();
  EXPECT_EQ(world.done(), Done::running);
  EXPECT_EQ(*world.now().outcome, Outcome::team_0) << "decided by who is wiped out first";
  doom(world, 0);
  world.step();
  EXPECT_EQ(world.done(), Done::terminated) << "nobody is left";
  EXPECT_EQ(*world.now().outcome, Outcome::team_0) << "and stays decided";
}

TEST(SimEpisode, ReturnsAndMaskedReturns) {
  // Everybody gets 1 a step while alive before it; agent 1 dies in step 2 of 4; the limit truncates in step 4.
  SimSpec spec = plain_spec(2, 1);
  for (AgentSpec& agent : spec.agents) agent.idle_reward = 1;
  spec.params.max_episode_length = 4;
  TestWorld world(spec, OnDone::reset);
  spread(world);
  world.step();
  doom(world, 1);
  world.step();
  EXPECT_EQ(world.now().returns[0], 4.0f);         // 2 agents x 2 steps
  EXPECT_EQ(world.now().returns_masked[0], 3.0f);  // without agent 1's last step
  world.step();
  EXPECT_EQ(world.stat(EpisodeStat::episodes), 0.0f);
  world.step();
  EXPECT_EQ(world.done(), Done::truncated);
  EXPECT_EQ(world.stat(EpisodeStat::episodes), 1.0f);
  EXPECT_EQ(world.stat(EpisodeStat::length), 4.0f);
  EXPECT_EQ(world.stat(EpisodeStat::truncated), 1.0f);
  EXPECT_EQ(world.stat(EpisodeStat::ties), 1.0f) << "the time limit is a tie";
  EXPECT_EQ(world.stat(EpisodeStat::return_0), 6.0f);         // 4 + 2
  EXPECT_EQ(world.stat(EpisodeStat::return_masked_0), 4.0f);  // 3 + 1
  EXPECT_EQ(world.stat(EpisodeStat::return_1), 4.0f);
  EXPECT_EQ(world.stat(EpisodeStat::return_masked_1), 3.0f);
  EXPECT_EQ(world.term_stat(0, RewardTerm::idle_reward), 6.0f);
  EXPECT_EQ(world.term_stat(1, RewardTerm::idle_reward), 4.0f);
  EXPECT_EQ(world.term_stat(0, RewardTerm::damage), 0.0f);
  EXPECT_EQ(world.now().returns[0], 0.0f);
  EXPECT_EQ(world.now().returns_masked[0], 0.0f);
  EXPECT_EQ(world.now().term_returns[static_cast<int>(RewardTerm::idle_reward)], 0.0f);
}

TEST(SimEpisode, WinsAndScoresInTheStatistics) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.waypoints = true;
  TestWorld world(spec, OnDone::reset);
  for (int episode = 0; episode < 3; ++episode) {
    spread(world);
    const float corners[] = {1, 1, 3, 3};  // around agent 0
    for (int k = 0; k < 4; ++k) world.now().waypoint[k] = corners[k];
    *world.now().waypoint_time = 5;
    world.step();
    doom(world, episode < 2 ? 1 : 0);
    world.step();
    EXPECT_EQ(world.done(), Done::terminated);
  }
  EXPECT_EQ(world.stat(EpisodeStat::episodes), 3.0f);
  EXPECT_EQ(world.stat(EpisodeStat::length), 6.0f);
  EXPECT_EQ(world.stat(EpisodeStat::wins_0), 2.0f);
  EXPECT_EQ(world.stat(EpisodeStat::wins_1), 1.0f);
  EXPECT_EQ(world.stat(EpisodeStat::ties), 0.0f);
  EXPECT_EQ(world.stat(EpisodeStat::truncated), 0.0f);
  EXPECT_EQ(world.stat(EpisodeStat::score_0), 3.0f);
  EXPECT_EQ(world.stat(EpisodeStat::score_1), 0.0f);
}

TEST(SimEpisode, SurvivorsAndDeathsByCause) {
  // Six a side; damage 1 a second from the third step of fire on. One step in which
  //   0 leaves the map while it stands in a box: out of bounds, which is looked at first;
  //   1 and 2 collide inside a box: agents come before obstacles;
  //   3 flies into the box; 4 is shot: health 0.05, fired at for the fourth step = 1 unit = 0.1; 5 lives.
  // Of team 1, 6 shoots, the others are far off.
  SimSpec spec = plain_spec(6, 6);
  spec.params.max_episode_length = 1;
  spec.maps[0].boxes = {{9.5f, 1, 12, 2, 0, 10}, {4, 4, 5, 5, 0, 10}};
  TestWorld world(spec, OnDone::reset);
  world.put(0, kOutside, 1.5f);
  world.put(1, 4.5f, 4.5f);
  world.put(2, 4.5f, 4.6f);
  world.put(3, 3.95f, 4.2f, 0, 5);
  world.put(4, 7, 8);
  world.put(5, 1, 1);
  world.put(6, 6, 8);
  for (int i = 7; i < 12; ++i) world.put(i, 1, 9, 0, static_cast<float>(i - 7) * 2);
  world.now().health[4] = 0.05f;
  world.now().tracked[4 * 12 + 6] = 3;
  world.step();
  ASSERT_EQ(world.stat(EpisodeStat::episodes), 1.0f);
  const auto team = [&](EpisodeStat of_team_0, int t) { return world.stat(of_team(of_team_0, t)); };
  EXPECT_EQ(team(EpisodeStat::deaths_bounds_0, 0), 1.0f);
  EXPECT_EQ(team(EpisodeStat::deaths_agent_0, 0), 2.0f);
  EXPECT_EQ(team(EpisodeStat::deaths_obstacle_0, 0), 1.0f);
  EXPECT_EQ(team(EpisodeStat::deaths_damage_0, 0), 1.0f);
  EXPECT_EQ(team(EpisodeStat::survivors_0, 0), 1.0f);
  EXPECT_EQ(team(EpisodeStat::survivors_0, 1), 6.0f);
  for (const EpisodeStat cause : {EpisodeStat::deaths_bounds_0, EpisodeStat::deaths_agent_0,
                                  EpisodeStat::deaths_obstacle_0, EpisodeStat::deaths_damage_0})
    EXPECT_EQ(team(cause, 1), 0.0f);
  for (int i = 0; i < 12; ++i) EXPECT_EQ(world.now().death[i], Death::none) << "a new episode: agent " << i;
}

TEST(SimEpisode, ADeathIsCountedOnceHoweverLongTheEpisode) {
  SimSpec spec = plain_spec(2, 1);
  spec.params.max_episode_length = 6;
  TestWorld world(spec, OnDone::reset);
  spread(world);
  doom(world, 1);
  for (int k = 0; k < 6; ++k) world.step();
  ASSERT_EQ(world.stat(EpisodeStat::episodes), 1.0f);
  EXPECT_EQ(world.stat(EpisodeStat::deaths_bounds_0), 1.0f);
  EXPECT_EQ(world.stat(EpisodeStat::survivors_0), 1.0f);
  EXPECT_EQ(world.stat(EpisodeStat::survivors_1), 1.0f);
}

TEST(SimEpisode, AutomaticResetKeepsTheFinalObservation) {
  // A twin that is not reset shows what the final observation must be.
  SimSpec spec = plain_spec(2, 2);
  set_reward(spec, RewardTerm::game_won, 5);
  TestWorld world(spec, OnDone::reset), twin(spec, OnDone::keep);
  for (TestWorld* w : {&world, &twin}) {
    spread(*w);
    w->step();
    EXPECT_TRUE(std::isnan(w->final_obs(0, 0))) << "nothing ended";
    EXPECT_EQ(w->final_alive(0), 0xFF);
    doom(*w, 1);
    doom(*w, 2);
    doom(*w, 3);
    w->step();
    ASSERT_EQ(w->done(), Done::terminated);
  }
  for (int i = 0; i < 4; ++i) {
    for (int column = 0; column < world.columns(); ++column)
      EXPECT_EQ(world.final_obs(i, column), twin.obs(i, column)) << "agent " << i << ", column " << column;
    EXPECT_EQ(world.final_alive(i), i == 0) << "agent " << i;
    EXPECT_EQ(world.reward(i), twin.reward(i)) << "agent " << i;
    // The new episode.
    EXPECT_TRUE(world.alive(i));
    EXPECT_EQ(world.alive_out(i), 1) << "agent " << i;
    EXPECT_EQ(world.now().v[i], 1.0f) << "agent " << i;
    EXPECT_EQ(world.now().health[i], 1.0f) << "agent " << i;
    EXPECT_EQ(world.obs(i, 2), world.now().x[i] * 0.1f) << "agent " << i;
  }
  for (int column = 0; column < state_size(world.params()); ++column)
    EXPECT_EQ(world.final_state(column), twin.state(column)) << "column " << column;
  EXPECT_EQ(*world.now().episode_length, 0);
  EXPECT_EQ(*world.now().outcome, Outcome::open);
  EXPECT_TRUE(std::isnan(twin.final_obs(0, 0))) << "keep has no final observation";
  EXPECT_EQ(world.reward(0), 5.0f) << "the last step is still paid";
}

TEST(SimEpisode, KeepStepsOn) {
  SimSpec spec = plain_spec(1, 1);
  spec.params.max_episode_length = 2;
  TestWorld world(spec, OnDone::keep);
  spread(world);
  world.steps(3);
  EXPECT_EQ(world.done(), Done::truncated);
  EXPECT_EQ(*world.now().episode_length, 3);
  EXPECT_EQ(world.stat(EpisodeStat::episodes), 0.0f);
}

TEST(SimEpisode, FreezeWaits) {
  SimSpec spec = plain_spec(2, 1);
  for (AgentSpec& agent : spec.agents) agent.idle_reward = 1;
  spec.params.max_episode_length = 2;
  TestWorld world(spec, OnDone::freeze);
  spread(world);
  world.step();
  EXPECT_EQ(*world.now().phase, Phase::plays);
  world.step();
  EXPECT_EQ(world.done(), Done::truncated);
  EXPECT_EQ(*world.now().phase, Phase::waits);
  EXPECT_EQ(world.final_alive(0), 1);
  const float x = world.now().x[0];
  const uint32_t draw_step = *world.now().draw_step;
  world.steps(3);
  EXPECT_EQ(world.now().x[0], x);
  EXPECT_TRUE(std::isnan(world.obs(0, 2))) << "it is not observed any more";
  EXPECT_EQ(world.reward(0), 0.0f);
  EXPECT_EQ(world.reward(2), 0.0f);
  EXPECT_EQ(world.done(), Done::running) << "done is told once";
  EXPECT_EQ(*world.now().episode_length, 2);
  EXPECT_EQ(*world.now().draw_step, draw_step);
  EXPECT_EQ(world.stat(EpisodeStat::episodes), 1.0f);
  EXPECT_EQ(world.stat(EpisodeStat::return_0), 4.0f);
  world.start();
  EXPECT_EQ(*world.now().phase, Phase::plays) << "a start wakes it";
}

// Worlds with the same luck and different actions: their first episodes differ in length, their second ones start
// alike.
TEST(SimEpisode, FreezeAfterSeveralEpisodes) {
  SimSpec spec = plain_spec(3, 3);
  spec.params.max_episode_length = 40;
  spec.maps[0].start[0] = spec.maps[0].start[1] = {3, 3, 7, 7, 0, 4, 0, 6};
  spec.finish();
  SimOptions options;
  options.n_worlds = 32;
  options.draw_period = 1;
  options.on_done = OnDone::freeze;
  options.episodes = 3;
  SimRunner runner(make_cpu_simulator(spec, options), Outputs::observations);
  runner.start();
  const StateView state = runner.sim().state().view();
  const auto row = [&](int world, EpisodeStat s) { return state.stats[world * kNStatRows + static_cast<int>(s)]; };
  std::map<float, std::set<float>> starts;  // of agent 0, by the number of the episode
  std::set<float> first_lengths;
  int steps = 0;
  for (; !runner.sim().over() && steps < 3 * 40; ++steps) {
    for (int world = 0; world < 32; ++world) {
      if (*(state.phase + world) != Phase::plays || state.episode_length[world] != 0) continue;
      const float episodes = row(world, EpisodeStat::episodes);
      starts[episodes].insert(state.x[world * 6]);
      if (episodes == 1) first_lengths.insert(row(world, EpisodeStat::length));
    }
    runner.step(static_cast<uint64_t>(steps));
  }
  EXPECT_TRUE(runner.sim().over());
  EXPECT_GT(first_lengths.size(), 3u);
  ASSERT_EQ(starts.size(), 3u);
  for (const auto& [episode, x] : starts) EXPECT_EQ(x.size(), 1u) << "episode " << episode;
  EXPECT_NE(*starts[0].begin(), *starts[1].begin());
  EXPECT_NE(*starts[1].begin(), *starts[2].begin());
  float longest = 0;
  for (int world = 0; world < 32; ++world) {
    EXPECT_EQ(row(world, EpisodeStat::episodes), 3.0f);
    longest = std::max(longest, row(world, EpisodeStat::length));
  }
  EXPECT_EQ(static_cast<float>(steps), longest) << "the last world decides";
}

TEST(SimEpisode, TakeStatsSumsWorldsOnce) {
  // 65 worlds, 5 steps an episode, nobody can die: 12 steps hold 2 episodes each.
  SimSpec spec = plain_spec(1, 1);
  spec.params.max_episode_length = 5;
  spec.params.collision_range2 = 0;
  spec.params.damage_per_second = 0;
  spec.params.limit_x = spec.params.limit_y = 100;
  spec.maps[0].start[0] = spec.maps[0].start[1] = {40, 40, 60, 60, 0, 0, 0, 0};
  spec.agents[1].idle_reward = 0.5f;
  spec.finish();
  SimOptions options;
  options.n_worlds = 65;
  options.n_threads = 2;
  SimRunner runner(make_cpu_simulator(spec, options));
  runner.start();
  for (uint64_t k = 0; k < 12; ++k) runner.step(k);
  const EpisodeStats stats = runner.sim().take_stats();
  EXPECT_EQ(stats[EpisodeStat::episodes], 130);
  EXPECT_EQ(stats[EpisodeStat::length], 650);
  EXPECT_EQ(stats[EpisodeStat::ties], 130);
  EXPECT_EQ(stats[EpisodeStat::truncated], 130);
  EXPECT_EQ(stats[EpisodeStat::return_1], 325);         // 0.5 x 650
  EXPECT_EQ(stats[EpisodeStat::return_masked_1], 260);  // without each last step
  EXPECT_EQ(stats.term(1, RewardTerm::idle_reward), 325);
  EXPECT_EQ(stats.term(0, RewardTerm::idle_reward), 0);
  const EpisodeStats again = runner.sim().take_stats();
  for (const double row : again.rows) EXPECT_EQ(row, 0);
}

}  // namespace
}  // namespace giga::test
