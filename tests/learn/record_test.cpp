// Recording: a replay holds the simulator's states and what the networks say of them, and plays again to the same bits.
#include "eval/record.hpp"

#include <gtest/gtest.h>
#include <torch/types.h>

#include <algorithm>
#include <cstring>

#include "cuda/runtime.hpp"
#include "game/game.hpp"
#include "learn/team_policy.hpp"
#include "recorded.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"
#include "sim/row_layout.hpp"

namespace giga::test {
namespace {

/// Keeps what a recorder should have seen of world 1.
struct Witness final : GameObserver {
  explicit Witness(const LoadedRun& loaded) : run(loaded) {}
  void before_step(int64_t, GameStep& step) override {
    for (auto& rows : step.rows) rows.wanted |= ObservationSet::all();
  }
  void after_step(int64_t t, const GameStep& step) override {
    const SimParams& p = run.spec.params;
    const WorldView w = world_view(step.sim->state().view(), p.n_agents, 1);
    if (over) return;
    x.push_back({w.x, w.x + p.n_agents});
    heading.push_back({w.heading, w.heading + p.n_agents});
    detected.push_back({w.detected, w.detected + p.n_agents});
    seen.push_back({w.seen, w.seen + p.n_agents});
    alive.push_back({w.alive, w.alive + p.n_agents});
    const int stride = observation_rows(run.spec).stride();
    const float* rows = step.rows[0].obs + int64_t{p.n_team[0]} * stride;
    obs.push_back({rows, rows + int64_t{p.n_team[0]} * stride});
    if (t >= 0) {
      const auto* action = static_cast<const int32_t*>(step.team[0].action) + p.n_team[0];
      actions.push_back({action, action + p.n_team[0]});
    }
    over = *w.phase == Phase::waits;
  }
  const LoadedRun& run;
  bool over = false;
  std::vector<std::vector<float>> x, heading, obs;
  std::vector<std::vector<uint32_t>> detected, seen;
  std::vector<std::vector<uint8_t>> alive;
  std::vector<std::vector<int32_t>> actions;
};

TEST(LearnRecord, KeepsWhatTheSimulatorSays) {
  const Recorded recorded;
  Witness witness(recorded.run);
  recorded.play_again(witness);
  const ReplayEpisode& e = recorded.replay.episodes.at(1);
  const int n = recorded.replay.n_agents(), states = e.steps + 1;
  ASSERT_EQ(static_cast<int>(witness.x.size()), states);
  const ReplayPairs pairs(recorded.replay);
  const auto bit = [&](const std::vector<uint8_t>& bits, int64_t pair, int k) {
    return bits[static_cast<size_t>(pair * ((states + 7) / 8) + k / 8)] >> (k & 7) & 1;
  };
  for (int k = 0; k < states; ++k) {
    const auto s = static_cast<size_t>(k);
    for (int i = 0; i < n; ++i) {
      const auto a = static_cast<size_t>(i), at = static_cast<size_t>(i * states + k);
      EXPECT_NEAR(e.x[at] * recorded.replay.place_unit(), witness.x[s][a], 0.51f * recorded.replay.place_unit());
      const float turn = static_cast<float>(e.heading[at]) * 2 * kPi / kReplayTurn - witness.heading[s][a];
      EXPECT_NEAR(turn - 2 * kPi * std::round(turn / (2 * kPi)), 0, 0.51f * 2 * kPi / 1024);
      EXPECT_EQ(e.died[a] < 0 || k < e.died[a], witness.alive[s][a] != 0) << "agent " << i << ", state " << k;
      for (int b = 0; b < n; ++b) {
        const bool other_team = recorded.run.spec.params.team_of(i) != recorded.run.spec.params.team_of(b);
        if (other_team) {
          EXPECT_EQ(bit(e.sees, pairs.opponents(i, b), k), witness.detected[s][a] >> b & 1);
        } else if (i != b && witness.alive[s][a]) {
          EXPECT_EQ(bit(e.hears, pairs.mates(i, b), k), witness.seen[s][a] >> b & 1);
        }
      }
    }
  }
}

/// Of a game with at least so many states.
void expect_actions_and_minds_of_their_states(const SmallRun& small, int least) {
  const Recorded recorded(small);
  Witness witness(recorded.run);
  recorded.play_again(witness);
  const ReplayEpisode& e = recorded.replay.episodes.at(1);
  const ReplayMind& mind = e.mind[0];
  const int n = recorded.run.spec.params.n_team[0], states = e.steps + 1;
  ASSERT_GE(states, least);
  ASSERT_EQ(mind.top, kLikelyActions);
  EXPECT_EQ(e.mind[1].top, 0) << "nobody asked team 1";
  float likeliest = 0;
  NetworkState thoughts, memory;  // of the policy, of the critic
  for (int k = 0; k < e.steps; ++k) {
    at::NoGradGuard no_grad;
    const auto s = static_cast<size_t>(k);
    const int stride = observation_rows(recorded.run.spec).stride();
    const at::Tensor obs = wrap(witness.obs[s].data(), {n, stride}, {});
    const at::Tensor head = recorded.learner->actor(0)->forward(obs, thoughts);
    const at::Tensor chance = head.narrow(1, 0, kNDiscreteActions).softmax(1);
    const at::Tensor alive = wrap(witness.alive[s].data(), {1, recorded.run.spec.params.n_agents}, {}).narrow(1, 0, n);
    const at::Tensor value = recorded.values->forward(obs.unsqueeze(0), alive, {}, memory);
    for (int i = 0; i < n; ++i) {
      const auto at = static_cast<size_t>(i * states + k);
      if (!witness.alive[s][static_cast<size_t>(i)]) {
        EXPECT_EQ(e.action[static_cast<size_t>(i * e.steps + k)], 13) << "the dead do nothing";
        EXPECT_EQ(mind.probability[at], 0);
        continue;
      }
      EXPECT_EQ(e.action[static_cast<size_t>(i * e.steps + k)], witness.actions[s][static_cast<size_t>(i)]);
      const float most = chance[i][mind.likely[at]].item<float>();
      EXPECT_FLOAT_EQ(most, chance[i].max().item<float>());
      EXPECT_NEAR(static_cast<float>(mind.probability[at]) / kReplayShares, most, 0.51f / kReplayShares);
      EXPECT_NEAR(mind.low + (mind.high - mind.low) * mind.value[at] / kReplayValues, value[0][i].item<float>(),
                  0.51f * (mind.high - mind.low) / kReplayValues + 1e-5f);
      likeliest = std::max(likeliest, most);
    }
  }
  EXPECT_GT(likeliest, 0.2f) << "a policy that knows what it wants, so that the test sees mistakes";
}

TEST(LearnRecord, ActionsAndMindsBelongToTheirState) { expect_actions_and_minds_of_their_states(recorded_run(), 2); }

TEST(LearnRecord, MindsOfALongGame) {
  SmallRun small = recorded_run();
  small.scenario = long_games(150);
  expect_actions_and_minds_of_their_states(small, 100);
}

TEST(LearnRecord, MindsThatRemember) {
  SmallRun small = recorded_run();
  small.actor = "hidden: [16], memory: gru, memory_size: 8, output_gain: 8";
  small.critic = "kind: independent, hidden: [8], memory: gru";
  small.scenario = long_games(90);
  expect_actions_and_minds_of_their_states(small, 80);
}

// Saturated, or of huge rewards: to 2^24 and more a float adds 1 in vain, and a range of values needs a width.
TEST(LearnRecord, ACriticThatSaysTheSameEverywhere) {
  const Recorded recorded;
  NamedArrays critics;
  recorded.learner->save_critics(critics);
  for (NamedArray& array : critics)
    if (array.type == ArrayType::f32) {
      const std::vector<float> huge(array.bytes.size() / sizeof(float), 3e7f);
      std::memcpy(array.bytes.data(), huge.data(), array.bytes.size());
    }
  const Actor& actor = *recorded.learner->actor(0);
  const auto values = ValueFunction::load(recorded.run, 0, critics, actor, Device{});
  const std::array<RecordedTeam, kNTeams> teams = {
      RecordedTeam{policy_controller(actor), {&actor, values.get()}, "a"},
      RecordedTeam{policy_controller(*recorded.learner->actor(1)), {}, "b"}};
  const Replay replay =
      record_match(recorded.run.scenario, recorded.run.spec, teams, three_games(Device{}), "0.1.0").replay;
  for (const ReplayEpisode& e : replay.episodes) {
    EXPECT_GE(e.mind[0].low, 1 << 24);
    EXPECT_LT(e.mind[0].low, e.mind[0].high);
  }
  EXPECT_EQ(decode_replay(encode_replay(replay), "game").episodes.size(), replay.episodes.size());
}

TEST(LearnRecord, PlaysAgainAndNoticesWhatDiffers) {
  const Recorded recorded;
  EXPECT_EQ(verify_replay(recorded.replay, {}), "");
  Replay other = recorded.replay;
  other.episodes[2].state_check ^= 1;
  EXPECT_NE(verify_replay(other, {}).find("episode 2 differs by less than the replay keeps"), std::string::npos);
  other = recorded.replay;
  other.episodes[1].x[1] = static_cast<int16_t>(other.episodes[1].x[1] + 1);
  EXPECT_EQ(verify_replay(other, {}), "episode 1 differs from step 1 on");
  other = recorded.replay;
  other.seed = "6";
  EXPECT_NE(verify_replay(other, {}), "");
}

// On a GPU small networks are asked by kernels of this program: what LibTorch makes of them, but for their rounding.
TEST(LearnRecordGpu, SmallNetworksSayWhatLibTorchMakesOfThem) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  for (const char* kind : {"composed", "independent"}) {
    SmallRun small = recorded_run();
    small.precision = "tf32";
    small.critic = cat("kind: ", kind, ", hidden: [16, 16]");
    small.mappo = "obs_norm: true";
    const LoadedRun run = small.load();
    const auto there = small.learner(gpu), here = small.learner();
    there->update();
    NamedArrays all;
    there->save(all);
    here->load(all);
    const auto values = values_of(run, *there, 1, gpu), expected = values_of(run, *here, 1, {});
    const int n = run.spec.params.n_team[1], stride = observation_rows(run.spec).stride();
    const at::Tensor obs = at::randn({65, n, stride}), alive = (at::rand({65, n}) > 0.3).to(at::kByte);
    NetworkState memory;
    const at::Tensor value = values->forward(obs.to(at::kCUDA), alive.to(at::kCUDA), {}, memory).cpu(),
                     plain = expected->forward(obs, alive, {}, memory);
    const at::Tensor living = alive.to(at::kFloat);
    EXPECT_LT(((value - plain) * living).abs().max().item<float>(), 0.02f * (1 + plain.abs().max().item<float>()));
    const ParallelFor loop(gpu, 0, current_stream(gpu));
    const at::Tensor rows = obs.view({-1, stride});
    const auto head = there->actor(1)->small_head(rows.to(at::kCUDA), loop);
    ASSERT_TRUE(head);
    EXPECT_LT((head->cpu() - here->actor(1)->forward(rows)).abs().max().item<float>(), 1e-3f);
  }
}

// Games of more states than wait on the device at a time, with what the networks say of each.
TEST(LearnRecordGpu, TheCpuPlaysTheSameGamesAgain) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  SmallRun small = recorded_run();
  small.scenario = long_games(90);
  const Recorded recorded(small, {Device::Kind::cuda, 0});
  EXPECT_EQ(verify_replay(recorded.replay, {}), "");
  EXPECT_EQ(verify_replay(recorded.replay, {Device::Kind::cuda, 0}), "");
  for (const ReplayEpisode& e : recorded.replay.episodes) {
    const auto agents = static_cast<size_t>(recorded.run.spec.params.n_team[0]);
    EXPECT_GT(e.steps, 70);
    EXPECT_EQ(e.mind[0].value.size(), agents * (static_cast<size_t>(e.steps) + 1));
    EXPECT_EQ(e.mind[0].likely.size(), 3 * e.mind[0].value.size());  // kLikelyActions
  }
}

/// What a recorder of a crowd should have seen of world 1: by state, whom living opponents see, and who fires at whom.
struct CrowdWitness final : GameObserver {
  void after_step(int64_t, const GameStep& step) override {
    const SimState& state = step.sim->state();
    const StateShape& shape = state.shape();
    const int n = shape.n_agents;
    if (over) return;
    const uint8_t* lives = state.view().alive + n;
    alive.push_back({lives, lives + n});
    auto& seen_now = seen.emplace_back(n);
    auto& fire_now = fire.emplace_back();
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k < shape.rows; ++k) {
        const uint32_t a = state.lists().neighbors[int64_t{n + i} * shape.rows + k];
        if (a < static_cast<uint32_t>(n) && lives[i] && lives[a] && (a < 520) != (i < 520)) seen_now[a] = true;
      }
      for (int k = 0; k < shape.shooters; ++k)
        if (const uint32_t entry = state.lists().fire[int64_t{n + i} * shape.shooters + k])
          fire_now.push_back({i, static_cast<int>(entry & 0xFFFFFF)});
    }
    over = state.view().phase[1] == Phase::waits;
  }
  bool over = false;
  std::vector<std::vector<uint8_t>> alive;
  std::vector<std::vector<bool>> seen;
  std::vector<std::vector<std::pair<int, int>>> fire;  // target, shooter
};

TEST(LearnRecord, ACrowdKeepsWhatTheSimulatorSays) {
  // 520 against 520 on 8 x 60. Teams start 0.2 x 8 = 1.6 apart, less than weapons reach, at 520 / (0.3 x 8 x 0.8 x 60),
  // 4.5 on each unit of ground: they see, shoot and hit each other at once.
  SmallRun small = recorded_run();
  small.scenario =
      "team_0: [{type: default, count: 520}]\nteam_1: [{type: default, count: 520}]\nlimit_x: 8\nlimit_y: 60\n"
      "max_episode_length: 10\ncollision: {collision_range: 0.1}\n";
  const LoadedRun run = small.load();
  const Actor actor = make_actor(run, 0, {});
  const auto controller = [&] { return policy_controller(actor); };
  const MatchOptions options{2, 5, {}, 2};
  const Replay replay =
      record_match(run.scenario, run.spec,
                   {RecordedTeam{controller(), {}, "a"}, RecordedTeam{controller(), {&actor}, "b"}}, options, "0.1.0")
          .replay;
  CrowdWitness witness;
  play_match(run.spec, controller(), controller(), options, {&witness});
  const ReplayEpisode& e = replay.episodes.at(1);
  const int states = e.steps + 1;
  ASSERT_EQ(static_cast<int>(witness.seen.size()), states);
  size_t n_seen = 0, n_fire = 0, n_dead = 0;
  for (int k = 0; k < states; ++k) {
    const auto s = static_cast<size_t>(k);
    for (size_t i = 0; i < 1040; ++i) {
      EXPECT_EQ(e.died[i] < 0 || k < e.died[i], witness.alive[s][i] != 0) << "agent " << i << ", state " << k;
      const bool seen = e.sees[i * static_cast<size_t>((states + 7) / 8) + s / 8] >> (k & 7) & 1;
      EXPECT_EQ(seen, witness.seen[s][i]) << "agent " << i << ", state " << k;
      n_seen += seen;
    }
    std::vector<std::pair<int, int>> fire;
    for (const ReplayFire& f : e.fire)
      if (f.from <= k && k <= f.to) fire.emplace_back(f.target, f.shooter);
    std::sort(fire.begin(), fire.end());
    EXPECT_EQ(fire, witness.fire[s]) << "state " << k;
    n_fire += fire.size();
  }
  for (const ReplayEvent& event : e.events) n_dead += event.what == ReplayEventKind::death;
  EXPECT_GT(n_seen, 1000u);
  EXPECT_GT(n_fire, 100u);
  EXPECT_EQ(n_dead, static_cast<size_t>(std::count_if(e.died.begin(), e.died.end(), [](int d) { return d >= 0; })));
  EXPECT_GT(n_dead, 10u);
  EXPECT_EQ(e.mind[1].likely.size(), static_cast<size_t>(kLikelyActions * kMostMinds * states));
  EXPECT_EQ(e.mind[0].top, 0) << "nobody asked team 0";

  // What is read is what was recorded, and plays again.
  const Replay read = decode_replay(encode_replay(replay), "x");
  EXPECT_EQ(verify_replay(read, {}), "");
  Replay other = read;
  ++other.episodes[1].fire.at(0).to;
  EXPECT_EQ(verify_replay(other, {}), "episode 1 has the same states, but differs in who shoots at whom");
  other = read;
  other.episodes[0].sees[5] ^= 1;
  EXPECT_EQ(verify_replay(other, {}), "episode 0 has the same states, but differs in who is seen");
}

}  // namespace
}  // namespace giga::test
