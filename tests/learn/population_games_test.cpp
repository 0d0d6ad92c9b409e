// The episodes of a generation: what a population plays is what a match of the same networks would be; the fused kernel
// does what LibTorch does.
#include "rollout/population_games.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "cuda/runtime.hpp"
#include "eval/match.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"
#include "runs.hpp"
#include "scripted/script.hpp"

namespace giga::test {
namespace {

/// Members and opponents of networks with weights of their own, all well away from zero.
struct Networks {
  Actor actor;
  at::Tensor members;    // [M, P]
  at::Tensor opponents;  // [3, P]

  Networks(const LoadedRun& run, int64_t n_members, Device device, Precision precision = Precision::fp32)
      : actor(run.config.population.actor, input_columns(run.config.population.actor.inputs, run.spec),
              run.spec.params.actions, false, precision, torch_device(device), 1) {
    const int64_t p = actor.parameters().size();
    const at::Generator generator = at::detail::createCPUGenerator(5);
    const at::Tensor noise = at::randn({n_members + 3, p}, generator).to(torch_device(device));
    const at::Tensor all = actor.parameters().values().detach() + 0.3 * noise;
    members = all.narrow(0, 0, n_members).contiguous();
    opponents = all.narrow(0, n_members, 3).contiguous();
  }
  void take(const at::Tensor& parameters) {
    at::NoGradGuard no_grad;
    actor.parameters().values().copy_(parameters);
  }
};

LoadedRun run_of(const std::string& scenario = "", const std::string& actor = "hidden: [16, 16]") {
  SmallRun small;
  small.scenario = scenario;
  small.more = cat("population: {actor: {", actor, "}}\n");
  return small.load();
}

double stat(const at::Tensor& results, EpisodeStat s) {
  return results.select(2, static_cast<int64_t>(s)).sum().item<double>();
}

// The same network as every member, without common random numbers: world w of the games is world w of a match.
void expect_the_match_of_that_network(Device device, Precision precision, const std::string& scenario, int n_worlds) {
  constexpr int kMembers = 6;
  for (const bool greedy : {false, true}) {
    for (const int team : {0, 1}) {
      const LoadedRun run = run_of(scenario);
      Networks n(run, 1, device, precision);
      Networks other(run, 1, device, precision);
      other.take(n.opponents[1]);
      n.take(n.members[0]);
      const ParallelFor parallel_for(device, 1, current_stream(device));
      PopulationGames games(run.spec, {kMembers, n_worlds, 1, false, greedy, 9, 1}, n.actor, parallel_for);
      games.play({{team, n.members.expand({kMembers, -1}).contiguous(), n.opponents,
                   std::vector<int32_t>(static_cast<size_t>(n_worlds), 1)}},
                 0);

      auto own = policy_controller(n.actor, greedy), opponent = policy_controller(other.actor, greedy);
      if (team == 1) std::swap(own, opponent);
      const int episodes = kMembers * n_worlds;
      const MatchResult match = play_match(run.spec, std::move(own), std::move(opponent), {episodes, 9, device, 1});
      const at::Tensor results = games.results(0);
      EXPECT_EQ(stat(results, EpisodeStat::episodes), episodes);
      EXPECT_EQ(stat(results, EpisodeStat::wins_0), match.wins[0]);
      EXPECT_EQ(stat(results, EpisodeStat::wins_1), match.wins[1]);
      EXPECT_EQ(stat(results, EpisodeStat::length) / episodes, match.mean_length);
      EXPECT_NEAR(stat(results, EpisodeStat::return_0) / episodes, match.mean_return[0], 1e-5);
    }
  }
}

TEST(LearnPopulationGames, APopulationOfOneNetworkPlaysTheMatchOfThatNetwork) {
  for (const char* action : {"discrete", "continuous"})
    expect_the_match_of_that_network({}, Precision::fp32, cat("action: ", action, "\n"), 4);
}

// A match of fp16 is played by the kernel that plays populations.
TEST(LearnPopulationGamesGpu, APopulationOfOneNetworkPlaysTheMatchOfThatNetwork) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  for (const char* action : {"discrete", "continuous"})
    expect_the_match_of_that_network({Device::Kind::cuda, 0}, Precision::fp16, cat("action: ", action, "\n"), 67);
}

// A policy of another shape, which a controller of its own moves: as above.
void expect_the_match_against_that_policy(Device device, Precision precision, const std::string& opponent_actor,
                                          Precision of_opponent = Precision::fp32,
                                          const std::string& own_actor = "hidden: [16, 16]") {
  constexpr int kMembers = 6, kWorlds = 5;
  for (const bool common : {false, true}) {
    for (const int team : {0, 1}) {
      const LoadedRun run = run_of("", own_actor);
      Networks n(run, 1, device, precision), other(run_of("", opponent_actor), 1, device, of_opponent);
      ASSERT_NE(other.members.size(1), n.members.size(1));
      n.take(n.members[0]);
      other.take(other.members[0]);
      const ParallelFor parallel_for(device, 1, current_stream(device));
      PopulationGamesOptions options{kMembers, kWorlds, 1, common, false, 9, 1};
      options.opponent = policy_controller(other.actor);
      options.opponent_team = 1 - team;
      PopulationGames games(run.spec, options, n.actor, parallel_for);
      const Population population{team, n.members.expand({kMembers, -1}).contiguous(), n.opponents,
                                  std::vector<int32_t>(kWorlds, 0)};
      games.play({population}, 0);

      // With common luck all members play the match of the first one's worlds.
      const int episodes = common ? kWorlds : kMembers * kWorlds, times = kMembers * kWorlds / episodes;
      auto own = policy_controller(n.actor), opponent = policy_controller(other.actor);
      if (team == 1) std::swap(own, opponent);
      const MatchResult match = play_match(run.spec, std::move(own), std::move(opponent), {episodes, 9, device, 1});
      const at::Tensor results = games.results(0);
      EXPECT_EQ(stat(results, EpisodeStat::wins_0), times * match.wins[0]);
      EXPECT_EQ(stat(results, EpisodeStat::wins_1), times * match.wins[1]);
      EXPECT_EQ(stat(results, EpisodeStat::length) / (kMembers * kWorlds), match.mean_length);
      EXPECT_GT(match.wins[0] + match.wins[1], 0);
    }
  }
}

TEST(LearnPopulationGames, APolicyOfAnotherShapeIsPlayedAsInAMatch) {
  expect_the_match_against_that_policy({}, Precision::fp32, "hidden: [8]");
  const std::string remembers = "hidden: [8], memory: gru, memory_size: 6";
  expect_the_match_against_that_policy({}, Precision::fp32, remembers);
  expect_the_match_against_that_policy({}, Precision::fp32, "hidden: [8]", Precision::fp32, remembers);
}

TEST(LearnPopulationGamesGpu, APolicyOfAnotherShapeIsPlayedAsInAMatch) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  for (const Precision precision : {Precision::fp16, Precision::fp32}) {
    // Two kernels, which are recorded side by side.
    for (const Precision of_opponent : {Precision::tf32, Precision::fp16})
      expect_the_match_against_that_policy(gpu, precision, "hidden: [64, 64]", of_opponent);
    expect_the_match_against_that_policy(gpu, precision, "hidden: [8]");
    expect_the_match_against_that_policy(gpu, precision, "hidden: [8], layer_norm: true");
    expect_the_match_against_that_policy(gpu, precision, "hidden: [8], memory: gru, memory_size: 6");
  }
}

TEST(LearnPopulationGames, ScriptsArePlayedAsInAMatch) {
  const LoadedRun run = run_of();
  Networks n(run, 1, {});
  n.take(n.members[0]);
  const ParallelFor parallel_for(Device{}, 1);
  PopulationGames games(run.spec, {8, 2, 1, false, false, 9, 1}, n.actor, parallel_for);
  const int32_t circle = network_of_script(Scripted::circle);
  games.play({{1, n.members.expand({8, -1}).contiguous(), n.opponents, {circle, circle}}}, 0);
  const MatchResult match =
      play_match(run.spec, script_controller(Scripted::circle), policy_controller(n.actor), {16, 9, Device{}, 1});
  EXPECT_EQ(stat(games.results(0), EpisodeStat::wins_0), match.wins[0]);
  EXPECT_EQ(stat(games.results(0), EpisodeStat::length) / 16, match.mean_length);
}

// Networks that read the egocentric view alone, beside scripts that read the rest of the observation and those that do
// not.
TEST(LearnPopulationGames, NetworksOfEgocentricViewsMeetScriptsThatLook) {
  const LoadedRun run =
      run_of("maps: two_rooms1\nobservation: {egocentric_view: true}\n", "hidden: [16, 16], inputs: egocentric");
  Networks n(run, 1, {});
  n.take(n.members[0]);
  const ParallelFor parallel_for(Device{}, 1);
  PopulationGames games(run.spec, {8, 2, 1, false, false, 9, 1}, n.actor, parallel_for);
  for (const Scripted script : {Scripted::circle, Scripted::pursuer, Scripted::circle}) {
    const int32_t id = network_of_script(script);
    games.play({{0, n.members.expand({8, -1}).contiguous(), n.opponents, {id, id}}}, 0);
    const MatchResult match =
        play_match(run.spec, policy_controller(n.actor), script_controller(script), {16, 9, Device{}, 1});
    EXPECT_EQ(stat(games.results(0), EpisodeStat::wins_0), match.wins[0]) << name_of(script);
    EXPECT_EQ(stat(games.results(0), EpisodeStat::length) / 16, match.mean_length) << name_of(script);
  }
}

// With common luck the first episodes of two games begin alike, whoever is met in the others: each is played as where
// all meet its opponent. Networks read the view, pursuer the rest, noop nothing: each world has what its player reads.
void expect_each_episode_as_where_all_meet_its_opponent(Device device, Precision precision) {
  const LoadedRun run =
      run_of("maps: two_rooms1\nobservation: {egocentric_view: true}\n", "hidden: [16, 16], inputs: egocentric");
  Networks n(run, 4, device, precision);
  const ParallelFor parallel_for(device, 1, current_stream(device));
  PopulationGames games(run.spec, {4, 3, 2, true, false, 9, 1}, n.actor, parallel_for);
  const auto play = [&](const std::vector<int32_t>& opponents) {
    const Population first{0, n.members, n.opponents, opponents}, second{1, n.members, n.opponents, opponents};
    games.play({first, second}, 3);
    return std::array{games.results(0).clone(), games.results(1).clone()};
  };
  const std::vector<int32_t> opponents = {network_of_script(Scripted::pursuer), 0, network_of_script(Scripted::noop)};
  const auto mixed = play(opponents);
  for (size_t e = 0; e < opponents.size(); ++e) {
    const auto alike = play({opponents[e], opponents[e], opponents[e]});
    for (const size_t k : {0, 1}) {
      EXPECT_TRUE(at::equal(mixed[k].select(1, static_cast<int64_t>(e)), alike[k].select(1, static_cast<int64_t>(e))))
          << "population " << k << ", episode " << e;
    }
  }
  EXPECT_FALSE(at::equal(mixed[0].select(1, 0), mixed[0].select(1, 1)));
}

TEST(LearnPopulationGames, EachEpisodeIsPlayedAsWhereAllMeetItsOpponent) {
  expect_each_episode_as_where_all_meet_its_opponent({}, Precision::fp32);
}

TEST(LearnPopulationGamesGpu, EachEpisodeIsPlayedAsWhereAllMeetItsOpponent) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  expect_each_episode_as_where_all_meet_its_opponent({Device::Kind::cuda, 0}, Precision::fp16);
}

// Nobody dies in a world of 60 x 60 in 30 steps. A cut is not the scenario's own time limit: nobody wins by living.
TEST(LearnPopulationGames, WhoHidesWinsAtTheTimeLimitAndNotAtACut) {
  const LoadedRun run = run_of(
      "limit_x: 60\nlimit_y: 60\nmax_episode_length: 30\ndamage: {damage_cone_depth: 0}\n"
      "collision: {collision_range: 0}\nwin: {at_time_limit: team_1}\n");
  Networks n(run, 4, {});
  const ParallelFor parallel_for(Device{}, 1);
  for (const std::optional<int> max_steps : {std::optional<int>(), std::optional<int>(20), std::optional<int>(40)}) {
    PopulationGamesOptions options{4, 2, 1, true, true, 9, 1};
    options.max_steps = max_steps;
    PopulationGames games(run.spec, options, n.actor, parallel_for);
    games.play({{0, n.members, n.opponents, {0, 1}}}, 0);
    const bool cut = max_steps == 20;
    EXPECT_EQ(stat(games.results(0), EpisodeStat::wins_1), cut ? 0 : 8);
    EXPECT_EQ(stat(games.results(0), EpisodeStat::ties), cut ? 8 : 0);
    EXPECT_EQ(stat(games.results(0), EpisodeStat::length), 8 * (cut ? 20 : 30));
  }
}

// With common random numbers two equal members have equal episodes, and only those.
TEST(LearnPopulationGames, CommonRandomNumbers) {
  const LoadedRun run = run_of();
  Networks n(run, 3, {});
  n.members[1].copy_(n.members[0]);
  const ParallelFor parallel_for(Device{}, 1);
  for (const bool common : {true, false}) {
    PopulationGames games(run.spec, {3, 8, 2, common, false, 9, 1}, n.actor, parallel_for);
    const Population population{0, n.members, n.opponents, {0, 1, 2, 0, 0, 1, 2, 2}};
    Population other = population;
    other.team = 1;
    games.play({population, other}, 3);
    for (const size_t k : {0, 1}) {
      const at::Tensor results = games.results(k);
      EXPECT_EQ(at::equal(results[0], results[1]), common) << "population " << k;
      EXPECT_FALSE(at::equal(results[0], results[2])) << "population " << k;
      EXPECT_TRUE(at::equal(results.select(2, 0), at::ones({3, 8}))) << "each world plays one episode";
    }
  }
}

// The second round of generation 0 draws what the only round of generation 1 does.
void expect_rounds_to_be_generations(const LoadedRun& run, const Networks& n, const ParallelFor& parallel_for) {
  const Population population{1, n.members, n.opponents, {0, 1, network_of_script(Scripted::circle_random), 2}};
  PopulationGames once(run.spec, {6, 4, 1, true, false, 9, 1}, n.actor, parallel_for);
  once.play({population}, 0);
  const at::Tensor first = once.results(0).clone();
  once.play({population}, once.draw_steps());
  PopulationGames twice(run.spec, {6, 4, 1, true, false, 9, 1, std::nullopt, 2}, n.actor, parallel_for);
  twice.play({population}, 0);
  EXPECT_EQ(twice.fused(), parallel_for.device().is_cuda() && n.actor.precision() == Precision::fp16);
  EXPECT_EQ(stat(twice.results(0), EpisodeStat::episodes), 48);
  EXPECT_TRUE(at::equal(twice.results(0), first + once.results(0)));
  EXPECT_FALSE(at::equal(first, once.results(0)));
}

TEST(LearnPopulationGames, AWorldPlaysSeveralEpisodes) {
  const LoadedRun run = run_of();
  for (const Precision precision : {Precision::fp32, Precision::fp16})
    expect_rounds_to_be_generations(run, Networks(run, 6, {}, precision), ParallelFor(Device{}, 2));
}

TEST(LearnPopulationGamesGpu, AWorldPlaysSeveralEpisodes) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const LoadedRun run = run_of();
  for (const Precision precision : {Precision::fp32, Precision::fp16})
    expect_rounds_to_be_generations(run, Networks(run, 6, gpu, precision), ParallelFor(gpu));
}

TEST(LearnPopulationGames, AGenerationIsRepeatableAndAnotherIsNot) {
  const LoadedRun run = run_of();
  Networks n(run, 4, {});
  const ParallelFor parallel_for(Device{}, 2);
  PopulationGames games(run.spec, {4, 4, 1, true, true, 9, 2}, n.actor, parallel_for);
  const auto played = [&](uint32_t generation) {
    games.play({{0, n.members, n.opponents, {0, 0, 1, 2}}}, generation * games.draw_steps());
    return games.results(0).clone();
  };
  const at::Tensor first = played(0), second = played(1);
  EXPECT_FALSE(at::equal(first, second));
  EXPECT_TRUE(at::equal(first, played(0)));
  EXPECT_TRUE(at::equal(second, played(1)));
}

/// Positions of all agents after some steps.
at::Tensor positions(const PopulationGames& games) {
  const Simulator& sim = games.simulator();
  const int64_t count = sim.agents_per_step();
  return at::cat({wrap(sim.state().view().x, {count}, sim.device()), wrap(sim.state().view().y, {count}, sim.device()),
                  wrap(sim.state().view().z, {count}, sim.device())})
      .cpu();
}

/// Share of numbers that are no further apart than agents come to be by rounding alone.
double share_near(const at::Tensor& a, const at::Tensor& b) {
  return ((a - b).abs() < 2e-3).to(at::kFloat).mean().item<double>();
}

// The networks of a population play alike in fp16 and in fp32, in which what was evolved is exported: the same luck,
// greedy, and nearly all agents are where they are in fp32 after some steps. The rest met two logits that are nearly
// equal.
TEST(LearnPopulationGames, HalfPrecisionPlaysAsFp32) {
  const LoadedRun run = run_of("", "hidden: [64, 64]");
  const Networks half(run, 60, {}, Precision::fp16), full(run, 60, {}, Precision::fp32);
  const ParallelFor parallel_for(Device{}, 2);
  const auto play = [&](const Networks& n) {
    PopulationGames games(run.spec, {60, 6, 1, true, true, 9, 2, 10}, n.actor, parallel_for);
    EXPECT_FALSE(games.fused());
    games.play({{0, n.members, n.opponents, {0, 1, 2, 0, 1, 2}}}, 0);
    return positions(games);
  };
  const at::Tensor a = play(half), b = play(full);
  EXPECT_FALSE(at::equal(a, b)) << "nothing was rounded";
  EXPECT_GT(share_near(a, b), 0.97);
}

struct FusedCase {
  const char* name;
  const char* scenario;
  const char* actor;
};
void PrintTo(const FusedCase& c, std::ostream* out) { *out << c.name; }
const FusedCase kFusedCases[] = {
    {"TwoAgainstTwo", "", "hidden: [64, 64]"},
    {"FiveAgainstThreeRelu",
     "team_0: [{type: default, count: 5}]\nteam_1: [{type: default, count: 3}]\nmaps: four_rooms\n",
     "hidden: [128], activation: relu"},
    {"OddSizesSilu", "", "hidden: [33, 7, 12], activation: silu"},
    {"ContinuousGelu", "action: continuous\n", "hidden: [32, 128], activation: gelu"},
    {"TwentyAgainstOne",
     "limit_x: 20\nlimit_y: 20\nteam_0: [{type: default, count: 20}]\nteam_1: [{type: default, count: 1}]\n",
     "hidden: [40, 24]"},
    {"EgocentricViewAlone",
     "team_0: [{type: default, count: 3}]\nteam_1: [{type: default, count: 2}]\nmaps: two_rooms1\nobservation: "
     "{egocentric_view: true}\n",
     "hidden: [64, 64], inputs: egocentric"},
};
class LearnPopulationGamesGpu : public testing::TestWithParam<FusedCase> {};

// The fused kernel against the same arithmetic through LibTorch on the CPU, from which it differs by its tanh and by
// the order of sums, and against fp32 through LibTorch on the GPU. An action flips now and then: few steps, and nearly
// all agents.
TEST_P(LearnPopulationGamesGpu, TheFusedKernelPlaysAsTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const LoadedRun run = run_of(GetParam().scenario, GetParam().actor);
  const Networks on_cpu(run, 70, {}, Precision::fp16), on_gpu(run, 70, gpu, Precision::fp16), fp32(run, 70, gpu);
  const ParallelFor cpu_loop(Device{}, 2), gpu_loop(gpu);
  for (const bool greedy : {true, false}) {
    const PopulationGamesOptions options{70, 9, 2, true, greedy, 9, 2, 6};
    PopulationGames a(run.spec, options, on_cpu.actor, cpu_loop), b(run.spec, options, on_gpu.actor, gpu_loop);
    PopulationGames c(run.spec, options, fp32.actor, gpu_loop);
    EXPECT_FALSE(a.fused());
    EXPECT_TRUE(b.fused());
    EXPECT_FALSE(c.fused());
    const int32_t script = network_of_script(Scripted::random);
    const auto play = [&](PopulationGames& games, const Networks& n) {
      games.play({{0, n.members, n.opponents, {0, script, 2, 1, 1, 0, script, 2, 2}},
                  {1, n.members, n.opponents, {2, 1, 0, 0, 0, 0, 0, 0, script}}},
                 2 * games.draw_steps());
      return positions(games);
    };
    const at::Tensor expected = play(a, on_cpu), fused = play(b, on_gpu), libtorch = play(c, fp32);
    std::cout << GetParam().name << ", greedy " << greedy << ": fused " << share_near(fused, expected) << ", fp32 "
              << share_near(fused, libtorch) << std::endl;
    EXPECT_GT(share_near(fused, expected), 0.98);
    EXPECT_GT(share_near(fused, libtorch), 0.97);
    EXPECT_EQ(b.results(1).select(2, 0).sum().item<double>(), 630);
  }
}
INSTANTIATE_TEST_SUITE_P(All, LearnPopulationGamesGpu, testing::ValuesIn(kFusedCases),
                         [](const auto& c) { return std::string(c.param.name); });

// Whole episodes, in which worlds end one after the other and are left out from then on.
TEST(LearnPopulationGamesGpu, WholeEpisodesAgreeInTheirShares) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const LoadedRun run = run_of("", "hidden: [64, 64]");
  const ParallelFor parallel_for(gpu);
  double length[2], wins[2];
  for (const bool fused : {true, false}) {
    const Networks n(run, 512, gpu, fused ? Precision::fp16 : Precision::fp32);
    PopulationGames games(run.spec, {512, 8, 1, true, true, 9, 2}, n.actor, parallel_for);
    EXPECT_EQ(games.fused(), fused);
    games.play({{0, n.members, n.opponents, {0, 1, 2, 0, 1, 2, 0, 1}}}, 0);
    const at::Tensor results = games.results(0);
    EXPECT_EQ(stat(results, EpisodeStat::episodes), 4096);
    length[fused] = stat(results, EpisodeStat::length) / 4096;
    wins[fused] = stat(results, EpisodeStat::wins_0) / 4096;
  }
  EXPECT_NEAR(length[0], length[1], 0.03 * length[0]);
  EXPECT_NEAR(wins[0], wins[1], 0.03);
}

}  // namespace
}  // namespace giga::test
