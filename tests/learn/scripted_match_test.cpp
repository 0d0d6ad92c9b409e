// Scripted teams in the scenarios that come with gigastep: each does what it is there for. Measured values, of 512
// episodes, stand behind the limits; they are far enough apart that no seed of 64 episodes comes near.
#include <gtest/gtest.h>

#include "eval/match.hpp"
#include "learn/run_config.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"

namespace giga::test {
namespace {

constexpr int kEpisodes = 64;

MatchResult play(const std::string& scenario, Scripted side0, Scripted side1) {
  const SimSpec spec = compile(load_scenario(scenario, data_dirs()));
  return play_match(spec, script_controller(side0), script_controller(side1), {kEpisodes, 11, {}, 2});
}
double share(int count) { return static_cast<double>(count) / kEpisodes; }

TEST(LearnScripted, PursuerBeatsRandomAndCircle) {
  for (const std::string scenario : {"identical_2_vs_2", "identical_5_vs_5", "identical_5_vs_5_cont", "special_5_vs_5"})
    for (const Scripted opponent : {Scripted::random, Scripted::circle}) {
      const MatchResult r = play(scenario, Scripted::pursuer, opponent);  // 0.99 to 1
      EXPECT_GT(share(r.wins[0]), 0.9) << scenario << ", " << name_of(opponent);
      const MatchResult other = play(scenario, opponent, Scripted::pursuer);
      EXPECT_GT(share(other.wins[1]), 0.9) << scenario << ", " << name_of(opponent);
    }
}

TEST(LearnScripted, PursuerShootsCirclesDown) {
  const MatchResult r = play("identical_5_vs_5", Scripted::pursuer, Scripted::circle);
  EXPECT_GT(r.mean_deaths[1][0], 4.6);  // 4.87 of 5 by damage
  EXPECT_GT(r.mean_survivors[0], 4.6);  // 4.86
}

TEST(LearnScripted, EvaderAndHiderOutliveCirclesAgainstPursuers) {
  // Steps until all are gone: circle 70, evader 137, hider 92; identical_5_vs_5_published: 40, 59.
  const double circle = play("hide_and_seek_5_vs_5", Scripted::pursuer, Scripted::circle).mean_length;
  EXPECT_GT(play("hide_and_seek_5_vs_5", Scripted::pursuer, Scripted::evader).mean_length, 1.4 * circle);
  EXPECT_GT(play("hide_and_seek_5_vs_5", Scripted::pursuer, Scripted::hider).mean_length, 1.1 * circle);
  EXPECT_GT(play("identical_5_vs_5_published", Scripted::pursuer, Scripted::evader).mean_length,
            1.2 * play("identical_5_vs_5_published", Scripted::pursuer, Scripted::circle).mean_length);
}

TEST(LearnScripted, WaypointRunnerCollectsAndWins) {
  const MatchResult r = play("waypoint_5_vs_5", Scripted::waypoint_runner, Scripted::random);
  EXPECT_GT(r.mean_score[0], 8);     // 10.6
  EXPECT_LT(r.mean_score[1], 1);     // 0.1
  EXPECT_GT(share(r.wins[0]), 0.9);  // 1
  const MatchResult other = play("waypoint_5_vs_5", Scripted::circle, Scripted::waypoint_runner);
  EXPECT_GT(other.mean_score[1], 8);     // 10.3
  EXPECT_GT(share(other.wins[1]), 0.9);  // 1; all ties by elimination, where nobody dies
}

TEST(LearnScripted, HidersWinAtTheTimeLimit) {
  EXPECT_GT(share(play("hide_and_seek_5_vs_5", Scripted::circle, Scripted::hider).wins[1]), 0.9);   // 1, by the limit
  EXPECT_GT(share(play("hide_and_seek_5_vs_5", Scripted::pursuer, Scripted::hider).wins[0]), 0.9);  // 1
}

TEST(LearnScripted, PatrollerShootsWhatItMeets) {
  EXPECT_GT(share(play("identical_5_vs_5", Scripted::patroller, Scripted::circle).wins[0]), 0.5);  // 0.74
}

TEST(LearnScripted, NobodyFliesIntoWallsOrObstacles) {
  // Maps with obstacles, 500 steps. Who starts inside an obstacle or too close to one has no way out.
  for (const Scripted script :
       {Scripted::evader, Scripted::waypoint_runner, Scripted::hider, Scripted::patroller, Scripted::pursuer}) {
    const MatchResult r = play("identical_5_vs_5", script, Scripted::circle);
    EXPECT_LT(r.mean_deaths[0][2], 0.15) << name_of(script);  // 0.02 of 5
    EXPECT_LT(r.mean_deaths[0][3], 0.05) << name_of(script);  // 0
    EXPECT_LT(r.mean_deaths[0][1], 0.5) << name_of(script);   // 0.02 to 0.15
  }
}

TEST(LearnScripted, SurvivorsAndDeathsAddUpToTheTeam) {
  for (const std::string scenario : {"special_5_vs_5", "identical_5_vs_3"}) {
    const SimSpec spec = compile(load_scenario(scenario, data_dirs()));
    const MatchResult r = play(scenario, Scripted::random, Scripted::pursuer);
    for (int side = 0; side < kNTeams; ++side) {
      double sum = r.mean_survivors[side];
      for (const double deaths : r.mean_deaths[side]) sum += deaths;
      EXPECT_NEAR(sum, spec.params.n_team[side], 1e-9) << scenario << ", side " << side;
    }
  }
}

}  // namespace
}  // namespace giga::test
