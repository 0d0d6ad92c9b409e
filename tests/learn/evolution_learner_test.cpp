// Evolution of two teams: who evolves against whom, determinism, saving and going on, and a game that is learned.
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/state_hash.hpp"
#include "io/temporary_folder.hpp"
#include "learn/evolution/opponents.hpp"
#include "runs.hpp"
#include "scripted/script.hpp"

namespace giga::test {
namespace {

/// Eight members of two episodes each, unless `population` says otherwise; further lines of the config in `more`.
SmallRun evolution(const std::string& algorithm, const std::string& population = "", const std::string& more = "",
                   const std::string& scenario = "") {
  SmallRun run;
  run.train = "algorithm: " + algorithm;
  run.n_threads = 1;  // so little work that threads only wait for each other
  const bool episodes = population.find("episodes_per_member") != std::string::npos;
  const bool actor = population.find("actor") != std::string::npos;
  run.more = cat("population: {population_size: 8", actor ? "" : ", actor: {hidden: [8, 8]}",
                 episodes ? "" : ", episodes_per_member: 2", population.empty() ? "" : ", ", population, "}\n", more);
  run.scenario = scenario;
  return run;
}

struct EvolutionVariant {
  const char* name;
  SmallRun run;
};
void PrintTo(const EvolutionVariant& v, std::ostream* out) { *out << v.name; }
SmallRun with_train(SmallRun run, const std::string& keys) {
  run.train += ", " + keys;
  return run;
}
const EvolutionVariant kEvolutionVariants[] = {
    {"OpenAi", evolution("openai_es")},
    {"OpenAiPoolLowRankSampled",
     evolution("openai_es", "noise: low_rank, noise_rank: 2, greedy: false, shaping: {kind: z_score}",
               "opponents: {pool_size: 3, pool_every_updates: 1, pool_share: 0.5, scripted: [pursuer], scripted_share: "
               "0.5}\nopenai_es: {optimizer: clip_up}\n")},
    {"SnesAlternatingWinRate",
     evolution("snes", "turns: alternating, objective: win_rate, antithetic: false, common_random_numbers: false")},
    {"DesContinuousDecay", evolution("des", "shaping: {weight_decay: 0.1}, greedy: false", "", "action: continuous\n")},
    {"SnesScoreWaypoints", evolution("snes", "objective: score, max_steps: 20", "",
                                     "waypoints: {enable_waypoints: true}\nmaps: four_rooms\n")},
    {"DesRounds", evolution("des", "episodes_per_member: 6, parallel_episodes: 2, max_steps: 30, greedy: false")},
    {"SnesGruPool", evolution("snes", "actor: {hidden: [8], memory: gru, memory_size: 6}",
                              "opponents: {pool_size: 3, pool_every_updates: 1, pool_share: 0.5}\n")},
    {"OpenAiPoolAndScripts",
     evolution("openai_es", "episodes_per_member: 4, actor: {hidden: [8], inputs: egocentric}",
               "opponents: {pool_size: 3, pool_every_updates: 1, pool_share: 0.25, scripted: [circle], scripted_share: "
               "0.25}\n",
               "observation: {egocentric_view: true}\n")},
    {"OpenAiTeamOneAgainstCircle", with_train(evolution("openai_es"), "opponent: circle, learning_team: 1")},
};

class LearnEvolutionLearner : public testing::TestWithParam<EvolutionVariant> {};

TEST_P(LearnEvolutionLearner, SaveLoadAndGoOnEqualsGoingOn) {
  const auto learner = GetParam().run.learner();
  for (int u = 0; u < 3; ++u) learner->update();
  const NamedArrays checkpoint = saved(*learner);
  expect_finite(checkpoint);
  const auto loaded = GetParam().run.learner();
  loaded->update();  // whatever it did before must not matter
  loaded->load(checkpoint);
  EXPECT_EQ(loaded->updates_done(), 3);
  EXPECT_EQ(difference(saved(*loaded), checkpoint), "");
  for (int u = 0; u < 3; ++u) {
    const Metrics expected = learner->update(), actual = loaded->update();
    EXPECT_EQ(difference(expected, actual), "") << "generation " << u << " after loading";
    ASSERT_EQ(difference(saved(*learner), saved(*loaded)), "") << "generation " << u << " after loading";
  }
  EXPECT_FALSE(learner->divergence().has_value());
}

// Disturbed, a field makes what comes after another run. The actors are the means once more, for those who play them.
TEST_P(LearnEvolutionLearner, EachSavedFieldMatters) {
  const auto learner = GetParam().run.learner();
  for (int u = 0; u < 4; ++u) learner->update();
  const NamedArrays checkpoint = saved(*learner);
  const auto after = [&](const NamedArrays& arrays) {
    learner->load(arrays);
    for (int u = 0; u < 2; ++u) learner->update();
    return state_sha256(saved(*learner));
  };
  const std::string undisturbed = after(checkpoint);
  EXPECT_EQ(after(checkpoint), undisturbed);
  for (size_t k = 0; k < checkpoint.size(); ++k) {
    if (checkpoint[k].name.find("/actor/") != std::string::npos) continue;
    NamedArrays disturbed = checkpoint;
    disturb(disturbed[k]);
    EXPECT_NE(after(disturbed), undisturbed) << checkpoint[k].name << " makes no difference";
  }
}

INSTANTIATE_TEST_SUITE_P(All, LearnEvolutionLearner, testing::ValuesIn(kEvolutionVariants),
                         [](const auto& variant) { return std::string(variant.param.name); });

// A policy with memory, of MAPPO, is the opponent of all members.
void expect_learning_against_a_policy(Device device, const std::string& precision) {
  const TemporaryFolder folder;
  const std::string frozen = (folder.path() / "frozen.h5").string();
  SmallRun other;
  other.actor = "hidden: [8], memory: gru, memory_size: 6";
  save(other, frozen);
  SmallRun run = with_train(evolution("snes"), cat("learning_team: 1, opponent: '", frozen, "'"));
  run.precision = precision;
  const auto learner = run.learner(device);
  EXPECT_EQ(learner->actor(0), nullptr);
  EXPECT_NE(learner->opponent(), nullptr);
  const NamedArrays before = saved(*learner);
  const Metrics metrics = learner->update();
  EXPECT_TRUE(std::isfinite(metric(metrics, "fitness_mean_1")));
  EXPECT_TRUE(std::isnan(metric(metrics, "fitness_mean_0")));
  const NamedArrays after = saved(*learner);
  EXPECT_NE(difference(before, after).find("team_1/"), std::string::npos);

  const auto loaded = run.learner(device);
  loaded->load(after);
  EXPECT_EQ(difference(learner->update(), loaded->update()), "");
  EXPECT_EQ(difference(saved(*learner), saved(*loaded)), "");
  // A run goes on against the same policy only.
  save(SmallRun{}, frozen, 7);
  EXPECT_THROW(run.learner(device)->load(after), InputError);
}

TEST(LearnEvolutionTeams, APolicyMayBeTheOpponent) { expect_learning_against_a_policy({}, "fp32"); }

TEST(LearnEvolutionLearnerGpu, APolicyMayBeTheOpponent) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  for (const char* precision : {"fp16", "fp32"}) expect_learning_against_a_policy({Device::Kind::cuda, 0}, precision);
}

TEST(LearnEvolutionTeams, AlternatingTeamsTakeTurns) {
  const auto learner = evolution("snes", "turns: alternating, generations_per_turn: 2, objective: win_rate").learner();
  for (int u = 0; u < 6; ++u) {
    const NamedArrays before = saved(*learner);
    const Metrics metrics = learner->update();
    const std::string changed = difference(before, saved(*learner));
    const int evolves = u / 2 % 2;
    EXPECT_NE(changed.find(cat("team_", evolves, "/strategy/mean")), std::string::npos) << u << ": " << changed;
    EXPECT_EQ(changed.find(cat("team_", 1 - evolves)), std::string::npos) << u << ": " << changed;
    EXPECT_TRUE(std::isnan(metric(metrics, cat("fitness_mean_", 1 - evolves))));
    EXPECT_EQ(metric(metrics, "episodes"), 16);
  }
}

// Team 0 evolves in generations 0 to 3, team 1 in the next four; both pools are asked after every second one. While
// team 1 evolves, team 0 has nothing new: copies of its mean would push out what it was before.
TEST(LearnEvolutionTeams, APoolTakesInNobodyWhoHasNotEvolved) {
  const auto learner = evolution("snes", "turns: alternating, generations_per_turn: 4",
                                 "opponents: {pool_size: 3, pool_every_updates: 2, pool_share: 0.5}\n")
                           .learner();
  for (int u = 0; u < 8; ++u) {
    const NamedArrays before = saved(*learner);
    learner->update();
    const std::string changed = difference(before, saved(*learner));
    const int evolves = u / 4;
    EXPECT_EQ(changed.find(cat("team_", 1 - evolves, "/pool/kept")), std::string::npos) << u << ": " << changed;
    EXPECT_EQ(changed.find(cat("team_", evolves, "/pool/kept")) != std::string::npos, u % 2 == 1)
        << u << ": " << changed;
  }
}

TEST(LearnEvolutionTeams, MetricsCountWhatWasPlayed) {
  const auto learner = evolution("openai_es").learner();
  const Metrics metrics = learner->update();
  EXPECT_EQ(metric(metrics, "episodes"), 32);  // 2 teams x 8 members x 2 episodes
  const double length = metric(metrics, "episode_length");
  EXPECT_EQ(learner->agent_steps_done(), std::llround(32 * length * 4));
  double decided = 0;  // episodes
  for (int team = 0; team < 2; ++team) {
    const auto m = [&](const char* name) { return metric(metrics, cat(name, "_", team)); };
    for (const char* rate : {"win_rate", "loss_rate"}) {
      const double games = 16 * m(rate);
      EXPECT_NEAR(games, std::round(games), 1e-9) << rate;
      EXPECT_GE(games, 0) << rate;
      decided += games;
    }
    EXPECT_GE(m("fitness_best"), m("fitness_mean"));
    EXPECT_EQ(m("not_finite"), 0);
    EXPECT_NEAR(m("fitness_mean"), m("return"), 1e-4);  // the objective is the return
    EXPECT_GT(m("step_norm"), 0);
  }
  EXPECT_GT(decided, 0);
  EXPECT_NEAR(decided + 32 * metric(metrics, "tie_rate"), 32, 1e-9);  // each episode is won, lost or tied
}

// Six episodes of a member, two at a time: means over all six.
TEST(LearnEvolutionTeams, EpisodesOneAfterTheOther) {
  const auto learner = evolution("snes", "episodes_per_member: 6, parallel_episodes: 2, max_steps: 30",
                                 "opponents: {scripted_share: 0.5}\n")
                           .learner();
  const Metrics metrics = learner->update();
  EXPECT_EQ(metric(metrics, "episodes"), 96);  // 2 teams x 8 members x 6 episodes
  EXPECT_LE(metric(metrics, "episode_length"), 30);
  for (int team = 0; team < 2; ++team) {
    EXPECT_NEAR(metric(metrics, cat("fitness_mean_", team)), metric(metrics, cat("return_", team)), 1e-4);
    const double wins = 24 * metric(metrics, cat("scripted_win_rate_", team));  // half of the worlds, 8 x 3 episodes
    EXPECT_NEAR(wins, std::round(wins), 1e-9);
  }
}

TEST(LearnEvolutionOpponents, GamesAgainstThePoolAreNoted) {
  // 8 members x 2 episodes: one of them against a script, one against the pool once it holds something.
  const auto learner = evolution("snes", "",
                                 "opponents: {pool_size: 2, pool_every_updates: 2, pool_share: 0.5, pool_draw: pfsp, "
                                 "scripted_share: 0.5}\n")
                           .learner();
  const auto games = [&](int team) {
    return array_values<double>(find_array(saved(*learner), cat("team_", team, "/pool/games")));
  };
  for (int u = 0; u < 3; ++u) {
    const Metrics metrics = learner->update();
    for (int team = 0; team < 2; ++team) {
      EXPECT_EQ(std::isnan(metric(metrics, cat("pool_win_rate_", team))), u < 2) << "generation " << u;
      // Eight episodes against the script.
      const double wins = 8 * metric(metrics, cat("scripted_win_rate_", team));
      EXPECT_NEAR(wins, std::round(wins), 1e-9);
      EXPECT_EQ(games(team), (std::vector<double>{u < 2 ? 0.0 : 8.0, 0})) << "generation " << u;
    }
  }
  EXPECT_EQ(learner->headline().back().metric, std::string("scripted_win_rate"));
}

TEST(LearnEvolutionOpponents, SharesOfTheEpisodes) {
  OpponentsConfig c;
  c.pool_share = 0.5;
  c.scripted = {Scripted::circle, Scripted::pursuer};
  c.scripted_share = 0.25;
  const int32_t circle = network_of_script(Scripted::circle), pursuer = network_of_script(Scripted::pursuer);
  // Without a pool yet: 4 of 16 episodes against scripts in turn, the rest against the mean.
  std::vector<int32_t> expected = {circle, pursuer, circle, pursuer};
  expected.resize(16, 0);
  EXPECT_EQ(assign_opponents(c, 16, {}, {1, 0, 0}, 0), expected);
  // With five past means: 8 episodes draw rows 1 to 5.
  std::array<int, 6> drawn{};
  const std::vector<double> alike(5, 1.0);
  for (uint32_t generation = 0; generation < 500; ++generation) {
    const std::vector<int32_t> opponents = assign_opponents(c, 16, alike, {1, generation, 0}, generation);
    for (size_t e = 0; e < 4; ++e) EXPECT_EQ(opponents[e], expected[e]);
    for (size_t e = 4; e < 12; ++e) ++drawn.at(static_cast<size_t>(opponents[e]));
    for (size_t e = 12; e < 16; ++e) EXPECT_EQ(opponents[e], 0);
  }
  EXPECT_EQ(drawn[0], 0);
  for (size_t k = 1; k < 6; ++k) EXPECT_NEAR(drawn[k], 800, 4 * 26);  // of 4,000; deviation sqrt(4000 x 0.2 x 0.8) = 25
  EXPECT_NE(assign_opponents(c, 16, alike, {1, 1, 0}, 1), assign_opponents(c, 16, alike, {1, 1, 1}, 1))
      << "teams draw apart";
}

TEST(LearnEvolutionOpponents, EachScriptHasItsTurn) {
  OpponentsConfig c;
  c.scripted = {Scripted::patroller, Scripted::hider, Scripted::evader};
  c.scripted_share = 0.5;
  // Two of four episodes against three scripts: numbers 0 and 1, then 2 and 0, then 1 and 2, then from the start.
  const std::array<std::array<Scripted, 2>, 4> expected = {{{Scripted::patroller, Scripted::hider},
                                                            {Scripted::evader, Scripted::patroller},
                                                            {Scripted::hider, Scripted::evader},
                                                            {Scripted::patroller, Scripted::hider}}};
  for (uint32_t generation = 0; generation < expected.size(); ++generation) {
    const auto& [first, second] = expected.at(generation);
    EXPECT_EQ(assign_opponents(c, 4, {}, {1, generation, 0}, generation),
              (std::vector<int32_t>{network_of_script(first), network_of_script(second), 0, 0}))
        << "generation " << generation;
  }
}

TEST(LearnEvolutionOpponents, ATeamCountsItsOwnGenerations) {
  PopulationConfig c;
  for (int team = 0; team < kNTeams; ++team) EXPECT_EQ(generations_of(c, team, 7), 7) << "together";
  c.turns = Turns::alternating;
  c.generations_per_turn = 2;  // team 0 plays generations 0, 1, 4, 5, ...; team 1 plays 2, 3, 6, 7, ...
  const int64_t expected[kNTeams][9] = {{0, 1, 2, 2, 2, 3, 4, 4, 4}, {0, 0, 0, 1, 2, 2, 2, 3, 4}};
  for (int team = 0; team < kNTeams; ++team)
    for (int64_t g = 0; g < 9; ++g) EXPECT_EQ(generations_of(c, team, g), expected[team][g]) << team << ", " << g;
  c.generations_per_turn = 1;
  EXPECT_EQ(generations_of(c, 0, 1'000'001), 500'001);
  EXPECT_EQ(generations_of(c, 1, 1'000'001), 500'000);
}

TEST(LearnEvolutionObjective, IsTheScoreWhereTheGameIsWonByWaypoints) {
  // Large waypoints, so that some are reached.
  const std::string waypoints = "waypoints: {enable_waypoints: true, waypoint_size: 6}\nmaps: empty\n";
  for (const char* win : {"waypoints", "elimination"}) {
    const auto learner =
        evolution("openai_es", "max_steps: 100", "", cat(waypoints, "win: {by: ", win, "}\n")).learner();
    const Metrics metrics = learner->update();
    for (int team = 0; team < kNTeams; ++team) {
      const auto m = [&](const char* name) { return metric(metrics, cat(name, "_", team)); };
      EXPECT_GT(m("score"), 0) << win;
      EXPECT_GT(std::fabs(m("return") - m("score")), 0.1) << win;
      EXPECT_NEAR(m("fitness_mean"), m(std::string_view(win) == "waypoints" ? "score" : "return"), 1e-4) << win;
    }
  }
}

// On an empty map where nobody shoots, whoever stays inside longest wins; the opponent flies straight on and is out
// after at most 70 steps. A team that learns to turn wins every episode.
TEST(LearnEvolutionGame, ATeamLearnsToStayInside) {
  for (const char* algorithm : {"openai_es", "snes", "des"}) {
    SmallRun run = evolution(algorithm, "", "openai_es: {learning_rate: 0.1}\n",
                             "damage: {damage_cone_depth: 0}\ncollision: {collision_range: 0}\nlimit_x: 10\nlimit_y: "
                             "10\nmax_episode_length: 120\n");
    run.train += ", opponent: noop";
    run.more =
        "population: {population_size: 32, episodes_per_member: 4, objective: win_rate, sigma_init: "
        "0.1, actor: {hidden: [8]}}\nopenai_es: {learning_rate: 0.05}\n";
    const auto learner = run.learner();
    const double before = metric(learner->update(), "fitness_mean_0");
    double after = 0;
    for (int u = 0; u < 59; ++u) after = metric(learner->update(), "fitness_mean_0");
    EXPECT_LT(before, 0.8) << algorithm;
    EXPECT_GT(after, 0.95) << algorithm;
  }
}

// Two generations of episodes of up to 30 steps have drawn in 2 x (30 + 2) steps, and one of 14 draws in the 16 behind
// them. A checkpoint of before that was noted: as if all had been of 14.
TEST(LearnEvolutionDraws, NeverComeAgainWhereEpisodesBecomeShorter) {
  const auto learner = evolution("snes", "max_steps: 30").learner(),
             shorter = evolution("snes", "max_steps: 14").learner();
  for (int u = 0; u < 2; ++u) learner->update();
  NamedArrays checkpoint = saved(*learner);
  const auto next = [](const NamedArrays& arrays) {
    return array_values<int64_t>(find_array(arrays, "next_draws")).at(0);
  };
  EXPECT_EQ(next(checkpoint), 64);
  shorter->load(checkpoint);
  shorter->update();
  EXPECT_EQ(next(saved(*shorter)), 80);
  std::erase_if(checkpoint, [](const NamedArray& array) { return array.name == "next_draws"; });
  shorter->load(checkpoint);
  shorter->update();
  EXPECT_EQ(next(saved(*shorter)), 48);
}

// Whatever the precision, which is for the GPU.
TEST(LearnEvolutionPrecision, TheCpuComputesInFp32) {
  SmallRun run = kEvolutionVariants[0].run;
  run.precision = "fp32";
  const auto expected = run.learner();
  expected->update();
  for (const char* precision : {"fp16", "tf32", "bf16"}) {
    run.precision = precision;
    const auto learner = run.learner();
    learner->update();
    EXPECT_EQ(difference(saved(*learner), saved(*expected)), "") << precision;
  }
}

TEST(LearnEvolutionLearnerGpu, GoingOnIsBitForBit) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  for (const EvolutionVariant& variant : kEvolutionVariants) {
    for (const char* precision : {"fp16", "tf32", "fp32"}) {  // fused, and through LibTorch
      SCOPED_TRACE(cat(variant.name, ", ", precision));
      // The kernel that computes fp16 knows no memory.
      if (std::string_view(variant.name) == "SnesGruPool" && std::string_view(precision) == "fp16") continue;
      SmallRun run = variant.run;
      run.precision = precision;
      const auto learner = run.learner(gpu), loaded = run.learner(gpu);
      for (int u = 0; u < 3; ++u) learner->update();
      const NamedArrays checkpoint = saved(*learner);
      expect_finite(checkpoint);
      loaded->load(checkpoint);
      for (int u = 0; u < 2; ++u) EXPECT_EQ(difference(learner->update(), loaded->update()), "");
      EXPECT_EQ(difference(saved(*learner), saved(*loaded)), "");
    }
  }
}

// hidden [200] on 106 numbers: min(200, 106) = 106. A GRU of 64: its gates' matrices are [3 x 64, 200] and [3 x 64,
// 64].
TEST(LearnEvolutionConfig, ACellsMatricesBoundTheRankToo) {
  const auto load = [](int rank) {
    return load_run_config_text(
        cat("train: {algorithm: openai_es, precision: tf32}\npopulation: {noise: low_rank, noise_rank: ", rank,
            ", actor: {hidden: [200], memory: gru, memory_size: 64}}\n"),
        "base: identical_5_vs_5\n");
  };
  EXPECT_NO_THROW(load(192));
  EXPECT_TRUE(contains(input_error_of([&] { load(193); }), {"population.noise_rank: 193", "at most 192"}));
}

}  // namespace
}  // namespace giga::test
