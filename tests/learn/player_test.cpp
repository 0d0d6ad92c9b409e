// Who can play: scripts, checkpoints and run folders, exported policies, TorchScript modules; what is said to those
// that do not fit; and a round robin.
#include "learn/players/player.hpp"

#include <gtest/gtest.h>
#include <torch/csrc/jit/api/module.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "config/fields.hpp"
#include "eval/match.hpp"
#include "eval/round_robin.hpp"
#include "export/export.hpp"
#include "io/checkpoint.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "policy/actor.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {
namespace fs = std::filesystem;

class LearnPlayer : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  /// A checkpoint of a freshly made learner.
  void save(const SmallRun& small, const std::string& name, int64_t updates = 0) const {
    test::save(small, path(name), updates);
  }

  TemporaryFolder folder_;
};

bool equal(const MatchResult& a, const MatchResult& b) {
  return a.wins[0] == b.wins[0] && a.wins[1] == b.wins[1] && a.ties == b.ties && a.mean_length == b.mean_length &&
         a.mean_return[0] == b.mean_return[0] && a.mean_return[1] == b.mean_return[1];
}

TEST_F(LearnPlayer, OneMayBeTheOpponentOfALearningTeam) {
  SmallRun other, run;
  other.actor = "hidden: [8]";  // another network
  save(other, "frozen.h5");
  run.train = cat("learning_team: 1, opponent: '", path("frozen.h5"), "'");
  const auto learner = run.learner();
  EXPECT_EQ(learner->actor(0), nullptr);
  const NamedArrays before = saved(*learner);
  for (int k = 0; k < 2; ++k) {
    const Metrics metrics = learner->update();
    expect_finite(metrics, 1);
    EXPECT_TRUE(std::isnan(metric(metrics, "policy_loss_0")));
  }
  EXPECT_NE(difference(before, saved(*learner)).find("team_1/actor/"), std::string::npos);
  // A run goes on against the same policy only.
  learner->load(before);
  save(SmallRun{}, "frozen.h5", 7);
  EXPECT_THROW(run.learner()->load(before), InputError);
}

TEST_F(LearnPlayer, ScriptsByName) {
  const SimSpec spec = SmallRun{}.load().spec;
  for (const std::string& name : FieldCodec<Scripted>::names()) {
    Player c = Player::load(name, {});
    EXPECT_EQ(c.name(), name);
    EXPECT_TRUE(c.can_play(0) && c.can_play(1));
    EXPECT_EQ(c.origin(), nullptr);
    ASSERT_TRUE(c.script());
    EXPECT_EQ(name_of(*c.script()), name);
    EXPECT_NE(c.controller(1, spec), nullptr);
  }
}

TEST_F(LearnPlayer, UnknownNamesAndFiles) {
  EXPECT_EQ(input_error_of([] { Player::load("cirle", {}); }),
            "'cirle' is neither a scripted team nor a file or folder; nearest: 'circle'; scripted teams: random, noop, "
            "circle, reverse_circle, circle_random, pursuer, evader, waypoint_runner, hider, patroller");
  EXPECT_EQ(input_error_of([] { Player::load("runs/x", {}); }), "there is no checkpoint or run folder runs/x");
  write_file(path("text.h5"), "no checkpoint");
  EXPECT_TRUE(contains(input_error_of([&] { Player::load(path("text.h5"), {}); }), {"text.h5"}));
  write_file(path("policy.safetensors"), "x");
  EXPECT_TRUE(contains(input_error_of([&] { Player::load(path("policy.safetensors"), {}); }), {"manifest.json"}));
}

TEST_F(LearnPlayer, ACheckpointPlaysAsTheActorsThatItHolds) {
  const SmallRun small;
  save(small, "run/checkpoints/update_00000003.h5", 3);
  Player c = Player::load(path("run"), {});
  ASSERT_NE(c.origin(), nullptr);
  EXPECT_EQ(c.origin()->updates, 3);
  EXPECT_EQ(c.origin()->scenario_name, "small");
  const SimSpec spec = small.load().spec;
  const auto learner = small.learner();
  const MatchOptions options{33, 1, {}, 2};
  const MatchResult expected =
      play_match(spec, policy_controller(*learner->actor(0)), policy_controller(*learner->actor(1)), options);
  EXPECT_TRUE(equal(expected, play_match(spec, c.controller(0, spec), c.controller(1, spec), options)));
  Player greedy = Player::load(path("run"), {{}, false, true});
  EXPECT_FALSE(equal(expected, play_match(spec, greedy.controller(0, spec), greedy.controller(1, spec), options)));
}

TEST_F(LearnPlayer, ARunFolderIsItsBestCheckpoint) {
  save(SmallRun{}, "run/checkpoints/update_00000007.h5", 7);
  save(SmallRun{}, "run/checkpoints/best.h5", 5);
  EXPECT_EQ(Player::load(path("run"), {}).origin()->updates, 5);
  EXPECT_TRUE(Player::load(path("run"), {}).origin()->warnings.empty());
  write_file(path("run/checkpoints/best.h5"), read_file(path("run/checkpoints/best.h5")).substr(0, 2000));
  const Player fallen = Player::load(path("run"), {});
  EXPECT_EQ(fallen.origin()->updates, 7);
  ASSERT_EQ(fallen.origin()->warnings.size(), 1u);
  EXPECT_TRUE(contains(fallen.origin()->warnings[0], {"best.h5", "is truncated", "update_00000007.h5 is taken"}));
}

TEST_F(LearnPlayer, ATeamThatWasScriptedHasNoPolicy) {
  SmallRun small;
  small.train = "opponent: pursuer, learning_team: 1";
  save(small, "one.h5");
  Player c = Player::load(path("one.h5"), {});
  EXPECT_FALSE(c.can_play(0));
  EXPECT_TRUE(c.can_play(1));
  const SimSpec spec = small.load().spec;
  EXPECT_TRUE(contains(input_error_of([&] { c.controller(0, spec); }), {"one.h5", "no policy for team 0"}));
}

TEST_F(LearnPlayer, TheScenarioMustShowWhatThePolicyReads) {
  save(SmallRun{}, "policy.h5");
  Player c = Player::load(path("policy.h5"), {});
  SmallRun other;
  other.scenario = "team_1: [{type: default, count: 3}]\n";
  SimSpec spec = other.load().spec;
  spec.name = "larger";
  // 2 + 2 agents of 9 numbers, and 2 + 3.
  EXPECT_TRUE(contains(input_error_of([&] { c.controller(0, spec); }),
                       {"policy.h5 was trained in 'small'", "36 numbers: self 1 x 9, neighbors 3 x 9; in 'larger'",
                        "45 numbers: self 1 x 9, neighbors 4 x 9"}));
  other.scenario = "action: continuous\n";
  spec = other.load().spec;
  EXPECT_TRUE(
      contains(input_error_of([&] { c.controller(0, spec); }), {"policy.h5", "discrete actions", "continuous"}));
  // As an opponent in training, with the keys.
  SmallRun learner;
  learner.train = cat("opponent: '", path("policy.h5"), "'");
  learner.scenario = "waypoints: {enable_waypoints: true}\n";
  EXPECT_TRUE(contains(input_error_of([&] { learner.learner(); }),
                       {"policy.h5", "; what differs: waypoints.enable_waypoints: false there, true here"}));
}

/// Saves a module whose forward has the given body; `obs` is its argument.
void save_module(const std::string& file, const std::string& body, const at::Tensor& log_std = {}) {
  torch::jit::Module module("policy");
  if (log_std.defined()) module.register_parameter("log_std", log_std, false);
  module.define("def forward(self, obs):\n  " + body + "\n");
  module.save(file);
}

TEST_F(LearnPlayer, ATorchScriptModuleNeedsTrust) {
  save_module(path("noop.pt"), "return obs[:, :27]");
  EXPECT_TRUE(contains(input_error_of([&] { Player::load(path("noop.pt"), {}); }), {"noop.pt", "is code", "--trust"}));
  EXPECT_TRUE(Player::load(path("noop.pt"), {{}, true, false}).can_play(1));
  write_file(path("broken.pt"), std::string("PK\x03\x04", 4) + "nothing more");
  Player broken = Player::load(path("broken.pt"), {{}, true, false});
  const SimSpec spec = SmallRun{}.load().spec;
  EXPECT_TRUE(contains(input_error_of([&] { broken.controller(0, spec); }), {"broken.pt is no TorchScript module"}));
}

TEST_F(LearnPlayer, ATorchScriptModulePlaysAsTheScriptThatItImitates) {
  // Logit 16 (turn left, action 9 + 3 x 2 + 1) is 50, the others 0: circle. In continuous actions the mean 20 of the
  // heading is a turn of tanh(20) = 1.
  save_module(path("circle.pt"),
              "out = torch.zeros([obs.size(0), 27], device=obs.device)\n  out[:, 16] = 50.0\n  return out");
  save_module(path("means.pt"),
              "out = torch.zeros([obs.size(0), 3], device=obs.device)\n  out[:, 0] = 20.0\n  return out");
  for (const bool continuous : {false, true}) {
    SmallRun small;
    if (continuous) small.scenario = "action: continuous\n";
    const SimSpec spec = small.load().spec;
    Player module = Player::load(path(continuous ? "means.pt" : "circle.pt"), {{}, true, false});
    const MatchOptions options{65, 3, {}, 2};
    for (const int side : {0, 1}) {
      const auto play = [&](std::unique_ptr<TeamController> one) {
        auto other = script_controller(Scripted::random);
        if (side == 1) std::swap(one, other);
        return play_match(spec, std::move(one), std::move(other), options);
      };
      EXPECT_TRUE(equal(play(module.controller(side, spec)), play(script_controller(Scripted::circle))))
          << "side " << side;
    }
  }
}

TEST_F(LearnPlayer, ATorchScriptModuleScattersByItsLogStd) {
  SmallRun small;
  small.scenario = "action: continuous\n";
  const SimSpec spec = small.load().spec;
  save_module(path("still.pt"), "return obs[:, :3] * 0.0");
  save_module(path("wild.pt"), "return obs[:, :3] * 0.0", at::ones({3}));
  const auto play = [&](std::unique_ptr<TeamController> one) {
    return play_match(spec, std::move(one), script_controller(Scripted::random), {65, 3, {}, 2});
  };
  Player still = Player::load(path("still.pt"), {{}, true, false});
  Player wild = Player::load(path("wild.pt"), {{}, true, false});
  const MatchResult noop = play(script_controller(Scripted::noop));
  EXPECT_TRUE(equal(noop, play(still.controller(0, spec))));
  EXPECT_FALSE(equal(noop, play(wild.controller(0, spec))));
  save_module(path("odd.pt"), "return obs[:, :3]", at::ones({2}));
  Player odd = Player::load(path("odd.pt"), {{}, true, false});
  EXPECT_TRUE(contains(input_error_of([&] { odd.controller(0, spec); }), {"odd.pt", "log_std has shape [2]"}));
}

TEST_F(LearnPlayer, ATorchScriptModuleOfOtherSizesIsRefused) {
  const SimSpec spec = SmallRun{}.load().spec;  // 36 numbers
  const PlayerOptions trusting{{}, true, false};
  save_module(path("narrow.pt"), "return obs[:, :26]");
  Player narrow = Player::load(path("narrow.pt"), trusting);
  EXPECT_TRUE(
      contains(input_error_of([&] { narrow.controller(0, spec); }), {"narrow.pt", "[2, 26]", "needed: Float [2, 27]"}));
  save_module(path("other.pt"), "return torch.matmul(obs, torch.zeros([40, 27]))");
  Player other = Player::load(path("other.pt"), trusting);
  EXPECT_TRUE(contains(input_error_of([&] { other.controller(0, spec); }),
                       {"other.pt is no TorchScript module that can play here"}));
}

/// The policies of both teams of a learner, each in a folder named by `name` and its team.
void export_both(const SmallRun& small, ExportFormat format, const std::string& name) {
  const LoadedRun run = small.load();
  const auto learner = small.learner();
  PolicyOrigin origin;
  origin.scenario_name = "small";
  origin.scenario_yaml = print_scenario(run.scenario);
  origin.config_yaml = print_yaml(run.config, true);
  origin.updates = 3;
  for (const int team : {0, 1}) {
    origin.team = team;
    write_export(cat(name, team), format, *learner->actor(team), run.spec, origin);
  }
}

TEST_F(LearnPlayer, AnExportedPolicyPlaysAsTheCheckpointThatItIsOf) {
  // What a policy does depends on what it sees: its output layer starts large.
  const std::string sees = "hidden: [16], output_gain: 1";
  const struct {
    const char* name;
    std::string scenario, actor;
  } cases[] = {{"discrete", "", sees},
               {"continuous", "action: continuous\n", sees},
               {"egocentric", "observation: {egocentric_view: true}\n", sees + ", inputs: egocentric"}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.name);
    SmallRun small;
    small.scenario = c.scenario;
    small.actor = c.actor;
    const std::string name = path(c.name);
    save(small, name + ".h5");
    export_both(small, ExportFormat::safetensors, name);
    const SimSpec spec = small.load().spec;
    const MatchOptions options{65, 1, {}, 2};
    Player checkpoint = Player::load(name + ".h5", {});
    const MatchResult expected =
        play_match(spec, checkpoint.controller(0, spec), checkpoint.controller(1, spec), options);
    Player team0 = Player::load(name + "0", {});
    Player team1 = Player::load(name + "1/policy.safetensors", {});
    EXPECT_TRUE(equal(expected, play_match(spec, team0.controller(0, spec), team1.controller(1, spec), options)));
    EXPECT_TRUE(team0.can_play(1)) << "an exported policy is for both sides";
    ASSERT_NE(team0.origin(), nullptr);
    EXPECT_EQ(team0.origin()->updates, 3);
    EXPECT_EQ(team0.origin()->run.spec.name, "small");
    EXPECT_EQ(team0.origin()->run.spec.observation_size(), spec.observation_size());
  }
}

// The same network, seat and draws: a team learns from the same games, bit for bit, whether its opponent is a
// checkpoint or the folder of a policy that was exported from it. Only the checksum of the opponent's file differs.
TEST_F(LearnPlayer, AnExportedPolicyMayBeTheOpponentOfALearningTeam) {
  SmallRun other;
  other.actor = "hidden: [8], output_gain: 1";  // another network; what it does depends on what it sees
  save(other, "frozen.h5");
  export_both(other, ExportFormat::safetensors, path("frozen"));
  const auto learner_against = [&](const std::string& name) {
    SmallRun run;
    run.train = cat("learning_team: 1, opponent: '", path(name), "'");
    return run.learner();
  };
  const auto with_export = learner_against("frozen0"), with_checkpoint = learner_against("frozen.h5");
  EXPECT_EQ(with_export->actor(0), nullptr);
  const NamedArrays before = saved(*with_export);
  for (int k = 0; k < 2; ++k) {
    const Metrics metrics = with_export->update();
    expect_finite(metrics, 1);
    EXPECT_EQ(difference(metrics, with_checkpoint->update()), "");
  }
  const NamedArrays after = saved(*with_export);
  EXPECT_NE(difference(before, after).find("team_1/actor/"), std::string::npos);
  EXPECT_EQ(difference(after, saved(*with_checkpoint)), "opponent/crc32c");
  // A run goes on against the same policy only.
  fs::remove_all(path("frozen0"));
  fs::rename(path("frozen1"), path("frozen0"));
  EXPECT_THROW(learner_against("frozen0")->load(after), InputError);
}

TEST_F(LearnPlayer, AnExportedPolicyMustFitAndBeReadable) {
  export_both(SmallRun{}, ExportFormat::safetensors, path("tensors"));
  SmallRun other;
  other.scenario = "team_1: [{type: default, count: 3}]\n";
  SimSpec larger = other.load().spec;
  larger.name = "larger";
  Player c = Player::load(path("tensors0"), {});
  EXPECT_TRUE(contains(input_error_of([&] { c.controller(0, larger); }),
                       {"tensors0/policy.safetensors was trained in 'small'", "in 'larger' it observes 45 numbers"}));
  const SimSpec spec = SmallRun{}.load().spec;
  c.controller(0, spec);
  const std::string file = path("tensors0/policy.safetensors"), bytes = read_file(file);
  fs::remove(file);
  c.controller(1, spec);  // the file was read once
  write_file(file, bytes);

  export_both(SmallRun{}, ExportFormat::onnx, path("graph"));
  EXPECT_TRUE(contains(input_error_of([&] { Player::load(path("graph0"), {}); }), {"graph0/policy.onnx", "ONNX"}));
  export_both(SmallRun{}, ExportFormat::torchscript, path("module"));
  EXPECT_TRUE(contains(input_error_of([&] { Player::load(path("module0"), {}); }), {"policy.pt", "--trust"}));
  std::string manifest = read_file(path("tensors0/manifest.json"));
  manifest.replace(manifest.find("n_worlds:"), 9, "n_wrlds: ");
  write_file(path("tensors0/manifest.json"), manifest);
  EXPECT_TRUE(contains(input_error_of([&] { Player::load(path("tensors0"), {}); }),
                       {"the manifest of ", "tensors0/policy.safetensors: ", "n_wrlds: unknown key"}));
}

TEST_F(LearnPlayer, RoundRobinPlaysEveryOrderedPair) {
  const SimSpec spec = SmallRun{}.load().spec;
  SmallRun one;
  one.train = "opponent: circle";
  save(one, "one.h5");  // a policy for team 0 only
  const auto table_of = [&](const std::vector<std::string>& names, uint64_t seed) {
    std::vector<Player> players;
    for (const std::string& name : names) players.push_back(Player::load(name, {}));
    return play_table(players, spec, {40, seed, {}, 2});
  };
  const std::vector<std::string> names = {"random", path("one.h5"), "pursuer"};
  std::vector<Player> counted = {Player::load("noop", {}), Player::load(path("one.h5"), {})};
  std::vector<std::string> told;
  play_table(counted, spec, {1, 1, {}, 2}, [&](int done, int all, const Player& side_0, const Player& side_1) {
    told.push_back(cat(done, " of ", all, ": ", fs::path(side_0.name()).stem().string(), ", ", side_1.name()));
  });
  EXPECT_EQ(told, (std::vector<std::string>{"0 of 2: noop, noop", "1 of 2: one, noop"}));
  const GameTable table = table_of(names, 1);
  EXPECT_EQ(table.players, names);
  ASSERT_EQ(table.games.size(), 9u);
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 3; ++j) {
      const Games& g = table.games[3 * i + j];
      EXPECT_EQ(g.wins + g.losses + g.ties, j == 1 ? 0 : 40) << i << " against " << j;
    }
  EXPECT_GT(table.games[3 * 2 + 0].wins, 20) << "pursuer on side 0 against random";
  EXPECT_GT(table.games[3 * 0 + 2].losses, 20) << "random on side 0 against pursuer";

  // Another order, and without the third: the same games.
  const GameTable other = table_of({"pursuer", "random"}, 1);
  const auto same = [](const Games& a, const Games& b) {
    return a.wins == b.wins && a.losses == b.losses && a.ties == b.ties;
  };
  EXPECT_TRUE(same(other.games[1], table.games[6]));
  EXPECT_TRUE(same(other.games[2], table.games[2]));
  EXPECT_TRUE(same(other.games[0], table.games[8]));
  EXPECT_FALSE(same(table_of({"random"}, 2).games[0], table.games[0])) << "another seed";
  EXPECT_EQ(input_error_of([&] { table_of({"random", "random"}, 1); }), "'random' takes part twice");
}

TEST(RoundRobinTime, TheOrderIsOneOfAllAndSpread) {
  for (const size_t n : {0, 1, 2, 3, 4, 9, 10, 144, 169, 400, 1000}) {
    const std::vector<size_t> order = spread_order(n);
    EXPECT_EQ(std::set<size_t>(order.begin(), order.end()).size(), n);
    // Of the first ten no two are neighbours, nor are large stretches left out.
    if (n < 100) continue;
    std::vector<size_t> few(order.begin(), order.begin() + 10);
    std::sort(few.begin(), few.end());
    for (size_t k = 1; k < few.size(); ++k) {
      EXPECT_GT(few[k] - few[k - 1], n / 40) << n;
      EXPECT_LT(few[k] - few[k - 1], n / 5) << n;
    }
  }
}

// Tables as those of scripts and checkpoints: some rows and columns take ten times as long as others.
TEST(RoundRobinTime, TheFirstPairsTellTheTimeOfAll) {
  EXPECT_EQ(expected_seconds(2, 2, 1, 5), 10);
  EXPECT_EQ(expected_seconds(2, 5, 4, 5), 6) << "2 + (5 - 2) / 3 x 4";
  for (const size_t n : {12, 13, 14, 16, 20, 30}) {
    for (const size_t short_ones : {2, 5}) {
      double all = 0;
      const auto seconds = [&](size_t pair) {
        const bool is_short = pair / n < short_ones || pair % n < short_ones;
        return (is_short ? 0.005 : 0.05) + (pair == 0 ? 0.3 : 0);
      };
      for (size_t k = 0; k < n * n; ++k) all += seconds(k);
      const std::vector<size_t> order = spread_order(n * n);
      const int done = pairs_for_estimate(static_cast<int>(n * n));
      double elapsed = 0;
      for (int k = 0; k < done; ++k) elapsed += seconds(order[static_cast<size_t>(k)]);
      const double ratio = expected_seconds(seconds(order[0]), elapsed, done, static_cast<int>(n * n)) / all;
      EXPECT_GT(ratio, 1 / 1.35) << n << ", " << short_ones;
      EXPECT_LT(ratio, 1.35) << n << ", " << short_ones;
    }
  }
}

}  // namespace
}  // namespace giga::test
